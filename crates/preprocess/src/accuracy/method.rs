//! The methods that are compared, by name.

use crate::differentiation::Kernel;
use crate::directional_derivative::EdgeOperator;
use crate::reconstruction::Reconstruction;
use crate::root_finder::RootFinder;
use crate::settings::{self, Settings, Smoothing, SmoothingSettings};

/// A named set of settings.
#[derive(Clone, Debug, PartialEq)]
pub struct Method {
    /// A short name, for plots and tables: `accurate`, `central2+cubic`, `fast, root cubic`.
    pub name: String,
    /// The options of `voxrole prepare` that choose it.
    pub options: String,
    /// Its settings.
    pub settings: Settings,
}

impl Method {
    fn preset(method: settings::Method) -> Self {
        Self { name: method.to_string(), options: format!("--method {method}"), settings: Settings::new(method) }
    }

    fn of(base: settings::Method, suffix: &str, option: &str, change: impl FnOnce(&mut Settings)) -> Self {
        let mut method = Self::preset(base);
        method.name = format!("{base}, {suffix}");
        method.options = format!("{} {option}", method.options);
        change(&mut method.settings);
        method
    }

    /// A step of the ladder of kernels and reconstructions, by the release rule and without smoothing.
    fn step(kernel: Kernel, reconstruction: Reconstruction) -> Self {
        let settings = Settings { kernel, reconstruction, ..Settings::new(settings::Method::Fast) };
        Self {
            name: format!("{kernel}+{reconstruction}"),
            options: format!("--method fast --derivative {kernel} --reconstruction {reconstruction}"),
            settings,
        }
    }

    fn smoothed(base: settings::Method, placement: Smoothing) -> Self {
        Self::of(base, &placement.to_string(), &format!("--smooth {placement}"), |settings| {
            settings.smoothing = SmoothingSettings::new(placement);
        })
    }

    fn rooted(base: settings::Method, root_finder: RootFinder) -> Self {
        let name = root_finder.name();
        Self::of(base, &format!("root {name}"), &format!("--root {name}"), |settings| {
            settings.root_finder = Some(root_finder);
        })
    }
}

/// All methods: the four rule sets, every kernel with every reconstruction, other root finders, the PLUS operator, and
/// smoothing in every place that the settings allow.
///
/// `fast` is central2 with linear reconstruction, `accurate` is bspline5 with exact: those two steps of the ladder have
/// these names only.
#[must_use]
pub fn methods() -> Vec<Method> {
    use settings::Method::{Accurate, Auto, Fast, Paper};
    let mut methods: Vec<Method> = [Paper, Fast, Accurate, Auto].map(Method::preset).into();
    let kernels = [Kernel::Central2, Kernel::Central4, Kernel::CubicSpline, Kernel::QuinticSpline];
    let ladder = kernels.into_iter().flat_map(|kernel| Reconstruction::ALL.map(|kind| (kernel, kind)));
    let named = [(Kernel::Central2, Reconstruction::Linear), (Kernel::QuinticSpline, Reconstruction::Exact)];
    methods.extend(ladder.filter(|step| !named.contains(step)).map(|(kernel, kind)| Method::step(kernel, kind)));
    methods.push(Method::step(Kernel::Gaussian(1.0), Reconstruction::Exact));
    methods.push(Method::rooted(Fast, RootFinder::Chandrupatla));
    methods.push(Method::rooted(Fast, RootFinder::Cubic));
    methods.push(Method::rooted(Accurate, RootFinder::Bisection));
    methods.push(Method::of(Accurate, "plus", "--edge plus", |settings| settings.operator = EdgeOperator::Plus));
    for base in [Fast, Accurate] {
        for placement in [Smoothing::BilateralDerivatives, Smoothing::BilateralValue, Smoothing::GaussianValue] {
            methods.push(Method::smoothed(base, placement));
        }
    }
    methods.retain(|method| method.settings.validate().is_ok());
    methods
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_differ_and_what_cannot_be_is_left_out() {
        let methods = methods();
        let names: Vec<&str> = methods.iter().map(|method| method.name.as_str()).collect();
        for (index, name) in names.iter().enumerate() {
            assert!(!names[..index].contains(name), "{name} twice");
        }
        for (index, method) in methods.iter().enumerate() {
            assert!(methods[..index].iter().all(|other| other.settings != method.settings), "{} twice", method.name);
        }
        for name in ["paper", "auto", "bspline3+exact", "gaussian:1+exact", "accurate, gaussian-value"] {
            assert!(names.contains(&name), "{name}");
        }
        // A difference kernel has no spline to evaluate; the exact reconstruction does not see filtered derivatives.
        assert!(!names.contains(&"central4+exact") && !names.contains(&"accurate, bilateral-derivatives"));
        assert_eq!(names.len(), 26);
    }
}
