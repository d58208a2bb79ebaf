//! A volume on the GPU, four 16-bit integers a voxel: one 3D texture, or some of its bricks where it is too large for
//! that.

use wgpu::{
    Extent3d, Origin3d, TexelCopyBufferLayout, TexelCopyTextureInfo, Texture, TextureAspect, TextureDimension,
    TextureFormat, TextureView, TextureViewDescriptor,
};

use super::brick_atlas::BrickAtlas;
use super::gpu::Gpu;
use super::lookup_textures::texture;
use crate::classify::macrocells::MACROCELL;
use crate::streaming::TexelSource;
use crate::volume::VolumeTexels;
use crate::{Error, Result};

pub(super) const BYTES_PER_TEXEL: usize = 8;
/// Bytes that are uploaded at once: bounds the memory that the driver takes to pass them on.
pub(super) const UPLOAD_BYTES: usize = 64 << 20;
/// Where a device has no room for a volume, this share of it is tried next, and of that.
const LESS: u64 = 2;
/// How often less is tried.
const TRIES: u32 = 6;

/// What of the volume is there.
pub enum VolumeTextures {
    /// All of it, and a table of bricks that is not looked at.
    Whole([TextureView; 2]),
    /// Bricks.
    Bricks(BrickAtlas),
}

impl VolumeTextures {
    /// Uploads a volume that takes `budget` bytes at most, or, where it takes more, the device has less or it is not in
    /// memory, makes room for bricks of it.
    ///
    /// # Errors
    /// [`Error::VolumeTooLarge`] when not even a small part of it fits.
    pub fn new(gpu: &Gpu, source: &TexelSource, budget: Option<u64>) -> Result<Self> {
        let dims = source.description().texel_dims();
        let limit = gpu.device.limits().max_texture_dimension_3d;
        let longest = u64::from(limit) * u64::from(MACROCELL);
        if dims.iter().any(|&dim| u64::from(dim) > longest) {
            return Err(too_large(gpu, format!("{dims:?} voxels, where {longest} along each axis can be drawn")));
        }
        let bytes = dims.iter().map(|&dim| u64::from(dim)).product::<u64>() * BYTES_PER_TEXEL as u64;
        let is_short = dims.iter().all(|&dim| dim <= limit);
        let mut room = match source {
            TexelSource::Memory(volume) => {
                if is_short && budget.is_none_or(|budget| bytes <= budget) {
                    match Self::whole(gpu, volume) {
                        Err(_) if budget.is_none() => {}
                        whole => return whole,
                    }
                }
                budget.unwrap_or(if is_short { bytes / LESS } else { bytes })
            }
            TexelSource::File(volume) => match budget {
                Some(budget) => budget,
                None if gpu.shares_memory => volume.claim_for_device()?,
                // With the voxels that are in two bricks.
                None => bytes.saturating_mul(LESS),
            },
        };
        for _ in 1..TRIES {
            if let Ok(bricks) = BrickAtlas::new(gpu, source, room) {
                return Ok(Self::Bricks(bricks));
            }
            room /= LESS;
        }
        BrickAtlas::new(gpu, source, room).map(Self::Bricks)
    }

    fn whole(gpu: &Gpu, volume: &VolumeTexels) -> Result<Self> {
        let [width, height, depth_or_array_layers] = volume.description.texel_dims();
        let size = Extent3d { width, height, depth_or_array_layers };
        let textures = gpu.checked("uploading the volume", || {
            let whole = volume_texture(gpu, "volume", size);
            upload(gpu, &whole, volume);
            [whole, volume_texture(gpu, "pages", Extent3d::default())]
        });
        let textures = textures.map_err(|error| {
            let bytes = volume.texels.len() * BYTES_PER_TEXEL;
            too_large(
                gpu,
                format!("{width} x {height} x {depth_or_array_layers} voxels take {} MiB; {error}", bytes >> 20),
            )
        })?;
        Ok(Self::Whole(textures.map(|texture| texture.create_view(&TextureViewDescriptor::default()))))
    }
}

pub(super) fn too_large(gpu: &Gpu, reason: String) -> Error {
    Error::VolumeTooLarge { device: gpu.name.clone(), reason }
}

/// A texture of four 16-bit integers.
pub(super) fn volume_texture(gpu: &Gpu, label: &str, size: Extent3d) -> Texture {
    texture(gpu, label, size, TextureDimension::D3, TextureFormat::Rgba16Uint)
}

/// Writes a box of texels, x fastest, that begins at a place in a texture.
pub(super) fn write_box(gpu: &Gpu, texture: &Texture, origin: Origin3d, size: Extent3d, texels: &[[u16; 4]]) {
    gpu.queue.write_texture(
        TexelCopyTextureInfo { texture, mip_level: 0, origin, aspect: TextureAspect::All },
        bytemuck::cast_slice(texels),
        TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(size.width * BYTES_PER_TEXEL as u32),
            rows_per_image: Some(size.height),
        },
        size,
    );
}

fn upload(gpu: &Gpu, texture: &Texture, volume: &VolumeTexels) {
    let [width, height, _] = volume.description.texel_dims();
    let slice = width as usize * height as usize;
    let slices_at_once = (UPLOAD_BYTES / (slice * BYTES_PER_TEXEL)).max(1);
    for (index, slab) in volume.texels.chunks(slice * slices_at_once).enumerate() {
        let origin = Origin3d { x: 0, y: 0, z: (index * slices_at_once) as u32 };
        let size = Extent3d { width, height, depth_or_array_layers: (slab.len() / slice) as u32 };
        write_box(gpu, texture, origin, size, slab);
        // Hands the slab over now instead of gathering the whole volume first.
        gpu.queue.submit([]);
    }
}
