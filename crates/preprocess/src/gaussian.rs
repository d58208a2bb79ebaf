//! Gaussian smoothing of the value field.

use rayon::prelude::*;

use crate::holes::Holes;
use crate::working_field::{Field, dims_of, voxels, voxels_mut};

/// How many σ a Gaussian is cut away at unless told otherwise: 6e-5 of its weight lie beyond.
const REACH_IN_SIGMAS: f32 = 4.0;

/// The radius in voxels that holds a Gaussian of `sigma`, in multiples of L_min as is `spacing`, along the finest axis.
#[must_use]
pub fn radius_of(sigma: f32, spacing: [f32; 3]) -> usize {
    let finest = spacing.into_iter().fold(f32::INFINITY, f32::min);
    (REACH_IN_SIGMAS * sigma / finest).ceil().max(1.0) as usize
}

/// Convolves with a Gaussian of `sigma` (in multiples of L_min, as is `spacing`), cut `radius` voxels away.
///
/// Where the Gaussian reaches beyond a face, its weights inside are tilted so that they still fit a ramp exactly (local
/// linear regression: Fan, *Design-adaptive nonparametric regression*, JASA 87, 1992): constants and ramps stay what they
/// are to the last voxel, and noise is averaged there too. NaN voxels stay NaN; for their neighbours they are filled from
/// their rims ([`Holes`]).
#[must_use]
pub fn gaussian(field: &Field, spacing: [f32; 3], sigma: f32, radius: usize) -> Field {
    let mut smooth = field.clone();
    let holes = Holes::fill(&mut smooth);
    let mut other = smooth.clone();
    for (axis, len) in dims_of(field).into_iter().enumerate() {
        if len > 1 {
            let kernel = LineKernel::new(spacing[axis] / sigma, radius, len);
            convolve(&smooth, &mut other, axis, &kernel);
            std::mem::swap(&mut smooth, &mut other);
        }
    }
    holes.mask(&mut smooth, 0);
    smooth
}

/// A Gaussian along lines of one length.
struct LineKernel {
    /// Weights from the middle outwards, their sum over both sides 1.
    half: Vec<f32>,
    len: usize,
}

impl LineKernel {
    /// `spacing` in multiples of σ.
    fn new(spacing: f32, radius: usize, len: usize) -> Self {
        let half: Vec<f32> = (0..=radius).map(|steps| (-0.5 * (steps as f32 * spacing).powi(2)).exp()).collect();
        let total = 2.0 * half.iter().sum::<f32>() - half[0];
        Self { half: half.into_iter().map(|weight| weight / total).collect(), len }
    }

    /// Samples whose whole neighbourhood lies inside.
    fn interior(&self) -> std::ops::Range<usize> {
        let radius = self.half.len() - 1;
        let end = self.len.saturating_sub(radius);
        if radius < end { radius..end } else { 0..0 }
    }

    /// The weights of all samples inside for the one at `at`: the Gaussian's, times the straight line that makes their sum 1
    /// and their mean place `at` itself.
    fn weights_at(&self, at: usize) -> Vec<f32> {
        let reach = self.half.len() - 1;
        let offset = |index: usize| index as f64 - at as f64;
        let gaussian: Vec<f64> = (0..self.len)
            .map(|index| if at.abs_diff(index) <= reach { f64::from(self.half[at.abs_diff(index)]) } else { 0.0 })
            .collect();
        let moment = |power: i32| -> f64 {
            gaussian.iter().enumerate().map(|(index, weight)| weight * offset(index).powi(power)).sum()
        };
        let [sum, first, second] = [moment(0), moment(1), moment(2)];
        // Σ w = 1 and Σ w·offset = 0 with w = gaussian · (constant + slope · offset).
        let determinant = sum * second - first * first;
        // A Gaussian too narrow for its neighbours to weigh anything changes nothing.
        let [constant, slope] =
            if determinant > 0.0 { [second / determinant, -first / determinant] } else { [sum.recip(), 0.0] };
        gaussian
            .iter()
            .enumerate()
            .map(|(index, weight)| (weight * (constant + slope * offset(index))) as f32)
            .collect()
    }

    /// The weights of every sample near an end.
    fn border(&self) -> Vec<(usize, Vec<f32>)> {
        let interior = self.interior();
        (0..self.len).filter(|at| !interior.contains(at)).map(|at| (at, self.weights_at(at))).collect()
    }
}

fn convolve(source: &Field, target: &mut Field, axis: usize, kernel: &LineKernel) {
    let [nx, ny, _] = dims_of(source);
    let source = voxels(source);
    let border = kernel.border();
    let interior = kernel.interior();
    voxels_mut(target).par_chunks_mut(nx).enumerate().for_each(|(row, out)| {
        let (j, k) = (row % ny, row / ny);
        let row_at = |j: usize, k: usize| &source[(k * ny + j) * nx..][..nx];
        match axis {
            0 => along_row(out, row_at(j, k), kernel, &border),
            1 => across_rows(out, |j| row_at(j, k), j, kernel, &border, &interior),
            _ => across_rows(out, |k| row_at(j, k), k, kernel, &border, &interior),
        }
    });
}

