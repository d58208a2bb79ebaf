//! Where each brick and section lies in the file.

use std::fmt;
use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::brick::BrickGrid;
pub use crate::compression::Encoding;
use crate::header::Header;
use crate::layer::LayerKind;
use crate::levels::dims_of_level;
use crate::value_range::ValueRange;
use crate::{Error, Result};

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

/// Where the numbers of a brick are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Here: one number, little-endian, with zeros behind it, stands for all.
    Constant([u8; 8]),
    /// In the file.
    Stored(Extent),
}

/// One brick of one layer, or a histogram.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry {
    /// Its numbers.
    pub place: Place,
    /// Range of its physical values, or `None` if no voxel has one.
    pub range: Option<ValueRange>,
}

/// Bytes of an entry.
pub const ENTRY_BYTES: usize = 40;
/// Stands for the ends of a range that there is not.
const NO_RANGE: [u8; 16] = [0xff; 16];

impl Entry {
    /// The bytes of the directory.
    #[must_use]
    pub fn to_bytes(&self) -> [u8; ENTRY_BYTES] {
        let mut bytes = [0; ENTRY_BYTES];
        let encoding = match self.place {
            Place::Constant(number) => {
                bytes[..8].copy_from_slice(&number);
                Encoding::Constant
            }
            Place::Stored(Extent { offset, stored_bytes, crc32, encoding }) => {
                bytes[..8].copy_from_slice(&offset.to_le_bytes());
                bytes[8..12].copy_from_slice(&stored_bytes.to_le_bytes());
                bytes[12..16].copy_from_slice(&crc32.to_le_bytes());
                encoding
            }
        };
        bytes[16..32].copy_from_slice(&NO_RANGE);
        if let Some(ValueRange { min, max }) = self.range {
            bytes[16..24].copy_from_slice(&min.to_le_bytes());
            bytes[24..32].copy_from_slice(&max.to_le_bytes());
        }
        bytes[32] = encoding as u8;
        bytes
    }

    /// The entry of some bytes.
    ///
    /// # Errors
    /// [`Error::Format`] for bytes that [`Self::to_bytes`] does not make.
    pub fn from_bytes(bytes: &[u8; ENTRY_BYTES]) -> Result<Self> {
        let u32_at = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        let u64_at = |at: usize| u64::from(u32_at(at)) | u64::from(u32_at(at + 4)) << 32;
        let encoding = Encoding::ALL.get(usize::from(bytes[32])).copied();
        let place = match encoding {
            Some(Encoding::Constant) => Place::Constant(u64_at(0).to_le_bytes()),
            Some(encoding) => {
                Place::Stored(Extent { offset: u64_at(0), stored_bytes: u32_at(8), crc32: u32_at(12), encoding })
            }
            None => {
                return Err(Error::Format(format!("an entry of the directory has the unknown encoding {}", bytes[32])));
            }
        };
        let (min, max) = (f64::from_bits(u64_at(16)), f64::from_bits(u64_at(24)));
        let range = (bytes[16..32] != NO_RANGE).then_some(ValueRange { min, max });
        let entry = Self { place, range };
        let is_sound = range.is_none_or(|ValueRange { min, max }| min <= max);
        if !is_sound || entry.to_bytes() != *bytes {
            return Err(Error::Format(format!("an entry of the directory is nonsensical: {entry:?}")));
        }
        Ok(entry)
    }

    /// The number of bytes that the file has for it beside the directory.
    #[must_use]
    pub fn stored_bytes(&self) -> u64 {
        match self.place {
            Place::Constant(_) => 0,
            Place::Stored(extent) => u64::from(extent.stored_bytes),
        }
    }
}

/// What a brick is part of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Table {
    /// Which voxels have a boundary: a bit each, see [`crate::mask`].
    Mask,
    /// A layer, by its place among the header's layers.
    Layer(usize),
}

/// In which order the directory lists bricks: level by level, the mask first, then layers, each brick by brick; then the
/// histograms. It follows from the header.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Order {
    levels: Vec<BrickGrid>,
    /// The place of each level's first entry, and one behind the last's end.
    starts: Vec<usize>,
    has_mask: bool,
    layers: usize,
    histograms: usize,
}

impl Order {
    /// The order in the file of a header that is valid.
    #[must_use]
    pub fn new(header: &Header) -> Self {
        let dims = header.geometry.dims_usize();
        let levels: Vec<_> =
            (0..header.levels as usize).map(|level| BrickGrid::new(dims_of_level(dims, level))).collect();
        let has_mask = header.layers.iter().any(|layer| layer.kind == LayerKind::Distance);
        let layers = header.layers.len();
        let mut starts = vec![0];
        for grid in &levels {
            starts.push(starts[starts.len() - 1] + grid.len() * (layers + usize::from(has_mask)));
        }
        Self { levels, starts, has_mask, layers, histograms: header.histograms.len() }
    }

