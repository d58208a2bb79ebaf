//! What the transfer function makes of a volume, on the GPU: the opacity table, and where something can be drawn.

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
use crate::classify::{EmphasisTable, MacrocellRanges, Occupancy, OpacityTable, PreintegrationTable, ValueTable};
use crate::frame::Frame;
use crate::state::{Classification, Curve, TransferFunction, TwoSidedEmphasis, ViewState};
use crate::streaming::TexelSource;
use crate::volume::VolumeDescription;

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
    /// What the two hold, and of what: the curve, and the step of the second where it is asked for.
    values: Option<(Curve, Option<f32>, ValueTable)>,
    ranges: MacrocellRanges,
    table: Option<(TransferFunction, OpacityTable)>,
    /// What the emphasis table holds.
    numbers: Vec<f32>,
    /// What the occupancy is that of, beside the table: how far boundaries and steps reach, whether rays leap at
    /// all, and what decides.
    drawn: Option<([f32; 2], bool, Classification)>,
    /// Where something can be drawn; `None` where rays do not leap.
    leaping: Option<Occupancy>,
}

/// What is another than before.
pub struct Changes {
    /// One of the textures, whatever it holds.
    pub textures: bool,
    /// Where something can be drawn.
    pub occupancy: bool,
}

impl LookupTextures {
    /// Makes ready for a volume with these ranges.
    pub fn new(gpu: &Gpu, volume: &TexelSource, ranges: MacrocellRanges) -> Self {
        let [width, height, depth_or_array_layers] = ranges.dims().map(|dim| dim as u32);
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
            occlusion: OcclusionTexture::new(gpu, volume),
            values: None,
            ranges,
            table: None,
            numbers: Vec::new(),
            drawn: None,
            leaping: None,
        }
    }

    /// Brings the textures up to date.
    ///
    /// # Errors
    /// As [`OcclusionTexture::update`].
    pub fn update(
        &mut self,
        gpu: &Gpu,
        state: &ViewState,
        volume: &VolumeDescription,
        emphases: &EmphasisTable,
        frame: &Frame,
    ) -> Result<Changes> {
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
        // The αd that regions share is none of its business.
        let wanted = TransferFunction { emphasis: TwoSidedEmphasis::default(), ..state.transfer_function.clone() };
        let kept = self.table.take().filter(|(of, _)| *of == wanted);
        let is_new = kept.is_none();
        let (_, table) = self.table.insert(kept.unwrap_or_else(|| {
            let table = OpacityTable::new(&wanted, volume.value_range, volume.hit_gradient);
            (wanted, table)
        }));
        if is_new {
            write(gpu, &self.opacity_table, bytemuck::cast_slice(table.entries()));
            write(gpu, &self.emphases, bytemuck::cast_slice(table.emphases()));
        }
        let values = match frame.classification {
            Classification::Value => Some(update_values(
                gpu,
                &mut self.values,
                state,
                volume,
                frame,
                [&self.value_table, &self.front_to_back],
            )),
            Classification::Roles | Classification::Stored => None,
        };
        let drawn = Some(([frame.reach, frame.half_step], state.render_settings.leaps, frame.classification));
        let is_drawn_elsewhere = is_new || self.drawn != drawn;
        if is_drawn_elsewhere {
            self.leaping = state.render_settings.leaps.then(|| match (frame.classification, values) {
                (Classification::Stored, _) => Occupancy::of_values(&self.ranges, |[_, high]| high > 0, frame),
                (Classification::Value, Some(values)) => {
                    Occupancy::of_values(&self.ranges, |range| values.any(range), frame)
                }
                _ => Occupancy::new(&self.ranges, table, frame),
            });
            match &self.leaping {
                Some(occupancy) => write(gpu, &self.occupancy, occupancy.distances()),
                None => write(gpu, &self.occupancy, &vec![0; self.ranges.dims().iter().product()]),
            }
            self.drawn = drawn;
        }
        let transfer_function = (&state.transfer_function, volume);
        let is_lit_otherwise = self.occlusion.update(gpu, transfer_function, (table, emphases), values, frame)?;
        Ok(Changes { textures: is_other || is_lit_otherwise, occupancy: is_drawn_elsewhere })
    }

    /// Where something can be drawn; `None` where rays do not leap.
    pub fn occupancy(&self) -> Option<&Occupancy> {
        self.leaping.as_ref()
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

/// Brings what value alone decides up to date.
fn update_values<'a>(
    gpu: &Gpu,
    values: &'a mut Option<(Curve, Option<f32>, ValueTable)>,
    state: &ViewState,
    volume: &VolumeDescription,
    frame: &Frame,
    [value_table, front_to_back]: [&Texture; 2],
) -> &'a ValueTable {
    let wanted = (&state.transfer_function.curve, frame.is_ordered.then_some(frame.step));
    let kept = values.take().filter(|(curve, step, _)| (curve, *step) == wanted);
    let (_, _, table) = values.insert(kept.unwrap_or_else(|| {
        let table = ValueTable::of(state, volume, frame);
        write(gpu, value_table, bytemuck::cast_slice(&table.rows()));
        if !table.front_to_back().is_empty() {
            write(gpu, front_to_back, bytemuck::cast_slice(table.front_to_back()));
        }
        (wanted.0.clone(), wanted.1, table)
    }));
    table
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
