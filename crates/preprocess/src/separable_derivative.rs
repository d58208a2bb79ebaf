//! Gradient magnitude and second derivative along the gradient by kernels of five taps an axis.

use std::ops::Range;

use multiversion::multiversion;
use rayon::prelude::*;

use crate::bspline::Degree;
use crate::directional_derivative::{Derivatives, EdgeOperator};
use crate::padded_field::PaddedField;
use crate::row_windows::{WINDOW, windows};
use crate::working_field::{dims_of, voxels_mut};

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
///
/// See [`separable_derivatives_into`] for its cost.
#[must_use]
pub fn separable_derivatives(
    field: &PaddedField,
    spacing: [f32; 3],
    kernel: &SeparableKernel,
    operator: EdgeOperator,
) -> Derivatives {
    let mut derivatives = Derivatives::zeros(field.dims());
    separable_derivatives_into(field, spacing, kernel, operator, &mut derivatives);
    derivatives
}

/// As [`separable_derivatives`], into fields that exist already.
///
/// Per voxel 4 bytes are read and 8 written, for 138 operations on f32 with a spline's kernel (62 products, 74 sums, a
/// division and a root), 8 voxels at a time with AVX2, 16 with AVX-512: the processor is busier than its memory. Five slices are combined
/// along z, row by row, five rows of that along y, and five samples of that along x; all but the slices stays in the
/// first-level cache.
///
/// # Panics
/// When `derivatives` are not of the field's dimensions.
pub fn separable_derivatives_into(
    field: &PaddedField,
    spacing: [f32; 3],
    kernel: &SeparableKernel,
    operator: EdgeOperator,
    derivatives: &mut Derivatives,
) {
    let Derivatives { gradient_magnitude, second_derivative } = derivatives;
    let dims @ [nx, ny, _] = field.dims();
    assert!(dims_of(gradient_magnitude) == dims && dims_of(second_derivative) == dims, "fields of one volume");
    let [row_len, slice_len] = field.strides();
    let pass = Pass {
        values: field.values(),
        row_len,
        slice_len,
        axes: spacing.map(|spacing| AxisKernel::new(kernel, spacing)),
        is_spline: kernel.value.is_some(),
        operator,
    };
    voxels_mut(gradient_magnitude)
        .par_chunks_mut(nx * ny)
        .zip(voxels_mut(second_derivative).par_chunks_mut(nx * ny))
        .enumerate()
        .for_each_init(
            || Buffers::new(row_len),
            |buffers, (k, (slice_g, slice_f2))| differentiate_slice(&pass, k, nx, buffers, slice_g, slice_f2),
        );
}

/// What is the same for all slices.
struct Pass<'a> {
    values: &'a [f32],
    row_len: usize,
    slice_len: usize,
    axes: [AxisKernel; 3],
    is_spline: bool,
    operator: EdgeOperator,
}

/// A kernel along an axis, per unit of length.
#[derive(Clone, Copy)]
struct AxisKernel {
    value: [f32; 3],
    first: [f32; 3],
    second: [f32; 3],
}

impl AxisKernel {
    fn new(kernel: &SeparableKernel, spacing: f32) -> Self {
        let per_length = spacing.recip();
        Self {
            value: kernel.value.unwrap_or([1.0, 0.0, 0.0]),
            first: kernel.first.map(|weight| weight * per_length),
            second: kernel.second.map(|weight| weight * (per_length * per_length)),
        }
    }

    /// The value. Only a `SPLINE`'s depends on neighbours, so that a NaN among them masks nothing else's.
    #[inline(always)]
    fn value_of<const SPLINE: bool>(&self, taps: [f32; TAPS]) -> f32 {
        if SPLINE { symmetric(taps, self.value) } else { taps[TAPS / 2] }
    }

    #[inline(always)]
    fn first_of(&self, taps: [f32; TAPS]) -> f32 {
        antisymmetric(taps, self.first)
    }

    #[inline(always)]
    fn second_of(&self, taps: [f32; TAPS]) -> f32 {
        symmetric(taps, self.second)
    }

    /// All three, from five lines of samples.
    #[inline(always)]
    fn all<const SPLINE: bool>(
        &self,
        part: Range<usize>,
        lines: &[&[f32]; TAPS],
        s: &mut [f32],
        d: &mut [f32],
        dd: &mut [f32],
    ) {
        let lines = cut(lines, &part);
        let (s, d, dd) = (&mut s[part.clone()], &mut d[part.clone()], &mut dd[part.clone()]);
        for x in 0..part.len() {
            let taps = at(&lines, x);
            (s[x], d[x], dd[x]) = (self.value_of::<SPLINE>(taps), self.first_of(taps), self.second_of(taps));
        }
    }

