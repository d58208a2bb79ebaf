//! What the transfer function makes of a volume, on the GPU: the opacity table, and where something can be drawn.

use std::sync::Arc;

use wgpu::{
    Extent3d, TexelCopyBufferLayout, Texture, TextureDescriptor, TextureDimension, TextureFormat, TextureUsages,
    TextureView, TextureViewDescriptor,
};

use super::gpu::Gpu;
use super::occlusion_texture::OcclusionTexture;
use crate::Result;
use crate::classify::emphasis_table::ROW;
use crate::classify::opacity::{GRADIENT_BINS, VALUE_BINS};
use crate::classify::preintegration::{LEVEL, LEVELS};
use crate::classify::value_table::{PARTS, SIDE};
use crate::classify::{LookupTables, MacrocellRanges, MacrocellSamples, Occupancy, PreintegrationTable};
use crate::frame::Frame;
use crate::state::ViewState;
use crate::streaming::{PackedVolume, TexelSource};

const TABLE_SIZE: Extent3d =
    Extent3d { width: VALUE_BINS as u32, height: GRADIENT_BINS as u32, depth_or_array_layers: 1 };

/// Textures that are rebuilt only when what they are made from changes.
pub struct LookupTextures {
    opacity_table: Texture,
    occupancy: Texture,
    emphases: Texture,
    emphasis_table: Texture,
    preintegration: Texture,
    value_table: Texture,
    front_to_back: Texture,
    occlusion: OcclusionTexture,
    tables: LookupTables,
    /// Where the volume's texels are, if they are not in memory: what occlusion takes is gathered when it is asked for.
    file: Option<Arc<PackedVolume>>,
    /// What the emphasis table holds.
    numbers: Vec<f32>,
}

/// What is another than before.
pub struct Changes {
    /// One of the textures, whatever it holds.
    pub textures: bool,
    /// Where something can be drawn.
    pub occupancy: bool,
}

impl LookupTextures {
    /// Makes ready for a volume with these ranges, whose texels need not be in memory any more afterwards.
    pub fn new(gpu: &Gpu, volume: &TexelSource, ranges: MacrocellRanges) -> Self {
        let mut tables = LookupTables::new(volume.description(), ranges);
        let file = match volume {
            TexelSource::Memory(volume) => {
                tables.set_samples(MacrocellSamples::new(volume));
                None
            }
            TexelSource::File(volume) => Some(Arc::clone(volume)),
        };
        let [width, height, depth_or_array_layers] = tables.macrocells().map(|dim| dim as u32);
        let size = Extent3d { width, height, depth_or_array_layers };
        Self {
            // Integers, so that the CPU's table reads the same to the last bit.
            opacity_table: texture(gpu, "opacity table", TABLE_SIZE, TextureDimension::D2, TextureFormat::Rgba16Uint),
            occupancy: texture(gpu, "occupancy", size, TextureDimension::D3, TextureFormat::R8Uint),
            emphases: texture(gpu, "emphases", TABLE_SIZE, TextureDimension::D2, TextureFormat::R16Uint),
            emphasis_table: emphasis_texture(gpu, 2),
            preintegration: preintegration_texture(gpu, 2),
            value_table: value_texture(gpu, "value table", [PARTS + 2, 2]),
            front_to_back: value_texture(gpu, "front to back", [SIDE; 2]),
            occlusion: OcclusionTexture::new(gpu),
            tables,
            file,
            numbers: Vec::new(),
        }
    }

