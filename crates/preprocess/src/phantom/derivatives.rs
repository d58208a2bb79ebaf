//! First and second derivatives of a field at a point, and what follows from them.

use std::iter::Sum;
use std::ops::Add;

use glam::{DMat3, DVec3};

/// Gradient and Hessian of a field at one point of the world.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Derivatives {
    /// Gradient, in value per world unit.
    pub gradient: DVec3,
    /// Hessian, symmetric, in value per squared world unit.
    pub hessian: DMat3,
}

impl Derivatives {
    /// No change at all.
    pub const ZERO: Self = Self { gradient: DVec3::ZERO, hessian: DMat3::ZERO };

    /// `n = ∇f/‖∇f‖`, or `None` where the gradient vanishes in `f64`.
    #[must_use]
    pub fn direction(&self) -> Option<DVec3> {
        // Far from a boundary the gradient is too small to be squared.
        let largest = self.gradient.abs().max_element();
        (largest > 0.0 && largest.is_finite()).then(|| (self.gradient / largest).normalize())
    }

    /// `‖∇f‖`, in value per world unit; also where its square leaves the range of `f64`.
    #[must_use]
    pub fn gradient_magnitude(&self) -> f64 {
        self.direction().map_or(0.0, |direction| direction.dot(self.gradient))
    }

    /// `f'' = nᵀHn`, the second derivative along the gradient (equation 2 of the paper); 0 where the gradient vanishes.
    #[must_use]
    pub fn second_derivative(&self) -> f64 {
        self.direction().map_or(0.0, |direction| direction.dot(self.hessian * direction))
    }

    /// `∇²f`, the trace of the Hessian.
    #[must_use]
    pub fn laplacian(&self) -> f64 {
        self.hessian.x_axis.x + self.hessian.y_axis.y + self.hessian.z_axis.z
    }
}

impl Add for Derivatives {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self { gradient: self.gradient + other.gradient, hessian: self.hessian + other.hessian }
    }
}

impl Sum for Derivatives {
    fn sum<I: Iterator<Item = Self>>(parts: I) -> Self {
        parts.fold(Self::ZERO, Add::add)
    }
}

/// `a·bᵀ`.
pub(super) fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}
