//! What the command line says of what is to draw.

use clap::Args;
use voxrole_preprocess::byte_size::byte_size;

/// The GPU or the CPU, in the window and by `render`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Args)]
pub struct DeviceArgs {
    /// GPU memory that the volume takes at most, such as 512MiB; of a larger one those parts are uploaded that are seen
    /// [default: what the GPU has].
    #[arg(long, value_name = "SIZE", value_parser = byte_size)]
    pub gpu_memory: Option<u64>,
    /// Draw on the CPU even where there is a GPU.
    #[arg(long, conflicts_with_all = ["gpu_memory", "gpu"])]
    pub cpu: bool,
    /// Draw with the GPU's shaders even where they run on the CPU, as with Mesa's lavapipe. Without this the CPU's own ray
    /// marcher draws there, which is several times faster.
    #[arg(long)]
    pub gpu: bool,
}

impl DeviceArgs {
    /// Whether the CPU ray marcher is to draw, given whether shaders would run on the CPU as well.
    #[must_use]
    pub fn wants_cpu(&self, gpu_is_cpu: bool) -> bool {
        self.cpu || (gpu_is_cpu && !self.gpu)
    }
}
