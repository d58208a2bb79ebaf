//! A ball truly convolved with a Gaussian.

use glam::{DMat3, DVec3};

use super::derivatives::{Derivatives, outer};
use super::part::Part;
use super::profile;

/// A sharp ball blurred by an isotropic three-dimensional Gaussian.
///
/// With `G` the normal density of deviation `s = blur`, `D = G(R − r) − G(R + r)` and `Φ` the normal distribution, the
/// value at distance `r` from the centre is `step · (Φ((R − r)/s) − Φ(−(R + r)/s) − s²/r · D)`: the integral of the
/// Gaussian over the ball in spherical coordinates around the point. Its zero crossing of f'' lies off the sharp surface,
/// at `r ≈ R − s²/R`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlurredBall {
    /// Its centre.
    pub centre: DVec3,
    /// Radius `R` of the sharp ball; positive.
    pub radius: f64,
    /// Value inside minus value outside; not 0.
    pub step: f64,
    /// Standard deviation of the Gaussian in world units; positive.
    pub blur: f64,
}

/// With `u = r·R/s²` and `E = G(R)·exp(−r²/2s²)`, so that `D = 2E·sinh u`: the three even functions that value and
/// derivatives are made of, which stay finite and exact at the centre.
struct Radial {
    /// `E · sinh(u)/u`.
    sinhc: f64,
    /// `E · p(u)`, `p(u) = (u·cosh u − sinh u)/u³`.
    p: f64,
    /// `E · u·p'(u)`, which is `E · (sinh(u)/u − 3p)`.
    up: f64,
}

/// Below this `u` the closed forms lose digits and the series are used; there twelve terms are exact to 1e-25.
const SERIES_END: f64 = 1.0;

impl BlurredBall {
    fn radial(&self, r: f64) -> Radial {
        let (radius, blur) = (self.radius, self.blur);
        let u = r * radius / (blur * blur);
        if u >= SERIES_END {
            let (near, far) = (profile::density(radius - r, blur), profile::density(radius + r, blur));
            let sinhc = 0.5 * (near - far) / u;
            let p = (0.5 * (near + far) - sinhc) / (u * u);
            return Radial { sinhc, p, up: sinhc - 3.0 * p };
        }
        let e = profile::density(radius, blur) * libm::exp(-0.5 * (r / blur) * (r / blur));
        // sinh(u)/u = Σ u²ᵏ/(2k+1)!, p = Σ 2k·u²ᵏ⁻²/(2k+1)!, u·p' = Σ 2k(2k−2)·u²ᵏ⁻²/(2k+1)!.
        let mut series = Radial { sinhc: 1.0, p: 0.0, up: 0.0 };
        let mut power_over_factorial = 1.0;
        for k in 1..=12 {
            let two_k = f64::from(2 * k);
            let divided = power_over_factorial / (two_k * (two_k + 1.0));
            series.p += two_k * divided;
            series.up += two_k * (two_k - 2.0) * divided;
            power_over_factorial = divided * u * u;
            series.sinhc += power_over_factorial;
        }
        Radial { sinhc: e * series.sinhc, p: e * series.p, up: e * series.up }
    }
}

impl Part for BlurredBall {
    fn value(&self, point: DVec3) -> f64 {
        let r = point.distance(self.centre);
        let within = profile::step(self.radius - r, self.blur) - profile::step(-self.radius - r, self.blur);
        self.step * (within - 2.0 * self.radius * self.radial(r).sinhc)
    }

    fn derivatives(&self, point: DVec3) -> Derivatives {
        let offset = point - self.centre;
        let r = offset.length();
        let radial = self.radial(r);
        let r_over_blur = r / self.blur;
        // f'/r = −2R³/s⁴ · E·p and f'' − f'/r = r·(f'/r)' = −2R³/s⁴ · E·(u·p' − r²/s² · p).
        let ratio = self.radius / self.blur;
        let factor = -2.0 * self.step * (ratio * ratio * ratio) / self.blur;
        let over_r = factor * radial.p;
        let direction = offset.normalize_or_zero();
        let radial_bend = factor * (radial.up - r_over_blur * r_over_blur * radial.p);
        Derivatives {
            gradient: over_r * offset,
            hessian: DMat3::from_diagonal(DVec3::splat(over_r)) + outer(direction, direction) * radial_bend,
        }
    }

