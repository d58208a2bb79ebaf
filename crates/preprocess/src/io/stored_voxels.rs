//! The numbers of a volume that stay in a file.

use std::fs::File;
use std::path::PathBuf;

use rayon::prelude::*;
use sha2::{Digest, Sha256};
use voxrole_pack::error::vec_with_capacity;
use voxrole_pack::positioned::read_exact_at;
use voxrole_pack::scalar::Scalar;
use voxrole_pack::{ScalarType, Scalars};

use super::payload::append_numbers;
use super::raw::StoredType;
use crate::region::Region;
use crate::{Error, Result};

/// Numbers in a file, uncompressed, read region by region from any thread.
#[derive(Debug)]
pub struct StoredVoxels {
    pub(super) file: File,
    /// The files that the user knows, at least one; others than `file` where that one was unpacked.
    pub(super) paths: Vec<PathBuf>,
    /// Whether numbers cannot change unless these files do.
    pub(super) are_all_paths: bool,
    pub(super) offset: u64,
    pub(super) dims: [usize; 3],
    pub(super) stored: StoredType,
}

impl StoredVoxels {
    /// The numbers' type.
    #[must_use]
    pub fn scalar_type(&self) -> ScalarType {
        self.stored.scalar_type
    }

    /// A hash of path, length, time of change and place of the numbers in the files that the user knows, and of the options that
    /// say which of them are read; `None` where there are other files, or the operating system does not tell.
    #[must_use]
    pub fn identity(&self, read_with: &str) -> Option<[u8; 32]> {
        if !self.are_all_paths {
            return None;
        }
        let mut hasher = Sha256::new();
        for path in &self.paths {
            let path = path.canonicalize().ok()?;
            let metadata = path.metadata().ok()?;
            let changed = metadata.modified().ok()?;
            hasher.update(format!("{path:?} {} {changed:?} ", metadata.len()));
        }
        hasher.update(format!("{} {:?} {:?} {read_with}", self.offset, self.dims, self.stored));
        Some(hasher.finalize().into())
    }

    /// Reads a region, x fastest.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Pack`] when memory runs out.
    pub fn read(&self, region: &Region) -> Result<Scalars> {
        Ok(match self.stored.scalar_type {
            ScalarType::U8 => Scalars::U8(self.numbers(region)?),
            ScalarType::I8 => Scalars::I8(self.numbers(region)?),
            ScalarType::U16 => Scalars::U16(self.numbers(region)?),
            ScalarType::I16 => Scalars::I16(self.numbers(region)?),
            ScalarType::U32 => Scalars::U32(self.numbers(region)?),
            ScalarType::I32 => Scalars::I32(self.numbers(region)?),
            ScalarType::F32 => Scalars::F32(self.numbers(region)?),
            ScalarType::F64 => Scalars::F64(self.numbers(region)?),
        })
    }

    fn numbers<T: Scalar>(&self, region: &Region) -> Result<Vec<T>> {
        let [width, height, _] = region.dims();
        let mut numbers = vec_with_capacity(region.voxel_count(), "the values of a block")?;
        numbers.resize(region.voxel_count(), T::default());
        let slices = numbers.par_chunks_mut(width * height).enumerate();
        slices.try_for_each_init(
            || (Vec::new(), Vec::new()),
            |(bytes, row), (k, slice)| self.read_slice(region, region.start[2] + k, slice, bytes, row),
        )?;
        Ok(numbers)
    }

    /// Reads the region's part of slice `k` with one call, and what lies between its rows with it.
    fn read_slice<T: Scalar>(
        &self,
        region: &Region,
        k: usize,
        slice: &mut [T],
        bytes: &mut Vec<u8>,
        numbers: &mut Vec<T>,
    ) -> Result<()> {
        let Region { start, end } = region;
        let voxel = |i: usize, j: usize| (k * self.dims[1] + j) * self.dims[0] + i;
        let first = voxel(start[0], start[1]);
        bytes.resize((voxel(end[0] - 1, end[1] - 1) + 1 - first) * T::SIZE, 0);
        let offset = self.offset + (first * T::SIZE) as u64;
        read_exact_at(&self.file, bytes, offset).map_err(Error::io(&self.paths[0]))?;
        let width = end[0] - start[0];
        for (row, out) in bytes.chunks_mut(self.dims[0] * T::SIZE).zip(slice.chunks_exact_mut(width)) {
            numbers.clear();
            append_numbers(&mut row[..width * T::SIZE], self.stored.byte_order, numbers);
            out.copy_from_slice(numbers);
        }
        Ok(())
    }
}
