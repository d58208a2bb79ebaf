//! The naive twin of a smoothing kernel, and fields to try kernels on.

use ndarray::Array3;
use proptest::prelude::*;

use crate::working_field::Field;

/// Spacing of [`fields`].
pub const SPACING: [f32; 3] = [1.0, 1.5, 3.0];

/// Small fields of noise in 0 to 1, with or without a NaN in the middle.
pub fn fields() -> impl Strategy<Value = Field> {
    (prop::array::uniform3(1_usize..7), any::<u32>(), any::<bool>()).prop_map(|([nz, ny, nx], seed, hole)| {
        let mut field = Array3::from_shape_fn((nz, ny, nx), |(k, j, i)| {
            (((k * 31 + j) * 31 + i) as u32 ^ seed).wrapping_mul(2_654_435_761) as f32 / u32::MAX as f32
        });
        if hole {
            field[[nz / 2, ny / 2, nx / 2]] = f32::NAN;
        }
        field
    })
}

/// The weighted mean of the cube of `radius` voxels around each voxel, in f64. Weights are of the squared distance and
/// the difference in value; voxels outside and NaN do not count, and NaN stays NaN.
pub fn naive_mean(field: &Field, radius: usize, weight: impl Fn(f64, f64) -> f64) -> Vec<f64> {
    let radius = radius as isize;
    let (nz, ny, nx) = field.dim();
    let mean = |((k, j, i), &center): ((usize, usize, usize), &f32)| {
        let (mut sum, mut total) = (0.0, 0.0);
        for dz in -radius..=radius {
            for dy in -radius..=radius {
                for dx in -radius..=radius {
                    let place = [(k, dz, nz), (j, dy, ny), (i, dx, nx)]
                        .map(|(index, d, n)| index.checked_add_signed(d).filter(|&p| p < n));
                    let [Some(z), Some(y), Some(x)] = place else { continue };
                    let value = f64::from(field[[z, y, x]]);
                    let squared: f64 =
                        [dx, dy, dz].iter().zip(SPACING).map(|(&d, h)| (d as f64 * f64::from(h)).powi(2)).sum();
                    if !value.is_nan() {
                        let weight = weight(squared, value - f64::from(center));
                        sum += weight * value;
                        total += weight;
                    }
                }
            }
        }
        if center.is_nan() { f64::NAN } else { sum / total }
    };
    field.indexed_iter().map(mean).collect()
}

/// Fails unless a kernel's result is its twin's, but for rounding.
pub fn check_against_naive(found: &Field, expected: &[f64]) -> Result<(), TestCaseError> {
    for (&found, &expected) in found.iter().zip(expected) {
        prop_assert_eq!(found.is_nan(), expected.is_nan());
        prop_assert!(found.is_nan() || (f64::from(found) - expected).abs() < 2e-6, "{} {}", found, expected);
    }
    Ok(())
}