    #[inline(always)]
    fn value_and_first<const SPLINE: bool>(
        &self,
        part: Range<usize>,
        lines: &[&[f32]; TAPS],
        s: &mut [f32],
        d: &mut [f32],
    ) {
        let lines = cut(lines, &part);
        let (s, d) = (&mut s[part.clone()], &mut d[part.clone()]);
        for x in 0..part.len() {
            let taps = at(&lines, x);
            (s[x], d[x]) = (self.value_of::<SPLINE>(taps), self.first_of(taps));
        }
    }

    #[inline(always)]
    fn value<const SPLINE: bool>(&self, part: Range<usize>, lines: &[&[f32]; TAPS], s: &mut [f32]) {
        let lines = cut(lines, &part);
        for (x, s) in s[part].iter_mut().enumerate() {
            *s = self.value_of::<SPLINE>(at(&lines, x));
        }
    }
}

/// Both sides first, so that mirroring the axis changes no bit.
#[inline(always)]
fn symmetric([a, b, c, d, e]: [f32; TAPS], [own, next, after]: [f32; 3]) -> f32 {
    own * c + (next * (b + d) + after * (a + e))
}

#[inline(always)]
fn antisymmetric([a, b, _, d, e]: [f32; TAPS], [_, next, after]: [f32; 3]) -> f32 {
    next * (d - b) + after * (e - a)
}

/// What one thread works in, a padded row each. Named by what has been done along z, then y: `s` the value, `d` the first,
/// `dd` the second derivative.
struct Buffers {
    /// s, d, dd of the five rows that are in use; row j in place j modulo 5.
    z: [[Vec<f32>; 3]; TAPS],
    /// s·s, s·d, s·dd, d·s, d·d, dd·s.
    zy: [Vec<f32>; 6],
}

