//! Checks every byte of a file.

use rayon::prelude::*;

use super::{ADVICE, BrickUnpacker, Reader, histogram_name};
use crate::brick::BrickGrid;
use crate::directory::Table;
use crate::layer::LayerKind;
use crate::packed_brick::boundary_mask;
use crate::scalar::Scalar;
use crate::value_range::ValueRange;
use crate::with_scalar_type;
use crate::{Error, Result};

/// How many damaged bricks and histograms a message names besides the first.
const DAMAGE_NAMED: usize = 16;

/// What [`Reader::verify`] looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Verified {
    /// Bricks whose checksum and content are sound.
    pub bricks: u64,
    /// Bytes of the file, all of them covered by a checksum.
    pub bytes: u64,
}

impl Reader {
    /// Reads everything and checks every byte.
    ///
    /// # Errors
    /// The first damage by brick and layer, and where else there is some.
    pub fn verify(&self) -> Result<Verified> {
        let (mut bricks, mut damage) = (0, Vec::<(String, Error)>::new());
        for level in 0..self.levels() {
            let grid = self.grid(level)?;
            for table in self.directory.order().tables() {
                bricks += grid.len() as u64;
                let check = |brick: usize| match table {
                    Table::Mask => self.verify_mask(level, brick, &grid),
                    Table::Layer(layer) => with_scalar_type!(self.header.layers[layer].scalar_type, T => {
                        self.verify_brick::<T>(layer, level, brick, &grid)
                    }),
                };
                let named = |brick| check(brick).err().map(|error| (self.name(table, level, brick), error));
                damage.par_extend((0..grid.len()).into_par_iter().filter_map(named));
            }
        }
        let histograms = 0..self.header.histograms.len();
        damage.extend(histograms.filter_map(|index| {
            let error = self.read_histogram_at(index).err()?;
            Some((histogram_name(&self.header.histograms[index]), error))
        }));
        let mut damage = damage.into_iter();
        let Some((_, first)) = damage.next() else { return Ok(Verified { bricks, bytes: self.file_bytes }) };
        let others: Vec<_> = damage.by_ref().take(DAMAGE_NAMED).map(|(name, _)| name).collect();
        let more = damage.count();
        let and_more = if more > 0 { format!(" and {more} more") } else { String::new() };
        Err(match first {
            Error::Format(first) if !others.is_empty() => {
                let first = first.strip_suffix(ADVICE).unwrap_or(&first);
                Error::Format(format!("{first}; damaged too: {}{and_more}{ADVICE}", others.join(", ")))
            }
            first => first,
        })
    }

    fn verify_mask(&self, level: usize, brick: usize, grid: &BrickGrid) -> Result<()> {
        self.unpackers.lend(BrickUnpacker::new, |tools| self.read_mask(tools, level, brick, grid))?
    }

    fn verify_brick<T: Scalar>(&self, layer: usize, level: usize, brick: usize, grid: &BrickGrid) -> Result<()> {
        let values = self.read_numbers::<T>(Table::Layer(layer), level, brick, grid)?;
        if self.header.layers[layer].kind == LayerKind::Distance {
            self.verify_distances(&values, level, brick, grid)?;
        }
        let computed = ValueRange::of(&values, &self.header.layers[layer].quantization);
        let stored = self.entry(Table::Layer(layer), level, brick)?.range;
        if computed == stored {
            return Ok(());
        }
        let name = self.name(Table::Layer(layer), level, brick);
        Err(Error::Format(format!("{name}: the range {stored:?} is stored, {computed:?} computed")))
    }

    /// The mask must be where distances are.
    fn verify_distances<T: Scalar>(&self, values: &[T], level: usize, brick: usize, grid: &BrickGrid) -> Result<()> {
        let computed = boundary_mask(values, grid.voxel_count(brick));
        self.unpackers.lend(BrickUnpacker::new, |tools| {
            self.read_mask(tools, level, brick, grid)?;
            if tools.mask == computed {
                return Ok(());
            }
            let name = self.name(Table::Mask, level, brick);
            Err(Error::Format(format!("{name} is not that of the distances")))
        })?
    }
}
