//! What lies between the voxels where a boundary is pinned down.

use std::fmt;
use std::str::FromStr;

use crate::bspline::Evaluator;
use crate::directional_derivative::EdgeOperator;
use crate::sampler::{Place, Sampler};
use crate::{Error, Result};

/// How g and f'' are reconstructed at the crossing. Crossings are always found on trilinear f'', where skipping cells is
/// exact, and then refined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Reconstruction {
    /// Trilinear interpolation of the voxels' g and f'': the paper's.
    #[default]
    Linear,
    /// Cubic B-splines through the voxels' g and f''.
    Cubic,
    /// Quintic B-splines through the voxels' g and f''.
    Quintic,
    /// The value's own B-spline: its gradient and Hessian at the place itself. Needs a kernel that is one.
    Exact,
}

impl Reconstruction {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Linear, Self::Cubic, Self::Quintic, Self::Exact];

    /// The name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Cubic => "cubic",
            Self::Quintic => "quintic",
            Self::Exact => "exact",
        }
    }
}

impl fmt::Display for Reconstruction {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

impl FromStr for Reconstruction {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        Self::ALL
            .into_iter()
            .find(|candidate| candidate.name() == text)
            .ok_or_else(|| Error::Parameter(format!("`{text}` is none of {}", Self::ALL.map(Self::name).join(", "))))
    }
}

/// A smooth reconstruction of one volume.
#[derive(Clone, Copy)]
pub enum Smooth<'a> {
    /// Splines through the derivatives' voxels.
    Fields {
        /// Through f''.
        second_derivative: Evaluator<'a>,
        /// Through g.
        gradient_magnitude: Evaluator<'a>,
        /// The values, interpolated linearly.
        values: (Sampler, &'a [f32]),
    },
    /// The value's own spline.
    Exact {
        /// The spline.
        value: Evaluator<'a>,
        /// What is zero on an edge.
        operator: EdgeOperator,
    },
}

/// What there is at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeSample {
    /// The edge operator.
    pub edge: f32,
    /// Gradient magnitude.
    pub gradient_magnitude: f32,
    /// Value.
    pub value: f32,
}

impl Smooth<'_> {
    /// All that it has at a place.
    #[inline(always)]
    #[must_use]
    pub fn at(&self, place: &Place) -> EdgeSample {
        match self {
            Self::Fields { second_derivative, gradient_magnitude, values: (sampler, values) } => EdgeSample {
                edge: second_derivative.value(place),
                gradient_magnitude: gradient_magnitude.value(place),
                value: sampler.trilinear(values, place),
            },
            Self::Exact { value, operator } => {
                let jet = value.jet(place);
                let edge = match operator {
                    EdgeOperator::SecondDerivative => jet.second_derivative(),
                    EdgeOperator::Plus => 0.5 * (jet.second_derivative() + jet.laplacian()),
                };
                EdgeSample { edge, gradient_magnitude: jet.gradient.length(), value: jet.value }
            }
        }
    }
}
