//! Gradient magnitude and second derivative along the gradient by kernels of five taps an axis.

use ndarray::Array3;
use rayon::prelude::*;

use crate::bspline::Degree;
use crate::directional_derivative::{Derivatives, EdgeOperator};
use crate::padded_field::PaddedField;
use crate::working_field::voxels_mut;

/// Samples of a kernel along an axis.
const TAPS: usize = 5;

/// Weights of a kernel along one axis, per voxel: for the sample itself, its first and its second neighbour. First
/// derivatives have the opposite sign at the lower neighbours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeparableKernel {
    /// For the value; `None` where it is the sample itself.
    pub value: Option<[f32; 3]>,
    /// For the first derivative.
    pub first: [f32; 3],
    /// For the second derivative.
    pub second: [f32; 3],
}

impl SeparableKernel {
    /// Central differences of second order on the samples.
    pub const CENTRAL_2: Self = Self { value: None, first: [0.0, 0.5, 0.0], second: [-2.0, 1.0, 0.0] };

    /// Central differences of fourth order on the samples (Abramowitz and Stegun 25.3.6 and 25.3.24).
    pub const CENTRAL_4: Self =
        Self { value: None, first: [0.0, 8.0 / 12.0, -1.0 / 12.0], second: [-30.0 / 12.0, 16.0 / 12.0, -1.0 / 12.0] };

    /// The derivatives of a spline at its samples, on the coefficients.
    #[must_use]
    pub const fn spline(degree: Degree) -> Self {
        let [value, first, second] = degree.at_samples();
        Self { value: Some(value), first, second }
    }
}

/// Derivatives of a field that goes on beyond its faces; `spacing` in multiples of L_min. NaN where a sample that has a
/// weight is.
#[must_use]
pub fn separable_derivatives(
    field: &PaddedField,
    spacing: [f32; 3],
    kernel: &SeparableKernel,
    operator: EdgeOperator,
) -> Derivatives {
    let [nx, ny, nz] = field.dims();
    let [row_len, slice_len] = field.strides();
    let axes = spacing.map(|spacing| AxisKernel::new(kernel, spacing));
    let mut gradient_magnitude = Array3::zeros((nz, ny, nx));
    let mut second_derivative = Array3::zeros((nz, ny, nx));
    voxels_mut(&mut gradient_magnitude)
        .par_chunks_mut(nx * ny)
        .zip(voxels_mut(&mut second_derivative).par_chunks_mut(nx * ny))
        .enumerate()
        .for_each_init(
            || Buffers::new(slice_len, row_len, nx),
            |buffers, (k, (slice_g, slice_f2))| {
                let slice = |tap: usize| &field.values()[(k + tap) * slice_len..][..slice_len];
                buffers.combine_slices(&std::array::from_fn(slice), &axes[2]);
                for (j, (row_g, row_f2)) in slice_g.chunks_mut(nx).zip(slice_f2.chunks_mut(nx)).enumerate() {
                    buffers.combine_rows(j * row_len, row_len, &axes[1]);
                    buffers.combine_samples(&axes[0]);
                    buffers.finish(operator, row_g, row_f2);
                }
            },
        );
    Derivatives { gradient_magnitude, second_derivative }
}

/// A kernel along an axis, per unit of length.
#[derive(Clone, Copy)]
struct AxisKernel {
    value: Option<[f32; 3]>,
    first: [f32; 3],
    second: [f32; 3],
}

impl AxisKernel {
    fn new(kernel: &SeparableKernel, spacing: f32) -> Self {
        let per_length = spacing.recip();
        Self {
            value: kernel.value,
            first: kernel.first.map(|weight| weight * per_length),
            second: kernel.second.map(|weight| weight * (per_length * per_length)),
        }
    }

    /// The value, from five lines of samples.
    fn value_of(&self, out: &mut [f32], lines: &[&[f32]; TAPS]) {
        match self.value {
            Some(weights) => symmetric(out, lines, weights),
            None => out.copy_from_slice(&lines[TAPS / 2][..out.len()]),
        }
    }
}

/// Both sides first, so that mirroring the axis changes no bit.
fn symmetric(out: &mut [f32], [a, b, c, d, e]: &[&[f32]; TAPS], [own, next, after]: [f32; 3]) {
    for (((((out, a), b), c), d), e) in out.iter_mut().zip(*a).zip(*b).zip(*c).zip(*d).zip(*e) {
        *out = own * c + (next * (b + d) + after * (a + e));
    }
}

fn antisymmetric(out: &mut [f32], [a, b, _, d, e]: &[&[f32]; TAPS], [_, next, after]: [f32; 3]) {
    for ((((out, a), b), d), e) in out.iter_mut().zip(*a).zip(*b).zip(*d).zip(*e) {
        *out = next * (d - b) + after * (e - a);
    }
}

