//! Computes voxel roles: where each voxel of a scalar volume stands relative to the nearest authentic boundary along its
//! own gradient.

pub mod error;
pub mod grid;
pub mod io;

pub use error::{Error, Result};
pub use grid::Grid;