    /// Brings the textures up to date; returns the numbers of the state's picture of `image_size` pixels, too.
    ///
    /// # Errors
    /// As [`MacrocellSamples::of_packed`].
    pub fn update(&mut self, gpu: &Gpu, state: &ViewState, image_size: [u32; 2]) -> Result<(Frame, Changes)> {
        let needs_samples = state.render_settings.shading.occlusion > 0.0 && !self.tables.has_samples();
        if let (true, Some(file)) = (needs_samples, &self.file) {
            self.tables.set_samples(MacrocellSamples::of_packed(file)?);
        }
        let (frame, changes) = self.tables.update(state, image_size);
        let emphases = self.tables.emphases();
        let rows = emphases.rows() as u32;
        let is_other = self.emphasis_table.height() != rows;
        if is_other {
            self.emphasis_table = emphasis_texture(gpu, rows);
            self.preintegration = preintegration_texture(gpu, rows);
        }
        if self.numbers != emphases.numbers() {
            write(gpu, &self.emphasis_table, bytemuck::cast_slice(emphases.numbers()));
            let integrals = PreintegrationTable::new(emphases);
            write(gpu, &self.preintegration, bytemuck::cast_slice(integrals.numbers()));
            self.numbers = emphases.numbers().to_vec();
        }
        if changes.opacity {
            let table = self.tables.opacity();
            write(gpu, &self.opacity_table, bytemuck::cast_slice(table.entries()));
            write(gpu, &self.emphases, bytemuck::cast_slice(table.emphases()));
        }
        if let (true, Some(values)) = (changes.values, self.tables.values()) {
            write(gpu, &self.value_table, bytemuck::cast_slice(&values.rows()));
            if !values.front_to_back().is_empty() {
                write(gpu, &self.front_to_back, bytemuck::cast_slice(values.front_to_back()));
            }
        }
        if changes.occupancy {
            match self.tables.occupancy() {
                Some(occupancy) => write(gpu, &self.occupancy, occupancy.distances()),
                None => write(gpu, &self.occupancy, &vec![0; self.tables.macrocells().iter().product()]),
            }
        }
        let is_lit_otherwise = changes.occlusion && self.occlusion.update(gpu, self.tables.occlusion());
        Ok((frame, Changes { textures: is_other || is_lit_otherwise, occupancy: changes.occupancy }))
    }

    /// Where something can be drawn; `None` where rays do not leap.
    pub fn occupancy(&self) -> Option<&Occupancy> {
        self.tables.occupancy()
    }

    /// How little light comes where, as shaders read it.
    pub fn occlusion(&self) -> TextureView {
        self.occlusion.view()
    }

    /// The opacity table, the distances of macrocells, which αd goes with which entry, αd, its integrals, and what
    /// value alone decides, as shaders read them.
    pub fn views(&self) -> [TextureView; 7] {
        let Self { opacity_table, occupancy, emphases, emphasis_table, preintegration, .. } = self;
        [opacity_table, occupancy, emphases, emphasis_table, preintegration, &self.value_table, &self.front_to_back]
            .map(|texture| texture.create_view(&TextureViewDescriptor::default()))
    }
}

/// A texture that shaders read.
pub(super) fn texture(
    gpu: &Gpu,
    label: &str,
    size: Extent3d,
    dimension: TextureDimension,
    format: TextureFormat,
) -> Texture {
    gpu.device.create_texture(&TextureDescriptor {
        label: Some(label),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension,
        format,
        usage: TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST,
        view_formats: &[],
    })
}

fn value_texture(gpu: &Gpu, label: &str, [width, height]: [usize; 2]) -> Texture {
    let size = Extent3d { width: width as u32, height: height as u32, depth_or_array_layers: 1 };
    texture(gpu, label, size, TextureDimension::D2, TextureFormat::Rgba32Float)
}

fn emphasis_texture(gpu: &Gpu, height: u32) -> Texture {
    let size = Extent3d { width: ROW as u32, height, depth_or_array_layers: 1 };
    texture(gpu, "emphasis table", size, TextureDimension::D2, TextureFormat::R32Float)
}

fn preintegration_texture(gpu: &Gpu, rows: u32) -> Texture {
    let size = Extent3d { width: LEVEL as u32, height: LEVELS as u32, depth_or_array_layers: rows };
    texture(gpu, "preintegration", size, TextureDimension::D3, TextureFormat::R32Float)
}

/// Writes a whole texture.
pub(super) fn write(gpu: &Gpu, texture: &Texture, bytes: &[u8]) {
    let size = texture.size();
    let rows = size.height * size.depth_or_array_layers;
    let layout = TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some((bytes.len() / rows as usize) as u32),
        rows_per_image: Some(size.height),
    };
    gpu.queue.write_texture(texture.as_image_copy(), bytes, layout, size);
}
