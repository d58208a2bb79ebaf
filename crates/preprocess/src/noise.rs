//! How noisy the value field is.

use std::ops::Range;

use rayon::prelude::*;

use crate::Result;
use crate::gaussian::{gaussian, radius_of};
use crate::region::{Region, lattice_stride};
use crate::working_field::{Field, WorkingField, voxels};

/// Residuals that are looked at: enough for the median to be right to 0.2 %.
const MOST_RESIDUALS: usize = 1 << 20;

/// The median magnitude of normal numbers of deviation 1.
pub(crate) const NORMAL_MEDIAN: f32 = 0.6745;

/// How far apart, in voxels, the samples of the wider mask lie. Twice the mask's spacing makes it most sensitive at half of
/// the sampling's highest frequency, where central differences are.
const WIDE: usize = 2;

/// Standard deviation of the noise in the value field, in working units: of white noise, or of what noise there is at the
/// frequencies that derivatives let through, if that is more. Reconstruction and resampling leave scanners' noise smooth:
/// voxel by voxel it looks two to five times weaker than its derivatives show it to be.
#[must_use]
pub fn noise_sigma(field: &WorkingField) -> f32 {
    [1, WIDE].map(|spread| residual_sigma(&[field], spread)).into_iter().fold(0.0, f32::max)
}

/// [`noise_sigma`] of a volume of `dims` voxels that is read in slabs of whole slices, about `slices` at a time: the same
/// to the last bit.
///
/// # Errors
/// Whatever reading says.
pub fn noise_sigma_of_slabs(
    dims: [usize; 3],
    slices: usize,
    mut read: impl FnMut(&Region) -> Result<WorkingField>,
) -> Result<f32> {
    let stride = lattice_stride(&[dims], MOST_RESIDUALS);
    let mut estimates = [1, WIDE].map(|spread| (Masks::new(dims, spread), Vec::new()));
    let reach = estimates.iter().map(|(masks, _)| masks.reach[2]).max().unwrap_or(0);
    for first in (0..dims[2]).step_by(slices.max(1)) {
        let part = first..(first + slices.max(1)).min(dims[2]);
        let lattice = estimates
            .each_ref()
            .map(|(masks, _)| masks.inner(2, dims, stride).filter(|k| part.contains(k)).collect::<Vec<_>>());
        if lattice.iter().all(Vec::is_empty) {
            continue;
        }
        let slab = Region { start: [0, 0, part.start], end: [dims[0], dims[1], part.end] };
        let slab = slab.grown([0, 0, reach], dims);
        let field = read(&slab)?;
        for ((masks, residuals), lattice) in estimates.iter_mut().zip(&lattice) {
            masks.collect(&field, slab.start[2], lattice, dims, stride, residuals);
        }
    }
    Ok(estimates.into_iter().map(|(masks, residuals)| masks.sigma(residuals)).fold(0.0, f32::max))
}

/// Standard deviation of white noise before it was smoothed by Gaussians of the given σ, judging by smoothed parts of a volume
/// and the frequencies that derivatives of them let through.
#[must_use]
pub fn smoothed_noise_sigma(fields: &[&WorkingField], sigmas: &[f32]) -> f32 {
    let Some(field) = fields.first() else { return 0.0 };
    residual_sigma(fields, WIDE) / VoxelMasks::new(field.dims(), WIDE).gain_of_gaussians(field.spacing, sigmas)
}

/// Masks with samples `spread` voxels apart, at single voxels.
pub(crate) struct VoxelMasks {
    masks: Masks,
    dims: [usize; 3],
    strides: Vec<usize>,
}

impl VoxelMasks {
    pub(crate) fn new(dims: [usize; 3], spread: usize) -> Self {
        let masks = Masks::new(dims, spread);
        let strides = masks.strides(dims);
        Self { masks, dims, strides }
    }

    /// The places along an axis that they can be applied at: none where the volume is too small for any.
    pub(crate) fn inner(&self, axis: usize) -> Range<usize> {
        let reach = self.masks.reach[axis];
        if self.strides.is_empty() { 0..0 } else { reach..self.dims[axis] - reach }
    }

    /// What they leave around a voxel.
    #[inline]
    pub(crate) fn residual(&self, source: &[f32], voxel: usize) -> f32 {
        residual(source, voxel, &self.strides).abs()
    }

    /// The deviation of what they leave of white noise of deviation 1 after Gaussians of the given σ.
    pub(crate) fn gain(&self, spacing: [f32; 3], sigmas: &[f32]) -> f32 {
        self.masks.gain() * self.gain_of_gaussians(spacing, sigmas)
    }

