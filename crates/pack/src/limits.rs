//! How much memory a file may ask for.

/// Bounds that are checked before anything is allocated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Most voxels of a volume.
    pub max_voxels: u64,
    /// Most bytes of a layer once unpacked.
    pub max_layer_bytes: u64,
    /// Most bins of one histogram.
    pub max_histogram_bins: u64,
}

impl Default for Limits {
    /// 2³⁴ voxels (a cube of 2580), 64 GiB a layer, 2²⁴ bins.
    fn default() -> Self {
        Self { max_voxels: 1 << 34, max_layer_bytes: 1 << 36, max_histogram_bins: 1 << 24 }
    }
}
