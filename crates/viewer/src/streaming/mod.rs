//! Volumes that are larger than the memory for them: their bricks are read from the packed file when they are needed.

mod brick_cache;
pub mod memory_bound;
pub mod packed_volume;
pub mod texel_brick;
pub mod texel_source;

pub use packed_volume::PackedVolume;
pub use texel_brick::TexelBrick;
pub use texel_source::TexelSource;