    /// That over the one without Gaussians.
    fn gain_of_gaussians(&self, spacing: [f32; 3], sigmas: &[f32]) -> f32 {
        let along = |axis: usize| self.masks.axes.iter().filter(|&&mask| mask == axis).count();
        let gain = |axis: usize| response(sigmas, spacing[axis], self.masks.spread, along(axis));
        (0..3).filter(|&axis| self.dims[axis] > 1).map(gain).product::<f32>()
    }
}

/// The norm of Gaussians and masks along an axis over that of the masks alone.
fn response(sigmas: &[f32], spacing: f32, spread: usize, masks: usize) -> f32 {
    let radii = sigmas.iter().map(|&sigma| radius_of(sigma, [spacing; 3]));
    let middle = radii.sum::<usize>() + 2 * spread * masks;
    let mut line = Field::zeros((1, 1, 2 * middle + 1));
    line[[0, 0, middle]] = 1.0;
    for &sigma in sigmas {
        line = gaussian(&line, [spacing; 3], sigma, radius_of(sigma, [spacing; 3]));
    }
    let strides = vec![spread; masks];
    let inner = spread * masks..2 * middle + 1 - spread * masks;
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
fn residual_sigma(fields: &[&WorkingField], spread: usize) -> f32 {
    let dims: Vec<_> = fields.iter().map(|field| field.dims()).collect();
    let stride = lattice_stride(&dims, MOST_RESIDUALS);
    let mut residuals = Vec::new();
    for (field, &dims) in fields.iter().zip(&dims) {
        let masks = Masks::new(dims, spread);
        let slices: Vec<_> = masks.inner(2, dims, stride).collect();
        masks.collect(field, 0, &slices, dims, stride, &mut residuals);
    }
    dims.first().map_or(0.0, |&dims| Masks::new(dims, spread).sigma(residuals))
}

/// The masks that leave noise alone.
struct Masks {
    /// The axis of every mask.
    axes: Vec<usize>,
    spread: usize,
    /// Voxels that they reach along each axis.
    reach: [usize; 3],
}

impl Masks {
    fn new(dims: [usize; 3], spread: usize) -> Self {
        let axes = masks(dims, spread);
        let reach = [0, 1, 2].map(|axis| axes.iter().filter(|&&mask| mask == axis).count() * spread);
        Self { axes, spread, reach }
    }

    /// The places along an axis that are looked at.
    fn inner(&self, axis: usize, dims: [usize; 3], stride: usize) -> impl Iterator<Item = usize> + Clone + use<> {
        let reach = self.reach[axis];
        (reach..dims[axis] - reach).step_by(if reach > 0 { stride } else { 1 })
    }

    /// Adds gradients and residuals in some slices of a volume of `dims` voxels; `field` has the slices from `first` on.
    fn collect(
        &self,
        field: &WorkingField,
        first: usize,
        slices: &[usize],
        dims: [usize; 3],
        stride: usize,
        residuals: &mut Vec<[f32; 2]>,
    ) {
        let [nx, ny, _] = dims;
        if self.axes.is_empty() {
            return;
        }
        let source = voxels(&field.values);
        let strides = self.strides(dims);
        let (along_x, along_y) = (self.inner(0, dims, stride), self.inner(1, dims, stride));
        residuals.par_extend(
            slices
                .par_iter()
                .flat_map_iter(|k| {
                    let (along_x, along_y) = (along_x.clone(), along_y.clone());
                    along_y.flat_map(move |j| along_x.clone().map(move |i| ((k - first) * ny + j) * nx + i))
                })
                .map(|voxel| [gradient(source, voxel, &strides), residual(source, voxel, &strides).abs()])
                .filter(|[_, residual]| *residual > 0.0),
        );
    }

    /// The deviation that gradients and residuals speak of.
    fn sigma(&self, mut residuals: Vec<[f32; 2]>) -> f32 {
        if residuals.is_empty() {
            return 0.0;
        }
        let half = residuals.len() / 2;
        residuals.select_nth_unstable_by(half, |a, b| a[0].total_cmp(&b[0]));
        residuals.truncate(half + 1);
        let middle = residuals.len() / 2;
        let (_, &mut [_, median], _) = residuals.select_nth_unstable_by(middle, |a, b| a[1].total_cmp(&b[1]));
        median / NORMAL_MEDIAN / self.gain()
    }

    /// The norm of all masks.
    fn gain(&self) -> f32 {
        self.reach.map(|reach| squared_weights(reach / self.spread)).iter().product::<f32>().sqrt()
    }

    /// What leads to the next sample of each mask.
    fn strides(&self, [nx, ny, _]: [usize; 3]) -> Vec<usize> {
        self.axes.iter().map(|&axis| [1, nx, nx * ny][axis] * self.spread).collect()
    }
}

/// The axes along which a mask is applied, one after another.
fn masks(dims: [usize; 3], spread: usize) -> Vec<usize> {
    let axes: Vec<usize> = (0..3).filter(|&axis| dims[axis] > 2 * spread).collect();
    let wanted = [0, 3, 2, 1][axes.len()];
    let fitting = |axis: usize| wanted.min((dims[axis] - 1) / (2 * spread));
    axes.into_iter().flat_map(|axis| std::iter::repeat_n(axis, fitting(axis))).collect()
}

/// What the masks leave of the values around a voxel; `strides` lead to the next sample of each mask.
fn residual(source: &[f32], voxel: usize, strides: &[usize]) -> f32 {
    match strides {
        // Volumes have one mask along each axis: spelled out, the estimate takes a third of the time.
        &[x, y, z] => {
            let line = |voxel: usize| mask([source[voxel - z], source[voxel], source[voxel + z]]);
            let plane = |voxel: usize| mask([line(voxel - y), line(voxel), line(voxel + y)]);
            mask([plane(voxel - x), plane(voxel), plane(voxel + x)])
        }
        _ => residual_of_any(source, voxel, strides),
    }
}

/// [`residual`] for any number of masks.
fn residual_of_any(source: &[f32], voxel: usize, strides: &[usize]) -> f32 {
    match strides {
        [] => source[voxel],
        [stride, rest @ ..] => {
            mask([voxel - stride, voxel, voxel + stride].map(|voxel| residual_of_any(source, voxel, rest)))
        }
    }
}

fn mask([below, own, above]: [f32; 3]) -> f32 {
    (below + above) - 2.0 * own
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
    use crate::phantom::NoiseKind;

    /// A signal under noise of deviation `sigma`.
    fn noisy(sigma: f32, dims: [u32; 3], signal: impl Fn(u32) -> f32) -> WorkingField {
        let count = dims.iter().product::<u32>();
        let values = (0..count).map(|voxel| {
            let value = f64::from(signal(voxel));
            NoiseKind::Gaussian.apply(value, f64::from(sigma), 1, u64::from(voxel)) as f32
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
        assert!(residual_sigma(&[&field], 1) < 0.2 * residual_sigma(&[&field], WIDE));
        let found = f64::from(smoothed_noise_sigma(&[&field], &[1.0])) * field.value_scale;
        assert!((found / 0.02 - 1.0).abs() < 0.06, "{found}");
    }

    #[test]
    fn three_masks_spelled_out_are_three_masks() {
        let field = noisy(0.3, [9, 8, 7], |voxel| voxel as f32 / 99.0);
        let source = voxels(&field.values);
        for (voxel, strides) in [(9 * 8 + 9 + 1, [1, 9, 72]), (9 * 8 * 3 + 9 * 4 + 4, [2, 18, 144])] {
            assert_eq!(residual(source, voxel, &strides), residual_of_any(source, voxel, &strides));
        }
    }

    #[test]
    fn a_clean_ramp_has_none() {
        assert_eq!(noise_sigma(&noisy(0.0, [8, 8, 8], |voxel| voxel as f32)), 0.0);
        assert_eq!(noise_sigma(&noisy(0.0, [2, 2, 2], |_| 1.0)), 0.0);
    }

    #[test]
    fn slabs_give_what_the_whole_gives() {
        for dims in [[20, 17, 40], [130, 120, 90], [30, 1, 9], [1, 1, 50], [40, 9, 2]] {
            let field = noisy(0.3, dims, |voxel| (voxel % 7) as f32);
            let expected = noise_sigma(&field);
            for slices in [1, 3, 64] {
                let dims = field.dims();
                let read = |slab: &Region| {
                    let values = slab.crop(voxels(&field.values), dims).into_owned();
                    let [nx, ny, nz] = slab.dims();
                    let values = Field::from_shape_vec((nz, ny, nx), values).expect("a slab");
                    Ok(WorkingField { values, ..field.clone() })
                };
                assert_eq!(noise_sigma_of_slabs(dims, slices, read).expect("reads"), expected, "{dims:?} {slices}");
            }
        }
    }
}
