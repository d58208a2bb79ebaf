//! Computes voxel roles: where each voxel of a scalar volume stands relative to the nearest authentic boundary along its
//! own gradient.

pub mod accuracy;
mod assembly;
pub mod automatic;
pub mod bilateral;
pub mod block_plan;
pub mod blur;
pub mod boundary;
pub mod bspline;
pub mod central_difference;
pub mod continuation;
pub mod differentiation;
pub mod directional_derivative;
pub mod error;
pub mod fields;
pub mod gaussian;
pub mod grid;
pub mod holes;
pub mod io;
pub mod joint_histogram;
#[cfg(test)]
mod naive_mean;
pub mod noise;
pub mod noise_gain;
pub mod packing;
pub mod padded_field;
pub mod phantom;
pub mod plot;
pub mod prepare;
pub mod progress;
pub mod raw_args;
pub mod reach;
pub mod recipe;
pub mod reconstruction;
pub mod region;
pub mod report;
pub mod roles;
pub mod root_finder;
pub mod row_windows;
pub mod sampler;
pub mod scan;
pub mod separable_derivative;
pub mod settings;
pub mod simd;
pub mod smoothing;
pub mod smoothing_study;
pub mod source;
pub mod stencil;
pub mod summary;
pub mod working_field;
pub mod zero_crossing;

pub use error::{Error, Result};
pub use grid::Grid;
pub use prepare::prepare;
