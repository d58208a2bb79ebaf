//! How steep a boundary must be.

use crate::noise_gain::GradientNoise;
use crate::value_noise::ValueNoise;

/// Gradients up to this magnitude are rounding, not data: four units in the last place of the largest value, over L_min.
///
/// Working values are at most 1, so the threshold is relative to the data.
pub const GRADIENT_FLOOR: f32 = 4.0 / (1 << 24) as f32;

/// The gradient magnitude that a boundary must have.
#[derive(Clone, Debug)]
pub struct GradientFloor {
    noise: Option<(GradientNoise, f32)>,
    by_value: ValueNoise,
    /// Where in the volume the fields begin.
    origin: [usize; 3],
}

impl GradientFloor {
    /// [`GRADIENT_FLOOR`] everywhere.
    pub const ROUNDING: Self = Self { noise: None, by_value: ValueNoise::EVEN, origin: [0; 3] };

    /// So many deviations of the gradient's noise at each voxel, which may depend on the value, and [`GRADIENT_FLOOR`] at least.
    #[must_use]
    pub fn new(noise: GradientNoise, by_value: ValueNoise, deviations: f32) -> Self {
        Self { noise: (deviations > 0.0).then_some((noise, deviations)), by_value, origin: [0; 3] }
    }

    /// The same for fields that begin at a voxel of the volume.
    #[must_use]
    pub fn from_voxel(&self, origin: [usize; 3]) -> Self {
        Self { origin, ..self.clone() }
    }

    /// The smallest that it is anywhere: no factor is below 1.
    pub(crate) fn least(&self) -> f32 {
        let Some((noise, deviations)) = &self.noise else { return GRADIENT_FLOOR };
        (deviations * noise.least()).max(GRADIENT_FLOOR)
    }

    /// The smallest that it is where the field has a value.
    #[inline]
    pub(crate) fn least_at(&self, value: f32) -> f32 {
        let Some((noise, deviations)) = &self.noise else { return GRADIENT_FLOOR };
        (deviations * noise.least() * self.by_value.at(value)).max(GRADIENT_FLOOR)
    }

    /// At a voxel, for a place where the field has a value.
    #[inline(always)]
    pub(super) fn at(&self, voxel: [usize; 3], value: f32) -> f32 {
        let Some((noise, deviations)) = &self.noise else { return GRADIENT_FLOOR };
        let [x, y, z] = self.origin;
        let even = deviations * noise.at([x + voxel[0], y + voxel[1], z + voxel[2]]);
        (even * self.by_value.at(value)).max(GRADIENT_FLOOR)
    }
}