/// What one thread works in. Named by what has been done along z, then y, then x: `s` the value, `d` the first, `dd` the
/// second derivative.
struct Buffers {
    /// A padded slice each.
    z: [Vec<f32>; 3],
    /// A padded row each: s·s, s·d, s·dd, d·s, d·d, dd·s, along z and y.
    zy: [Vec<f32>; 6],
    /// A row each: x, y, z, xx, yy, zz, yz, xz, xy.
    partial: [Vec<f32>; 9],
}

impl Buffers {
    fn new(slice_len: usize, row_len: usize, nx: usize) -> Self {
        Self {
            z: std::array::from_fn(|_| vec![0.0; slice_len]),
            zy: std::array::from_fn(|_| vec![0.0; row_len]),
            partial: std::array::from_fn(|_| vec![0.0; nx]),
        }
    }

    fn combine_slices(&mut self, slices: &[&[f32]; TAPS], axis: &AxisKernel) {
        let [s, d, dd] = &mut self.z;
        axis.value_of(s, slices);
        antisymmetric(d, slices, axis.first);
        symmetric(dd, slices, axis.second);
    }

    fn combine_rows(&mut self, start: usize, row_len: usize, axis: &AxisKernel) {
        let [s, d, dd] = [0, 1, 2].map(|which: usize| {
            let slice = &self.z[which];
            std::array::from_fn(|tap| &slice[start + tap * row_len..][..row_len])
        });
        let [ss, sd, sdd, ds, d_d, dds] = &mut self.zy;
        axis.value_of(ss, &s);
        antisymmetric(sd, &s, axis.first);
        symmetric(sdd, &s, axis.second);
        axis.value_of(ds, &d);
        antisymmetric(d_d, &d, axis.first);
        axis.value_of(dds, &dd);
    }

    fn combine_samples(&mut self, axis: &AxisKernel) {
        let len = self.partial[0].len();
        let [ss, sd, sdd, ds, d_d, dds] =
            [0, 1, 2, 3, 4, 5].map(|which: usize| std::array::from_fn(|tap| &self.zy[which][tap..][..len]));
        let [x, y, z, xx, yy, zz, yz, xz, xy] = &mut self.partial;
        antisymmetric(x, &ss, axis.first);
        axis.value_of(y, &sd);
        axis.value_of(z, &ds);
        symmetric(xx, &ss, axis.second);
        axis.value_of(yy, &sdd);
        axis.value_of(zz, &dds);
        axis.value_of(yz, &d_d);
        antisymmetric(xz, &ds, axis.first);
        antisymmetric(xy, &sd, axis.first);
    }