fn along_row(out: &mut [f32], row: &[f32], kernel: &LineKernel, border: &[(usize, Vec<f32>)]) {
    let interior = kernel.interior();
    if !interior.is_empty() {
        accumulate(&mut out[interior.clone()], kernel, |offset| {
            &row[interior.start.wrapping_add_signed(offset)..][..interior.len()]
        });
    }
    for (at, weights) in border {
        out[*at] = weights.iter().zip(row).map(|(weight, value)| weight * value).sum();
    }
}

fn across_rows<'a>(
    out: &mut [f32],
    row: impl Fn(usize) -> &'a [f32],
    at: usize,
    kernel: &LineKernel,
    border: &[(usize, Vec<f32>)],
    interior: &std::ops::Range<usize>,
) {
    if interior.contains(&at) {
        accumulate(out, kernel, |offset| row(at.wrapping_add_signed(offset)));
        return;
    }
    out.fill(0.0);
    let weights = border.iter().find(|(place, _)| *place == at).map_or(&[] as &[f32], |(_, weights)| weights);
    for (index, &weight) in weights.iter().enumerate().filter(|(_, weight)| **weight != 0.0) {
        out.iter_mut().zip(row(index)).for_each(|(out, value)| *out += weight * value);
    }
}

/// The kernel's sum over `line(offset)` for offsets up to its radius; both sides first, so that mirroring the axis changes
/// no bit.
fn accumulate<'a>(out: &mut [f32], kernel: &LineKernel, line: impl Fn(isize) -> &'a [f32]) {
    out.iter_mut().zip(line(0)).for_each(|(out, value)| *out = kernel.half[0] * value);
    for (steps, weight) in kernel.half.iter().enumerate().skip(1) {
        let (below, above) = (line(-(steps as isize)), line(steps as isize));
        out.iter_mut().zip(below).zip(above).for_each(|((out, below), above)| *out += weight * (below + above));
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::naive_mean::{SPACING, check_against_naive, fields};

    /// The naive twin: at every voxel the weighted least-squares plane's value, from the normal equations of all samples
    /// around it. The kernel is separable, and so is the plane on a box of samples.
    fn naive(field: &Field, sigma: f32, radius: usize) -> Vec<f64> {
        let mut filled = field.clone();
        Holes::fill(&mut filled);
        let (nz, ny, nx) = field.dim();
        let axis = |at: usize, len: usize, spacing: f32| -> Vec<(usize, f64)> {
            let inside = at.saturating_sub(radius)..(at + radius + 1).min(len);
            let place = |index: usize| (index as f64 - at as f64) * f64::from(spacing);
            let gaussian = |index: usize| (-0.5 * (place(index) / f64::from(sigma)).powi(2)).exp();
            let moment = |power| inside.clone().map(|index| gaussian(index) * place(index).powi(power)).sum::<f64>();
            let [sum, first, second] = [moment(0), moment(1), moment(2)];
            let tilt = if len == 1 { 0.0 } else { first / second };
            let total = sum - tilt * first;
            inside.clone().map(|index| (index, gaussian(index) * (1.0 - tilt * place(index)) / total)).collect()
        };
        let mean = |((k, j, i), &center): ((usize, usize, usize), &f32)| {
            let [x, y, z] = [axis(i, nx, SPACING[0]), axis(j, ny, SPACING[1]), axis(k, nz, SPACING[2])];
            let mut sum = 0.0;
            for (k, weight_z) in &z {
                for (j, weight_y) in &y {
                    for (i, weight_x) in &x {
                        sum += weight_x * weight_y * weight_z * f64::from(filled[[*k, *j, *i]]);
                    }
                }
            }
            if center.is_nan() { f64::NAN } else { sum }
        };
        field.indexed_iter().map(mean).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn equals_its_naive_twin(field in fields(), radius in 1_usize..4) {
            let found = gaussian(&field, SPACING, 1.2, radius);
            check_against_naive(&found, &naive(&field, 1.2, radius))?;
        }
    }

    #[test]
    fn ramps_stay_ramps_up_to_the_faces() {
        let field = Field::from_shape_fn((4, 6, 9), |(k, j, i)| i as f32 - 0.5 * j as f32 + 0.25 * k as f32);
        let smooth = gaussian(&field, [1.0, 1.5, 2.0], 2.0, 8);
        for (found, expected) in smooth.iter().zip(&field) {
            assert!((found - expected).abs() < 1e-5, "{found} {expected}");
        }
    }

    #[test]
    fn a_gaussian_narrower_than_a_voxel_changes_nothing() {
        let field = Field::from_shape_fn((7, 5, 6), |(k, j, i)| ((k * 5 + j * 3 + i * 7) % 11) as f32);
        for sigma in [0.3, 0.05, 0.01] {
            let smooth = gaussian(&field, [1.0, 8.0, 30.0], sigma, 4);
            let moved = smooth.iter().zip(&field).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(if sigma < 0.1 { moved < 1e-5 } else { moved < 0.1 }, "{sigma}: {moved}");
        }
    }

    #[test]
    fn the_radius_holds_the_gaussian_along_the_finest_axis() {
        assert_eq!(radius_of(1.5, [1.0, 2.0, 3.0]), 6);
        assert_eq!(radius_of(0.1, [1.0; 3]), 1);
    }
}
