//! The value field as the kernels see it: f32, scaled by a power of two, lengths in multiples of L_min.
//!
//! Scaling makes every threshold relative to the data and keeps f32 away from overflow and denormals for any value
//! range; because the factor is a power of two, it changes no digit.

use ndarray::Array3;
use rayon::prelude::*;
use voxrole_pack::error::with_capacity;
use voxrole_pack::scalar::Scalar;
use voxrole_pack::{ScalarType, Scalars, with_scalars};

use crate::source::Source;
use crate::{Error, Grid, Result};

/// A volume of f32, indexed (z, y, x), so that x is fastest.
pub type Field = Array3<f32>;

/// The value field and what leads back to physical units.
#[derive(Clone, Debug)]
pub struct WorkingField {
    /// Scaled values, magnitudes of at most 1; NaN where the input is NaN or infinite.
    pub values: Field,
    /// Distance between voxels along x, y, z in multiples of L_min; each at least 1.
    pub spacing: [f32; 3],
    /// `physical = value_scale · working + value_offset`; positive.
    pub value_scale: f64,
    /// See [`Self::value_scale`].
    pub value_offset: f64,
    /// L_min in world units.
    pub smallest_spacing: f64,
}

/// How stored numbers become a working field, the same for every part of a volume.
#[derive(Clone, Copy, Debug)]
pub struct Scaling {
    shift: f64,
    factor: f64,
    spacing: [f32; 3],
    value_scale: f64,
    value_offset: f64,
    smallest_spacing: f64,
}

impl Scaling {
    /// The scaling of a volume whose finite stored numbers lie in `low..=high`. Types that f32 does not hold exactly (u32,
    /// i32, f64) are first shifted by the middle of their range where they lie far from 0, so that a large offset costs no
    /// precision.
    #[must_use]
    pub fn new(source: &Source<'_>, [low, high]: [f64; 2]) -> Self {
        let shift = shift(source.scalar_type(), low, high);
        let largest = (low - shift).abs().max((high - shift).abs());
        let scale = power_of_two_at_least(largest);
        // A negative slope turns the field upside down; the sign belongs to the value, not to the scale.
        let sign = source.slope.signum();
        let smallest_spacing = source.geometry.smallest_spacing();
        Self {
            shift,
            factor: sign / scale,
            spacing: source.geometry.spacing.map(|spacing| (spacing / smallest_spacing) as f32),
            value_scale: source.slope.abs() * scale,
            value_offset: source.slope.mul_add(shift, source.intercept),
            smallest_spacing,
        }
    }

    /// The working field of stored numbers, of a part of `dims` voxels, x fastest.
    ///
    /// # Errors
    /// [`Error::Pack`] when memory runs out.
    ///
    /// # Panics
    /// When there are more or fewer numbers than voxels.
    pub fn field(&self, scalars: &Scalars, dims: [usize; 3]) -> Result<WorkingField> {
        self.field_in(Vec::new(), scalars, dims)
    }

    /// The same in memory that was used before.
    ///
    /// # Errors
    /// As [`Self::field`].
    ///
    /// # Panics
    /// As [`Self::field`].
    pub fn field_in(&self, memory: Vec<f32>, scalars: &Scalars, [nx, ny, nz]: [usize; 3]) -> Result<WorkingField> {
        let Self { shift, factor, spacing, value_scale, value_offset, smallest_spacing } = *self;
        let mut values = with_capacity(memory, scalars.len(), "the value field")?;
        with_scalars!(scalars, stored => {
            stored.par_iter().map(|value| scaled(value.to_f64(), shift, factor)).collect_into_vec(&mut values);
        });
        let values = Array3::from_shape_vec((nz, ny, nx), values).expect("a number for every voxel");
        Ok(WorkingField { values, spacing, value_scale, value_offset, smallest_spacing })
    }

    /// A stored number as the field has it.
    #[must_use]
    pub fn working(&self, stored: f64) -> f32 {
        scaled(stored, self.shift, self.factor)
    }

    /// Physical value per working one; positive.
    #[must_use]
    pub fn value_scale(&self) -> f64 {
        self.value_scale
    }

    /// Physical value of a working 0.
    #[must_use]
    pub fn value_offset(&self) -> f64 {
        self.value_offset
    }

    /// L_min in world units.
    #[must_use]
    pub fn smallest_spacing(&self) -> f64 {
        self.smallest_spacing
    }

    /// Physical gradient magnitude per working one.
    #[must_use]
    pub fn gradient_scale(&self) -> f64 {
        self.value_scale / self.smallest_spacing
    }

    /// Physical second derivative per working one.
    #[must_use]
    pub fn second_derivative_scale(&self) -> f64 {
        self.value_scale / (self.smallest_spacing * self.smallest_spacing)
    }

    /// Distance between voxels along x, y, z in multiples of L_min.
    #[must_use]
    pub fn spacing(&self) -> [f32; 3] {
        self.spacing
    }
}

impl WorkingField {
    /// The working field of a whole grid.
    ///
    /// # Errors
    /// [`Error::Parameter`] when no voxel is finite, [`Error::Pack`] when memory runs out.
    pub fn new(grid: &Grid) -> Result<Self> {
        let range = grid.scalars.finite_range().ok_or_else(|| {
            Error::Parameter(format!("{}: every voxel is NaN or infinite; there is nothing to prepare", grid.name))
        })?;
        Scaling::new(&Source::from(grid), range).field(&grid.scalars, grid.geometry.dims_usize())
    }

