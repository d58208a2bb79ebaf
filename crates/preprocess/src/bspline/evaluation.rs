//! A spline between its samples: value, gradient and Hessian.

use glam::{Vec3, Vec3A, Vec4};

use super::{Coefficients, Degree};
use crate::padded_field::PADDING;
use crate::sampler::Place;

/// Samples that a place depends on along an axis: six of a quintic spline, the middle four of a cubic one.
const TAPS: usize = 6;
/// Taps with room to load them as whole vectors.
const LANES: usize = 8;

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
    values: &'a [f32],
    strides: [usize; 2],
    degree: Degree,
    per_length: Vec3,
}

/// Weights of an axis' taps for the value, the first and the second derivative per voxel.
type Weights = [Taps; 3];

impl<'a> Evaluator<'a> {
    /// An evaluator of a spline on a grid with the given spacing.
    #[must_use]
    pub fn new(coefficients: &'a Coefficients, spacing: [f32; 3]) -> Self {
        Self {
            values: coefficients.field.values(),
            strides: coefficients.field.strides(),
            degree: coefficients.degree,
            per_length: Vec3::from_array(spacing.map(f32::recip)),
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
        let [x, y, z] = weights(self.degree, place.fraction);
        let first = self.first(place);
        x[0].dot(|half| {
            let mut sum = Vec4::ZERO;
            for depth in 0..TAPS {
                let mut slice = Vec4::ZERO;
                for tap in 0..TAPS {
                    slice += y[0].at(tap) * self.half_row(first, depth, tap, half);
                }
                sum += z[0].at(depth) * slice;
            }
            sum
        })
    }

    /// Value, gradient and Hessian at a place.
    #[must_use]
    pub fn jet(&self, place: &Place) -> Jet {
        let [x, y, z] = weights(self.degree, place.fraction);
        let first = self.first(place);
        let mut value = 0.0;
        let [mut gradient, mut diagonal, mut mixed] = [Vec3::ZERO; 3];
        // Half of the taps along x at a time: sums over y and z then fit a processor's registers.
        for half in 0..2 {
            // Named by the derivative along z and y.
            let [mut s, mut along_y, mut along_yy, mut along_z, mut along_yz, mut along_zz] = [Vec4::ZERO; 6];
            for depth in 0..TAPS {
                let [mut slice, mut slice_y, mut slice_yy] = [Vec4::ZERO; 3];
                for tap in 0..TAPS {
                    let row = self.half_row(first, depth, tap, half);
                    slice += y[0].at(tap) * row;
                    slice_y += y[1].at(tap) * row;
                    slice_yy += y[2].at(tap) * row;
                }
                let [weight, weight_z, weight_zz] = [z[0].at(depth), z[1].at(depth), z[2].at(depth)];
                s += weight * slice;
                along_y += weight * slice_y;
                along_yy += weight * slice_yy;
                along_z += weight_z * slice;
                along_yz += weight_z * slice_y;
                along_zz += weight_zz * slice;
            }
            let [plain, first, second] = [x[0].half(half), x[1].half(half), x[2].half(half)];
            value += plain.dot(s);
            gradient += Vec3::new(first.dot(s), plain.dot(along_y), plain.dot(along_z));
            diagonal += Vec3::new(second.dot(s), plain.dot(along_yy), plain.dot(along_zz));
            mixed += Vec3::new(plain.dot(along_yz), first.dot(along_z), first.dot(along_y));
        }
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
    pub fn gradient_at_sample(&self, [i, j, k]: [usize; 3]) -> Vec3 {
        let [[own, next, after], [_, first_next, first_after], _] = self.degree.at_samples();
        let value = [after, next, own, next, after];
        let first = [-first_after, -first_next, 0.0, first_next, first_after];
        let [row_len, slice_len] = self.strides;
        let start = k * slice_len + j * row_len + i;
        let mut gradient = Vec3::ZERO;
        for half in 0..2 {
            let [mut s, mut along_y, mut along_z] = [Vec4::ZERO; 3];
            for depth in 0..5 {
                let [mut slice, mut slice_y] = [Vec4::ZERO; 2];
                for tap in 0..5 {
                    let row = self.half_row(start, depth, tap, half);
                    slice += value[tap] * row;
                    slice_y += first[tap] * row;
                }
                s += value[depth] * slice;
                along_y += value[depth] * slice_y;
                along_z += first[depth] * slice;
            }
            let taps = |weights: [f32; 5]| match half {
                0 => Vec4::new(weights[0], weights[1], weights[2], weights[3]),
                _ => Vec4::new(weights[4], 0.0, 0.0, 0.0),
            };
            let [value, first] = [value, first].map(taps);
            gradient += Vec3::new(first.dot(s), value.dot(along_y), value.dot(along_z));
        }
        gradient * self.per_length
    }

    /// The first tap: two samples before the cell, which is where the padding begins to count.
    #[inline(always)]
    fn first(&self, place: &Place) -> usize {
        const { assert!(PADDING == 2) };
        let [row_len, slice_len] = self.strides;
        let [i, j, k] = place.cell;
        k * slice_len + j * row_len + i
    }

    /// Four taps along x of the row at a tap along z and y.
    #[inline(always)]
    fn half_row(&self, first: usize, depth: usize, tap: usize, half: usize) -> Vec4 {
        let [row_len, slice_len] = self.strides;
        Vec4::from_slice(&self.values[first + depth * slice_len + tap * row_len + 4 * half..])
    }
}

/// The weights of an axis' taps; those of the last two lanes are 0.
#[derive(Clone, Copy, Default)]
struct Taps([f32; LANES]);

impl Taps {
    #[inline(always)]
    fn at(&self, tap: usize) -> f32 {
        self.0[tap]
    }

    #[inline(always)]
    fn half(&self, half: usize) -> Vec4 {
        Vec4::from_slice(&self.0[4 * half..])
    }

    /// The weighted sum of two halves.
    #[inline(always)]
    fn dot(&self, sums: impl Fn(usize) -> Vec4) -> f32 {
        self.half(0).dot(sums(0)) + self.half(1).dot(sums(1))
    }
}

/// Basis weights of all three axes at once: value, first and second derivative per voxel of every tap.
///
/// By the recursion over the degree of Cox and de Boor on equidistant knots; a derivative is a difference of the basis one
/// degree lower.
#[inline(always)]
fn weights(degree: Degree, fraction: Vec3) -> [Weights; 3] {
    let fraction = Vec3A::from(fraction);
    let two = raised::<1, 2>([Vec3A::ONE], fraction);
    let three = raised::<2, 3>(two, fraction);
    let four = raised::<3, 4>(three, fraction);
    match degree {
        Degree::Cubic => {
            let (value, first) = (four, difference::<3, 4>(three));
            by_axis::<4, 1>([value, first, difference::<3, 4>(difference::<2, 3>(two))])
        }
        Degree::Quintic => {
            let five = raised::<4, 5>(four, fraction);
            let (value, first) = (raised::<5, 6>(five, fraction), difference::<5, 6>(five));
            by_axis::<6, 0>([value, first, difference::<5, 6>(difference::<4, 5>(four))])
        }
    }
}

/// The basis with `N` taps from the one with one less.
#[inline(always)]
fn raised<const M: usize, const N: usize>(lower: [Vec3A; M], fraction: Vec3A) -> [Vec3A; N] {
    let degree = M as f32;
    std::array::from_fn(|tap| {
        let mut sum = Vec3A::ZERO;
        if tap > 0 {
            sum += (fraction + (degree - tap as f32)) * lower[tap - 1];
        }
        if tap < M {
            sum += (1.0 + tap as f32 - fraction) * lower[tap];
        }
        sum * (1.0 / degree)
    })
}

#[inline(always)]
fn difference<const M: usize, const N: usize>(lower: [Vec3A; M]) -> [Vec3A; N] {
    std::array::from_fn(|tap| {
        (if tap > 0 { lower[tap - 1] } else { Vec3A::ZERO }) - (if tap < M { lower[tap] } else { Vec3A::ZERO })
    })
}

/// Weights axis by axis, as taps `FIRST` samples further on.
#[inline(always)]
fn by_axis<const N: usize, const FIRST: usize>(weights: [[Vec3A; N]; 3]) -> [Weights; 3] {
    let mut axes = [[Taps::default(); 3]; 3];
    for (derivative, taps) in weights.iter().enumerate() {
        for (tap, weight) in taps.iter().enumerate() {
            for (axis, weight) in weight.to_array().into_iter().enumerate() {
                axes[axis][derivative].0[FIRST + tap] = weight;
            }
        }
    }
    axes
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
                let coefficients = Coefficients::new(field.clone(), degree).expect("fits");
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
                let coefficients = Coefficients::new(field.clone(), degree).expect("fits");
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
            let coefficients = Coefficients::new(field.clone(), degree).expect("fits");
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
    fn weights_at_samples_are_the_table_s() {
        for degree in DEGREES {
            let table = degree.at_samples();
            for (derivative, found) in weights(degree, Vec3::ZERO)[1].into_iter().enumerate() {
                let sign = if derivative == 1 { -1.0 } else { 1.0 };
                let [own, next, after] = table[derivative];
                let expected = [sign * after, sign * next, own, next, after, 0.0, 0.0, 0.0];
                assert!(found.0.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{degree:?} {:?}", found.0);
            }
        }
    }

    #[test]
    fn ramps_are_exact_up_to_the_faces() {
        let field = Array3::from_shape_fn((5, 4, 7), |(k, j, i)| 0.5 * i as f32 - 0.25 * j as f32 + 0.125 * k as f32);
        for degree in DEGREES {
            let coefficients = Coefficients::new(field.clone(), degree).expect("fits");
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
            let coefficients = Coefficients::new(field, degree).expect("fits");
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
