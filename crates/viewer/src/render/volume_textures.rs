//! A volume on the GPU: one 3D texture, four 16-bit integers a voxel.

use wgpu::{
    Extent3d, Origin3d, TexelCopyBufferLayout, TexelCopyTextureInfo, Texture, TextureAspect, TextureDescriptor,
    TextureDimension, TextureFormat, TextureUsages, TextureView, TextureViewDescriptor,
};

use super::gpu::Gpu;
use crate::volume::VolumeTexels;
use crate::{Error, Result};

const BYTES_PER_TEXEL: usize = 8;
/// Bytes that are uploaded at once: bounds the memory that the driver takes to pass them on.
const UPLOAD_BYTES: usize = 64 << 20;

/// The texture and its view.
pub struct VolumeTextures {
    view: TextureView,
}

impl VolumeTextures {
    /// Uploads a volume.
    ///
    /// # Errors
    /// [`Error::VolumeTooLarge`] when an axis is longer than the device's textures or its memory does not suffice.
    pub fn new(gpu: &Gpu, volume: &VolumeTexels) -> Result<Self> {
        let dims = volume.description.texel_dims();
        let limit = gpu.device.limits().max_texture_dimension_3d;
        let too_large = |reason: String| Error::VolumeTooLarge { device: gpu.name.clone(), reason };
        if dims.iter().any(|&dim| dim > limit) {
            return Err(too_large(format!("{dims:?} voxels, where its 3D textures end at {limit} along each axis")));
        }
        let texture = gpu
            .checked("uploading the volume", || {
                let texture = create_texture(gpu, dims);
                upload(gpu, &texture, volume);
                texture
            })
            .map_err(|error| {
                let bytes = volume.texels.len() * BYTES_PER_TEXEL;
                too_large(format!("{dims:?} voxels take {} MiB; {error}", bytes >> 20))
            })?;
        Ok(Self { view: texture.create_view(&TextureViewDescriptor::default()) })
    }

    /// What a shader reads.
    pub fn view(&self) -> &TextureView {
        &self.view
    }
}

fn create_texture(gpu: &Gpu, [width, height, depth_or_array_layers]: [u32; 3]) -> Texture {
    gpu.device.create_texture(&TextureDescriptor {
        label: Some("volume"),
        size: Extent3d { width, height, depth_or_array_layers },
        mip_level_count: 1,
        sample_count: 1,
        dimension: TextureDimension::D3,
        format: TextureFormat::Rgba16Uint,
        usage: TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST,
        view_formats: &[],
    })
}

fn upload(gpu: &Gpu, texture: &Texture, volume: &VolumeTexels) {
    let [width, height, _] = volume.description.texel_dims();
    let slice = width as usize * height as usize;
    let slices_at_once = (UPLOAD_BYTES / (slice * BYTES_PER_TEXEL)).max(1);
    for (index, slab) in volume.texels.chunks(slice * slices_at_once).enumerate() {
        gpu.queue.write_texture(
            TexelCopyTextureInfo {
                texture,
                mip_level: 0,
                origin: Origin3d { x: 0, y: 0, z: (index * slices_at_once) as u32 },
                aspect: TextureAspect::All,
            },
            bytemuck::cast_slice(slab),
            TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(width * BYTES_PER_TEXEL as u32),
                rows_per_image: Some(height),
            },
            Extent3d { width, height, depth_or_array_layers: (slab.len() / slice) as u32 },
        );
        // Hands the slab over now instead of gathering the whole volume first.
        gpu.queue.submit([]);
    }
}