    /// Voxels along x, y, z.
    #[must_use]
    pub fn dims(&self) -> [usize; 3] {
        dims_of(&self.values)
    }

    /// Physical gradient magnitude per working one.
    #[must_use]
    pub fn gradient_scale(&self) -> f64 {
        self.value_scale / self.smallest_spacing
    }

    /// Physical second derivative per working one.
    #[must_use]
    pub fn second_derivative_scale(&self) -> f64 {
        self.value_scale / (self.smallest_spacing * self.smallest_spacing)
    }
}

/// Voxels along x, y, z of a field.
#[must_use]
pub fn dims_of(field: &Field) -> [usize; 3] {
    let (nz, ny, nx) = field.dim();
    [nx, ny, nz]
}

/// The voxels of a field, x fastest.
///
/// # Panics
/// When the field is not in standard layout; every field of this crate is made in it.
#[must_use]
pub fn voxels(field: &Field) -> &[f32] {
    field.as_slice().expect("fields are made in standard layout")
}

/// As [`voxels`], to write.
///
/// # Panics
/// As [`voxels`].
pub fn voxels_mut(field: &mut Field) -> &mut [f32] {
    field.as_slice_mut().expect("fields are made in standard layout")
}

/// What is taken off stored numbers before they become f32. Values near 0 are left alone: they may be tails that are
/// known to many digits.
fn shift(scalar_type: ScalarType, low: f64, high: f64) -> f64 {
    let is_far = low.abs().max(high.abs()) > 2.0 * (high - low);
    let middle = low / 2.0 + high / 2.0;
    match scalar_type {
        ScalarType::U32 | ScalarType::I32 if is_far => middle.trunc(),
        ScalarType::F64 if is_far => middle,
        _ => 0.0,
    }
}

fn scaled(value: f64, shift: f64, factor: f64) -> f32 {
    if value.is_finite() { ((value - shift) * factor) as f32 } else { f32::NAN }
}

/// The smallest power of two that is at least `value`; 1 for 0.
fn power_of_two_at_least(value: f64) -> f64 {
    if value == 0.0 {
        return 1.0;
    }
    let exponent = value.log2().ceil().clamp(-1022.0, 1023.0);
    exponent.exp2()
}

#[cfg(test)]
mod tests {
    use voxrole_pack::GridGeometry;

    use super::*;

    fn working(scalars: Scalars, slope: f64) -> WorkingField {
        let geometry = GridGeometry::axis_aligned([scalars.len() as u32, 1, 1], [2.0, 3.0, 4.0]);
        let grid = Grid::with_mapping("test", geometry, scalars, slope, 5.0).expect("a grid");
        WorkingField::new(&grid).expect("a field")
    }

    fn physical(field: &WorkingField) -> Vec<f64> {
        voxels(&field.values)
            .iter()
            .map(|&value| f64::from(value).mul_add(field.value_scale, field.value_offset))
            .collect()
    }

    #[test]
    fn integers_keep_every_digit() {
        let field = working(Scalars::U16(vec![0, 1, 40000, 65535]), 1.0);
        assert_eq!(physical(&field), [5.0, 6.0, 40005.0, 65540.0]);
        assert_eq!(field.spacing, [1.0, 1.5, 2.0]);
    }

    #[test]
    fn a_negative_slope_turns_the_field() {
        let field = working(Scalars::I16(vec![-10, 20]), -2.0);
        assert_eq!(physical(&field), [25.0, -35.0]);
        assert!(field.value_scale > 0.0);
    }

    #[test]
    fn a_large_offset_costs_nothing() {
        let field = working(Scalars::I32(vec![2_000_000_000, 2_000_000_001, 2_000_000_005]), 1.0);
        assert_eq!(physical(&field), [2_000_000_005.0, 2_000_000_006.0, 2_000_000_010.0]);
        let field = working(Scalars::F64(vec![1e6, 1e6 + 1e-6, 1e6 + 1.0]), 1.0);
        assert!((physical(&field)[1] - physical(&field)[0] - 1e-6).abs() < 1e-7, "{:?}", physical(&field));
        let field = working(Scalars::F64(vec![1e-12, 1.0]), 1.0);
        assert!((f64::from(voxels(&field.values)[0]) * field.value_scale / 1e-12 - 1.0).abs() < 1e-6);
    }

    #[test]
    fn extreme_ranges_stay_finite_and_bad_voxels_become_nan() {
        let field = working(Scalars::F64(vec![-1e300, 1e300, f64::INFINITY, f64::NAN]), 1.0);
        let values = voxels(&field.values);
        assert!(values[..2].iter().all(|value| value.abs() <= 1.0 && value.abs() > 0.4));
        assert!(values[2].is_nan() && values[3].is_nan());
        let tiny = working(Scalars::F32(vec![1e-40, -1e-40]), 1.0);
        assert!(voxels(&tiny.values)[0] > 0.4);
    }

    #[test]
    fn a_volume_without_a_finite_voxel_is_refused() {
        let grid = Grid::new("x", GridGeometry::axis_aligned([1, 1, 1], [1.0; 3]), Scalars::F32(vec![f32::NAN]));
        assert!(WorkingField::new(&grid.expect("a grid")).is_err());
    }
}
