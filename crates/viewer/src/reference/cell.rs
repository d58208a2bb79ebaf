//! A cell of eight voxels, its corners side by side in the lanes of vectors.

// No iterators and closures in vector code: what std calls might be compiled without the level's instructions.
#![allow(clippy::needless_range_loop, reason = "see above")]

use fearless_simd::{Select, Simd, SimdBase, SimdInt, SimdMask, f32x8, u32x8};
use glam::{UVec3, Vec3};

use super::corners::{CORNERS, Corners, trilinear};
use super::lanes::{exp_of_negative, sums};
use super::roles::RoleLanes;
use super::sampling::{RoleSample, Sampler, unit_or_zero};
use crate::classify::opacity::{GRADIENT_BINS, value_bin, value_bins};
use crate::classify::preintegration::SHORTEST;

/// The cell that the last samples of a ray lay in.
pub struct Cell<S: Simd> {
    base: UVec3,
    /// Whether any of its corners can be drawn somewhere in it.
    is_active: bool,
    values: f32x8<S>,
    /// The first of the bins of each corner's gradient magnitude; those of nothing for a corner that cannot be drawn.
    bins: [u32; 8],
    normals: [f32x8<S>; 3],
    /// Signed distance of a corner's plane at the cell's lowest corner, and by how much that grows along the cell.
    distance: f32x8<S>,
    growth: [f32x8<S>; 3],
    /// By how much a plane's distance changes, either way, along a unit of the ray.
    slant: f32x8<S>,
    /// The roles of the last samples' values.
    roles: [RoleLanes<S>; 2],
}

impl<S: Simd> Cell<S> {
    /// None that a place lies in.
    #[inline(always)]
    pub fn none(simd: S) -> Self {
        let zero = f32x8::splat(simd, 0.0);
        Self {
            base: UVec3::MAX,
            is_active: false,
            values: zero,
            bins: [0; 8],
            normals: [zero; 3],
            distance: zero,
            growth: [zero; 3],
            slant: zero,
            roles: [RoleLanes::none(simd), RoleLanes::none(simd)],
        }
    }

    /// Reads the voxels of a cell by its lowest one, for steps along `direction`, which is that of all samples that the
    /// cell is used for. Whether anything can be drawn in it.
    #[inline(always)]
    pub fn enter(&mut self, simd: S, sampler: &Sampler<'_>, base: UVec3, direction: Vec3) -> bool {
        if self.base != base {
            self.base = base;
            self.is_active = self.read(simd, sampler, base, direction);
        }
        self.is_active
    }

    #[inline(always)]
    fn read(&mut self, simd: S, sampler: &Sampler<'_>, base: UVec3, direction: Vec3) -> bool {
        let frame = sampler.frame;
        let corners = Corners::read(simd, sampler, base);
        let distance = corners.distances().to_float::<f32x8<S>>() * frame.distance_scale;
        // A plane's distance changes within the cell by no more than the cell's diagonal.
        let near = corners.have_hit() & distance.abs().simd_lt(frame.reach);
        if !near.any_true() {
            return false;
        }
        self.values = corners.values();
        let extent = [self.values.reduce_min() as u16, self.values.reduce_max() as u16];
        let [low, high] = value_bins(extent);
        let rows: [u32; 8] = gradient_bins(simd, corners.gradients()).into();
        let [mut first, mut last, mut bins] = [[0; 8]; 3];
        for lane in 0..8 {
            let row = sampler.roles.row(rows[lane]);
            [first[lane], last[lane]] = row.lit.map(u32::from);
            bins[lane] = row.first;
        }
        let (first, last) = (u32x8::from_slice(simd, &first), u32x8::from_slice(simd, &last));
        // Corners that have an opacity with any of the cell's values.
        let lit = near & last.simd_ge(low as u32) & first.simd_le(high as u32);
        if !lit.any_true() {
            return false;
        }
        self.normals = corners.normals(simd);
        let zero = f32x8::splat(simd, 0.0);
        let (mut slant, mut range) = (zero, zero);
        (self.distance, self.growth) = (distance, [zero; 3]);
        let mut middle = distance;
        for axis in 0..3 {
            let growth = self.normals[axis] * frame.spacing[axis];
            let corner = f32x8::from_slice(simd, &CORNERS[axis]);
            self.distance -= growth * corner;
            middle += growth * (0.5 - corner);
            range += growth.abs();
            slant += self.normals[axis] * direction[axis];
            self.growth[axis] = growth;
        }
        self.slant = slant.abs();
        // Between the smallest and the largest distance that a plane has in the cell, with a little for rounding.
        let nearest = middle.abs() - range * 0.5 - self.slant * frame.half_step;
        let lit = lit & nearest.simd_lt(1.001 * sampler.roles.largest_d_c());
        self.bins = lit.select(u32x8::from_slice(simd, &bins), u32x8::splat(simd, 0)).into();
        lit.any_true()
    }