impl Buffers {
    fn new(row_len: usize) -> Self {
        let row = || vec![0.0; row_len];
        Self { z: std::array::from_fn(|_| std::array::from_fn(|_| row())), zy: std::array::from_fn(|_| row()) }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn differentiate_slice(
    pass: &Pass<'_>,
    k: usize,
    nx: usize,
    buffers: &mut Buffers,
    slice_g: &mut [f32],
    slice_f2: &mut [f32],
) {
    use EdgeOperator::{Plus, SecondDerivative};
    // Spelled out, so that no loop asks which it is.
    match (pass.is_spline, pass.operator) {
        (true, SecondDerivative) => pass.rows::<true>(k, nx, SecondDerivative, buffers, slice_g, slice_f2),
        (true, Plus) => pass.rows::<true>(k, nx, Plus, buffers, slice_g, slice_f2),
        (false, SecondDerivative) => pass.rows::<false>(k, nx, SecondDerivative, buffers, slice_g, slice_f2),
        (false, Plus) => pass.rows::<false>(k, nx, Plus, buffers, slice_g, slice_f2),
    }
}

impl Pass<'_> {
    #[inline(always)]
    fn rows<const SPLINE: bool>(
        &self,
        k: usize,
        nx: usize,
        operator: EdgeOperator,
        buffers: &mut Buffers,
        slice_g: &mut [f32],
        slice_f2: &mut [f32],
    ) {
        for j in 0..TAPS - 1 {
            self.combine_slices::<SPLINE>(k, j, buffers);
        }
        for (j, (row_g, row_f2)) in slice_g.chunks_exact_mut(nx).zip(slice_f2.chunks_exact_mut(nx)).enumerate() {
            self.combine_slices::<SPLINE>(k, j + TAPS - 1, buffers);
            self.combine_rows::<SPLINE>(j, buffers);
            for part in windows(nx) {
                if part.len() == WINDOW {
                    let part = part.start..part.start + WINDOW;
                    self.combine_samples::<SPLINE>(part, operator, &buffers.zy, row_g, row_f2);
                } else {
                    self.combine_samples::<SPLINE>(part, operator, &buffers.zy, row_g, row_f2);
                }
            }
        }
    }

    /// Along z, for a padded row.
    #[inline(always)]
    fn combine_slices<const SPLINE: bool>(&self, k: usize, j: usize, buffers: &mut Buffers) {
        let axis = &self.axes[2];
        let row = |tap: usize| &self.values[(k + tap) * self.slice_len + j * self.row_len..][..self.row_len];
        let rows = [row(0), row(1), row(2), row(3), row(4)];
        let [s, d, dd] = &mut buffers.z[j % TAPS];
        for part in windows(self.row_len) {
            if part.len() == WINDOW {
                axis.all::<SPLINE>(part.start..part.start + WINDOW, &rows, s, d, dd);
            } else {
                axis.all::<SPLINE>(part, &rows, s, d, dd);
            }
        }
    }

    /// Along y, for a padded row.
    #[inline(always)]
    fn combine_rows<const SPLINE: bool>(&self, j: usize, buffers: &mut Buffers) {
        let Buffers { z, zy } = buffers;
        let rows = |which: usize| -> [&[f32]; TAPS] {
            [
                &z[j % TAPS][which],
                &z[(j + 1) % TAPS][which],
                &z[(j + 2) % TAPS][which],
                &z[(j + 3) % TAPS][which],
                &z[(j + 4) % TAPS][which],
            ]
        };
        let [s, d, dd] = [rows(0), rows(1), rows(2)];
        let [ss, sd, sdd, ds, d_d, dds] = zy;
        let axis = &self.axes[1];
        for part in windows(self.row_len) {
            if part.len() == WINDOW {
                let part = || part.start..part.start + WINDOW;
                axis.all::<SPLINE>(part(), &s, ss, sd, sdd);
                axis.value_and_first::<SPLINE>(part(), &d, ds, d_d);
                axis.value::<SPLINE>(part(), &dd, dds);
            } else {
                axis.all::<SPLINE>(part.clone(), &s, ss, sd, sdd);
                axis.value_and_first::<SPLINE>(part.clone(), &d, ds, d_d);
                axis.value::<SPLINE>(part, &dd, dds);
            }
        }
    }

    /// Along x, and the derivatives themselves.
    #[inline(always)]
    fn combine_samples<const SPLINE: bool>(
        &self,
        part: Range<usize>,
        operator: EdgeOperator,
        zy: &[Vec<f32>; 6],
        row_g: &mut [f32],
        row_f2: &mut [f32],
    ) {
        let axis = &self.axes[0];
        let [ss, sd, sdd, ds, d_d, dds] = zy;
        let [ss, sd, sdd] = [shifted(ss, &part), shifted(sd, &part), shifted(sdd, &part)];
        let [ds, d_d, dds] = [shifted(ds, &part), shifted(d_d, &part), shifted(dds, &part)];
        let (row_g, row_f2) = (&mut row_g[part.clone()], &mut row_f2[part.clone()]);
        for x in 0..part.len() {
            (row_g[x], row_f2[x]) = operator.apply([
                axis.first_of(at(&ss, x)),
                axis.value_of::<SPLINE>(at(&sd, x)),
                axis.value_of::<SPLINE>(at(&ds, x)),
                axis.second_of(at(&ss, x)),
                axis.value_of::<SPLINE>(at(&sdd, x)),
                axis.value_of::<SPLINE>(at(&dds, x)),
                axis.first_of(at(&sd, x)),
                axis.first_of(at(&ds, x)),
                axis.value_of::<SPLINE>(at(&d_d, x)),
            ]);
        }
    }
}

/// Some samples of every line.
#[inline(always)]
fn cut<'a>([a, b, c, d, e]: &[&'a [f32]; TAPS], part: &Range<usize>) -> [&'a [f32]; TAPS] {
    let of = |line: &'a [f32]| &line[part.clone()];
    [of(a), of(b), of(c), of(d), of(e)]
}

/// Some samples of a padded line, with the two before and behind them.
#[inline(always)]
fn shifted<'a>(line: &'a [f32], part: &Range<usize>) -> [&'a [f32]; TAPS] {
    let from = |tap: usize| &line[part.start + tap..part.end + tap];
    [from(0), from(1), from(2), from(3), from(4)]
}

#[inline(always)]
fn at([a, b, c, d, e]: &[&[f32]; TAPS], x: usize) -> [f32; TAPS] {
    [a[x], b[x], c[x], d[x], e[x]]
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;
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
            short in prop::array::uniform3(1_usize..8),
            long in prop::option::of(1_usize..150),
            seed in any::<u32>(),
            kernel in prop::sample::select(vec![
                SeparableKernel::CENTRAL_4,
                SeparableKernel::spline(Degree::Cubic),
                SeparableKernel::spline(Degree::Quintic),
            ]),
            operator in prop::sample::select(vec![EdgeOperator::SecondDerivative, EdgeOperator::Plus]),
        ) {
            let dims = [short[0], short[1], long.unwrap_or(short[2])];
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
            let coefficients = Coefficients::new(&field, degree).expect("fits");
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
