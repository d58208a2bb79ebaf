//! Where a volume's texels are.

use std::sync::Arc;

use super::memory_bound::level_bytes;
use super::packed_volume::PackedVolume;
use crate::Result;
use crate::open::Opened;
use crate::volume::{VolumeDescription, VolumeTexels};

/// Texels to draw. Cheap to clone: all clones have the same.
#[derive(Clone)]
pub enum TexelSource {
    /// All of them in memory.
    Memory(Arc<VolumeTexels>),
    /// In a packed file.
    File(Arc<PackedVolume>),
}

impl TexelSource {
    /// Reads a level of a file where its texels take at most `memory` bytes; others stay in the file.
    ///
    /// # Errors
    /// [`crate::Error::Pack`] when there is no such level, a layer is missing or damaged, or memory does not suffice.
    pub fn open(opened: impl Into<Opened>, level: usize, memory: u64) -> Result<Self> {
        let opened = opened.into();
        if level_bytes(&opened.reader, level)? <= memory {
            return Ok(VolumeTexels::read_level(&opened.reader, level)?.into());
        }
        Ok(Self::File(Arc::new(PackedVolume::new(opened, level, memory)?)))
    }

    /// What the texels mean.
    #[must_use]
    pub fn description(&self) -> &VolumeDescription {
        match self {
            Self::Memory(volume) => &volume.description,
            Self::File(volume) => volume.description(),
        }
    }

    /// All texels, for what needs them; `what` says what that is, such as `the CPU ray marcher needs`.
    ///
    /// # Errors
    /// [`crate::Error::TooMuchMemory`] where they are not in memory.
    pub fn in_memory(&self, what: &str) -> Result<&Arc<VolumeTexels>> {
        match self {
            Self::Memory(volume) => Ok(volume),
            Self::File(volume) => Err(volume.too_large(format!("{what} all of it there"))),
        }
    }
}

impl From<VolumeTexels> for TexelSource {
    fn from(volume: VolumeTexels) -> Self {
        Self::Memory(Arc::new(volume))
    }
}

impl From<&Arc<VolumeTexels>> for TexelSource {
    fn from(volume: &Arc<VolumeTexels>) -> Self {
        Self::Memory(Arc::clone(volume))
    }
}

impl From<&Self> for TexelSource {
    fn from(source: &Self) -> Self {
        source.clone()
    }
}
