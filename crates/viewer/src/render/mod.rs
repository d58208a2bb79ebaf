//! Rays and slices on the GPU: device and state in, picture out. The window and the picture file share it.

mod bindings;
mod brick_atlas;
mod brick_march;
mod compressed_normals;
pub mod device_memory;
mod geometry;
pub mod gpu;
mod lookup_textures;
mod occlusion_texture;
mod proxy_geometry;
mod ray_march;
mod renderer;
mod shader;
mod slice_bricks;
mod slicing;
pub mod target;
mod uniforms;
mod volume_textures;

pub use device_memory::{DeviceMemory, Normals};
pub use gpu::Gpu;
pub use renderer::Renderer;
pub use target::Target;
pub use volume_textures::normals_of_a_file;
