//! The inner loop: one row of voxels, all their neighbours.

use multiversion::multiversion;

use super::padded_box::{LANES, MISSING};
use super::range_weight::{FastWeight, exp_of_negative};

/// What a voxel and its neighbours count for, with fast weights.
#[derive(Clone, Debug)]
pub struct FastNeighbours {
    /// The weight of the voxel itself.
    own: f32,
    /// That of both neighbours of each pair of opposite ones.
    pairs: Vec<FastWeight>,
}

impl FastNeighbours {
    /// Pairs of spatial weights exp(−`exponent`), with v = `falloff`·difference².
    pub fn new(exponents: impl Iterator<Item = f64>, falloff: f64) -> Self {
        Self {
            own: FastWeight::new(0.0, falloff).at(0.0),
            pairs: exponents.map(|exponent| FastWeight::new(exponent, falloff)).collect(),
        }
    }
}

/// What a voxel and its neighbours count for, with exact weights.
#[derive(Clone, Debug)]
pub struct ExactNeighbours {
    /// Spatial weights of all neighbours, and of the voxel itself among them.
    pub spatial: Vec<f32>,
    /// Range weights are exp(−`falloff`·difference²).
    pub falloff: f32,
}

/// [`filter_row_fast_plainly`].
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
pub fn filter_row_fast(samples: &[f32], start: usize, shifts: &[isize], weights: &FastNeighbours, out: &mut [f32]) {
    filter_row_fast_plainly(samples, start, shifts, weights, out);
}

/// [`filter_row_exact_plainly`].
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
pub fn filter_row_exact(samples: &[f32], start: usize, shifts: &[isize], weights: &ExactNeighbours, out: &mut [f32]) {
    filter_row_exact_plainly(samples, start, shifts, weights, out);
}

/// Filters the samples from `start` on, as many as `out` holds: a multiple of [`LANES`]. `shifts` lead to the later
/// neighbour of each pair.
#[inline(always)]
fn filter_row_fast_plainly(samples: &[f32], start: usize, shifts: &[isize], weights: &FastNeighbours, out: &mut [f32]) {
    for (block, out) in out.chunks_exact_mut(LANES).enumerate() {
        let place = start + block * LANES;
        let center = lanes(samples, place);
        let (mut sums, mut totals) = ([0.0; LANES], [weights.own; LANES]);
        for (shift, weight) in shifts.iter().zip(&weights.pairs) {
            let shift = shift.unsigned_abs();
            let (later, earlier) = (lanes(samples, place + shift), lanes(samples, place - shift));
            for lane in 0..LANES {
                let (to_later, to_earlier) = (later[lane] - center[lane], earlier[lane] - center[lane]);
                let (weight_later, weight_earlier) = (weight.at(to_later), weight.at(to_earlier));
                // Opposite neighbours first, so that ramps stay ramps.
                sums[lane] += weight_later * to_later + weight_earlier * to_earlier;
                totals[lane] += weight_later + weight_earlier;
            }
        }
        for lane in 0..LANES {
            out[lane] = center[lane] + sums[lane] / totals[lane];
        }
    }
}

/// Filters the samples from `start` on, as many as `out` holds: a multiple of [`LANES`]. `shifts` lead to all neighbours, in
/// their order in memory.
#[inline(always)]
fn filter_row_exact_plainly(
    samples: &[f32],
    start: usize,
    shifts: &[isize],
    weights: &ExactNeighbours,
    out: &mut [f32],
) {
    for (block, out) in out.chunks_exact_mut(LANES).enumerate() {
        let place = start + block * LANES;
        let center = lanes(samples, place);
        let (mut sums, mut totals) = ([0.0; LANES], [0.0; LANES]);
        for (&shift, spatial) in shifts.iter().zip(&weights.spatial) {
            let other = lanes(samples, place.wrapping_add_signed(shift));
            for lane in 0..LANES {
                let difference = other[lane] - center[lane];
                let weight = spatial * exp_of_negative(difference * difference * weights.falloff);
                let weight = if other[lane] < MISSING { weight } else { 0.0 };
                sums[lane] += weight * difference;
                totals[lane] += weight;
            }
        }
        for lane in 0..LANES {
            out[lane] = center[lane] + sums[lane] / totals[lane];
        }
    }
}

#[inline(always)]
fn lanes(samples: &[f32], from: usize) -> &[f32; LANES] {
    samples[from..].first_chunk().expect("rows are filled up to whole blocks")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_processor_gives_the_same_bits() {
        let number = |index: u32| index.wrapping_mul(2_654_435_761) as f32 / u32::MAX as f32;
        let samples: Vec<f32> = (0..400).map(|index| 3.0 * number(index)).collect();
        let shifts: Vec<isize> = (1..60).collect();
        let spatial: Vec<f32> = (1..60).map(number).collect();
        let fast = FastNeighbours::new(spatial.iter().map(|&exponent| f64::from(exponent)), 0.3);
        let exact = ExactNeighbours { spatial, falloff: 0.3 };
        // Called from here, the plain ones are compiled for the baseline processor.
        let mut out = [[0.0; 2 * LANES]; 4];
        filter_row_fast_plainly(&samples, 100, &shifts, &fast, &mut out[0]);
        filter_row_fast(&samples, 100, &shifts, &fast, &mut out[1]);
        filter_row_exact_plainly(&samples, 100, &shifts, &exact, &mut out[2]);
        filter_row_exact(&samples, 100, &shifts, &exact, &mut out[3]);
        assert_eq!(out[0], out[1]);
        assert_eq!(out[2], out[3]);
    }
}
