//! A spline between its samples: value, gradient and Hessian.

// No iterators and closures in vector code: what std calls might be compiled without the level's instructions.
#![allow(clippy::needless_range_loop, reason = "see above")]

use fearless_simd::{Level, Simd, SimdBase, SimdSplit, dispatch, f32x8};
use glam::Vec3;

use super::basis::{TAPS, weights};
use super::{Coefficients, Degree};
use crate::padded_field::PADDING;
use crate::sampler::Place;
use crate::simd;

/// Value, gradient and Hessian of a spline at a place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Jet {
    /// Value.
    pub value: f32,
    /// Gradient, per unit of the spacing given to [`Evaluator::new`].
    pub gradient: Vec3,
    /// Diagonal of the Hessian: xx, yy, zz.
    pub diagonal: Vec3,
    /// The rest of it: yz, xz, xy.
    pub mixed: Vec3,
}

impl Jet {
    /// The second derivative along the gradient, `nᵀHn` (eq. (2) of the paper); 0 where there is no gradient.
    #[inline(always)]
    #[must_use]
    pub fn second_derivative(&self) -> f32 {
        let Vec3 { x, y, z } = self.gradient;
        let squared = self.gradient.length_squared();
        let crossed = Vec3::new(y * z, x * z, x * y);
        let along = (self.gradient * self.gradient).dot(self.diagonal) + 2.0 * crossed.dot(self.mixed);
        if squared > 0.0 { along / squared } else { 0.0 }
    }

    /// The trace of the Hessian.
    #[inline(always)]
    #[must_use]
    pub fn laplacian(&self) -> f32 {
        self.diagonal.element_sum()
    }
}

/// Evaluates one spline.
#[derive(Clone, Copy, Debug)]
pub struct Evaluator<'a> {
    samples: Samples<'a>,
    degree: Degree,
    per_length: Vec3,
    level: Level,
}

impl<'a> Evaluator<'a> {
    /// An evaluator of a spline on a grid with the given spacing.
    #[must_use]
    pub fn new(coefficients: &'a Coefficients, spacing: [f32; 3]) -> Self {
        Self {
            samples: Samples { values: coefficients.field.values(), strides: coefficients.field.strides() },
            degree: coefficients.degree,
            per_length: Vec3::from_array(spacing.map(f32::recip)),
            level: simd::level(),
        }
    }

    /// Voxels per unit of length along each axis.
    #[must_use]
    pub fn per_length(&self) -> Vec3 {
        self.per_length
    }

    /// The value at a place.
    #[must_use]
    pub fn value(&self, place: &Place) -> f32 {
        dispatch!(self.level, simd => value(simd, self.samples, self.degree, place))
    }

    /// Value, gradient and Hessian at a place.
    ///
    /// Reads 216 coefficients, with about 500 multiplications and as many additions.
    #[must_use]
    pub fn jet(&self, place: &Place) -> Jet {
        let Jet { value, gradient, diagonal, mixed } =
            dispatch!(self.level, simd => jet(simd, self.samples, self.degree, place));
        let scale = self.per_length;
        Jet {
            value,
            gradient: gradient * scale,
            diagonal: diagonal * scale * scale,
            mixed: mixed * Vec3::new(scale.y * scale.z, scale.x * scale.z, scale.x * scale.y),
        }
    }

    /// The gradient at a sample, which depends on five samples along each axis instead of six.
    #[must_use]
    pub fn gradient_at_sample(&self, sample: [usize; 3]) -> Vec3 {
        dispatch!(self.level, simd => gradient_at_sample(simd, self.samples, self.degree, sample)) * self.per_length
    }
}

/// The padded coefficients.
#[derive(Clone, Copy, Debug)]
struct Samples<'a> {
    values: &'a [f32],
    strides: [usize; 2],
}

