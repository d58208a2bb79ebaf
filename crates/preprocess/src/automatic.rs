//! Smoothing, kernel and reconstruction by what a volume's noise and blur let through.

use serde::Serialize;

use crate::Result;
use crate::blur::{EdgeStatistics, Edges};
use crate::boundary::{GradientFloor, Tracer};
use crate::bspline::Evaluator;
use crate::differentiation::{Gradient, GradientSource, Kernel, differentiate};
use crate::directional_derivative::EdgeOperator;
use crate::gaussian::{gaussian, radius_of};
use crate::noise::smoothed_noise_sigma;
use crate::noise_gain::{GradientNoise, NoiseGain};
use crate::reconstruction::Reconstruction;
use crate::region::Region;
use crate::settings::{Automatic, Method, Settings, Smoothing, SmoothingSettings};
use crate::smoothing::sigma_on_noise;
use crate::value_noise::ValueNoise;
use crate::working_field::WorkingField;
use crate::zero_crossing::CellDistances;

/// Edges sharper than this, in samples of the axis that they face, are under-sampled: a spline rings beside them, and its second
/// derivative has crossings of its own.
pub const LEAST_BLUR: f64 = 0.8;
/// How far noise may move a crossing, as a standard deviation in multiples of L_min.
pub const MOST_JITTER: f64 = 0.025;
/// The widths that are tried, in multiples of L_min, the smallest that suffices being taken. Beyond the largest, layers of
/// four voxels would run into one another.
const SIGMAS: [f64; 7] = [0.0, 0.5, 0.7, 0.85, 1.0, 1.25, 1.5];
/// σ of the Gaussian under which blur is measured, so that noise does not make it look sharper; taken off again.
const MEASURING_SIGMA: f32 = 1.0;

/// No edge is taken to be sharper, in multiples of L_min: that of a mask sampled voxel by voxel.
const SHARPEST: f32 = 0.3;

/// What was found and chosen, as the report gives it.
#[derive(Clone, Debug, Serialize)]
pub struct Choice {
    /// Estimated noise as a share of the typical step across a boundary; absent where no boundary was found.
    pub noise_share: Option<f64>,
    /// Estimated standard deviation of the blur of the stronger boundaries, in multiples of L_min.
    pub blur: Option<f64>,
    /// Gaussian smoothing of the value, σ in multiples of L_min; 0 for none.
    pub sigma: f64,
    /// By how much noise is expected to move a crossing, in multiples of L_min.
    pub jitter: Option<f64>,
    /// The kernel.
    pub kernel: String,
    /// The reconstruction.
    pub reconstruction: &'static str,
    /// Why, in words.
    pub reason: String,
}

/// Fills in whatever [`Settings::automatic`] leaves to the data, judging by parts of a volume; `noise` is the volume's, in
/// working units.
///
/// # Errors
/// [`crate::Error::Pack`] when memory runs out.
///
/// # Panics
/// When there is no part.
pub fn choose(fields: &[&WorkingField], noise: f32, settings: &mut Settings) -> Result<Choice> {
    let edges = measure(fields, noise)?;
    let field = fields[0];
    let blur = edges.map(|edges| f64::from(edges.blur));
    // A spline where the edges are blurred enough for it, be it by the Gaussian that noise asks for.
    let width = |kernel: Kernel| match (&edges, settings.automatic.smoothing) {
        (Some(edges), true) => sufficient_width(field, noise, edges, kernel),
        _ => Ok((sigma_on_noise(&settings.smoothing).map_or(0.0, f64::from), None)),
    };
    let mut kernel = if settings.automatic.kernel { Kernel::QuinticSpline } else { settings.kernel };
    let (mut sigma, mut jitter) = width(kernel)?;
    let samples = edges.map(|edges| edges.samples_across(field.spacing, sigma));
    // What is asked for on a spline needs one, whatever the edges are.
    let needs_spline = settings.reconstruction == Reconstruction::Exact && !settings.automatic.reconstruction;
    if samples.is_some_and(|samples| samples < LEAST_BLUR) && settings.automatic.kernel && !needs_spline {
        kernel = Kernel::Central2;
        (sigma, jitter) = width(kernel)?;
    }
    let reason = samples.map_or_else(
        || "no boundary stands out from the noise, so that there is nothing to go by".into(),
        |samples| reason(samples, sigma, settings.automatic),
    );
    settings.kernel = kernel;
    if settings.automatic.smoothing {
        settings.smoothing = if sigma > 0.0 {
            SmoothingSettings {
                spatial_sigma: sigma,
                radius: radius_of(sigma as f32, field.spacing),
                ..SmoothingSettings::new(Smoothing::GaussianValue)
            }
        } else {
            SmoothingSettings::new(Smoothing::None)
        };
    }
    if settings.automatic.reconstruction {
        let exact =
            settings.kernel.spline().is_some() && settings.smoothing.placement != Smoothing::BilateralDerivatives;
        settings.reconstruction = if exact { Reconstruction::Exact } else { Reconstruction::Linear };
    }
    Ok(Choice {
        noise_share: edges.map(|edges| f64::from(noise / edges.step)),
        blur,
        sigma,
        jitter,
        kernel: settings.kernel.to_string(),
        reconstruction: settings.reconstruction.name(),
        reason,
    })
}

