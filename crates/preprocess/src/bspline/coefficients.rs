//! A field's B-spline coefficients.

use super::Degree;
use super::prefilter::prefilter;
use crate::Result;
use crate::padded_field::PaddedField;
use crate::working_field::{Field, dims_of};

/// The coefficients of the spline through a field's samples.
#[derive(Clone, Debug)]
pub struct Coefficients {
    /// One coefficient a voxel, and those that the outermost cells need beyond the faces.
    pub field: PaddedField,
    /// The spline's degree.
    pub degree: Degree,
}

impl Coefficients {
    /// The spline through every sample of `field`, none of which may be NaN. Beyond the faces the field goes on as in
    /// [`PaddedField`].
    ///
    /// # Errors
    /// [`crate::Error::Pack`] when memory runs out.
    pub fn new(field: &Field, degree: Degree) -> Result<Self> {
        Self::new_in(Vec::new(), field, degree)
    }

    /// The same in memory that was used before.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn new_in(memory: Vec<f32>, field: &Field, degree: Degree) -> Result<Self> {
        let mut coefficients = PaddedField::unset(memory, dims_of(field))?;
        prefilter(field, &mut coefficients, degree);
        coefficients.continue_beyond_faces();
        Ok(Self { field: coefficients, degree })
    }
}
