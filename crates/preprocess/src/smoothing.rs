//! Which field is smoothed, with which widths.

use crate::bilateral::{BilateralSettings, bilateral};
use crate::directional_derivative::Derivatives;
use crate::gaussian::gaussian;
use crate::noise_gain::NoiseGain;
use crate::report::FieldSigma;
use crate::settings::{Smoothing, SmoothingSettings};
use crate::working_field::{Field, WorkingField};

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
}

impl RangeSigmas {
    /// That of the value, whose working numbers lie between two; none where the value is not filtered.
    #[must_use]
    pub fn of_value(settings: &SmoothingSettings, [a, b]: [f32; 2]) -> Self {
        let mut sigmas = Self::default();
        if settings.placement == Smoothing::BilateralValue {
            sigmas.add("value", (b - a).abs(), |range| RANGE_SIGMA_OF_VALUE * range, settings);
        }
        sigmas
    }

    /// Those of gradient magnitude and second derivative, which have these ranges; `noise` is the value's.
    #[must_use]
    pub fn of_derivatives(settings: &SmoothingSettings, ranges: [[f32; 2]; 2], noise: f32, gain: NoiseGain) -> Self {
        let mut sigmas = Self::default();
        let fields = [("gradient-magnitude", gain.gradient), ("second-derivative", gain.second_derivative)];
        for ((name, gain), [low, high]) in fields.into_iter().zip(ranges) {
            sigmas.add(name, (high - low).max(0.0), |_| RANGE_SIGMA_PER_NOISE * noise * gain, settings);
        }
        sigmas
    }

    /// Adds σr of a field, which is `default` of the field's range where the settings name none.
    fn add(&mut self, field: &'static str, range: f32, default: impl Fn(f32) -> f32, settings: &SmoothingSettings) {
        let sigma = settings.range_sigma.map_or_else(|| default(range), |share| share as f32 * range);
        let share = if range > 0.0 { f64::from(sigma / range) } else { 0.0 };
        self.shares.push(FieldSigma { field, share });
        self.working.push(sigma);
    }
}

/// Smooths the value field where the settings say so.
pub fn smooth_value(field: &mut WorkingField, settings: &SmoothingSettings, sigmas: &RangeSigmas) {
    match settings.placement {
        Smoothing::None | Smoothing::BilateralDerivatives => {}
        Smoothing::GaussianValue => {
            field.values = gaussian(&field.values, field.spacing, settings.spatial_sigma as f32, settings.radius);
        }
        Smoothing::BilateralValue => {
            field.values = filtered(&field.values, field.spacing, sigmas.working[0], settings);
        }
    }
}

/// Smooths gradient magnitude and second derivative where the settings say so, as the paper does.
pub fn smooth_derivatives(
    derivatives: &mut Derivatives,
    spacing: [f32; 3],
    settings: &SmoothingSettings,
    sigmas: &RangeSigmas,
) {
    if settings.placement == Smoothing::BilateralDerivatives {
        let Derivatives { gradient_magnitude, second_derivative } = derivatives;
        for (field, &sigma) in [gradient_magnitude, second_derivative].into_iter().zip(&sigmas.working) {
            *field = filtered(field, spacing, sigma, settings);
        }
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

fn filtered(field: &Field, spacing: [f32; 3], range_sigma: f32, settings: &SmoothingSettings) -> Field {
    bilateral(
        field,
        spacing,
        BilateralSettings { spatial_sigma: settings.spatial_sigma as f32, range_sigma, radius: settings.radius },
    )
}
