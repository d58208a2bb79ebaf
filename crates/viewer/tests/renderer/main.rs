//! The two ray marchers on phantoms whose roles are known exactly.

mod artifacts;
mod bricks;
mod by_value;
mod clipping;
mod compressed_normals;
mod counting;
mod cpu_gpu;
mod integration;
mod occlusion;
mod one_after_another;
mod packed_file;
mod painted;
mod phantom;
mod sampling_rule;
mod scene;
mod shells;
mod skipping;
mod streaming;
mod techniques;
mod usage;
