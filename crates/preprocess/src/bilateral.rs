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

    /// The naive twin, in f64, straight from the equations.
    fn naive(field: &Field, spacing: [f32; 3], settings: BilateralSettings) -> Vec<f64> {
        let (nz, ny, nx) = field.dim();
        let radius = settings.radius as isize;
        let mut out = Vec::new();
        for ((k, j, i), &center) in field.indexed_iter() {
            let (mut sum, mut total) = (0.0, 0.0);
            for dz in -radius..=radius {
                for dy in -radius..=radius {
                    for dx in -radius..=radius {
                        let place = [(k, dz, nz), (j, dy, ny), (i, dx, nx)]
                            .map(|(index, d, n)| index.checked_add_signed(d).filter(|&p| p < n));
                        let [Some(z), Some(y), Some(x)] = place else { continue };
                        let value = field[[z, y, x]];
                        if value.is_nan() {
                            continue;
                        }
                        let squared: f64 =
                            [dx, dy, dz].iter().zip(spacing).map(|(&d, h)| (d as f64 * f64::from(h)).powi(2)).sum();
                        let difference = f64::from(value) - f64::from(center);
                        let weight = (-0.5 * squared / f64::from(settings.spatial_sigma).powi(2)
                            - 0.5 * difference.powi(2) / f64::from(settings.range_sigma).powi(2))
                        .exp();
                        sum += weight * f64::from(value);
                        total += weight;
                    }
                }
            }
            out.push(if center.is_nan() { f64::NAN } else { sum / total });
        }
        out
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn equals_its_naive_twin(
            dims in prop::array::uniform3(1_usize..7),
            seed in any::<u32>(),
            range_sigma in 0.01_f32..2.0,
            radius in 1_usize..4,
            hole in any::<bool>(),
        ) {
            let [nz, ny, nx] = dims;
            let mut field = Array3::from_shape_fn((nz, ny, nx), |(k, j, i)| {
                let hash = ((k * 31 + j) * 31 + i) as u32 ^ seed;
                hash.wrapping_mul(2_654_435_761) as f32 / u32::MAX as f32
            });
            if hole {
                field[[nz / 2, ny / 2, nx / 2]] = f32::NAN;
            }
            let settings = BilateralSettings { spatial_sigma: 1.3, range_sigma, radius };
            let spacing = [1.0, 1.5, 3.0];
            let found = bilateral(&field, spacing, settings);
            for (&found, expected) in found.iter().zip(naive(&field, spacing, settings)) {
                prop_assert_eq!(found.is_nan(), expected.is_nan());
                prop_assert!(found.is_nan() || (f64::from(found) - expected).abs() < 2e-6, "{} {}", found, expected);
            }
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