    fn finish(&self, operator: EdgeOperator, row_g: &mut [f32], row_f2: &mut [f32]) {
        let [x, y, z, xx, yy, zz, yz, xz, xy] = &self.partial;
        for (at, (g, f2)) in row_g.iter_mut().zip(row_f2).enumerate() {
            (*g, *f2) = operator.apply([x[at], y[at], z[at], xx[at], yy[at], zz[at], xy[at], xz[at], yz[at]]);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::bspline::{Coefficients, Evaluator};
    use crate::sampler::Place;
    use crate::working_field::{Field, voxels};

    fn noise([nz, ny, nx]: [usize; 3], seed: u32) -> Field {
        Array3::from_shape_fn((nz, ny, nx), |(k, j, i)| {
            (((k * 31 + j) * 31 + i) as u32 ^ seed).wrapping_mul(2_654_435_761) as f32 / u32::MAX as f32
        })
    }

    /// The naive twin: every partial derivative as a sum over all 125 samples, in f64.
    fn naive(
        field: &PaddedField,
        spacing: [f32; 3],
        kernel: &SeparableKernel,
        operator: EdgeOperator,
    ) -> Vec<[f64; 2]> {
        let [nx, ny, nz] = field.dims();
        let [row, slice] = field.strides();
        let even = |[own, next, after]: [f32; 3]| [after, next, own, next, after].map(f64::from);
        let odd = |[_, next, after]: [f32; 3]| [-after, -next, 0.0, next, after].map(f64::from);
        let value = even(kernel.value.unwrap_or([1.0, 0.0, 0.0]));
        let order = [value, odd(kernel.first), even(kernel.second)];
        let mut out = Vec::new();
        for voxel in 0..nx * ny * nz {
            let start = voxel / (nx * ny) * slice + voxel / nx % ny * row + voxel % nx;
            let partial = |orders: [usize; 3]| {
                let mut sum = 0.0;
                for tap in 0..125 {
                    let taps = [tap % 5, tap / 5 % 5, tap / 25];
                    let weight: f64 = (0..3).map(|axis| order[orders[axis]][taps[axis]]).product();
                    if weight != 0.0 {
                        sum += weight * f64::from(field.values()[start + taps[2] * slice + taps[1] * row + taps[0]]);
                    }
                }
                sum / (0..3).map(|axis| f64::from(spacing[axis]).powi(orders[axis] as i32)).product::<f64>()
            };
            let [x, y, z] = [partial([1, 0, 0]), partial([0, 1, 0]), partial([0, 0, 1])];
            let [xx, yy, zz] = [partial([2, 0, 0]), partial([0, 2, 0]), partial([0, 0, 2])];
            let [yz, xz, xy] = [partial([0, 1, 1]), partial([1, 0, 1]), partial([1, 1, 0])];
            let squared = x * x + y * y + z * z;
            let along = x * x * xx + y * y * yy + z * z * zz + 2.0 * (y * z * yz + x * z * xz + x * y * xy);
            let second = if squared > 0.0 { along / squared } else { 0.0 };
            out.push([
                squared.sqrt(),
                match operator {
                    EdgeOperator::SecondDerivative => second,
                    EdgeOperator::Plus => 0.5 * (second + xx + yy + zz),
                },
            ]);
        }
        out
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(30))]
        #[test]
        fn equals_its_naive_twin(
            dims in prop::array::uniform3(1_usize..8),
            seed in any::<u32>(),
            kernel in prop::sample::select(vec![
                SeparableKernel::CENTRAL_4,
                SeparableKernel::spline(Degree::Cubic),
                SeparableKernel::spline(Degree::Quintic),
            ]),
            operator in prop::sample::select(vec![EdgeOperator::SecondDerivative, EdgeOperator::Plus]),
        ) {
            let field = PaddedField::new(&noise(dims, seed)).expect("fits");
            let spacing = [1.0, 1.5, 2.25];
            let found = separable_derivatives(&field, spacing, &kernel, operator);
            let pairs = voxels(&found.gradient_magnitude).iter().zip(voxels(&found.second_derivative));
            for ((&g, &f2), [expected_g, expected_f2]) in pairs.zip(naive(&field, spacing, &kernel, operator)) {
                prop_assert!((f64::from(g) - expected_g).abs() < 2e-6, "{} {}", g, expected_g);
                // Where the gradient nearly vanishes its direction is lost to rounding.
                let tolerance = 1e-5 + 1e-6 / expected_g.max(1e-3);
                prop_assert!((f64::from(f2) - expected_f2).abs() < tolerance, "{} {} {}", f2, expected_f2, g);
            }
        }
    }

    #[test]
    fn a_spline_s_derivatives_are_those_of_its_evaluation() {
        let field = noise([6, 7, 8], 11);
        let spacing = [1.0, 2.0, 1.5];
        for degree in [Degree::Cubic, Degree::Quintic] {
            let coefficients = Coefficients::new(field.clone(), degree).expect("fits");
            let kernel = SeparableKernel::spline(degree);
            let found = separable_derivatives(&coefficients.field, spacing, &kernel, EdgeOperator::SecondDerivative);
            let evaluator = Evaluator::new(&coefficients, spacing);
            for ((k, j, i), &g) in found.gradient_magnitude.indexed_iter() {
                let cell = [i.min(6), j.min(5), k.min(4)];
                let fraction = glam::Vec3::new((i - cell[0]) as f32, (j - cell[1]) as f32, (k - cell[2]) as f32);
                let jet = evaluator.jet(&Place { cell, fraction });
                assert!((g - jet.gradient.length()).abs() < 1e-5, "{degree:?} {g} {jet:?}");
                let second = found.second_derivative[[k, j, i]];
                assert!((second - jet.second_derivative()).abs() < 1e-4, "{degree:?} {second} {jet:?}");
            }
        }
    }

    #[test]
    fn one_bad_sample_masks_only_what_weighs_it() {
        let mut field = noise([9, 9, 9], 5);
        field[[4, 4, 4]] = f32::NAN;
        let padded = PaddedField::new(&field).expect("fits");
        let found =
            separable_derivatives(&padded, [1.0; 3], &SeparableKernel::CENTRAL_4, EdgeOperator::SecondDerivative);
        let masked = voxels(&found.second_derivative).iter().filter(|value| value.is_nan()).count();
        // Five taps along each axis, and five by five in each of the three planes: 13 + 3 · 16.
        assert_eq!(masked, 61);
        assert_eq!(voxels(&found.gradient_magnitude).iter().filter(|value| value.is_nan()).count(), 61);
    }
}