/// The smallest of the widths that keeps noise from moving crossings by more than [`MOST_JITTER`], or the largest, and by
/// how much noise moves them then.
fn sufficient_width(
    field: &WorkingField,
    noise: f32,
    edges: &EdgeStatistics,
    kernel: Kernel,
) -> Result<(f64, Option<f64>)> {
    let mut found = (0.0, None);
    for sigma in SIGMAS {
        let jitter = expected_jitter(field, noise, edges, kernel, sigma)?;
        found = (sigma, Some(jitter));
        if jitter <= MOST_JITTER {
            break;
        }
    }
    Ok(found)
}

/// Why, for what was left to the data; `samples` is the blur of the worst sampled edges after smoothing.
fn reason(samples: f64, sigma: f64, automatic: Automatic) -> String {
    let once = if sigma > 0.0 { " once smoothed" } else { "" };
    let kernel = match (automatic.kernel, samples < LEAST_BLUR) {
        (false, _) => format!("boundaries are blurred by {samples:.2} samples{once}; the kernel was given"),
        (true, true) => format!(
            "boundaries blurred by {samples:.2} samples{once} are under-sampled: splines would ring, differences do not"
        ),
        (true, false) => {
            format!("boundaries blurred by {samples:.2} samples{once} are sampled well enough for a quintic spline")
        }
    };
    let smoothing = match (automatic.smoothing, sigma > 0.0) {
        (false, _) => "smoothing was given".into(),
        (true, true) => format!("a Gaussian of {sigma} voxels keeps the noise from moving them by more than it must"),
        (true, false) => "the noise is too low to move them".into(),
    };
    format!("{kernel}; {smoothing}")
}

/// The standard deviation of a crossing's place: that of f'' under noise over the slope of f'' across the edge, which is
/// A/(s³√2π) for a step A blurred by s.
fn expected_jitter(
    field: &WorkingField,
    noise: f32,
    edges: &EdgeStatistics,
    kernel: Kernel,
    sigma: f64,
) -> Result<f64> {
    let sigmas = if sigma > 0.0 { vec![sigma as f32] } else { Vec::new() };
    let gain = NoiseGain::new(kernel, &sigmas, field.spacing)?;
    let blur = f64::from(edges.blur).hypot(sigma);
    let slope = f64::from(edges.step) / (blur.powi(3) * std::f64::consts::TAU.sqrt());
    Ok(f64::from(noise * gain.second_derivative) / slope)
}

/// The edges of parts of a volume under a Gaussian, its blur taken off again; `None` where hardly any stands out.
fn measure(fields: &[&WorkingField], noise: f32) -> Result<Option<EdgeStatistics>> {
    let parts: Vec<_> = fields.iter().map(|field| field.dims()).collect();
    let mut edges = Edges::among(&parts);
    for field in fields {
        look_for_edges(field, noise, &mut edges)?;
    }
    let own = |blur: f32| (blur * blur - MEASURING_SIGMA * MEASURING_SIGMA).max(SHARPEST * SHARPEST).sqrt();
    Ok(edges.statistics().map(|found| EdgeStatistics {
        blur: own(found.blur),
        blur_facing: found.blur_facing.map(|blur| blur.map(own)),
        ..found
    }))
}

/// Adds the edges of one part, as if it was a volume of its own.
fn look_for_edges(field: &WorkingField, noise: f32, edges: &mut Edges) -> Result<()> {
    let radius = radius_of(MEASURING_SIGMA, field.spacing);
    let values = gaussian(&field.values, field.spacing, MEASURING_SIGMA, radius);
    let mut smooth = WorkingField { values, ..*field };
    let kernel = Kernel::QuinticSpline;
    let (derivatives, source) = differentiate(&mut smooth, kernel, EdgeOperator::SecondDerivative)?;
    let GradientSource::Spline(coefficients) = &source else { unreachable!("the kernel is a spline") };
    let cells = CellDistances::new(&derivatives.second_derivative);
    let settings = Settings { d_max: 4.0, ..Settings::new(Method::Fast) };
    let noise = noise.max(smoothed_noise_sigma(&[&smooth], &[MEASURING_SIGMA]));
    let gradient_noise = GradientNoise::new(kernel, &[MEASURING_SIGMA], field.spacing, field.dims(), noise)?;
    // Where noise is stronger, noisy edges are weak ones too, and only the stronger half is judged by.
    let floor = GradientFloor::new(gradient_noise, ValueNoise::EVEN, settings.noise_floor as f32);
    let gradient = Gradient::new(&smooth, &source);
    let tracer = Tracer::new(&smooth, &derivatives, &cells, gradient, None, &floor, &settings);
    let spline = Evaluator::new(coefficients, field.spacing);
    edges.look(&tracer, &spline, &Region::whole(field.dims()), [0; 3]);
    Ok(())
}
