//! What a run is asked to do.

use std::fmt;

use voxrole_pack::Precision;
use voxrole_pack::levels::MOST_LEVELS;

use crate::bilateral::RangeWeights;
use crate::differentiation::Kernel;
use crate::directional_derivative::EdgeOperator;
use crate::reconstruction::Reconstruction;
use crate::root_finder::RootFinder;
use crate::{Error, Result};

/// Which rule set computes the roles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// The paper as printed: bilateral filter on g and f'', literal climbing rule, two rays for every voxel.
    Paper,
    /// Central differences, trilinear interpolation, no smoothing, release climbing rule.
    Fast,
    /// The quintic B-spline through the values and its own derivatives at the boundary, no smoothing, release climbing
    /// rule. For data without noise and with edges blurred by 0.8 voxels or more.
    Accurate,
    /// What suits the data: see [`crate::automatic`].
    Auto,
}

/// Where smoothing is applied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Smoothing {
    /// Nowhere.
    None,
    /// Bilateral filter on gradient magnitude and second derivative, eqs. (3)–(5) of the paper.
    BilateralDerivatives,
    /// Bilateral filter on the value.
    BilateralValue,
    /// Gaussian on the value.
    GaussianValue,
}

/// What stops a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Climb {
    /// A fall of the sampled gradient magnitude.
    Literal,
    /// Only a rise along the other ray.
    Release,
}

/// A smoothing filter's reach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmoothingSettings {
    /// Where it is applied.
    pub placement: Smoothing,
    /// σd in multiples of L_min.
    pub spatial_sigma: f64,
    /// σr as a share of the filtered field's range, or `None` for the placement's own: 0.4 for the value, three times
    /// their estimated noise for derivatives.
    pub range_sigma: Option<f64>,
    /// Neighbours on each side along each axis, in voxels.
    pub radius: usize,
    /// How a bilateral filter computes its range weights.
    pub range_weights: RangeWeights,
}

impl SmoothingSettings {
    /// Defaults for a placement: a bilateral filter of σd = 1 and radius 2 (the neighbourhood holds 95 % of the weight
    /// along an axis) with fast weights, a Gaussian of σ = 1.5 and radius 5.
    #[must_use]
    pub fn new(placement: Smoothing) -> Self {
        let (spatial_sigma, radius) = if placement == Smoothing::GaussianValue { (1.5, 5) } else { (1.0, 2) };
        Self { placement, spatial_sigma, range_sigma: None, radius, range_weights: RangeWeights::Fast }
    }
}

/// Everything that shapes the result of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The rule set that the other defaults came from.
    pub method: Method,
    /// Smoothing.
    pub smoothing: SmoothingSettings,
    /// What differentiates the value.
    pub kernel: Kernel,
    /// What is zero on an edge.
    pub operator: EdgeOperator,
    /// What lies between the voxels at a crossing.
    pub reconstruction: Reconstruction,
    /// What refines a crossing, or `None` for what suits the reconstruction: see [`Self::root_finder`].
    pub root_finder: Option<RootFinder>,
    /// What stops a ray.
    pub climb: Climb,
    /// Distance between samples along a ray, in multiples of L_min; at most 1.
    pub step: f64,
    /// Length of a ray in multiples of L_min.
    pub d_max: f64,
    /// Gradients up to this multiple of the estimated gradient noise are no boundary; where some values are found to be noisier, of
    /// theirs ([`crate::value_noise`]).
    pub noise_floor: f64,
    /// Whether gradient magnitude and second derivative are stored as layers of their own.
    pub keep_derivatives: bool,
    /// How many bits a stored distance and gradient magnitude at a hit have.
    pub precision: Precision,
    /// How many levels of detail the file gets, or `None` for as many as [`usual_levels`] says.
    ///
    /// [`usual_levels`]: voxrole_pack::levels::usual_levels
    pub levels: Option<u32>,
    /// Whether work that cannot hit is skipped; the result is the same.
    pub skip: bool,
    /// What is chosen anew for each volume, whatever is set above.
    pub automatic: Automatic,
}

/// What [`Method::Auto`] chooses by the volume; an option that the user set himself is left to him.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Automatic {
    /// [`Settings::smoothing`].
    pub smoothing: bool,
    /// [`Settings::kernel`].
    pub kernel: bool,
    /// [`Settings::reconstruction`].
    pub reconstruction: bool,
}

/// The longest ray, in multiples of L_min.
pub const LARGEST_D_MAX: f64 = 1000.0;
/// Steps have to be longer than this, in multiples of L_min: a crossing is pinned down far below it anyway.
pub const LEAST_STEP: f64 = 1e-3;
/// The spatial σ of a filter is above this many multiples of `L_min`: far below a voxel it changes nothing.
pub const LEAST_SIGMA: f64 = 1e-3;
/// A bilateral filter's range σ is above this share of the range.
pub const LEAST_RANGE_SIGMA: f64 = 1e-6;

