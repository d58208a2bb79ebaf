//! A scene's value at a voxel as a stored number.

use voxrole_pack::GridGeometry;

use super::volume::fill;
use super::{NoiseKind, PhantomSettings, Quantization, Scene};
use crate::Result;

/// A scene with what turns its value into a stored number.
pub(super) struct Sampler<'a> {
    scene: &'a Scene,
    geometry: GridGeometry,
    noise_kind: NoiseKind,
    noise_sigma: f64,
    seed: u64,
    slope: f64,
    intercept: f64,
    limits: [f64; 2],
}

impl<'a> Sampler<'a> {
    /// `scene` is that of `settings` before scaling of its values.
    pub(super) fn new(scene: &'a Scene, settings: &PhantomSettings) -> Self {
        let [low, high] = scene.value_range;
        let (slope, intercept, limits) = match settings.quantization.or_else(|| Quantization::of(settings.scalar_type))
        {
            Some(Quantization { plateaus: [stored_low, stored_high], limits }) => {
                let slope = (stored_high - stored_low) / (high - low);
                (slope, stored_low - slope * low, limits)
            }
            None => (settings.value_scale, settings.value_offset, [f64::NEG_INFINITY, f64::INFINITY]),
        };
        Self {
            scene,
            geometry: settings.geometry(),
            noise_kind: settings.noise_kind,
            noise_sigma: settings.noise * scene.largest_step(),
            seed: settings.seed,
            slope,
            intercept,
            limits,
        }
    }

    /// The stored number of every voxel, x fastest; `convert` rounds it to its type.
    pub(super) fn volume<T: Copy + Default + Send>(&self, convert: impl Fn(f64) -> T + Sync) -> Result<Vec<T>> {
        let [smallest, largest] = self.limits;
        fill(&self.geometry, |index, point| {
            let mut value = self.scene.value(point);
            if self.noise_sigma > 0.0 {
                value = self.noise_kind.apply(value, self.noise_sigma, self.seed, index as u64);
            }
            convert(self.slope.mul_add(value, self.intercept).clamp(smallest, largest))
        })
    }
}
