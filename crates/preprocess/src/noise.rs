//! How noisy the value field is.

use rayon::prelude::*;

use crate::gaussian::{gaussian, radius_of};
use crate::working_field::{Field, WorkingField, voxels};

/// Residuals that are looked at: enough for the median to be right to 0.2 %.
const MOST_RESIDUALS: usize = 1 << 20;

/// How far apart, in voxels, the samples of the wider mask lie. Twice the mask's spacing makes it most sensitive at half of
/// the sampling's highest frequency, where central differences are.
const WIDE: usize = 2;

/// Standard deviation of the noise in the value field, in working units: of white noise, or of what noise there is at the
/// frequencies that derivatives let through, if that is more. Reconstruction and resampling leave scanners' noise smooth:
/// voxel by voxel it looks two to five times weaker than its derivatives show it to be.
#[must_use]
pub fn noise_sigma(field: &WorkingField) -> f32 {
    residual_sigma(field, 1).max(residual_sigma(field, WIDE))
}

/// Standard deviation of white noise before it was smoothed by Gaussians of the given σ, judging by a smoothed field and
/// the frequencies that derivatives of it let through.
#[must_use]
pub fn smoothed_noise_sigma(field: &WorkingField, sigmas: &[f32]) -> f32 {
    let gain = |axis: usize, masks: usize| response(sigmas, field.spacing[axis], masks);
    let masks = masks(field.dims(), WIDE);
    let along = |axis: usize| masks.iter().filter(|&&mask| mask == axis).count();
    let smoothed = (0..3).filter(|&axis| field.dims()[axis] > 1).map(|axis| gain(axis, along(axis))).product::<f32>();
    residual_sigma(field, WIDE) / smoothed
}

/// The norm of Gaussians and wide masks along an axis over that of the masks alone.
fn response(sigmas: &[f32], spacing: f32, masks: usize) -> f32 {
    let radii = sigmas.iter().map(|&sigma| radius_of(sigma, [spacing; 3]));
    let middle = radii.sum::<usize>() + 2 * WIDE * masks;
    let mut line = Field::zeros((1, 1, 2 * middle + 1));
    line[[0, 0, middle]] = 1.0;
    for &sigma in sigmas {
        line = gaussian(&line, [spacing; 3], sigma, radius_of(sigma, [spacing; 3]));
    }
    let strides = vec![WIDE; masks];
    let inner = WIDE * masks..2 * middle + 1 - WIDE * masks;
    let squares: f32 = inner.map(|at| residual(voxels(&line), at, &strides).powi(2)).sum();
    (squares / squared_weights(masks)).sqrt()
}

/// The squared weights of m masks along an axis add up to the central binomial coefficient of 4m.
fn squared_weights(masks: usize) -> f32 {
    [1.0, 6.0, 70.0, 924.0][masks]
}

/// Standard deviation of white noise in the value field, in working units.
///
/// The residual of the mask `(1, −2, 1)`, its samples `spread` voxels apart, along every axis that is long enough cancels
/// whatever is linear along any one of them, so edges hardly reach it (Immerkær, CVIU 64(2), 1996, in three dimensions; in
/// two the mask is applied twice along each axis, in one three times). Of the half of the voxels with the weaker gradient
/// (Tai and Yang, *A fast method for image noise estimation using Laplacian operator and adaptive edge detection*, ISCCSP
/// 2008), the median magnitude over 0.6745 is robust against the rest (Donoho and Johnstone, Biometrika 81(3), 1994).
/// Residuals of exactly 0 are left out: they come from padding and masked background, not from noise. 0 for a volume
/// without any other.
fn residual_sigma(field: &WorkingField, spread: usize) -> f32 {
    let dims @ [nx, ny, _] = field.dims();
    let source = voxels(&field.values);
    let masks = masks(dims, spread);
    if masks.is_empty() {
        return 0.0;
    }
    // Large volumes are looked at on a coarser lattice.
    let stride = (1..).find(|stride| dims.map(|dim| dim.div_ceil(*stride)).iter().product::<usize>() <= MOST_RESIDUALS);
    let stride = stride.unwrap_or(1);
    let counts = [0, 1, 2].map(|axis| masks.iter().filter(|mask| **mask == axis).count());
    let reach = counts.map(|count| count * spread);
    let inner = |axis: usize| (reach[axis]..dims[axis] - reach[axis]).step_by(if reach[axis] > 0 { stride } else { 1 });
    let strides: Vec<usize> = masks.iter().map(|&axis| [1, nx, nx * ny][axis] * spread).collect();
    let mut residuals: Vec<[f32; 2]> = inner(2)
        .collect::<Vec<_>>()
        .into_par_iter()
        .flat_map_iter(|k| inner(1).flat_map(move |j| inner(0).map(move |i| (k * ny + j) * nx + i)))
        .map(|voxel| [gradient(source, voxel, &strides), residual(source, voxel, &strides).abs()])
        .filter(|[_, residual]| *residual > 0.0)
        .collect();
    if residuals.is_empty() {
        return 0.0;
    }
    let half = residuals.len() / 2;
    residuals.select_nth_unstable_by(half, |a, b| a[0].total_cmp(&b[0]));
    residuals.truncate(half + 1);
    let middle = residuals.len() / 2;
    let (_, &mut [_, median], _) = residuals.select_nth_unstable_by(middle, |a, b| a[1].total_cmp(&b[1]));
    median / 0.6745 / counts.map(squared_weights).iter().product::<f32>().sqrt()
}

