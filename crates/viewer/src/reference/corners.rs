//! The eight voxels at a cell's corners, side by side in the lanes of vectors, x fastest.

// No iterators and closures in vector code: what std calls might be compiled without the level's instructions.
#![allow(clippy::needless_range_loop, reason = "see above")]

use fearless_simd::{
    Bytes, Select, Simd, SimdBase, SimdCombine, SimdFloat, SimdInt, f32x8, i32x8, mask32x8, u16x8, u32x4, u32x8,
};
use glam::{UVec3, Vec3};
use voxrole_pack::DistanceQuantization;
use voxrole_pack::quantization::NO_NORMAL;

use super::sampling::Sampler;

/// What is stored at the corners.
#[derive(Clone, Copy)]
pub(super) struct Corners<S: Simd> {
    /// Value and distance in the halves of 32 bits.
    low: u32x8<S>,
    /// Gradient magnitude and normal.
    high: u32x8<S>,
}

impl<S: Simd> Corners<S> {
    /// Zeros.
    #[inline(always)]
    pub(super) fn none(simd: S) -> Self {
        Self { low: u32x8::splat(simd, 0), high: u32x8::splat(simd, 0) }
    }

    /// Reads a cell by its lowest voxel.
    #[inline(always)]
    pub(super) fn read(simd: S, sampler: &Sampler<'_>, base: UVec3) -> Self {
        let rows = sampler.rows(base);
        let mut pairs = [u32x4::splat(simd, 0); 4];
        for row in 0..4 {
            let pair = sampler.pair(rows[row]);
            pairs[row] = u16x8::from_slice(simd, pair.as_flattened()).bitcast();
        }
        let (near, far) = (pairs[0].combine(pairs[1]), pairs[2].combine(pairs[3]));
        let (low, high) = near.deinterleave(far);
        Self { low, high }
    }

    /// Values as they are stored, 0 to 65535.
    #[inline(always)]
    pub(super) fn values(&self) -> f32x8<S> {
        (self.low & 0xffff).to_float()
    }

    /// Signed distances as they are stored: see [`DistanceQuantization`].
    #[inline(always)]
    pub(super) fn distances(&self) -> i32x8<S> {
        self.low.bitcast::<i32x8<S>>() >> 16
    }

    /// Gradient magnitudes at the hit as they are stored, 0 for none.
    #[inline(always)]
    pub(super) fn gradients(&self) -> u32x8<S> {
        self.high & 0xffff
    }

    /// As [`crate::VolumeTexels::has_hit`].
    #[inline(always)]
    pub(super) fn have_hit(&self) -> mask32x8<S> {
        self.distances().simd_gt(i32::from(DistanceQuantization::MASKED)) & self.gradients().simd_gt(0)
    }

    /// The unit vectors' components along the grid's axes, 0 where there is no normal.
    #[inline(always)]
    pub(super) fn normals(&self, simd: S) -> [f32x8<S>; 3] {
        normals(simd, self.high >> 16)
    }
}

/// As [`voxrole_pack::quantization::decode_normal`]; 0 for none.
#[inline(always)]
fn normals<S: Simd>(simd: S, stored: u32x8<S>) -> [f32x8<S>; 3] {
    let words = stored.bitcast::<i32x8<S>>();
    let bytes = [(words << 24) >> 24, (words << 16) >> 24];
    let [x, y]: [f32x8<S>; 2] = [bytes[0].to_float::<f32x8<S>>() / 127.0, bytes[1].to_float::<f32x8<S>>() / 127.0];
    let z = 1.0 - x.abs() - y.abs();
    let is_upper = z.simd_ge(0.0);
    let u = is_upper.select(x, (1.0 - y.abs()).copysign(x));
    let v = is_upper.select(y, (1.0 - x.abs()).copysign(y));
    let share = 1.0 / ((u * u + v * v) + z * z).sqrt();
    let is_none = stored.simd_eq(u32::from(NO_NORMAL));
    let zero = f32x8::splat(simd, 0.0);
    [is_none.select(zero, u * share), is_none.select(zero, v * share), is_none.select(zero, z * share)]
}

/// Trilinear weights.
#[inline(always)]
pub(super) fn trilinear<S: Simd>(simd: S, fraction: Vec3) -> f32x8<S> {
    let mut weights = f32x8::splat(simd, 1.0);
    for axis in 0..3 {
        let corner = f32x8::from_slice(simd, &CORNERS[axis]);
        // 1 − x, or x itself.
        weights *= (1.0 - corner) + (corner + corner - 1.0) * fraction[axis];
    }
    weights
}

/// The cell's corners, x fastest: where they lie along each axis.
pub(super) const CORNERS: [[f32; 8]; 3] = [
    [0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0],
    [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0],
    [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0],
];

#[cfg(test)]
mod tests {
    use fearless_simd::dispatch;
    use voxrole_pack::quantization::decode_normal;
    use voxrole_preprocess::simd;

    use super::*;

    #[test]
    fn every_stored_normal_is_its_vector() {
        for first in (0..=u16::MAX).step_by(8) {
            let lanes: [u32; 8] = std::array::from_fn(|lane| u32::from(first) + lane as u32);
            let [x, y, z]: [[f32; 8]; 3] = dispatch!(simd::level(), simd => {
                let [x, y, z] = normals(simd, u32x8::from_slice(simd, &lanes));
                [x.into(), y.into(), z.into()]
            });
            for lane in 0..8 {
                let expected = decode_normal(lanes[lane] as u16).unwrap_or(Vec3::ZERO);
                let found = Vec3::new(x[lane], y[lane], z[lane]);
                assert!((found - expected).abs().max_element() < 2e-7, "{}: {found} {expected}", lanes[lane]);
            }
        }
    }
}
