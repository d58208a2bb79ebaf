//! Where each brick and section lies in the file.

use std::fmt;

use serde::{Deserialize, Serialize};

pub use crate::compression::Encoding;
use crate::value_range::ValueRange;

/// A run of bytes in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Extent {
    /// Distance from the start of the file.
    pub offset: u64,
    /// Length in bytes.
    pub stored_bytes: u32,
    /// CRC-32 (IEEE) of the stored bytes.
    pub crc32: u32,
    /// How they are to be unpacked.
    pub encoding: Encoding,
}

/// One brick of one layer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BrickEntry {
    /// Its bytes.
    pub extent: Extent,
    /// Range of its physical values, or `None` if no voxel has one.
    pub range: Option<ValueRange>,
}

/// Everything after the prologue and before the header, in the header's order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Directory {
    /// Per layer, every brick of the grid, x fastest.
    pub layers: Vec<Vec<BrickEntry>>,
    /// Per histogram, its counts as u64.
    pub histograms: Vec<Extent>,
}

/// A part of the file, to complain by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Section {
    /// A brick of a layer.
    Brick {
        /// The layer's place among the layers.
        layer: usize,
        /// The brick's place in the grid.
        brick: usize,
    },
    /// A histogram.
    Histogram(usize),
    /// The header.
    Header,
    /// The directory.
    Directory,
}

impl fmt::Display for Section {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Brick { layer, brick } => write!(formatter, "brick {brick} of layer {layer}"),
            Self::Histogram(index) => write!(formatter, "histogram {index}"),
            Self::Header => formatter.write_str("the header"),
            Self::Directory => formatter.write_str("the directory"),
        }
    }
}

impl Directory {
    /// Every extent.
    pub fn extents(&self) -> impl Iterator<Item = (Section, Extent)> + '_ {
        let bricks = self.layers.iter().enumerate().flat_map(|(layer, entries)| {
            entries.iter().enumerate().map(move |(brick, entry)| (Section::Brick { layer, brick }, entry.extent))
        });
        let histograms = self.histograms.iter().enumerate().map(|(index, &extent)| (Section::Histogram(index), extent));
        bricks.chain(histograms)
    }
}
