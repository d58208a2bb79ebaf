//! What a scene is the sum of.

use std::fmt::Debug;

use glam::{DMat3, DVec3};

use super::derivatives::Derivatives;
use super::{BlurredBall, BlurredBox, Junction, MarschnerLobb};

/// A smooth field with exact derivatives; a scene is a sum of such parts.
///
/// Lengths are in world units. Everything is a closed form in `f64`, good to a few units in the last place of the part's
/// step.
pub trait Part: Debug + Send + Sync {
    /// What it adds to the value at `point`.
    fn value(&self, point: DVec3) -> f64;

    /// Gradient and Hessian of [`Self::value`].
    fn derivatives(&self, point: DVec3) -> Derivatives;

    /// Hessian of [`Self::value`], symmetric, in value per squared world unit.
    fn hessian(&self, point: DVec3) -> DMat3 {
        self.derivatives(point).hessian
    }

    /// `f'' = nᵀHn`, in value per squared world unit; 0 where the gradient vanishes.
    fn second_derivative(&self, point: DVec3) -> f64 {
        self.derivatives(point).second_derivative()
    }

    /// `∇²f`, in value per squared world unit.
    fn laplacian(&self, point: DVec3) -> f64 {
        self.derivatives(point).laplacian()
    }

    /// Distance from `point` to the sharp surface that was blurred, positive on the side of the higher value; `None`
    /// for a part that was never sharp.
    fn signed_distance(&self, point: DVec3) -> Option<f64>;

    /// Largest difference between its plateaus, as an absolute value.
    fn step(&self) -> f64;

    /// Length below which it is smooth: the deviation of its blur, or the inverse of its highest angular frequency.
    fn detail(&self) -> f64;

    /// Multiplies its values by `factor`, which is not 0.
    fn scale(&mut self, factor: f64);
}

/// The parts that are not a profile on the distance to a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// A sharp ball, blurred.
    Ball(BlurredBall),
    /// A sharp box, blurred.
    Box(BlurredBox),
    /// Three materials that meet along a line, blurred.
    Junction(Junction),
    /// The test signal of Marschner and Lobb.
    MarschnerLobb(MarschnerLobb),
}

impl Shape {
    /// The shape as a part.
    #[must_use]
    pub fn part(&self) -> &dyn Part {
        match self {
            Self::Ball(part) => part,
            Self::Box(part) => part,
            Self::Junction(part) => part,
            Self::MarschnerLobb(part) => part,
        }
    }

    /// The shape as a part that can be changed.
    pub fn part_mut(&mut self) -> &mut dyn Part {
        match self {
            Self::Ball(part) => part,
            Self::Box(part) => part,
            Self::Junction(part) => part,
            Self::MarschnerLobb(part) => part,
        }
    }
}
