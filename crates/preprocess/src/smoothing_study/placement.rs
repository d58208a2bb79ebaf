//! What is compared: where to smooth, each with two kernels.

use crate::accuracy::Method;
use crate::differentiation::Kernel;
use crate::reconstruction::Reconstruction;
use crate::settings::{self, Automatic, Settings, Smoothing, SmoothingSettings};

/// The placements by name, in the order of [`placements()`].
pub const PLACEMENTS: [&str; 7] = [
    "none",
    "bilateral-derivatives",
    "bilateral-value",
    "bilateral-value narrow",
    "gaussian-value 1",
    "gaussian-value 1.5",
    "auto",
];

/// Range σ of the narrow bilateral filter as a share of the value's range; the default is four times that.
const NARROW: f64 = 0.1;

/// The kernels by name: the differences of `fast`, and the quintic spline of `accurate`.
pub const KERNELS: [&str; 2] = ["central2", "bspline5"];

/// Every placement with every kernel, named `central2, none`: by the release rule, with the default noise floor.
///
/// central2 goes with linear reconstruction, as in `fast`; bspline5 with the best that sees what was smoothed: exact, and
/// quintic for filtered derivatives, which the value's own spline knows nothing of.
#[must_use]
pub fn placements() -> Vec<Method> {
    KERNELS.iter().flat_map(|kernel| PLACEMENTS.map(|placement| method(kernel, placement))).collect()
}

fn method(kernel: &str, placement: &str) -> Method {
    let (smoothing, options) = smoothing(placement);
    let differences = kernel == KERNELS[0];
    let (kernel_of, reconstruction) = match (differences, smoothing.placement) {
        (true, _) => (Kernel::Central2, Reconstruction::Linear),
        (false, Smoothing::BilateralDerivatives) => (Kernel::QuinticSpline, Reconstruction::Quintic),
        (false, _) => (Kernel::QuinticSpline, Reconstruction::Exact),
    };
    let automatic = Automatic { smoothing: placement == "auto", ..Automatic::default() };
    let base = if automatic.smoothing { settings::Method::Auto } else { settings::Method::Fast };
    let settings = Settings { smoothing, kernel: kernel_of, reconstruction, automatic, ..Settings::new(base) };
    Method {
        name: format!("{kernel}, {placement}"),
        options: format!("--method {base} --derivative {kernel} --reconstruction {reconstruction}{options}"),
        settings,
    }
}

/// The smoothing of a placement and the options that choose it.
fn smoothing(placement: &str) -> (SmoothingSettings, String) {
    let of = |placement: Smoothing| (SmoothingSettings::new(placement), format!(" --smooth {placement}"));
    match placement {
        "bilateral-derivatives" => of(Smoothing::BilateralDerivatives),
        "bilateral-value" => of(Smoothing::BilateralValue),
        "bilateral-value narrow" => {
            let (settings, options) = of(Smoothing::BilateralValue);
            (SmoothingSettings { range_sigma: Some(NARROW), ..settings }, format!("{options} --range-sigma {NARROW}"))
        }
        "gaussian-value 1" => {
            let (settings, options) = of(Smoothing::GaussianValue);
            (SmoothingSettings { spatial_sigma: 1.0, ..settings }, options + " --spatial-sigma 1")
        }
        "gaussian-value 1.5" => of(Smoothing::GaussianValue),
        // Replaced by what suits the data.
        "auto" => (SmoothingSettings::new(Smoothing::None), String::new()),
        _ => of(Smoothing::None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn placements_differ_and_can_be_run() {
        let methods = placements();
        assert_eq!(methods.len(), 14);
        for (index, method) in methods.iter().enumerate() {
            assert!(method.settings.validate().is_ok(), "{}", method.name);
            assert!(methods[..index].iter().all(|other| other.settings != method.settings), "{} twice", method.name);
            assert_eq!((method.settings.climb, method.settings.noise_floor), (settings::Climb::Release, 4.0));
            let smooths = method.settings.smoothing.placement != Smoothing::None || method.settings.automatic.smoothing;
            assert_eq!(smooths, !method.name.ends_with("none"), "{}", method.name);
        }
        let sigma = |name: &str| {
            let method = methods.iter().find(|method| method.name == name).expect(name);
            (method.settings.smoothing.spatial_sigma, method.options.clone())
        };
        let options = "--method fast --derivative bspline5 --reconstruction exact --smooth gaussian-value";
        assert_eq!(sigma("bspline5, gaussian-value 1.5"), (1.5, options.into()));
        assert_eq!(sigma("bspline5, gaussian-value 1"), (1.0, format!("{options} --spatial-sigma 1")));
    }
}
