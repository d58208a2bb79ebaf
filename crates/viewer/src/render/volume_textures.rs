//! A volume on the GPU, four 16-bit integers a voxel: one 3D texture, or some of its bricks where it is too large for
//! that. Where normals are compressed they have a texture of their own, and so do gradient magnitudes.

use rayon::prelude::*;
use wgpu::{
    Extent3d, Origin3d, TexelCopyBufferLayout, TexelCopyTextureInfo, Texture, TextureAspect, TextureDimension,
    TextureFormat, TextureView, TextureViewDescriptor,
};

use super::brick_atlas::{BRICK_BYTES, BrickAtlas};
use super::compressed_normals::{BLOCK, BLOCK_BYTES, blocks, gradient_with_side};
use super::device_memory::{DeviceMemory, Normals};
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

/// What of the volume is there.
pub enum VolumeTextures {
    /// All of it.
    Whole(WholeVolume),
    /// Bricks.
    Bricks(BrickAtlas),
}

/// What shaders read of a volume that is there as a whole.
pub struct WholeVolume {
    textures: [Texture; 4],
}

impl WholeVolume {
    /// Texels, a table of bricks that is not looked at, and gradient magnitudes and normals where these are compressed.
    pub fn views(&self) -> [TextureView; 4] {
        self.textures.each_ref().map(view)
    }

    /// What it takes of the device's memory.
    pub fn bytes(&self) -> u64 {
        self.textures.iter().map(texture_bytes).sum()
    }
}