impl Settings {
    /// What refines a crossing: unless it is set, bisection where f'' is trilinear, many voxels at once, and Chandrupatla's
    /// method on splines, which take as long to evaluate as those many voxels, and are no cubics.
    #[must_use]
    pub fn root_finder(&self) -> RootFinder {
        match (self.root_finder, self.reconstruction) {
            (Some(root_finder), Reconstruction::Linear) => root_finder,
            (None, Reconstruction::Linear) => RootFinder::Bisection,
            (Some(RootFinder::Bisection), _) => RootFinder::Bisection,
            _ => RootFinder::Chandrupatla,
        }
    }

    /// These, with what takes up least chosen wherever that is left to the data.
    #[must_use]
    pub fn cheapest(&self) -> Self {
        let mut settings = Self { automatic: Automatic::default(), ..*self };
        if self.automatic.smoothing {
            settings.smoothing = SmoothingSettings::new(Smoothing::None);
        }
        if self.automatic.kernel {
            settings.kernel = Kernel::Central2;
        }
        if self.automatic.reconstruction {
            settings.reconstruction = Reconstruction::Linear;
        }
        settings
    }

    /// The defaults of a method: step L_min/5 and d_max = 15·L_min as in the paper.
    #[must_use]
    pub fn new(method: Method) -> Self {
        let (placement, climb, noise_floor) = match method {
            Method::Paper => (Smoothing::BilateralDerivatives, Climb::Literal, 0.0),
            // One voxel of pure noise in a thousand has a gradient above four deviations of its components.
            Method::Fast | Method::Accurate | Method::Auto => (Smoothing::None, Climb::Release, 4.0),
        };
        let (kernel, reconstruction) = match method {
            Method::Paper | Method::Fast => (Kernel::Central2, Reconstruction::Linear),
            Method::Accurate | Method::Auto => (Kernel::QuinticSpline, Reconstruction::Exact),
        };
        let chosen = method == Method::Auto;
        Self {
            method,
            smoothing: SmoothingSettings::new(placement),
            kernel,
            operator: EdgeOperator::SecondDerivative,
            reconstruction,
            root_finder: None,
            climb,
            step: 0.2,
            d_max: 15.0,
            noise_floor,
            keep_derivatives: false,
            precision: Precision::default(),
            levels: None,
            skip: true,
            automatic: Automatic { smoothing: chosen, kernel: chosen, reconstruction: chosen },
        }
    }

    /// Checks every number.
    ///
    /// # Errors
    /// [`Error::Parameter`], naming the option as on the command line.
    pub fn validate(&self) -> Result<()> {
        let inside = |option: &str, value: f64, low: f64, high: f64| {
            if value > low && value <= high {
                Ok(())
            } else {
                Err(Error::Parameter(format!("{option} {value}: give a number above {low} and up to {high}")))
            }
        };
        inside("--step", self.step, LEAST_STEP, 1.0)?;
        inside("--dmax", self.d_max, 0.0, LARGEST_D_MAX)?;
        if self.d_max < self.step {
            return Err(Error::Parameter(format!("--dmax {} is shorter than --step {}", self.d_max, self.step)));
        }
        inside("--spatial-sigma", self.smoothing.spatial_sigma, LEAST_SIGMA, 30.0)?;
        inside("--radius", self.smoothing.radius as f64, 0.0, 100.0)?;
        if !(0.0..=1e6).contains(&self.noise_floor) {
            return Err(Error::Parameter(format!(
                "--noise-floor {}: give a number from 0 to 1000000",
                self.noise_floor
            )));
        }
        if let Kernel::Gaussian(sigma) = self.kernel {
            inside("--derivative gaussian:", sigma, LEAST_SIGMA, 100.0)?;
        }
        if let Some(levels) = self.levels.filter(|levels| !(1..=MOST_LEVELS).contains(levels)) {
            return Err(Error::Parameter(format!("--levels {levels}: give a number from 1 to {MOST_LEVELS}")));
        }
        self.validate_reconstruction()?;
        self.smoothing.range_sigma.map_or(Ok(()), |sigma| inside("--range-sigma", sigma, LEAST_RANGE_SIGMA, 1000.0))
    }

    fn validate_reconstruction(&self) -> Result<()> {
        if self.reconstruction != Reconstruction::Exact || self.automatic.reconstruction {
            return Ok(());
        }
        if self.kernel.spline().is_none() && !self.automatic.kernel {
            return Err(Error::Parameter(format!(
                "--reconstruction exact needs a spline to evaluate: choose --derivative bspline3, bspline5 or \
                 gaussian:SIGMA, not {}",
                self.kernel
            )));
        }
        if self.smoothing.placement == Smoothing::BilateralDerivatives && !self.automatic.smoothing {
            return Err(Error::Parameter(
                "--reconstruction exact evaluates the value's own spline, which --smooth bilateral-derivatives does not \
                 reach: choose --reconstruction linear, cubic or quintic"
                    .into(),
            ));
        }
        Ok(())
    }
}

impl fmt::Display for Method {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Paper => "paper",
            Self::Fast => "fast",
            Self::Accurate => "accurate",
            Self::Auto => "auto",
        })
    }
}

impl fmt::Display for Smoothing {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::None => "none",
            Self::BilateralDerivatives => "bilateral-derivatives",
            Self::BilateralValue => "bilateral-value",
            Self::GaussianValue => "gaussian-value",
        })
    }
}

impl fmt::Display for Climb {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Literal => "literal",
            Self::Release => "release",
        })
    }
}
