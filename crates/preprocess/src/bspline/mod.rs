//! Interpolating B-splines: a smooth function through every sample, with exact derivatives.
//!
//! Source: Unser, Aldroubi and Eden, *B-spline signal processing*, IEEE Trans. Signal Processing 41(2), 1993; Unser,
//! *Splines: a perfect fit for signal and image processing*, IEEE Signal Processing Magazine 16(6), 1999.

mod basis;
pub mod coefficients;
pub mod evaluation;
mod prefilter;

pub use coefficients::Coefficients;
pub use evaluation::{Evaluator, Jet};

/// Degree of a spline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Degree {
    /// Degree 3: error of the value O(h⁴), of the gradient O(h³) between samples and O(h⁴) on them, of the second
    /// derivative O(h²).
    Cubic,
    /// Degree 5: O(h⁶), O(h⁵) between samples and O(h⁶) on them, O(h⁴).
    Quintic,
}

impl Degree {
    /// The poles of the recursive filter that turns samples into coefficients, Unser 1999, table in box 2.
    const fn poles(self) -> &'static [f64] {
        match self {
            Self::Cubic => &[-0.267_949_192_431_122_7],
            Self::Quintic => &[-0.430_575_347_099_973_8, -0.043_096_288_203_264_66],
        }
    }

    /// How many samples away, along an axis, a coefficient still depends on: farther ones change no digit of f32.
    #[must_use]
    pub const fn reach(self) -> usize {
        match self {
            Self::Cubic => 15,
            Self::Quintic => 24,
        }
    }

    /// Basis weights at a sample of the spline, its first and its second derivative per voxel: for the sample itself and
    /// its first and second neighbour, the higher one where the sign differs.
    #[must_use]
    pub const fn at_samples(self) -> [[f32; 3]; 3] {
        match self {
            Self::Cubic => [[4.0 / 6.0, 1.0 / 6.0, 0.0], [0.0, 0.5, 0.0], [-2.0, 1.0, 0.0]],
            Self::Quintic => [
                [66.0 / 120.0, 26.0 / 120.0, 1.0 / 120.0],
                [0.0, 10.0 / 24.0, 1.0 / 24.0],
                [-1.0, 1.0 / 3.0, 1.0 / 6.0],
            ],
        }
    }
}
