//! Colour and opacity by value, or as stored, between voxels: no boundary is asked for.

use fearless_simd::{Select, Simd, SimdBase, SimdInt, f32x8};
use glam::{UVec3, Vec3};

use super::corners::{Corners, trilinear};
use super::lanes::sums;
use super::sampling::{RoleSample, Sampler, unit_or_zero};
use crate::classify::ValueTable;
use crate::frame::Ray;

/// What decides on colour and opacity where roles do not.
#[derive(Clone, Copy)]
pub(super) enum ByValue<'a> {
    /// A curve.
    Curve(&'a ValueTable),
    /// The voxels' own intensity and opacity.
    Stored,
}

/// Samples along a ray by value.
pub(super) struct ValueSampler<'a, S: Simd> {
    by_value: ByValue<'a>,
    /// The cell that was read last.
    base: UVec3,
    corners: Corners<S>,
    values: f32x8<S>,
    /// Where along the ray the last step ended, and the value there.
    end: (f32, f32),
}

impl<'a, S: Simd> ValueSampler<'a, S> {
    #[inline(always)]
    pub(super) fn new(simd: S, by_value: ByValue<'a>) -> Self {
        let (corners, values) = (Corners::none(simd), f32x8::splat(simd, 0.0));
        Self { by_value, base: UVec3::MAX, corners, values, end: (f32::NEG_INFINITY, 0.0) }
    }

    /// The sample of a step whose middle lies at `place`; over the step's `ends` along the ray, or where they are missing its
    /// middle counts for all of it.
    #[inline(always)]
    pub(super) fn sample(
        &mut self,
        simd: S,
        sampler: &Sampler<'_>,
        place: (UVec3, Vec3),
        ray: &Ray,
        ends: Option<[f32; 2]>,
    ) -> RoleSample {
        let table = match self.by_value {
            ByValue::Curve(table) => table,
            ByValue::Stored => return self.stored(simd, sampler, place),
        };
        let light = if let Some([begin, end]) = ends {
            // Most steps begin where the one before ended.
            let front = if begin == self.end.0 { self.end.1 } else { self.value_along(simd, sampler, ray, begin) };
            self.end = (end, self.value_along(simd, sampler, ray, end));
            table.look_up(front, self.end.1)
        } else {
            let value = self.value(simd, sampler, place);
            table.look_up(value, value)
        };
        if light.w > 0.0 {
            RoleSample { opacity: light.w, color: light.truncate(), normal: self.normal(simd, sampler, place) }
        } else {
            RoleSample::default()
        }
    }

    /// Intensity and opacity as they are stored.
    #[inline(always)]
    fn stored(&mut self, simd: S, sampler: &Sampler<'_>, (base, fraction): (UVec3, Vec3)) -> RoleSample {
        self.enter(simd, sampler, base);
        let weights = trilinear(simd, fraction);
        let intensities = self.corners.gradients().to_float::<f32x8<S>>();
        let zero = f32x8::splat(simd, 0.0);
        let [opacity, intensity, ..] = sums(simd, [weights * self.values, weights * intensities, zero, zero]);
        RoleSample { opacity: opacity / 65535.0, color: Vec3::splat(intensity / 65535.0), normal: Vec3::ZERO }
    }

    #[inline(always)]
    fn value_along(&mut self, simd: S, sampler: &Sampler<'_>, ray: &Ray, along: f32) -> f32 {
        self.value(simd, sampler, sampler.place(ray.origin + along * ray.direction))
    }

    /// The value at a place.
    #[inline(always)]
    fn value(&mut self, simd: S, sampler: &Sampler<'_>, (base, fraction): (UVec3, Vec3)) -> f32 {
        self.enter(simd, sampler, base);
        (trilinear(simd, fraction) * self.values).reduce_sum()
    }

    /// Direction of the mean of the normals that there are: where no boundary is near, light has nothing to fall on.
    #[inline(always)]
    fn normal(&mut self, simd: S, sampler: &Sampler<'_>, (base, fraction): (UVec3, Vec3)) -> Vec3 {
        self.enter(simd, sampler, base);
        let zero = f32x8::splat(simd, 0.0);
        let weights = self.corners.have_hit().select(trilinear(simd, fraction), zero);
        let [x, y, z] = self.corners.normals(simd);
        let [x, y, z, _] = sums(simd, [weights * x, weights * y, weights * z, zero]);
        unit_or_zero(Vec3::new(x, y, z))
    }

