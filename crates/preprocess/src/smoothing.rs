//! Which field is smoothed, with which widths.

use crate::bilateral::{BilateralSettings, bilateral};
use crate::directional_derivative::Derivatives;
use crate::gaussian::gaussian;
use crate::noise::{GRADIENT_GAIN, SECOND_DERIVATIVE_GAIN, noise_sigma};
use crate::report::FieldSigma;
use crate::settings::{Smoothing, SmoothingSettings};
use crate::working_field::{Field, WorkingField, voxels};

/// σr in multiples of the filtered field's estimated noise: differences of noise alone keep most of their weight, an edge
/// of ten times the noise keeps 0.4 %.
pub const RANGE_SIGMA_PER_NOISE: f32 = 3.0;

/// What smoothing found out on its way.
#[derive(Clone, Debug, Default)]
pub struct SmoothingFindings {
    /// Estimated noise of the value field, in working units.
    pub noise: Option<f32>,
    /// σr of each bilaterally filtered field.
    pub range_sigma: Vec<FieldSigma>,
}

/// Smooths the value field where the settings say so.
pub fn smooth_value(field: &mut WorkingField, settings: &SmoothingSettings, findings: &mut SmoothingFindings) {
    match settings.placement {
        Smoothing::None | Smoothing::BilateralDerivatives => {}
        Smoothing::GaussianValue => {
            field.values = gaussian(&field.values, field.spacing, settings.spatial_sigma as f32, settings.radius);
        }
        Smoothing::BilateralValue => {
            let noise = noise_of(field, settings, findings);
            field.values = filtered(&field.values, "value", noise, field.spacing, settings, findings);
        }
    }
}

/// Smooths gradient magnitude and second derivative where the settings say so, as the paper does.
pub fn smooth_derivatives(
    field: &WorkingField,
    derivatives: &mut Derivatives,
    settings: &SmoothingSettings,
    findings: &mut SmoothingFindings,
) {
    if settings.placement != Smoothing::BilateralDerivatives {
        return;
    }
    let noise = noise_of(field, settings, findings);
    for (name, gain, derivative) in [
        ("gradient-magnitude", GRADIENT_GAIN, &mut derivatives.gradient_magnitude),
        ("second-derivative", SECOND_DERIVATIVE_GAIN, &mut derivatives.second_derivative),
    ] {
        *derivative = filtered(derivative, name, noise * gain, field.spacing, settings, findings);
    }
}

/// The noise, unless σr is given and nobody needs it.
fn noise_of(field: &WorkingField, settings: &SmoothingSettings, findings: &mut SmoothingFindings) -> f32 {
    if settings.range_sigma.is_some() {
        return 0.0;
    }
    *findings.noise.get_or_insert_with(|| noise_sigma(field))
}

fn filtered(
    field: &Field,
    name: &'static str,
    noise: f32,
    spacing: [f32; 3],
    settings: &SmoothingSettings,
    findings: &mut SmoothingFindings,
) -> Field {
    let (low, high) = voxels(field)
        .iter()
        .filter(|value| !value.is_nan())
        .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &value| (low.min(value), high.max(value)));
    let range = (high - low).max(0.0);
    let range_sigma = settings.range_sigma.map_or(RANGE_SIGMA_PER_NOISE * noise, |share| share as f32 * range);
    let share = if range > 0.0 { f64::from(range_sigma / range) } else { 0.0 };
    findings.range_sigma.push(FieldSigma { field: name, share });
    bilateral(
        field,
        spacing,
        BilateralSettings { spatial_sigma: settings.spatial_sigma as f32, range_sigma, radius: settings.radius },
    )
}
