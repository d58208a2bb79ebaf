//! Colour and opacity by value, or as stored, between voxels: no boundary is asked for.

use glam::Vec3;

use super::sampling::{RoleSample, Sampler, unit_or_zero};
use crate::classify::ValueTable;
use crate::volume::VolumeTexels;

/// What decides on colour and opacity where roles do not.
#[derive(Clone, Copy)]
pub enum ByValue<'a> {
    /// A curve.
    Curve(&'a ValueTable),
    /// The voxels' own intensity and opacity.
    Stored,
}

/// What trilinear interpolation makes of a place's eight voxels.
struct Interpolated {
    /// Of the channel of values.
    value: f32,
    /// Of the channel that holds gradient magnitudes, or intensities where those are stored.
    third: f32,
    /// Mean of the normals that there are: where no boundary is near, light has nothing to fall on.
    normal: Vec3,
}

impl Sampler<'_> {
    /// The sample at a place, for a step along a unit vector over `half_step` to either side.
    #[must_use]
    #[inline(always)]
    pub fn sample_value(&self, by_value: &ByValue<'_>, position: Vec3, direction: Vec3, half_step: f32) -> RoleSample {
        let Interpolated { value, third, normal } = self.interpolate(position);
        let table = match by_value {
            ByValue::Curve(table) => table,
            ByValue::Stored => {
                return RoleSample {
                    opacity: value / 65535.0,
                    color: Vec3::splat(third / 65535.0),
                    normal: Vec3::ZERO,
                };
            }
        };
        let light = if half_step > 0.0 {
            let front = self.interpolate(position - half_step * direction).value;
            let back = self.interpolate(position + half_step * direction).value;
            table.look_up(front, back)
        } else {
            table.look_up(value, value)
        };
        RoleSample { opacity: light.w, color: light.truncate(), normal: unit_or_zero(normal) }
    }

    #[inline(always)]
    fn interpolate(&self, position: Vec3) -> Interpolated {
        let (base, fraction) = self.place(position);
        let ([x1, y1, z1], [x0, y0, z0]) = (fraction.to_array(), (1.0 - fraction).to_array());
        let mut sum = Interpolated { value: 0.0, third: 0.0, normal: Vec3::ZERO };
        for (corner, texel) in self.texels(base).into_iter().enumerate() {
            let side = |bit: usize, low: f32, high: f32| if corner & bit == 0 { low } else { high };
            let weight = side(1, x0, x1) * side(2, y0, y1) * side(4, z0, z1);
            sum.value += weight * f32::from(texel[0]);
            sum.third += weight * f32::from(texel[2]);
            if VolumeTexels::has_hit(texel) {
                sum.normal += weight * self.normal(texel[3]);
            }
        }
        sum
    }
}
