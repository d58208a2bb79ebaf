//! Which field is smoothed, with which widths.

use crate::bilateral::{Bilateral, BilateralSettings};
use crate::directional_derivative::Derivatives;
use crate::gaussian::gaussian;
use crate::noise_gain::NoiseGain;
use crate::report::FieldSigma;
use crate::settings::{Smoothing, SmoothingSettings};
use crate::working_field::{Field, WorkingField, dims_of};

/// σr of the paper's filters of derivatives in multiples of the filtered field's estimated noise: differences of noise
/// alone keep most of their weight, an edge of ten times the noise keeps 0.4 %.
pub const RANGE_SIGMA_PER_NOISE: f32 = 3.0;
/// σr of the filter of the value as a share of the value's range. A σr of a few times the noise averages nothing across an
/// edge, where f'' is taken; see the study in docs/smoothing.md.
pub const RANGE_SIGMA_OF_VALUE: f32 = 0.4;

/// σr of each bilaterally filtered field.
#[derive(Clone, Debug, Default)]
pub struct RangeSigmas {
    /// As the report gives them.
    pub shares: Vec<FieldSigma>,
    /// In the units of the filtered fields, in the same order.
    working: Vec<f32>,
    /// Voxels filtered so far.
    voxels: Vec<usize>,
}

/// The volume whose fields are filtered.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    /// Voxels along x, y, z.
    pub dims: [usize; 3],
    /// Distance between them in multiples of L_min.
    pub spacing: [f32; 3],
}

impl RangeSigmas {
    /// That of the value, whose working numbers lie between two; none where the value is not filtered.
    #[must_use]
    pub fn of_value(settings: &SmoothingSettings, volume: Extent, [a, b]: [f32; 2]) -> Self {
        let mut sigmas = Self::default();
        if settings.placement == Smoothing::BilateralValue {
            sigmas.add("value", (b - a).abs(), |range| RANGE_SIGMA_OF_VALUE * range, settings, volume);
        }
        sigmas
    }

    /// Those of gradient magnitude and second derivative, which have these ranges; `noise` is the value's.
    #[must_use]
    pub fn of_derivatives(
        settings: &SmoothingSettings,
        volume: Extent,
        ranges: [[f32; 2]; 2],
        noise: f32,
        gain: NoiseGain,
    ) -> Self {
        let mut sigmas = Self::default();
        let fields = [("gradient-magnitude", gain.gradient), ("second-derivative", gain.second_derivative)];
        for ((name, gain), [low, high]) in fields.into_iter().zip(ranges) {
            sigmas.add(name, (high - low).max(0.0), |_| RANGE_SIGMA_PER_NOISE * noise * gain, settings, volume);
        }
        sigmas
    }

    /// Adds σr of a field, which is `default` of the field's range where the settings name none.
    fn add(
        &mut self,
        field: &'static str,
        range: f32,
        default: impl Fn(f32) -> f32,
        settings: &SmoothingSettings,
        volume: Extent,
    ) {
        let sigma = settings.range_sigma.map_or_else(|| default(range), |share| share as f32 * range);
        let share = if range > 0.0 { f64::from(sigma / range) } else { 0.0 };
        let weights = bilateral(volume, sigma, settings).range_weights();
        self.shares.push(FieldSigma { field, share, weights, boxes_filtered: 0.0 });
        self.working.push(sigma);
        self.voxels.push(0);
    }

    /// Filters one of the fields, whose first voxel is `origin` of the volume.
    fn filter(
        &mut self,
        index: usize,
        field: &mut Field,
        spacing: [f32; 3],
        origin: [usize; 3],
        settings: &SmoothingSettings,
    ) {
        let FieldSigma { share, boxes_filtered, .. } = &mut self.shares[index];
        let volume = Extent { dims: dims_of(field), spacing };
        let filtered = if *share > 0.0 {
            let filtered = bilateral(volume, self.working[index], settings).filter(field, origin);
            *field = filtered.values;
            filtered.boxes_filtered
        } else {
            0.0
        };
        // The mean over all parts, by their size.
        let before = self.voxels[index];
        self.voxels[index] += field.len();
        *boxes_filtered += (filtered - *boxes_filtered) * (1.0 - before as f64 / self.voxels[index] as f64);
    }
}

/// Smooths a part of the value field, whose first voxel is `origin` of the volume, where the settings say so.
pub fn smooth_value(
    field: &mut WorkingField,
    origin: [usize; 3],
    settings: &SmoothingSettings,
    sigmas: &mut RangeSigmas,
) {
    match settings.placement {
        Smoothing::None | Smoothing::BilateralDerivatives => {}
        Smoothing::GaussianValue => {
            field.values = gaussian(&field.values, field.spacing, settings.spatial_sigma as f32, settings.radius);
        }
        Smoothing::BilateralValue => sigmas.filter(0, &mut field.values, field.spacing, origin, settings),
    }
}

/// Smooths a part of gradient magnitude and second derivative, whose first voxel is `origin` of the volume, where the
/// settings say so, as the paper does.
pub fn smooth_derivatives(
    derivatives: &mut Derivatives,
    spacing: [f32; 3],
    origin: [usize; 3],
    settings: &SmoothingSettings,
    sigmas: &mut RangeSigmas,
) {
    if settings.placement == Smoothing::BilateralDerivatives {
        sigmas.filter(0, &mut derivatives.gradient_magnitude, spacing, origin, settings);
        sigmas.filter(1, &mut derivatives.second_derivative, spacing, origin, settings);
    }
}

/// σ of the Gaussian as which smoothing of the value acts on noise: a bilateral filter, where there is nothing but noise,
/// as that of its spatial σ.
#[must_use]
pub fn sigma_on_noise(settings: &SmoothingSettings) -> Option<f32> {
    match settings.placement {
        Smoothing::None | Smoothing::BilateralDerivatives => None,
        Smoothing::BilateralValue | Smoothing::GaussianValue => Some(settings.spatial_sigma as f32),
    }
}

fn bilateral(volume: Extent, range_sigma: f32, settings: &SmoothingSettings) -> Bilateral {
    let Extent { dims, spacing } = volume;
    let spatial_sigma = settings.spatial_sigma as f32;
    let weights = settings.range_weights;
    Bilateral::new(dims, spacing, BilateralSettings { spatial_sigma, range_sigma, radius: settings.radius, weights })
}
