//! What is read of a file that holds more than one scalar volume, or does not say enough.

use super::raw::RawLayout;

/// How to read a volume; the default reads a file that holds one scalar volume and says everything itself.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadOptions {
    /// The layout of a headerless file; any file is then read as headerless numbers, whatever it looks like.
    pub raw: Option<RawLayout>,
    /// Which of several numbers of a voxel, or channels, counted from 0. Without it only volumes of one are read.
    pub component: Option<usize>,
    /// Which point of time, counted from 0. Without it only volumes of one are read.
    pub time: Option<usize>,
}

impl From<RawLayout> for ReadOptions {
    fn from(layout: RawLayout) -> Self {
        Self { raw: Some(layout), ..Self::default() }
    }
}
