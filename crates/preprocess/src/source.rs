//! A volume to prepare, wherever its numbers are.

use std::borrow::Cow;

use voxrole_pack::{GridGeometry, ScalarType, Scalars, with_scalars};

use crate::io::{StoredVolume, StoredVoxels};
use crate::region::Region;
use crate::{Grid, Result};

/// A scalar volume: numbers in their own type on a regular grid, in memory or in a file.
#[derive(Clone, Copy, Debug)]
pub struct Source<'a> {
    /// The input's file name, without folders.
    pub name: &'a str,
    /// The options that the input was read with, as they are typed.
    pub read_with: &'a str,
    /// Where the voxels lie.
    pub geometry: &'a GridGeometry,
    /// `physical = slope · stored + intercept`.
    pub slope: f64,
    /// See [`Self::slope`].
    pub intercept: f64,
    voxels: Voxels<'a>,
}

#[derive(Clone, Copy, Debug)]
enum Voxels<'a> {
    Memory(&'a Scalars),
    File(&'a StoredVoxels),
}

impl<'a> From<&'a Grid> for Source<'a> {
    fn from(grid: &'a Grid) -> Self {
        let Grid { name, read_with, geometry, scalars, slope, intercept } = grid;
        Self { name, read_with, geometry, slope: *slope, intercept: *intercept, voxels: Voxels::Memory(scalars) }
    }
}

impl<'a> From<&'a StoredVolume> for Source<'a> {
    fn from(volume: &'a StoredVolume) -> Self {
        let StoredVolume { name, read_with, geometry, slope, intercept, voxels } = volume;
        Self { name, read_with, geometry, slope: *slope, intercept: *intercept, voxels: Voxels::File(voxels) }
    }
}

impl<'a> Source<'a> {
    /// Voxels along x, y, z.
    #[must_use]
    pub fn dims(&self) -> [usize; 3] {
        self.geometry.dims_usize()
    }

    /// The numbers' type.
    #[must_use]
    pub fn scalar_type(&self) -> ScalarType {
        match self.voxels {
            Voxels::Memory(scalars) => scalars.scalar_type(),
            Voxels::File(voxels) => voxels.scalar_type(),
        }
    }

    /// Bytes of memory that the numbers take up as long as the source is there.
    #[must_use]
    pub fn resident_bytes(&self) -> u64 {
        match self.voxels {
            Voxels::Memory(scalars) => scalars.len() as u64 * scalars.scalar_type().size_in_bytes() as u64,
            Voxels::File(_) => 0,
        }
    }

    /// What tells the input's file from others, from itself at other times and from what else is read of it, without reading it:
    /// `None` where there is no file, or where not all of its files are known.
    #[must_use]
    pub fn identity(&self) -> Option<[u8; 32]> {
        match self.voxels {
            Voxels::Memory(_) => None,
            Voxels::File(voxels) => voxels.identity(self.read_with),
        }
    }

    /// The stored numbers of a region, x fastest.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when reading fails, [`crate::Error::Pack`] when memory runs out.
    pub fn read(&self, region: &Region) -> Result<Cow<'a, Scalars>> {
        match self.voxels {
            Voxels::Memory(scalars) => Ok(cropped(scalars, self.dims(), region)),
            Voxels::File(voxels) => voxels.read(region).map(Cow::Owned),
        }
    }
}

/// What numbers of all voxels of a volume of `dims` voxels are in a region.
pub(crate) fn cropped<'a>(scalars: &'a Scalars, dims: [usize; 3], region: &Region) -> Cow<'a, Scalars> {
    if region.dims() == dims {
        return Cow::Borrowed(scalars);
    }
    macro_rules! each_type {
        ($($variant:ident),*) => {
            match scalars {
                $(Scalars::$variant(values) => Scalars::$variant(region.crop(values, dims).into_owned()),)*
            }
        };
    }
    Cow::Owned(each_type!(U8, I8, U16, I16, U32, I32, F32, F64))
}

/// Whether a number is NaN or infinite.
pub(crate) fn has_bad(scalars: &Scalars) -> bool {
    fn any<T: voxrole_pack::scalar::Scalar>(values: &[T]) -> bool {
        values.chunks(1 << 12).any(|part| part.iter().fold(false, |bad, value| bad | !value.to_f64().is_finite()))
    }
    match scalars {
        Scalars::F32(_) | Scalars::F64(_) => with_scalars!(scalars, values => any(values)),
        _ => false,
    }
}