impl VolumeTextures {
    /// Uploads a volume that takes as many bytes at most as it may, or, where it takes more, the device has less or it is not
    /// in memory, makes room for bricks of it.
    ///
    /// # Errors
    /// [`Error::VolumeTooLarge`] when not even a small part of it fits, [`Error::Normals`] where they are to be compressed
    /// and the device has no such textures, or the volume does not fit as a whole.
    pub fn new(gpu: &Gpu, source: &TexelSource, memory: DeviceMemory) -> Result<Self> {
        let budget = memory.most;
        memory.normals.check(gpu)?;
        let dims = source.description().texel_dims();
        let limit = gpu.device.limits().max_texture_dimension_3d;
        let longest = u64::from(limit) * u64::from(MACROCELL);
        if dims.iter().any(|&dim| u64::from(dim) > longest) {
            return Err(too_large(gpu, format!("{dims:?} voxels, where {longest} along each axis can be drawn")));
        }
        let is_short = dims.iter().all(|&dim| dim <= limit);
        if memory.normals == Normals::Compressed {
            let fits = is_short && budget.is_none_or(|budget| compressed_bytes(dims) <= budget);
            return match source {
                TexelSource::Memory(volume) if fits => WholeVolume::compressed(gpu, volume).map(Self::Whole),
                TexelSource::Memory(_) if is_short => {
                    Err(not_whole("there is room for less (--gpu-memory gives more)"))
                }
                TexelSource::Memory(_) => Err(not_whole(&format!("its textures are {limit} voxels long"))),
                TexelSource::File(_) => Err(normals_of_a_file()),
            };
        }
        let bytes = dims.iter().map(|&dim| u64::from(dim)).product::<u64>() * BYTES_PER_TEXEL as u64;
        let mut room = match source {
            TexelSource::Memory(volume) => {
                if is_short && budget.is_none_or(|budget| bytes <= budget) {
                    match WholeVolume::exact(gpu, volume).map(Self::Whole) {
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
        while room / LESS >= BRICK_BYTES {
            if let Ok(bricks) = BrickAtlas::new(gpu, source, room) {
                return Ok(Self::Bricks(bricks));
            }
            room /= LESS;
        }
        BrickAtlas::new(gpu, source, room).map(Self::Bricks)
    }
}

/// Why the normals of a volume cannot be compressed that stays in its file.
#[must_use]
pub fn normals_of_a_file() -> Error {
    not_whole("it takes more of the computer's memory than it may (--memory gives more)")
}

fn not_whole(why: &str) -> Error {
    Error::Normals { reason: format!("they are where all of the volume is on the GPU, and {why}") }
}

impl WholeVolume {
    fn exact(gpu: &Gpu, volume: &VolumeTexels) -> Result<Self> {
        let size = extent(volume.description.texel_dims());
        Self::uploaded(gpu, volume, || {
            let whole = volume_texture(gpu, "volume", size);
            let [gradients, normals] = not_apart(gpu);
            for_each_slab(gpu, volume, |origin, size, texels| {
                write_texels(gpu, &whole, origin, size, texels);
            });
            [whole, volume_texture(gpu, "pages", Extent3d::default()), gradients, normals]
        })
    }

    fn compressed(gpu: &Gpu, volume: &VolumeTexels) -> Result<Self> {
        let dims @ [width, height, _] = volume.description.texel_dims();
        Self::uploaded(gpu, volume, || {
            let part = |label, size, format| texture(gpu, label, extent(size), TextureDimension::D3, format);
            let whole = part("values and distances", dims, TextureFormat::Rg16Uint);
            let gradients = part("gradient magnitudes", dims, TextureFormat::R16Uint);
            let normals = part("normals", whole_blocks(dims), TextureFormat::Bc5RgSnorm);
            for_each_slab(gpu, volume, |origin, size, texels| {
                let pairs: Vec<_> = texels.par_iter().map(|&[value, distance, ..]| [value, distance]).collect();
                write_box(gpu, &whole, origin, size, bytemuck::cast_slice(&pairs));
                let magnitudes: Vec<_> = texels.par_iter().map(|&texel| gradient_with_side(texel)).collect();
                write_box(gpu, &gradients, origin, size, bytemuck::cast_slice(&magnitudes));
                let [padded_width, padded_height, _] = whole_blocks(dims);
                let padded = Extent3d { width: padded_width, height: padded_height, ..size };
                write_box(gpu, &normals, origin, padded, &blocks(texels, [width, height].map(|side| side as usize)));
            });
            [whole, volume_texture(gpu, "pages", Extent3d::default()), gradients, normals]
        })
    }

    fn uploaded(gpu: &Gpu, volume: &VolumeTexels, upload: impl FnOnce() -> [Texture; 4]) -> Result<Self> {
        let textures = gpu.checked("uploading the volume", upload).map_err(|error| {
            let dims = volume.description.texel_dims();
            let bytes = volume.texels.len() * BYTES_PER_TEXEL;
            too_large(gpu, format!("{dims:?} voxels take up to {} MiB; {error}", bytes >> 20))
        })?;
        Ok(Self { textures })
    }
}

/// Bytes of a volume whose normals are compressed.
fn compressed_bytes(dims: [u32; 3]) -> u64 {
    let voxels = |dims: [u32; 3]| dims.iter().map(|&dim| u64::from(dim)).product::<u64>();
    let others = BYTES_PER_TEXEL as u64 - size_of::<u16>() as u64;
    voxels(dims) * others + voxels(whole_blocks(dims)) / (BLOCK * BLOCK) as u64 * BLOCK_BYTES as u64
}

/// The texels of blocks that cover a volume.
fn whole_blocks([width, height, depth]: [u32; 3]) -> [u32; 3] {
    let [width, height] = [width, height].map(|side| side.next_multiple_of(BLOCK as u32));
    [width, height, depth]
}

fn extent([width, height, depth_or_array_layers]: [u32; 3]) -> Extent3d {
    Extent3d { width, height, depth_or_array_layers }
}

pub(super) fn too_large(gpu: &Gpu, reason: String) -> Error {
    Error::VolumeTooLarge { device: gpu.name.clone(), reason }
}

/// A texture of four 16-bit integers.
pub(super) fn volume_texture(gpu: &Gpu, label: &str, size: Extent3d) -> Texture {
    texture(gpu, label, size, TextureDimension::D3, TextureFormat::Rgba16Uint)
}

/// What is bound in place of gradient magnitudes and normals where these are with the texels.
pub(super) fn not_apart(gpu: &Gpu) -> [Texture; 2] {
    [("gradient magnitudes", TextureFormat::R16Uint), ("normals", TextureFormat::Rg8Snorm)]
        .map(|(label, format)| texture(gpu, label, Extent3d::default(), TextureDimension::D3, format))
}

pub(super) fn view(texture: &Texture) -> TextureView {
    texture.create_view(&TextureViewDescriptor::default())
}

/// What a texture takes, as far as that is known without the device's own padding.
pub(super) fn texture_bytes(texture: &Texture) -> u64 {
    texture.format().theoretical_memory_footprint(texture.size())
}

/// Writes a box of texels, x fastest, that begins at a place in a texture of them.
pub(super) fn write_texels(gpu: &Gpu, texture: &Texture, origin: Origin3d, size: Extent3d, texels: &[[u16; 4]]) {
    write_box(gpu, texture, origin, size, bytemuck::cast_slice(texels));
}

/// Writes a box of a texture, row after row of its blocks, which are texels where it is not compressed.
fn write_box(gpu: &Gpu, texture: &Texture, origin: Origin3d, size: Extent3d, bytes: &[u8]) {
    let (_, block) = texture.format().block_dimensions();
    let rows_per_image = size.height.div_ceil(block);
    gpu.queue.write_texture(
        TexelCopyTextureInfo { texture, mip_level: 0, origin, aspect: TextureAspect::All },
        bytes,
        TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(bytes.len() as u32 / (rows_per_image * size.depth_or_array_layers)),
            rows_per_image: Some(rows_per_image),
        },
        size,
    );
}

/// Hands a volume over slab by slab.
fn for_each_slab(gpu: &Gpu, volume: &VolumeTexels, write: impl Fn(Origin3d, Extent3d, &[[u16; 4]])) {
    let [width, height, _] = volume.description.texel_dims();
    let slice = width as usize * height as usize;
    let slices_at_once = (UPLOAD_BYTES / (slice * BYTES_PER_TEXEL)).max(1);
    for (index, slab) in volume.texels.chunks(slice * slices_at_once).enumerate() {
        let origin = Origin3d { x: 0, y: 0, z: (index * slices_at_once) as u32 };
        write(origin, extent([width, height, (slab.len() / slice) as u32]), slab);
        // Hands the slab over now instead of gathering the whole volume first.
        gpu.queue.submit([]);
    }
}