    fn signed_distance(&self, point: DVec3) -> Option<f64> {
        Some((self.radius - point.distance(self.centre)) * self.step.signum())
    }

    fn step(&self) -> f64 {
        self.step.abs()
    }

    fn detail(&self) -> f64 {
        self.blur
    }

    fn scale(&mut self, factor: f64) {
        self.step *= factor;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phantom::test_support::{check_derivatives, integrate, scattered_points};

    fn ball(radius: f64, blur: f64) -> BlurredBall {
        BlurredBall { centre: DVec3::new(0.3, -0.2, 0.1), radius, step: -0.7, blur }
    }

    /// The convolution along cylinders around the line from the centre to the point, `ρ = R·sin θ`.
    fn convolved(ball: &BlurredBall, r: f64) -> f64 {
        let BlurredBall { radius, blur, .. } = *ball;
        integrate(0.0, std::f64::consts::FRAC_PI_2, 400, |theta| {
            let (rho, half_chord) = (radius * theta.sin(), radius * theta.cos());
            let along = profile::step(half_chord - r, blur) - profile::step(-half_chord - r, blur);
            let area = 2.0 * std::f64::consts::PI * rho * radius * theta.cos();
            area * profile::density(rho, blur) * profile::density(0.0, blur) * along
        })
    }

    #[test]
    fn the_closed_form_is_the_convolution() {
        for (radius, blur) in [(5.0, 1.0), (2.0, 1.5), (1.0, 3.0), (8.0, 0.7)] {
            let ball = ball(radius, blur);
            for r in [0.0, 1e-9, 0.01, 0.3, 0.99, 1.7, radius, radius + 1.0, radius + 3.0 * blur] {
                let point = ball.centre + r * DVec3::new(0.36, 0.48, 0.8);
                let error = Part::value(&ball, point) + 0.7 * convolved(&ball, r);
                assert!(error.abs() < 1e-11, "R {radius} s {blur} r {r}: {error}");
            }
        }
    }

    #[test]
    fn derivatives_agree_with_differences_also_at_the_centre() {
        for (radius, blur) in [(5.0, 1.0), (2.0, 1.5), (1.0, 3.0)] {
            let ball = ball(radius, blur);
            let near_centre = [0.0, 1e-7, 1e-3, 0.1].map(|r| ball.centre + r * DVec3::new(0.6, 0.0, 0.8));
            check_derivatives(&ball, scattered_points(DVec3::ZERO, 7.0).chain(near_centre));
        }
    }

    #[test]
    fn series_and_closed_form_meet() {
        let ball = ball(3.0, 1.2);
        let meeting = SERIES_END * 1.44 / 3.0;
        let at = |r: f64| {
            let derivatives = ball.derivatives(ball.centre + DVec3::new(r, 0.0, 0.0));
            (derivatives.gradient.x, derivatives.hessian.x_axis.x, derivatives.hessian.y_axis.y)
        };
        let (below, above) = (at(meeting * (1.0 - 1e-15)), at(meeting * (1.0 + 1e-15)));
        for (a, b) in [(below.0, above.0), (below.1, above.1), (below.2, above.2)] {
            assert!((a / b - 1.0).abs() < 1e-12, "{a} {b}");
        }
    }

    #[test]
    fn nearly_sharp_and_far_away_it_stays_finite() {
        for r in [0.0, 1.0, 19.99, 20.0, 20.01, 1e4] {
            let ball = ball(20.0, 1e-3);
            let point = ball.centre + DVec3::new(0.0, r, 0.0);
            let derivatives = ball.derivatives(point);
            assert!(Part::value(&ball, point).is_finite() && derivatives.hessian.is_finite(), "{r}: {derivatives:?}");
        }
    }
}
