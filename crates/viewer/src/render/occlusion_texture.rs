//! How little light comes where, on the GPU.

use std::sync::Arc;

use glam::Vec4;
use wgpu::{Extent3d, Texture, TextureDimension, TextureFormat, TextureView, TextureViewDescriptor};

use super::gpu::Gpu;
use super::lookup_textures::{texture, write};
use crate::classify::{EmphasisTable, MacrocellSamples, Occlusion, OpacityTable, ValueTable};
use crate::frame::Frame;
use crate::state::{Classification, TransferFunction};
use crate::streaming::{PackedVolume, TexelSource};
use crate::volume::VolumeDescription;
use crate::{Error, Result};

/// A texture that is as large as there is something to say.
pub struct OcclusionTexture {
    texture: Texture,
    samples: Samples,
    /// Whose it is, and what cuts.
    of: Option<(TransferFunction, Vec<Vec4>)>,
}

/// All that is asked of the volume, which need not be in memory any more.
enum Samples {
    Gathered(MacrocellSamples),
    /// Gathered whenever they are needed, and not kept: memory is short then.
    InFile(Arc<PackedVolume>),
}

impl OcclusionTexture {
    /// Makes ready for a volume: light comes everywhere.
    pub fn new(gpu: &Gpu, volume: &TexelSource) -> Self {
        let samples = match volume {
            TexelSource::Memory(volume) => Samples::Gathered(MacrocellSamples::new(volume)),
            TexelSource::File(volume) => Samples::InFile(Arc::clone(volume)),
        };
        Self { texture: volume_texture(gpu, [1; 3]), samples, of: None }
    }

    /// Brings the texture up to date; whether it is another one than before. `values` are there where value decides.
    ///
    /// # Errors
    /// As [`MacrocellSamples::of_packed`].
    pub fn update(
        &mut self,
        gpu: &Gpu,
        (transfer_function, volume): (&TransferFunction, &VolumeDescription),
        (table, emphases): (&OpacityTable, &EmphasisTable),
        values: Option<&ValueTable>,
        frame: &Frame,
    ) -> Result<bool> {
        let planes = frame.cutting_planes();
        let wanted = (frame.shading.occlusion > 0.0).then_some((transfer_function, planes));
        if self.of.as_ref().map(|(of, planes)| (of, &planes[..])) == wanted {
            return Ok(false);
        }
        let made_of = wanted.map(|(of, planes)| (of.clone(), planes.to_vec()));
        let volume = (volume, planes);
        let occlusion = wanted.map(|_| {
            let gathered;
            let samples = match &self.samples {
                Samples::Gathered(samples) => samples,
                Samples::InFile(volume) => {
                    gathered = MacrocellSamples::of_packed(volume)?;
                    &gathered
                }
            };
            Ok::<_, Error>(match (frame.classification, values) {
                (Classification::Stored, _) => Occlusion::of_stored(samples, volume),
                (Classification::Value, Some(values)) => Occlusion::of_values(samples, volume, values),
                _ => Occlusion::of_roles(samples, volume, table, emphases),
            })
        });
        let occlusion = occlusion.transpose()?;
        self.of = made_of;
        let dims = occlusion.as_ref().map_or([1; 3], Occlusion::dims).map(|dim| dim as u32);
        let size = self.texture.size();
        let is_other = [size.width, size.height, size.depth_or_array_layers] != dims;
        if is_other {
            self.texture = volume_texture(gpu, dims);
        }
        if let Some(occlusion) = occlusion {
            write(gpu, &self.texture, occlusion.shares());
        }
        Ok(is_other)
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