    /// How many entries there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.starts[self.levels.len()] + self.histograms
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The bricks of each level.
    #[must_use]
    pub fn levels(&self) -> &[BrickGrid] {
        &self.levels
    }

    /// The tables of a level, in the directory's order.
    pub fn tables(&self) -> impl Iterator<Item = Table> + use<> {
        self.has_mask.then_some(Table::Mask).into_iter().chain((0..self.layers).map(Table::Layer))
    }

    /// The places of a table's entries on a level; `None` where there is no such table or level.
    #[must_use]
    pub fn bricks(&self, table: Table, level: usize) -> Option<Range<usize>> {
        let index = match table {
            Table::Mask if self.has_mask => 0,
            Table::Layer(layer) if layer < self.layers => layer + usize::from(self.has_mask),
            _ => return None,
        };
        let bricks = self.levels.get(level)?.len();
        let start = self.starts[level] + index * bricks;
        Some(start..start + bricks)
    }

    /// The place of a histogram's entry.
    #[must_use]
    pub fn histogram(&self, index: usize) -> usize {
        self.starts[self.levels.len()] + index
    }

    /// What the entry at a place is.
    #[must_use]
    pub fn section(&self, place: usize) -> Section {
        let Some(level) = self.starts.windows(2).position(|ends| (ends[0]..ends[1]).contains(&place)) else {
            return Section::Histogram(place - self.starts[self.levels.len()]);
        };
        let (within, bricks) = (place - self.starts[level], self.levels[level].len());
        let table = match (within / bricks, self.has_mask) {
            (0, true) => Table::Mask,
            (index, has_mask) => Table::Layer(index - usize::from(has_mask)),
        };
        Section::Brick { table, level, brick: within % bricks }
    }
}

/// The entries of a file in their [`Order`], as they are stored.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Directory {
    order: Order,
    bytes: Vec<u8>,
}

impl Directory {
    /// The directory of some bytes.
    ///
    /// # Errors
    /// [`Error::Format`] when there are more or fewer entries than the order has.
    pub fn new(order: Order, bytes: Vec<u8>) -> Result<Self> {
        let expected = order.len() as u128 * ENTRY_BYTES as u128;
        if bytes.len() as u128 != expected {
            return Err(Error::Format(format!(
                "the directory has {} bytes where the header's dimensions, levels and layers make {expected}",
                bytes.len()
            )));
        }
        Ok(Self { order, bytes })
    }

    /// In which order entries are listed.
    #[must_use]
    pub fn order(&self) -> &Order {
        &self.order
    }

    /// The entry at a place below [`Order::len`].
    ///
    /// # Errors
    /// [`Error::Format`], naming it, when it is nonsensical.
    pub fn entry(&self, place: usize) -> Result<Entry> {
        let (entries, _) = self.bytes.as_chunks::<ENTRY_BYTES>();
        Entry::from_bytes(&entries[place]).map_err(|error| match error {
            Error::Format(message) => Error::Format(format!("{}: {message}", self.order.section(place))),
            other => other,
        })
    }

    /// All entries.
    pub fn entries(&self) -> impl Iterator<Item = Result<Entry>> + '_ {
        (0..self.order.len()).map(|place| self.entry(place))
    }
}

/// A part of the file, to complain by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Section {
    /// A brick.
    Brick {
        /// What it is part of.
        table: Table,
        /// Its level.
        level: usize,
        /// Its place in the level's grid.
        brick: usize,
    },
    /// A histogram.
    Histogram(usize),
}

impl fmt::Display for Section {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Brick { table: Table::Mask, level, brick } => {
                write!(formatter, "brick {brick} of level {level} of the mask")
            }
            Self::Brick { table: Table::Layer(layer), level, brick } => {
                write!(formatter, "brick {brick} of level {level} of layer {layer}")
            }
            Self::Histogram(index) => write!(formatter, "histogram {index}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_survive_and_nonsense_is_refused() {
        let stored = Extent { offset: 1 << 40, stored_bytes: 7, crc32: 9, encoding: Encoding::SparseZstd };
        let range = Some(ValueRange { min: -1.0, max: f64::MAX });
        for entry in [
            Entry { place: Place::Stored(stored), range },
            Entry { place: Place::Constant([1, 2, 3, 4, 5, 6, 7, 8]), range: None },
        ] {
            assert_eq!(Entry::from_bytes(&entry.to_bytes()).expect("its own bytes"), entry);
        }
        let good = Entry { place: Place::Constant([0; 8]), range }.to_bytes();
        for (at, byte) in [(9, 1), (15, 1), (23, 0x7f), (32, 5), (33, 1), (39, 1)] {
            let mut bad = good;
            bad[at] = byte;
            assert!(matches!(Entry::from_bytes(&bad), Err(Error::Format(_))), "byte {at}");
        }
    }
}
