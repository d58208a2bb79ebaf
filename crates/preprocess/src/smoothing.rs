//! Which field is smoothed, with which widths.

use crate::bilateral::{BilateralSettings, bilateral};
use crate::directional_derivative::Derivatives;
use crate::gaussian::gaussian;
use crate::noise_gain::NoiseGain;
use crate::report::FieldSigma;
use crate::settings::{Smoothing, SmoothingSettings};
use crate::working_field::{Field, WorkingField, voxels};

/// σr of the paper's filters of derivatives in multiples of the filtered field's estimated noise: differences of noise
/// alone keep most of their weight, an edge of ten times the noise keeps 0.4 %.
pub const RANGE_SIGMA_PER_NOISE: f32 = 3.0;
/// σr of the filter of the value as a share of the value's range. A σr of a few times the noise averages nothing across an
/// edge, where f'' is taken; see the study in docs/smoothing.md.
pub const RANGE_SIGMA_OF_VALUE: f32 = 0.4;

/// σr of each bilaterally filtered field.
pub type RangeSigmas = Vec<FieldSigma>;

/// Smooths the value field where the settings say so.
pub fn smooth_value(field: &mut WorkingField, settings: &SmoothingSettings, sigmas: &mut RangeSigmas) {
    match settings.placement {
        Smoothing::None | Smoothing::BilateralDerivatives => {}
        Smoothing::GaussianValue => {
            field.values = gaussian(&field.values, field.spacing, settings.spatial_sigma as f32, settings.radius);
        }
        Smoothing::BilateralValue => {
            let default = |range| RANGE_SIGMA_OF_VALUE * range;
            field.values = filtered(&field.values, "value", default, field.spacing, settings, sigmas);
        }
    }
}

/// Smooths gradient magnitude and second derivative where the settings say so, as the paper does.
pub fn smooth_derivatives(
    derivatives: &mut Derivatives,
    spacing: [f32; 3],
    noise: f32,
    gain: NoiseGain,
    settings: &SmoothingSettings,
    sigmas: &mut RangeSigmas,
) {
    if settings.placement != Smoothing::BilateralDerivatives {
        return;
    }
    for (name, gain, derivative) in [
        ("gradient-magnitude", gain.gradient, &mut derivatives.gradient_magnitude),
        ("second-derivative", gain.second_derivative, &mut derivatives.second_derivative),
    ] {
        *derivative = filtered(derivative, name, |_| RANGE_SIGMA_PER_NOISE * noise * gain, spacing, settings, sigmas);
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

/// The field after a bilateral filter, whose σr is `default` of the field's range where the settings name none.
fn filtered(
    field: &Field,
    name: &'static str,
    default: impl Fn(f32) -> f32,
    spacing: [f32; 3],
    settings: &SmoothingSettings,
    sigmas: &mut RangeSigmas,
) -> Field {
    let (low, high) = voxels(field)
        .iter()
        .filter(|value| !value.is_nan())
        .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &value| (low.min(value), high.max(value)));
    let range = (high - low).max(0.0);
    let range_sigma = settings.range_sigma.map_or_else(|| default(range), |share| share as f32 * range);
    let share = if range > 0.0 { f64::from(range_sigma / range) } else { 0.0 };
    sigmas.push(FieldSigma { field: name, share });
    bilateral(
        field,
        spacing,
        BilateralSettings { spatial_sigma: settings.spatial_sigma as f32, range_sigma, radius: settings.radius },
    )
}
