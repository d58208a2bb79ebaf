//! The eight voxels around each of sixteen places.

// No iterators and closures in vector code: what std calls might be compiled without the level's instructions.
#![allow(clippy::needless_range_loop, reason = "see above")]

use fearless_simd::{Bytes, Select, Simd, SimdBase, SimdFloat, SimdInt, f32x16, i32x16, mask32x16, u32x16};
use voxrole_pack::DistanceQuantization;
use voxrole_pack::quantization::NO_NORMAL;

use super::gathers::texel_pairs;
use super::lanes::{Directions, splat};
use super::sampling::Sampler;
use crate::classify::opacity::GRADIENT_BINS;

/// Places between voxels.
#[derive(Clone, Copy)]
pub(super) struct Places<S: Simd> {
    /// The lowest voxel of each one's cell.
    pub(super) cells: [u32x16<S>; 3],
    /// Where in the cell the place lies, 0 to 1 along each axis.
    pub(super) fractions: Directions<S>,
}

/// What is stored around them, and its trilinear weights; x fastest.
pub(super) struct Corners<S: Simd> {
    /// Value and distance in the halves of 32 bits.
    low: [u32x16<S>; 8],
    /// Gradient magnitude and normal.
    high: [u32x16<S>; 8],
    pub(super) weights: [f32x16<S>; 8],
}

impl<S: Simd> Corners<S> {
    /// Reads them.
    #[inline(always)]
    pub(super) fn read(simd: S, sampler: &Sampler<'_>, places: &Places<S>) -> Self {
        let zero = u32x16::splat(simd, 0);
        let (mut low, mut high) = ([zero; 8], [zero; 8]);
        let firsts = sampler.firsts(places);
        for row in 0..4 {
            let words = texel_pairs(simd, sampler.texels(), &firsts, sampler.offsets[row], sampler.is_one_wide);
            [low[2 * row], high[2 * row], low[2 * row + 1], high[2 * row + 1]] = words;
        }
        let [x, y, z] = places.fractions;
        let sides = [[1.0 - x, x], [1.0 - y, y], [1.0 - z, z]];
        let mut weights = [splat(simd, 0.0); 8];
        for corner in 0..8 {
            weights[corner] = sides[0][corner & 1] * sides[1][corner >> 1 & 1] * sides[2][corner >> 2];
        }
        Self { low, high, weights }
    }

    /// Interpolated values, 0 to 65535.
    #[inline(always)]
    pub(super) fn value(&self, simd: S) -> f32x16<S> {
        let mut value = splat(simd, 0.0);
        for corner in 0..8 {
            value += self.weights[corner] * (self.low[corner] & 0xffff).to_float::<f32x16<S>>();
        }
        value
    }

    /// Signed distances of a corner as they are stored: see [`DistanceQuantization`].
    #[inline(always)]
    pub(super) fn distances(&self, corner: usize) -> i32x16<S> {
        self.low[corner].bitcast::<i32x16<S>>() >> 16
    }

    /// Gradient magnitudes at the hit as they are stored, 0 for none.
    #[inline(always)]
    pub(super) fn gradients(&self, corner: usize) -> u32x16<S> {
        self.high[corner] & 0xffff
    }

    /// As [`crate::VolumeTexels::has_hit`].
    #[inline(always)]
    pub(super) fn have_hit(&self, corner: usize) -> mask32x16<S> {
        have_hit(self.distances(corner), self.gradients(corner))
    }

    /// The unit vectors' components along the grid's axes, 0 where there is no normal.
    #[inline(always)]
    pub(super) fn normals(&self, simd: S, corner: usize) -> Directions<S> {
        normals(simd, self.high[corner] >> 16)
    }
}

/// As [`crate::VolumeTexels::has_hit`].
#[inline(always)]
pub(super) fn have_hit<S: Simd>(distances: i32x16<S>, gradients: u32x16<S>) -> mask32x16<S> {
    distances.simd_gt(i32::from(DistanceQuantization::MASKED)) & gradients.simd_gt(0)
}

/// As [`crate::classify::opacity::gradient_bin`], of numbers that are not 0.
#[inline(always)]
pub(super) fn gradient_bins<S: Simd>(simd: S, stored: u32x16<S>) -> u32x16<S> {
    let one = u32x16::splat(simd, 1);
    let number = (stored.max(one) - one) * GRADIENT_BINS as u32;
    // Over 65535, exactly, of all numbers below 2³².
    (number + (number >> 16) + one) >> 16
}

/// As [`voxrole_pack::quantization::decode_normal`]; 0 for none.
#[inline(always)]
pub(super) fn normals<S: Simd>(simd: S, stored: u32x16<S>) -> Directions<S> {
    let words = stored.bitcast::<i32x16<S>>();
    // Whole numbers up to the square root: exact, and its divisions spared.
    let [x, y] = [((words << 24) >> 24).to_float::<f32x16<S>>(), ((words << 16) >> 24).to_float::<f32x16<S>>()];
    let z = 127.0 - x.abs() - y.abs();
    let folded = (-z).max(splat(simd, 0.0));
    let (u, v) = ((x.abs() - folded).copysign(x), (y.abs() - folded).copysign(y));
    let share = 1.0 / ((u * u + v * v) + z * z).sqrt();
    let share = stored.simd_eq(u32::from(NO_NORMAL)).select(splat(simd, 0.0), share);
    [u * share, v * share, z * share]
}

#[cfg(test)]
mod tests {
    use fearless_simd::dispatch;
    use glam::Vec3;
    use voxrole_pack::quantization::decode_normal;
    use voxrole_preprocess::simd;

    use super::super::lanes::LANES;
    use super::*;
    use crate::classify::opacity::gradient_bin;

    #[test]
    fn every_stored_normal_is_its_vector() {
        for first in (0..=u16::MAX).step_by(LANES) {
            let lanes: [u32; LANES] = std::array::from_fn(|lane| u32::from(first) + lane as u32);
            let [x, y, z]: [[f32; LANES]; 3] = dispatch!(simd::level(), simd => {
                normals(simd, u32x16::from_slice(simd, &lanes)).map(Into::into)
            });
            for lane in 0..LANES {
                let expected = decode_normal(lanes[lane] as u16).unwrap_or(Vec3::ZERO);
                let found = Vec3::new(x[lane], y[lane], z[lane]);
                assert!((found - expected).abs().max_element() < 2e-7, "{}: {found} {expected}", lanes[lane]);
            }
        }
    }

    #[test]
    fn every_stored_gradient_has_its_bin() {
        for first in (1..=u16::MAX).step_by(LANES) {
            let stored: [u16; LANES] = std::array::from_fn(|lane| first.saturating_add(lane as u16));
            let lanes = stored.map(u32::from);
            let bins: [u32; LANES] =
                dispatch!(simd::level(), simd => gradient_bins(simd, u32x16::from_slice(simd, &lanes)).into());
            assert_eq!(bins, stored.map(|stored| gradient_bin(stored) as u32));
        }
    }
}
