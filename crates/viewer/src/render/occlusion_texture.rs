//! How little light comes where, on the GPU.

use glam::Vec4;
use wgpu::{Extent3d, Texture, TextureDimension, TextureFormat, TextureView, TextureViewDescriptor};

use super::gpu::Gpu;
use super::lookup_textures::{texture, write};
use crate::classify::{Drawn, EmphasisTable, MacrocellSamples, Occlusion, Occupancy, OpacityTable, ValueTable};
use crate::frame::Frame;
use crate::state::{Classification, TransferFunction};
use crate::volume::{VolumeDescription, VolumeTexels};

/// A texture that is as large as there is something to say.
pub struct OcclusionTexture {
    texture: Texture,
    /// All that is asked of the volume, which need not be there any more.
    samples: MacrocellSamples,
    /// Whose it is, and what cuts.
    of: Option<(TransferFunction, Vec<Vec4>)>,
}

impl OcclusionTexture {
    /// Makes ready for a volume: light comes everywhere.
    pub fn new(gpu: &Gpu, volume: &VolumeTexels) -> Self {
        Self { texture: volume_texture(gpu, [1; 3]), samples: MacrocellSamples::new(volume), of: None }
    }

    /// Brings the texture up to date; whether it is another one than before. `values` are there where value decides.
    pub fn update(
        &mut self,
        gpu: &Gpu,
        (transfer_function, volume): (&TransferFunction, &VolumeDescription),
        (table, emphases): (&OpacityTable, &EmphasisTable),
        values: Option<&ValueTable>,
        occupancy: Option<&Occupancy>,
        frame: &Frame,
    ) -> bool {
        let planes = frame.cutting_planes();
        let wanted = (frame.shading.occlusion > 0.0).then_some((transfer_function, planes));
        if self.of.as_ref().map(|(of, planes)| (of, &planes[..])) == wanted {
            return false;
        }
        self.of = wanted.map(|(of, planes)| (of.clone(), planes.to_vec()));
        let drawn = Drawn { volume, planes, occupancy };
        let occlusion = wanted.map(|_| match (frame.classification, values) {
            (Classification::Stored, _) => Occlusion::of_stored(&self.samples, drawn),
            (Classification::Value, Some(values)) => Occlusion::of_values(&self.samples, drawn, values),
            _ => Occlusion::of_roles(&self.samples, drawn, table, emphases),
        });
        let dims = occlusion.as_ref().map_or([1; 3], Occlusion::dims).map(|dim| dim as u32);
        let size = self.texture.size();
        let is_other = [size.width, size.height, size.depth_or_array_layers] != dims;
        if is_other {
            self.texture = volume_texture(gpu, dims);
        }
        if let Some(occlusion) = occlusion {
            write(gpu, &self.texture, occlusion.shares());
        }
        is_other
    }

    /// What shaders read.
    pub fn view(&self) -> TextureView {
        self.texture.create_view(&TextureViewDescriptor::default())
    }
}

fn volume_texture(gpu: &Gpu, [width, height, depth_or_array_layers]: [u32; 3]) -> Texture {
    let size = Extent3d { width, height, depth_or_array_layers };
    texture(gpu, "occlusion", size, TextureDimension::D3, TextureFormat::R8Uint)
}
