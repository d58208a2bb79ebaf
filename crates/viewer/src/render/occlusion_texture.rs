//! How little light comes where, on the GPU.

use wgpu::{Extent3d, Texture, TextureDimension, TextureFormat, TextureView, TextureViewDescriptor};

use super::gpu::Gpu;
use super::lookup_textures::{texture, write};
use crate::classify::Occlusion;

/// A texture that is as large as there is something to say.
pub struct OcclusionTexture {
    texture: Texture,
}

impl OcclusionTexture {
    /// Light comes everywhere.
    pub fn new(gpu: &Gpu) -> Self {
        Self { texture: volume_texture(gpu, [1; 3]) }
    }

    /// Takes over what has changed; whether the texture is another one than before.
    pub fn update(&mut self, gpu: &Gpu, occlusion: Option<&Occlusion>) -> bool {
        let dims = occlusion.map_or([1; 3], Occlusion::dims).map(|dim| dim as u32);
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
