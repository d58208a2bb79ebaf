//! How noisy the value field is.

use rayon::prelude::*;

use crate::working_field::{WorkingField, voxels};

/// Residuals that are looked at: enough for the median to be right to 0.2 %.
const MOST_RESIDUALS: usize = 1 << 20;

/// Standard deviation of white noise in the value field, in working units.
///
/// The residual of the mask `(1, −2, 1)` along every axis that has three samples cancels whatever is linear along any one
/// of them, so edges hardly reach it (Immerkær, CVIU 64(2), 1996, in three dimensions; in two the mask is applied twice
/// along each axis, in one three times). Its median magnitude over 0.6745 is robust against those that do (Donoho and
/// Johnstone, Biometrika 81(3), 1994). Residuals of exactly 0 are left out: they come from padding and masked background,
/// not from noise. 0 for a volume without any other.
#[must_use]
pub fn noise_sigma(field: &WorkingField) -> f32 {
    let dims @ [nx, ny, _] = field.dims();
    let source = voxels(&field.values);
    let masks = masks(dims);
    if masks.is_empty() {
        return 0.0;
    }
    // Large volumes are looked at on a coarser lattice.
    let stride = (1..).find(|stride| dims.map(|dim| dim.div_ceil(*stride)).iter().product::<usize>() <= MOST_RESIDUALS);
    let stride = stride.unwrap_or(1);
    let reach = [0, 1, 2].map(|axis| masks.iter().filter(|mask| **mask == axis).count());
    let inner = |axis: usize| (reach[axis]..dims[axis] - reach[axis]).step_by(if reach[axis] > 0 { stride } else { 1 });
    let strides: Vec<usize> = masks.iter().map(|&axis| [1, nx, nx * ny][axis]).collect();
    let mut residuals: Vec<f32> = inner(2)
        .collect::<Vec<_>>()
        .into_par_iter()
        .flat_map_iter(|k| inner(1).flat_map(move |j| inner(0).map(move |i| (k * ny + j) * nx + i)))
        .map(|voxel| residual(source, voxel, &strides).abs())
        .filter(|&residual| residual > 0.0)
        .collect();
    if residuals.is_empty() {
        return 0.0;
    }
    let middle = residuals.len() / 2;
    let (_, &mut median, _) = residuals.select_nth_unstable_by(middle, f32::total_cmp);
    // The squared weights of m masks along an axis add up to the central binomial coefficient of 4m.
    let squared: f32 = reach.map(|count| [1.0, 6.0, 70.0, 924.0][count]).iter().product();
    median / 0.6745 / squared.sqrt()
}

/// The axes along which a mask is applied, one after another.
fn masks(dims: [usize; 3]) -> Vec<usize> {
    let axes: Vec<usize> = (0..3).filter(|&axis| dims[axis] >= 3).collect();
    let wanted = [0, 3, 2, 1][axes.len()];
    axes.into_iter().flat_map(|axis| std::iter::repeat_n(axis, wanted.min((dims[axis] - 1) / 2))).collect()
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

#[cfg(test)]
mod tests {
    use voxrole_pack::{GridGeometry, Scalars};

    use super::*;
    use crate::Grid;

    /// Uniform noise of unit variance times `sigma`, by a counter-based generator.
    fn noisy(sigma: f32, dims: [u32; 3], signal: impl Fn(u32) -> f32) -> WorkingField {
        let count = dims.iter().product::<u32>();
        let values = (0..count).map(|voxel| {
            let mut hash = u64::from(voxel).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            hash = (hash ^ (hash >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            hash = (hash ^ (hash >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            let uniform = ((hash ^ (hash >> 31)) >> 40) as f32 / (1_u32 << 24) as f32 - 0.5;
            signal(voxel) + sigma * uniform * 12.0_f32.sqrt()
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
    fn a_clean_ramp_has_none() {
        assert_eq!(noise_sigma(&noisy(0.0, [8, 8, 8], |voxel| voxel as f32)), 0.0);
        assert_eq!(noise_sigma(&noisy(0.0, [2, 2, 2], |_| 1.0)), 0.0);
    }
}
