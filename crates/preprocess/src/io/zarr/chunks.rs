//! The numbers of a Zarr array, decoded by rows of chunks along z.

use std::path::PathBuf;

use voxrole_pack::ScalarType;
use zarrs::array::{Array, ArrayBytes, ArrayError, ArrayShardedExt, ArraySubset, CodecOptions};

use super::super::slabs::Slabs;
use super::chunk_files::ChunkFiles;
use crate::{Error, Result};

/// Bytes of slices that are decoded at once at most; chunks that are thicker are decoded more than once.
const MAX_SLAB_BYTES: u64 = 256 << 20;

/// A volume in an array of three or more axes, of which z, y and x follow each other in this order.
#[derive(Debug)]
pub struct Chunks {
    /// The array's metadata.
    pub files: [PathBuf; 1],
    pub array: Array<ChunkFiles>,
    pub scalar_type: ScalarType,
    /// The index on each axis that is none of the three.
    pub fixed: Vec<u64>,
    /// The axis of z.
    pub z: usize,
}

impl Slabs for Chunks {
    fn scalar_type(&self) -> ScalarType {
        self.scalar_type
    }

    fn files(&self) -> &[PathBuf] {
        &self.files
    }

    fn are_all_files(&self) -> bool {
        false
    }

    fn decode(&self, sink: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let shape = self.array.shape();
        let slices = shape[self.z];
        let number_bytes = self.scalar_type.size_in_bytes();
        let slice_bytes: u64 = shape[self.z + 1..].iter().product::<u64>() * number_bytes as u64;
        let depth = self.chunk_depth().min(MAX_SLAB_BYTES / slice_bytes).max(1);
        let mut start = 0;
        while start < slices {
            // Ends at chunks: what begins inside one does not end in the next.
            let end =
                (start + depth).min((start / self.chunk_depth() + 1).saturating_mul(self.chunk_depth())).min(slices);
            let ranges: Vec<_> = (0..shape.len())
                .map(|axis| match axis {
                    axis if axis == self.z => start..end,
                    axis if axis > self.z => 0..shape[axis],
                    axis => self.fixed[axis]..self.fixed[axis] + 1,
                })
                .collect();
            self.check_memory((end - start) * slice_bytes)?;
            let subset = ArraySubset::new_with_ranges(&ranges);
            let bytes = self.array.retrieve_array_subset_opt::<ArrayBytes<'static>>(&subset, &CodecOptions::default());
            let bytes =
                bytes.and_then(|bytes| bytes.into_fixed().map_err(|error| ArrayError::Other(error.to_string())));
            let mut bytes = bytes.map_err(|error| self.broken(&error, start..end))?.into_owned();
            if cfg!(target_endian = "big") {
                bytes.chunks_exact_mut(number_bytes).for_each(<[u8]>::reverse);
            }
            sink(&bytes)?;
            start = end;
        }
        Ok(())
    }
}

impl Chunks {
    /// Slices of a chunk or, in a shard, of what can be decoded of it at least.
    fn chunk_depth(&self) -> u64 {
        let shape = self.array.effective_subchunk_shape();
        let shape = shape.or_else(|| self.array.chunk_shape(&vec![0; self.array.dimensionality()]).ok());
        shape.map_or(1, |shape| shape[self.z].get())
    }

    /// Makes sure that there is memory for slices, and as much for their chunks: `zarrs` would end the program.
    fn check_memory(&self, bytes: u64) -> Result<()> {
        let fits = usize::try_from(bytes.saturating_mul(2))
            .is_ok_and(|bytes| Vec::<u8>::new().try_reserve_exact(bytes).is_ok());
        let what = || format!("slices of {}", self.files[0].display());
        if fits { Ok(()) } else { Err(Error::OutOfMemory { what: what(), bytes: u128::from(bytes) * 2 }) }
    }

    fn broken(&self, error: &ArrayError, slices: std::ops::Range<u64>) -> Error {
        let message =
            format!("expected whole chunks for slices {} to {}, found: {error}", slices.start, slices.end - 1);
        Error::format(&self.files[0], message)
    }
}
