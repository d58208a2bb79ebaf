//! A sharp step along a line, blurred by a Gaussian.

use std::f64::consts::{PI, SQRT_2};

/// A unit step at 0, blurred by a Gaussian of deviation `blur`, at `t`: the normal distribution's `Φ(t / blur)`.
///
/// Small values on the low side keep their relative precision.
pub(super) fn step(t: f64, blur: f64) -> f64 {
    0.5 * libm::erfc(-t / (blur * SQRT_2))
}

/// First derivative of [`step`]: the normal distribution's density.
pub(super) fn density(t: f64, blur: f64) -> f64 {
    let t = t / blur;
    libm::exp(-0.5 * t * t) / (blur * (2.0 * PI).sqrt())
}
