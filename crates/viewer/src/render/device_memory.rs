//! What a volume may take of a device's memory, and in which form.

use clap::ValueEnum;

use crate::{Error, Result};

use super::gpu::Gpu;

/// How normals are kept on the device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Normals {
    /// As stored: two bytes a voxel.
    #[default]
    Exact,
    /// In blocks of BC5: one byte a voxel, and normals that are off by a few degrees.
    Compressed,
}

/// What a volume may take of a device's memory, and in which form.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DeviceMemory {
    /// Most bytes, where there is a bound: of a larger volume those bricks are there that are seen.
    pub most: Option<u64>,
    /// How normals are kept.
    pub normals: Normals,
}

impl From<Option<u64>> for DeviceMemory {
    fn from(most: Option<u64>) -> Self {
        Self { most, ..Self::default() }
    }
}

impl Normals {
    /// Makes sure that a device can hold them.
    ///
    /// # Errors
    /// [`Error::Normals`] where it has no compressed 3D textures.
    pub fn check(self, gpu: &Gpu) -> Result<()> {
        if self == Self::Exact || gpu.has_compressed_volumes() {
            return Ok(());
        }
        let reason = format!("{} has no 3D textures of BC5 (texture-compression-bc-sliced-3d)", gpu.name);
        Err(Error::Normals { reason })
    }
}