/// The axes along which a mask is applied, one after another.
fn masks(dims: [usize; 3], spread: usize) -> Vec<usize> {
    let axes: Vec<usize> = (0..3).filter(|&axis| dims[axis] > 2 * spread).collect();
    let wanted = [0, 3, 2, 1][axes.len()];
    let fitting = |axis: usize| wanted.min((dims[axis] - 1) / (2 * spread));
    axes.into_iter().flat_map(|axis| std::iter::repeat_n(axis, fitting(axis))).collect()
}

fn residual(source: &[f32], voxel: usize, strides: &[usize]) -> f32 {
    match strides {
        [] => source[voxel],
        [stride, rest @ ..] => {
            let along = |voxel: usize| residual(source, voxel, rest);
            (along(voxel - stride) + along(voxel + stride)) - 2.0 * along(voxel)
        }
    }
}

/// Squared magnitude of the differences across a voxel along the masks' axes.
fn gradient(source: &[f32], voxel: usize, strides: &[usize]) -> f32 {
    strides.iter().map(|stride| (source[voxel + stride] - source[voxel - stride]).powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use voxrole_pack::{GridGeometry, Scalars};

    use super::*;
    use crate::Grid;

    /// Nearly normal noise of deviation `sigma`: sums of eight uniform numbers, by a counter-based generator.
    fn noisy(sigma: f32, dims: [u32; 3], signal: impl Fn(u32) -> f32) -> WorkingField {
        let count = dims.iter().product::<u32>();
        let uniform = |counter: u64| {
            let mut hash = counter.wrapping_mul(0x9e37_79b9_7f4a_7c15);
            hash = (hash ^ (hash >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            hash = (hash ^ (hash >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((hash ^ (hash >> 31)) >> 40) as f32 / (1_u32 << 24) as f32 - 0.5
        };
        let values = (0..count).map(|voxel| {
            let sum: f32 = (0..8).map(|term| uniform(8 * u64::from(voxel) + term)).sum();
            signal(voxel) + sigma * sum * 1.5_f32.sqrt()
        });
        let grid = Grid::new("n", GridGeometry::axis_aligned(dims, [1.0; 3]), Scalars::F32(values.collect()));
        WorkingField::new(&grid.expect("a grid")).expect("a field")
    }

    #[test]
    fn recovers_the_noise_beside_edges_and_padding() {
        for (dims, tolerance) in [([32, 32, 32], 0.06), ([32, 1, 96], 0.12), ([4096, 1, 1], 0.1)] {
            // A line's mask is wide, so that fewer edges are as many.
            let period = if dims[1] == 1 && dims[2] == 1 { 512 } else { 32 };
            let field = noisy(0.02, dims, |voxel| if voxel % period < 13 { 0.0 } else { 0.9 });
            let found = f64::from(noise_sigma(&field)) * field.value_scale;
            assert!((found / 0.02 - 1.0).abs() < tolerance, "{dims:?}: {found}");
        }
    }

    #[test]
    fn smooth_noise_is_judged_by_what_derivatives_let_through() {
        let mut field = noisy(0.02, [48, 48, 48], |_| 0.0);
        let white = f64::from(noise_sigma(&field)) * field.value_scale;
        assert!((white / 0.02 - 1.0).abs() < 0.05, "{white}");
        field.values = gaussian(&field.values, [1.0; 3], 1.0, 4);
        // A single mask sees next to nothing of it, the wide one more.
        assert!(residual_sigma(&field, 1) < 0.2 * residual_sigma(&field, WIDE));
        let found = f64::from(smoothed_noise_sigma(&field, &[1.0])) * field.value_scale;
        assert!((found / 0.02 - 1.0).abs() < 0.06, "{found}");
    }

    #[test]
    fn a_clean_ramp_has_none() {
        assert_eq!(noise_sigma(&noisy(0.0, [8, 8, 8], |voxel| voxel as f32)), 0.0);
        assert_eq!(noise_sigma(&noisy(0.0, [2, 2, 2], |_| 1.0)), 0.0);
    }
}