    /// The samples at places within the cell, 0 to 1 along each axis, by the rule of [`super::sampling`], over `half_step`
    /// multiples of `L_min` to either side; that is 0 where a place counts for all of it. Two at once hardly take longer than one, which leaves the processor waiting.
    #[inline(always)]
    pub fn sample<const N: usize>(
        &mut self,
        simd: S,
        sampler: &Sampler<'_>,
        fractions: [Vec3; N],
        half_step: f32,
    ) -> [RoleSample; N] {
        const { assert!(N <= 2) };
        let zero = f32x8::splat(simd, 0.0);
        let [mut weights, mut distances, mut shares] = [[zero; N]; 3];
        let mut weighted = [zero; 4];
        for place in 0..N {
            weights[place] = trilinear(simd, fractions[place]);
            weighted[place] = weights[place] * self.values;
            distances[place] = self.distance;
            for axis in 0..3 {
                distances[place] += self.growth[axis] * fractions[place][axis];
            }
        }
        let values = sums(simd, weighted);
        let mut any = false;
        for place in 0..N {
            any |= self.roles[place].look_up(simd, sampler.roles, &self.bins, value_bin(values[place]));
        }
        let mut samples = [RoleSample::default(); N];
        if !any {
            return samples;
        }
        if half_step > 0.0 {
            let half = (self.slant * half_step).max(f32x8::splat(simd, 0.5 * SHORTEST));
            let per_length = 0.5 / half;
            for place in 0..N {
                let roles = &self.roles[place];
                let begin = roles.integral(simd, sampler.roles, distances[place] - half);
                let end = roles.integral(simd, sampler.roles, distances[place] + half);
                shares[place] = (begin - end) * per_length;
            }
            for place in 0..N {
                shares[place] = weights[place] * (1.0 - exp_of_negative(simd, shares[place]));
            }
        } else {
            for place in 0..N {
                shares[place] = weights[place] * self.roles[place].opacity(simd, sampler.roles, distances[place]);
            }
        }
        for place in 0..N {
            let share = shares[place];
            let [red, green, blue] = self.roles[place].color;
            let [x, y, z] = self.normals;
            let [opacity, red, green, blue] = sums(simd, [share, share * red, share * green, share * blue]);
            let [x, y, z, _] = sums(simd, [share * x, share * y, share * z, zero]);
            if opacity > 0.0 {
                let share = opacity.recip();
                samples[place] = RoleSample {
                    opacity: opacity.min(1.0),
                    color: Vec3::new(red, green, blue) * share,
                    normal: unit_or_zero(Vec3::new(x, y, z) * share),
                };
            }
        }
        samples
    }
}

/// As [`crate::classify::opacity::gradient_bin`], of numbers that are not 0.
#[inline(always)]
fn gradient_bins<S: Simd>(simd: S, stored: u32x8<S>) -> u32x8<S> {
    let one = u32x8::splat(simd, 1);
    let number = (stored.max(one) - one) * GRADIENT_BINS as u32;
    // Over 65535, exactly, of all numbers below 2³².
    (number + (number >> 16) + one) >> 16
}

#[cfg(test)]
mod tests {
    use fearless_simd::dispatch;
    use voxrole_preprocess::simd;

    use super::*;
    use crate::classify::opacity::gradient_bin;

    #[test]
    fn every_stored_gradient_has_its_bin() {
        for stored in (1..=u16::MAX).step_by(8) {
            let stored: [u16; 8] = std::array::from_fn(|lane| stored.saturating_add(lane as u16));
            let lanes = stored.map(u32::from);
            let bins: [u32; 8] =
                dispatch!(simd::level(), simd => gradient_bins(simd, u32x8::from_slice(simd, &lanes)).into());
            assert_eq!(bins, stored.map(|stored| gradient_bin(stored) as u32));
        }
    }
}