impl<'a> Samples<'a> {
    /// The samples from the first tap of a cell on: two before the cell, which is where the padding begins to count.
    #[inline(always)]
    fn from(&self, [i, j, k]: [usize; 3]) -> Self {
        const { assert!(PADDING == 2) };
        let [row_len, slice_len] = self.strides;
        Self { values: &self.values[k * slice_len + j * row_len + i..], ..*self }
    }

    /// The taps along x of the row at a tap along z and y.
    #[inline(always)]
    fn row<S: Simd>(&self, simd: S, depth: usize, tap: usize) -> f32x8<S> {
        let [row_len, slice_len] = self.strides;
        f32x8::from_slice(simd, &self.values[depth * slice_len + tap * row_len..][..8])
    }
}

/// Weights along y or z, one at a time.
#[inline(always)]
fn scalars<S: Simd>(simd: S, degree: Degree, fraction: f32) -> [[f32; 8]; 3] {
    let [value, first, second] = weights(simd, degree, fraction);
    [value.into(), first.into(), second.into()]
}

/// Σ a·b, in an order that is the same for every width of vectors.
#[inline(always)]
fn dot<S: Simd>(a: f32x8<S>, b: f32x8<S>) -> f32 {
    let (low, high) = (a * b).split();
    let sums: [f32; 4] = (low + high).into();
    (sums[0] + sums[2]) + (sums[1] + sums[3])
}

#[inline(always)]
fn value<S: Simd>(simd: S, samples: Samples<'_>, degree: Degree, place: &Place) -> f32 {
    let samples = samples.from(place.cell);
    let [x, ..] = weights(simd, degree, place.fraction.x);
    let y = scalars(simd, degree, place.fraction.y);
    let z = scalars(simd, degree, place.fraction.z);
    let mut sum = f32x8::splat(simd, 0.0);
    for depth in 0..TAPS {
        let mut slice = f32x8::splat(simd, 0.0);
        for tap in 0..TAPS {
            slice += samples.row(simd, depth, tap) * y[0][tap];
        }
        sum += slice * z[0][depth];
    }
    dot(x, sum)
}

/// The jet per voxel.
#[inline(always)]
fn jet<S: Simd>(simd: S, samples: Samples<'_>, degree: Degree, place: &Place) -> Jet {
    let samples = samples.from(place.cell);
    let [plain, first, second] = weights(simd, degree, place.fraction.x);
    let y = scalars(simd, degree, place.fraction.y);
    let z = scalars(simd, degree, place.fraction.z);
    let zero = f32x8::splat(simd, 0.0);
    // Named by the derivative along z and y.
    let [mut s, mut along_y, mut along_yy, mut along_z, mut along_yz, mut along_zz] = [zero; 6];
    for depth in 0..TAPS {
        let [mut slice, mut slice_y, mut slice_yy] = [zero; 3];
        for tap in 0..TAPS {
            let row = samples.row(simd, depth, tap);
            slice += row * y[0][tap];
            slice_y += row * y[1][tap];
            slice_yy += row * y[2][tap];
        }
        let [weight, weight_z, weight_zz] = [z[0][depth], z[1][depth], z[2][depth]];
        s += slice * weight;
        along_y += slice_y * weight;
        along_yy += slice_yy * weight;
        along_z += slice * weight_z;
        along_yz += slice_y * weight_z;
        along_zz += slice * weight_zz;
    }
    Jet {
        value: dot(plain, s),
        gradient: Vec3::new(dot(first, s), dot(plain, along_y), dot(plain, along_z)),
        diagonal: Vec3::new(dot(second, s), dot(plain, along_yy), dot(plain, along_zz)),
        mixed: Vec3::new(dot(plain, along_yz), dot(first, along_z), dot(first, along_y)),
    }
}

