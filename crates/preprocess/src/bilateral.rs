//! The bilateral filter, brute force over a cut neighbourhood.

use ndarray::Array3;
use rayon::prelude::*;

use crate::working_field::{Field, dims_of, voxels, voxels_mut};

/// Width and reach of a bilateral filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BilateralSettings {
    /// σd in multiples of L_min; positive.
    pub spatial_sigma: f32,
    /// σr in the field's own units; 0 leaves the field as it is.
    pub range_sigma: f32,
    /// Neighbours on each side along each axis, in voxels.
    pub radius: usize,
}

/// Filters a field, eqs. (3)–(5) of the paper (Tomasi and Manduchi, ICCV 1998):
/// `h(x) = Σ Wd·Wr·h(y) / Σ Wd·Wr` with `Wd = exp(−‖x−y‖²/2σd²)` and `Wr = exp(−(h(x)−h(y))²/2σr²)`.
///
/// `spacing` is in multiples of L_min, so Wd is right on anisotropic grids. Neighbours outside the volume and NaN
/// neighbours have no weight; NaN voxels stay NaN. Weights that matter are right to 1e-6.
#[must_use]
pub fn bilateral(field: &Field, spacing: [f32; 3], settings: BilateralSettings) -> Field {
    if settings.range_sigma == 0.0 {
        return field.clone();
    }
    let dims @ [nx, ny, _] = dims_of(field);
    let neighbours = neighbours(dims, spacing, &settings);
    let falloff = 0.5 / (settings.range_sigma * settings.range_sigma);
    let source = voxels(field);
    let mut out: Field = Array3::zeros(field.dim());
    voxels_mut(&mut out).par_chunks_mut(nx).enumerate().for_each_init(
        || (vec![0.0; nx], vec![0.0; nx]),
        |(sums, weights), (row, out)| {
            let center = &source[row * nx..][..nx];
            sums.fill(0.0);
            weights.fill(0.0);
            let (j, k) = ((row % ny) as isize, (row / ny) as isize);
            for neighbour in &neighbours {
                let [_, y, z] = [neighbour.offset[0], neighbour.offset[1] + j, neighbour.offset[2] + k];
                if y < 0 || z < 0 || y >= ny as isize || z >= dims[2] as isize {
                    continue;
                }
                let other = &source[(z as usize * ny + y as usize) * nx..][..nx];
                let shift = neighbour.offset[0];
                let (to, from) = ((-shift).max(0) as usize, shift.max(0) as usize);
                let len = nx - shift.unsigned_abs();
                accumulate(
                    &mut sums[to..to + len],
                    &mut weights[to..to + len],
                    &center[to..to + len],
                    &other[from..from + len],
                    neighbour.weight,
                    falloff,
                );
            }
            for (((out, &center), &sum), &weight) in out.iter_mut().zip(center).zip(&*sums).zip(&*weights) {
                *out = center + sum / weight;
            }
        },
    );
    out
}

struct Neighbour {
    offset: [isize; 3],
    weight: f32,
}

fn neighbours(dims: [usize; 3], spacing: [f32; 3], settings: &BilateralSettings) -> Vec<Neighbour> {
    let reach = dims.map(|dim| settings.radius.min(dim - 1) as isize);
    let mut all = Vec::new();
    for z in -reach[2]..=reach[2] {
        for y in -reach[1]..=reach[1] {
            for x in -reach[0]..=reach[0] {
                let offset = [x, y, z];
                let squared: f32 = offset.iter().zip(spacing).map(|(&steps, h)| (steps as f32 * h).powi(2)).sum();
                let weight = (-0.5 * squared / settings.spatial_sigma.powi(2)).exp();
                all.push(Neighbour { offset, weight });
            }
        }
    }
    all
}

/// Adds one neighbour of every voxel of a row: differences to the centre and weights, so that flat regions stay exact.
fn accumulate(sums: &mut [f32], weights: &mut [f32], center: &[f32], other: &[f32], spatial: f32, falloff: f32) {
    for (((sum, weight), &center), &other) in sums.iter_mut().zip(weights).zip(center).zip(other) {
        let difference = other - center;
        let known = !other.is_nan();
        let both = spatial * exp_of_negative(difference * difference * falloff);
        *sum += if known { both * difference } else { 0.0 };
        *weight += if known { both } else { 0.0 };
    }
}

/// `exp(−x)` for x ≥ 0 with a relative error below `(3 + x)·1e-7`; beyond x = 86, below 1e-37. Written so that it
/// vectorises.
#[inline(always)]
fn exp_of_negative(x: f32) -> f32 {
    /// Adding 1.5·2²³ leaves a number's nearest integer in its low bits.
    const ROUND: f32 = 12_582_912.0;
    let exponent = (x * std::f32::consts::LOG2_E).min(124.0);
    let rounded = exponent + ROUND;
    let rest = (rounded - ROUND - exponent) * std::f32::consts::LN_2;
    // Taylor's series on ±ln2/2, where its next term is below 1.3e-7.
    let series = 1.0
        + rest * (1.0 + rest * (0.5 + rest * (1.0 / 6.0 + rest * (1.0 / 24.0 + rest * (1.0 / 120.0 + rest / 720.0)))));
    series * f32::from_bits(0x3f80_0000_u32.wrapping_sub(rounded.to_bits() << 23))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::naive_mean::{SPACING, check_against_naive, fields, naive_mean};

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn equals_its_naive_twin(field in fields(), range_sigma in 0.01_f32..2.0, radius in 1_usize..4) {
            let settings = BilateralSettings { spatial_sigma: 1.3, range_sigma, radius };
            let found = bilateral(&field, SPACING, settings);
            let [by_distance, by_value] =
                [settings.spatial_sigma, range_sigma].map(|sigma| -0.5 / f64::from(sigma).powi(2));
            let expected = naive_mean(&field, radius, |squared, difference| {
                (by_distance * squared + by_value * difference * difference).exp()
            });
            check_against_naive(&found, &expected)?;
        }
    }

    #[test]
    fn exponential_is_accurate() {
        for i in 0..=85_000 {
            let x = i as f32 / 1000.0;
            let exact = (-f64::from(x)).exp();
            let error = (f64::from(exp_of_negative(x)) / exact - 1.0).abs();
            assert!(error < (3.0 + f64::from(x)) * 1e-7, "{x}: {error}");
        }
        assert!(exp_of_negative(1e30) < 1e-37);
    }

    #[test]
    fn an_edge_survives_where_a_gaussian_would_blur_it() {
        let field = Array3::from_shape_fn((1, 1, 16), |(_, _, i)| if i < 8 { 0.0 } else { 1.0 });
        let settings = BilateralSettings { spatial_sigma: 1.0, range_sigma: 0.1, radius: 2 };
        let found = bilateral(&field, [1.0; 3], settings);
        assert!(found.iter().zip(&field).all(|(found, &value)| (found - value).abs() < 1e-20), "{found}");
    }
}
