//! A scalar volume as read: numbers in their own type on a regular grid.

use sha2::{Digest, Sha256};
use voxrole_pack::{GridGeometry, Scalars};

use crate::{Error, Result, scan};

/// What every reader gives.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// The input's file name, without folders.
    pub name: String,
    /// The options that the input was read with, as they are typed; empty where it said everything itself.
    pub read_with: String,
    /// Where the voxels lie.
    pub geometry: GridGeometry,
    /// The stored numbers, x fastest.
    pub scalars: Scalars,
    /// `physical = slope · stored + intercept`.
    pub slope: f64,
    /// See [`Self::slope`].
    pub intercept: f64,
}

impl Grid {
    /// A grid whose stored numbers are physical values.
    ///
    /// # Errors
    /// As [`Self::with_mapping`].
    pub fn new(name: impl Into<String>, geometry: GridGeometry, scalars: Scalars) -> Result<Self> {
        Self::with_mapping(name, geometry, scalars, 1.0, 0.0)
    }

    /// A grid whose physical values are `slope · stored + intercept`.
    ///
    /// # Errors
    /// [`Error::Pack`] for an unusable geometry; [`Error::Parameter`] when the count of numbers differs from the grid's
    /// count of voxels, or the mapping is not finite or has slope 0.
    pub fn with_mapping(
        name: impl Into<String>,
        geometry: GridGeometry,
        scalars: Scalars,
        slope: f64,
        intercept: f64,
    ) -> Result<Self> {
        geometry.validate()?;
        if scalars.len() != geometry.voxel_count() {
            return Err(Error::Parameter(format!(
                "{} numbers do not fill a grid of {:?} voxels",
                scalars.len(),
                geometry.dims
            )));
        }
        check_mapping(slope, intercept)?;
        Ok(Self { name: name.into(), read_with: String::new(), geometry, scalars, slope, intercept })
    }

    /// Physical value of voxel `index`.
    ///
    /// # Panics
    /// When `index` is not below the count of voxels.
    #[must_use]
    pub fn physical(&self, index: usize) -> f64 {
        self.slope.mul_add(self.scalars.get(index), self.intercept)
    }

    /// SHA-256 of the stored numbers alone: own type, little-endian, x fastest.
    #[must_use]
    pub fn voxels_sha256(&self) -> [u8; 32] {
        let mut hasher = Sha256::new();
        scan::hash(&self.scalars, &mut hasher);
        hasher.finalize().into()
    }
}

/// Makes sure that stored numbers can be mapped to physical ones.
///
/// # Errors
/// [`Error::Parameter`] when the mapping is not finite or has slope 0.
pub(crate) fn check_mapping(slope: f64, intercept: f64) -> Result<()> {
    if slope.is_finite() && slope != 0.0 && intercept.is_finite() {
        return Ok(());
    }
    Err(Error::Parameter(format!("the mapping {slope} · stored + {intercept} cannot be used")))
}