    #[inline(always)]
    fn enter(&mut self, simd: S, sampler: &Sampler<'_>, base: UVec3) {
        if self.base != base {
            self.base = base;
            self.corners = Corners::read(simd, sampler, base);
            self.values = self.corners.values();
        }
    }
}

#[cfg(test)]
mod tests {
    use fearless_simd::dispatch;
    use proptest::prelude::*;
    use voxrole_pack::quantization::decode_normal;
    use voxrole_pack::{DistanceQuantization, GridGeometry, HitGradientQuantization, Precision};
    use voxrole_preprocess::simd;

    use super::*;
    use crate::reference::RayMarcher;
    use crate::state::{Classification, ViewState};
    use crate::volume::{VolumeDescription, VolumeTexels};

    /// Value, third channel and mean normal at a place, corner by corner.
    fn naive(volume: &VolumeTexels, [x, y, z]: [usize; 3], fraction: Vec3) -> (f32, f32, Vec3) {
        let [width, height, _] = volume.description.dims.map(|dim| dim as usize);
        let mut sum = (0.0, 0.0, Vec3::ZERO);
        for corner in 0..8 {
            let [i, j, k] = [corner & 1, corner >> 1 & 1, corner >> 2];
            let texel = volume.texels[((z + k) * height + y + j) * width + x + i];
            let side = |is_high: usize, fraction: f32| if is_high > 0 { fraction } else { 1.0 - fraction };
            let weight = side(i, fraction.x) * side(j, fraction.y) * side(k, fraction.z);
            sum.0 += weight * f32::from(texel[0]);
            sum.1 += weight * f32::from(texel[2]);
            if VolumeTexels::has_hit(texel) {
                sum.2 += weight * decode_normal(texel[3]).unwrap_or(Vec3::ZERO);
            }
        }
        sum
    }

    proptest! {
        #[test]
        fn a_place_is_interpolated_as_corner_by_corner(
            texels in prop::collection::vec(
                (any::<u16>(), prop::sample::select(vec![DistanceQuantization::MASKED, i16::MIN, 0, 900]),
                 prop::sample::select(vec![0, 7, u16::MAX]), any::<u16>()),
                27,
            ),
            place in prop::array::uniform3(0.0_f32..2.0),
        ) {
            let geometry = GridGeometry::axis_aligned([3; 3], [1.0; 3]);
            let hit_gradient = HitGradientQuantization::new(0.0, 1.0, Precision::default());
            let description = VolumeDescription::new(&geometry, 2.0, [0.0, 1.0], hit_gradient);
            let texels = texels.into_iter().map(|(value, distance, third, normal)| [value, distance as u16, third, normal]);
            let volume = VolumeTexels { description, texels: texels.collect() };
            let mut state = ViewState::default();
            state.transfer_function.classification = Classification::Stored;
            let marcher = RayMarcher::new(&volume, &state, [1, 1]).expect("a picture");
            let sampler = marcher.sampler();
            let (base, fraction) = sampler.place(Vec3::from_array(place));
            let (value, third, normal) = naive(&volume, base.as_usizevec3().to_array(), fraction);
            let (found, of_normal, stored) = dispatch!(simd::level(), simd => {
                let mut samples = ValueSampler::new(simd, ByValue::Stored);
                let place = (base, fraction);
                (
                    samples.value(simd, &sampler, place),
                    samples.normal(simd, &sampler, place),
                    samples.stored(simd, &sampler, place),
                )
            });
            prop_assert!((found - value).abs() < 0.05, "{found} {value}");
            prop_assert!((stored.opacity * 65535.0 - value).abs() < 0.05);
            prop_assert!((stored.color.x * 65535.0 - third).abs() < 0.05);
            // Where normals all but cancel their direction is rounding.
            if normal.length() > 0.01 {
                prop_assert!((of_normal - normal.normalize()).length() < 1e-4, "{of_normal} {normal}");
            }
        }
    }
}
