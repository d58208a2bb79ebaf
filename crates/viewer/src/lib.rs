//! Shows packed voxel roles: one renderer for window and picture file, on the GPU or the CPU.
//!
//! [`state`] says what is wanted, [`classify`] turns it into tables and formulas, [`frame`] turns camera and settings
//! into the numbers of one picture, and two ray marchers draw it by the same rule: [`render`] on the GPU, and
//! [`mod@reference`] on the CPU, which is the oracle of the first and stands in where there is no GPU.

#[cfg(feature = "window")]
pub mod app;
pub mod args;
pub mod bench;
pub mod classify;
pub mod demo;
pub mod device_args;
pub mod drawing;
pub mod error;
pub mod frame;
pub mod headless;
pub mod open;
pub mod picture;
pub mod reference;
pub mod region_args;
pub mod render;
pub mod scene;
pub mod scene_args;
pub mod slicing;
pub mod state;
pub mod streaming;
#[cfg(feature = "window")]
pub mod ui;
pub mod usage;
pub mod volume;
mod watch;

pub use error::{Error, Result};
pub use picture::{LightPicture, Picture, PixelLight};
pub use render::{Gpu, Renderer, Target};
pub use state::ViewState;
pub use streaming::{PackedVolume, TexelSource};
pub use volume::{VolumeDescription, VolumeTexels};
pub use watch::Watch;
