//! The opacity table on the GPU.

use wgpu::{
    Extent3d, TexelCopyBufferLayout, Texture, TextureDescriptor, TextureDimension, TextureFormat, TextureUsages,
    TextureView, TextureViewDescriptor,
};

use super::gpu::Gpu;
use crate::classify::OpacityTable;
use crate::classify::opacity::{GRADIENT_BINS, VALUE_BINS};
use crate::state::Region;
use crate::volume::VolumeDescription;

const SIZE: Extent3d = Extent3d { width: VALUE_BINS as u32, height: GRADIENT_BINS as u32, depth_or_array_layers: 1 };

/// A table that is rebuilt only when the regions change.
pub struct LookupTextures {
    texture: Texture,
    view: TextureView,
    regions: Option<Vec<Region>>,
}

impl LookupTextures {
    /// An empty table.
    pub fn new(gpu: &Gpu) -> Self {
        let texture = gpu.device.create_texture(&TextureDescriptor {
            label: Some("opacity table"),
            size: SIZE,
            mip_level_count: 1,
            sample_count: 1,
            dimension: TextureDimension::D2,
            // Integers, so that the CPU's table reads the same to the last bit.
            format: TextureFormat::Rgba16Uint,
            usage: TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let view = texture.create_view(&TextureViewDescriptor::default());
        Self { texture, view, regions: None }
    }

    /// Brings the table up to date.
    pub fn update(&mut self, gpu: &Gpu, regions: &[Region], volume: &VolumeDescription) {
        if self.regions.as_deref() == Some(regions) {
            return;
        }
        let table = OpacityTable::new(regions, volume.value_range, volume.hit_gradient);
        gpu.queue.write_texture(
            self.texture.as_image_copy(),
            bytemuck::cast_slice(table.entries()),
            TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(SIZE.width * 8), rows_per_image: Some(SIZE.height) },
            SIZE,
        );
        self.regions = Some(regions.to_vec());
    }

    /// What a shader reads.
    pub fn view(&self) -> &TextureView {
        &self.view
    }
}
