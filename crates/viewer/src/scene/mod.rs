//! Opaque geometry inside the volume's space: what [`crate::state::Scene`] asks for, as triangles, and their pixels.
//!
//! [`surfaces`] makes what stays where it is, out of mesh files ([`mesh_file`]) and values ([`isosurface`]); [`lines`]
//! makes what faces the camera. [`rasterizer`] turns both into colour and depth along every pixel's ray, as the GPU's
//! own rasteriser does, and the ray marchers end their rays there. [`scale_bar`] lies over the finished picture.

pub mod isosurface;
pub mod lines;
pub mod mesh_file;
mod obj;
pub mod projection;
pub mod rasterizer;
pub mod scale_bar;
mod stl;
pub mod surfaces;
pub mod triangles;

pub use rasterizer::OpaquePixel;
pub use scale_bar::ScaleBar;
pub use surfaces::Surfaces;
pub use triangles::{Triangles, Vertex};
