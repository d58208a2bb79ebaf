//! The GPU ray marcher: device and state in, picture out. The window and the picture file share it.

mod geometry;
pub mod gpu;
mod lookup_textures;
mod ray_march;
mod renderer;
mod shader;
pub mod target;
mod uniforms;
mod volume_textures;

pub use gpu::Gpu;
pub use renderer::Renderer;
pub use target::Target;