/// The gradient per voxel.
#[inline(always)]
fn gradient_at_sample<S: Simd>(simd: S, samples: Samples<'_>, degree: Degree, sample: [usize; 3]) -> Vec3 {
    let [[own, next, after], [_, first_next, first_after], _] = degree.at_samples();
    let value = [after, next, own, next, after, 0.0, 0.0, 0.0];
    let first = [-first_after, -first_next, 0.0, first_next, first_after, 0.0, 0.0, 0.0];
    let samples = samples.from(sample);
    let [mut s, mut along_y, mut along_z] = [f32x8::splat(simd, 0.0); 3];
    for depth in 0..5 {
        let [mut slice, mut slice_y] = [f32x8::splat(simd, 0.0); 2];
        for tap in 0..5 {
            let row = samples.row(simd, depth, tap);
            slice += row * value[tap];
            slice_y += row * first[tap];
        }
        s += slice * value[depth];
        along_y += slice_y * value[depth];
        along_z += slice * first[depth];
    }
    let [value, first] = [f32x8::from_slice(simd, &value), f32x8::from_slice(simd, &first)];
    Vec3::new(dot(first, s), dot(value, along_y), dot(value, along_z))
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;
    use proptest::prelude::*;

    use super::*;
    use crate::working_field::Field;

    const DEGREES: [Degree; 2] = [Degree::Cubic, Degree::Quintic];

    fn noise([nz, ny, nx]: [usize; 3], seed: u32) -> Field {
        Array3::from_shape_fn((nz, ny, nx), |(k, j, i)| {
            (((k * 31 + j) * 31 + i) as u32 ^ seed).wrapping_mul(2_654_435_761) as f32 / u32::MAX as f32
        })
    }

    fn at(cell: [usize; 3], fraction: [f32; 3]) -> Place {
        Place { cell, fraction: Vec3::from_array(fraction) }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn the_spline_goes_through_every_sample(dims in prop::array::uniform3(1_usize..12), seed in any::<u32>()) {
            let field = noise(dims, seed);
            for degree in DEGREES {
                let coefficients = Coefficients::new(&field, degree).expect("fits");
                let evaluator = Evaluator::new(&coefficients, [1.0; 3]);
                for ((k, j, i), &expected) in field.indexed_iter() {
                    // The last sample of an axis is the far end of its last cell.
                    let [cell_x, cell_y, cell_z] =
                        [(i, dims[2]), (j, dims[1]), (k, dims[0])].map(|(index, len)| index.min(len.saturating_sub(2)));
                    let fraction = [i - cell_x, j - cell_y, k - cell_z].map(|steps| steps as f32);
                    let found = evaluator.value(&at([cell_x, cell_y, cell_z], fraction));
                    prop_assert!((found - expected).abs() < 4e-6, "{degree:?} {found} {expected}");
                }
            }
        }

        #[test]
        fn the_jet_is_the_derivative_of_the_value(
            seed in any::<u32>(),
            cell in prop::array::uniform3(0_usize..5),
            fraction in prop::array::uniform3(0.15_f32..0.85),
        ) {
            let field = noise([6, 6, 6], seed);
            let spacing = [1.0, 2.0, 4.0];
            for degree in DEGREES {
                let coefficients = Coefficients::new(&field, degree).expect("fits");
                let evaluator = Evaluator::new(&coefficients, spacing);
                let h = 0.1_f32;
                let jet_at = |offset: [f32; 3]| {
                    evaluator.jet(&at(cell, [0, 1, 2].map(|axis| fraction[axis] + offset[axis])))
                };
                let jet = jet_at([0.0; 3]);
                prop_assert!((jet.value - evaluator.value(&at(cell, fraction))).abs() < 1e-6);
                // In between samples a quintic spline's derivative is a polynomial: Simpson's rule over it gives back the
                // difference to O(h⁴).
                for (axis, spacing) in spacing.into_iter().enumerate() {
                    let moved = |sign: f32| jet_at(std::array::from_fn(|a| if a == axis { sign * h } else { 0.0 }));
                    let (low, high) = (moved(-1.0), moved(1.0));
                    let length = 2.0 * h * spacing;
                    let mean = |of: &dyn Fn(&Jet) -> f32| (of(&low) + 4.0 * of(&jet) + of(&high)) / 6.0;
                    let rise = |of: &dyn Fn(&Jet) -> f32| (of(&high) - of(&low)) / length;
                    let error = rise(&|jet| jet.value) - mean(&|jet| jet.gradient[axis]);
                    prop_assert!(error.abs() < 2e-4, "{degree:?} gradient {axis}: {error}");
                    let error = rise(&|jet| jet.gradient[axis]) - mean(&|jet| jet.diagonal[axis]);
                    prop_assert!(error.abs() < 1e-3, "{degree:?} diagonal {axis}: {error}");
                    let (next, other) = ((axis + 1) % 3, (axis + 2) % 3);
                    let error = rise(&|jet| jet.gradient[next]) - mean(&|jet| jet.mixed[other]);
                    prop_assert!(error.abs() < 1e-3, "{degree:?} mixed {other}: {error}");
                }
            }
        }
    }

    #[test]
    fn gradients_at_samples_are_those_between_them() {
        let field = noise([5, 7, 6], 3);
        for degree in DEGREES {
            let coefficients = Coefficients::new(&field, degree).expect("fits");
            let evaluator = Evaluator::new(&coefficients, [1.0, 1.5, 2.0]);
            // At the far corner itself there is no cell, but a gradient.
            assert!(evaluator.gradient_at_sample([5, 6, 4]).is_finite());
            for cell in [[0, 0, 0], [4, 5, 3], [2, 3, 1], [0, 5, 2]] {
                let [found, expected] =
                    [evaluator.gradient_at_sample(cell), evaluator.jet(&at(cell, [0.0; 3])).gradient];
                assert!((found - expected).length() < 1e-5, "{degree:?} {found} {expected}");
            }
        }
    }

    #[test]
    fn ramps_are_exact_up_to_the_faces() {
        let field = Array3::from_shape_fn((5, 4, 7), |(k, j, i)| 0.5 * i as f32 - 0.25 * j as f32 + 0.125 * k as f32);
        for degree in DEGREES {
            let coefficients = Coefficients::new(&field, degree).expect("fits");
            let evaluator = Evaluator::new(&coefficients, [1.0; 3]);
            for cell in [[0, 0, 0], [5, 2, 3], [0, 2, 0], [3, 1, 2]] {
                for fraction in [[0.0; 3], [1.0; 3], [0.3, 0.6, 0.9]] {
                    let jet = evaluator.jet(&at(cell, fraction));
                    assert!((jet.gradient - Vec3::new(0.5, -0.25, 0.125)).length() < 1e-5, "{degree:?} {jet:?}");
                    assert!(jet.diagonal.length() < 1e-5 && jet.mixed.length() < 1e-5, "{degree:?} {jet:?}");
                }
            }
        }
    }

    #[test]
    fn polynomials_of_the_spline_s_degree_are_exact_far_from_the_ends() {
        for (degree, power) in [(Degree::Cubic, 3), (Degree::Quintic, 5)] {
            let x = |index: f32| (index - 24.0) / 8.0;
            let field = Array3::from_shape_fn((1, 1, 49), |(_, _, i)| x(i as f32).powi(power));
            let coefficients = Coefficients::new(&field, degree).expect("fits");
            let evaluator = Evaluator::new(&coefficients, [0.125, 1.0, 1.0]);
            for fraction in [0.0, 0.3, 0.75] {
                let jet = evaluator.jet(&at([27, 0, 0], [fraction, 0.0, 0.0]));
                let (x, n) = (x(27.0 + fraction), power as f32);
                assert!((jet.value - x.powi(power)).abs() < 1e-4, "{degree:?} {jet:?}");
                assert!((jet.gradient.x - n * x.powi(power - 1)).abs() < 2e-3, "{degree:?} {jet:?}");
                assert!((jet.diagonal.x - n * (n - 1.0) * x.powi(power - 2)).abs() < 4e-2, "{degree:?} {jet:?}");
            }
        }
    }
}
