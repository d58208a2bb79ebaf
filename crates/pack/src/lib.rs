//! The packed file of voxel roles (`.vxr`).
//!
//! A packed file holds, for one scalar volume, the layers that an interactive viewer needs: the value itself, the
//! signed distance to the nearest authentic boundary along the voxel's own gradient, the gradient magnitude at the hit
//! location and the normal, cut into bricks that are compressed and checksummed one by one; and the joint histograms
//! that were taken over all voxels at full precision. `SPEC.md` beside this crate describes every byte.
//!
//! Volumes are dense slices with x fastest, then y, then z.

pub mod atomic_file;
pub mod brick;
mod codec;
mod compression;
pub mod directory;
pub mod error;
pub mod geometry;
pub mod header;
pub mod histogram;
pub mod layer;
pub mod levels;
pub mod limits;
pub mod mask;
pub mod packed_brick;
pub mod positioned;
pub mod prologue;
mod pyramid;
pub mod quantization;
pub mod reader;
pub mod reused;
pub mod scalar;
pub mod unfinished;
pub mod value_range;
pub mod writer;

pub use error::{Error, Result};
pub use geometry::{GridGeometry, WorldFrame};
pub use header::Header;
pub use histogram::{Histogram, HistogramAxis, HistogramKind};
pub use layer::{Layer, LayerKind};
pub use limits::Limits;
pub use quantization::{DistanceQuantization, HitGradientQuantization, Precision};
pub use reader::Reader;
pub use scalar::{ScalarType, Scalars};
pub use writer::Writer;
