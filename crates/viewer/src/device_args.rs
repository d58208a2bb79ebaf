//! What the command line says of what is to draw.

use clap::Args;
use voxrole_preprocess::byte_size::byte_size;

use crate::render::{DeviceMemory, Normals};

/// The GPU or the CPU, in the window and by `render`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Args)]
pub struct DeviceArgs {
    /// GPU memory that the volume takes at most, such as 512MiB; of a larger one those parts are uploaded that are seen
    /// [default: what the GPU has].
    #[arg(long, value_name = "SIZE", value_parser = byte_size)]
    pub gpu_memory: Option<u64>,
    /// How normals are kept on the GPU: exact, or compressed to half of their size, 7 bytes a voxel in place of 8 in all, and
    /// off by a few degrees; for volumes that the GPU has room for as a whole [default: exact].
    #[arg(long, value_enum, hide_possible_values = true, value_name = "exact|compressed")]
    pub normals: Option<Normals>,
    /// Draw on the CPU even where there is a GPU.
    #[arg(long, conflicts_with_all = ["gpu_memory", "normals", "gpu"])]
    pub cpu: bool,
    /// Draw with the GPU's shaders even where they run on the CPU, as with Mesa's lavapipe. Without this the CPU's own ray
    /// marcher draws there, which is several times faster.
    #[arg(long)]
    pub gpu: bool,
}

impl DeviceArgs {
    /// What a volume may take of the GPU's memory.
    #[must_use]
    pub fn memory(&self) -> DeviceMemory {
        DeviceMemory { most: self.gpu_memory, normals: self.normals.unwrap_or_default() }
    }

    /// Whether the CPU ray marcher is to draw, given whether shaders would run on the CPU as well.
    #[must_use]
    pub fn wants_cpu(&self, gpu_is_cpu: bool) -> bool {
        self.cpu || (gpu_is_cpu && !self.gpu)
    }
}
