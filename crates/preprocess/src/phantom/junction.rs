//! Three materials that meet along a line.

use glam::DVec3;

use super::derivatives::{Derivatives, outer};
use super::part::Part;
use super::profile;

/// A T-junction, blurred by an isotropic Gaussian: beyond a plane the world is divided by a second one at right angles.
///
/// With `u` the distance beyond the first plane and `v` that beyond the second, the value is
/// `Φ(u/s) · (step + split · Φ(v/s))`: 0 where `u < 0`, else `step` where `v < 0` and `step + split` where `v > 0`. It is
/// the exact convolution, because the Gaussian is a product over `u` and `v`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Junction {
    /// A point where the three materials meet.
    pub centre: DVec3,
    /// Unit vector from the first material into the two others.
    pub normal: DVec3,
    /// Unit vector from the second material to the third; at right angles to `normal`.
    pub split_normal: DVec3,
    /// Value of the second material minus that of the first; not 0.
    pub step: f64,
    /// Value of the third material minus that of the second; not 0, and `step + split` of the same sign as `step`.
    pub split: f64,
    /// Standard deviation of the Gaussian in world units; positive.
    pub blur: f64,
}

impl Junction {
    /// Distance beyond the first plane and beyond the second.
    fn coordinates(&self, point: DVec3) -> (f64, f64) {
        let offset = point - self.centre;
        (self.normal.dot(offset), self.split_normal.dot(offset))
    }
}

impl Part for Junction {
    fn value(&self, point: DVec3) -> f64 {
        let (u, v) = self.coordinates(point);
        profile::step(u, self.blur) * self.split.mul_add(profile::step(v, self.blur), self.step)
    }

    fn derivatives(&self, point: DVec3) -> Derivatives {
        let (u, v) = self.coordinates(point);
        let beyond = profile::step(u, self.blur);
        let first = profile::density(u, self.blur);
        let first_slope = -u / self.blur / self.blur * first;
        let height = self.split.mul_add(profile::step(v, self.blur), self.step);
        let split = self.split * profile::density(v, self.blur);
        let split_slope = -v / self.blur / self.blur * split;
        let (a, b) = (self.normal, self.split_normal);
        Derivatives {
            gradient: first * height * a + beyond * split * b,
            hessian: outer(a, a) * (first_slope * height)
                + (outer(a, b) + outer(b, a)) * (first * split)
                + outer(b, b) * (beyond * split_slope),
        }
    }

    fn signed_distance(&self, point: DVec3) -> Option<f64> {
        let (u, v) = self.coordinates(point);
        // The second plane ends at the first: on the near side nothing of it is closer than the first plane.
        Some(if u <= v.abs() { u * self.step.signum() } else { v * self.split.signum() })
    }

    fn step(&self) -> f64 {
        self.step.abs().max(self.split.abs()).max((self.step + self.split).abs())
    }

    fn detail(&self) -> f64 {
        self.blur
    }

    fn scale(&mut self, factor: f64) {
        self.step *= factor;
        self.split *= factor;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phantom::test_support::{check_derivatives, integrate, scattered_points};

    const JUNCTION: Junction = Junction {
        centre: DVec3::new(0.3, -0.2, 0.1),
        normal: DVec3::new(0.8, 0.48, 0.36),
        split_normal: DVec3::new(-0.6, 0.64, 0.48),
        step: 0.4,
        split: 0.6,
        blur: 1.1,
    };

    fn at(u: f64, v: f64) -> DVec3 {
        // Along the line where the materials meet nothing changes.
        let along = JUNCTION.normal.cross(JUNCTION.split_normal);
        JUNCTION.centre + u * JUNCTION.normal + v * JUNCTION.split_normal + 3.7 * along
    }

    #[test]
    fn the_closed_form_is_the_convolution() {
        for (u, v) in [(0.0, 0.0), (1.0, 0.5), (0.7, -1.9), (-1.2, 0.3), (4.0, 1.0), (-0.5, -3.0)] {
            let gaussian = |x: f64, y: f64| {
                let squared = (x - u) * (x - u) + (y - v) * (y - v);
                (-0.5 * squared / 1.21).exp() / (1.21 * 2.0 * std::f64::consts::PI)
            };
            let quadrant = |from: f64, to: f64, value: f64| {
                value * integrate(0.0, 16.0, 60, |x| integrate(from, to, 60, |y| gaussian(x, y)))
            };
            let convolved = quadrant(-16.0, 0.0, 0.4) + quadrant(0.0, 16.0, 1.0);
            let error = Part::value(&JUNCTION, at(u, v)) - convolved;
            assert!(error.abs() < 1e-8, "{u} {v}: {error}");
        }
    }

    #[test]
    fn derivatives_agree_with_differences() {
        check_derivatives(&JUNCTION, scattered_points(JUNCTION.centre, 4.0));
    }

    #[test]
    fn distance_is_that_to_the_nearer_plane() {
        let cases = [(-2.0, 0.5, -2.0), (1.0, 3.0, 1.0), (3.0, 1.0, 1.0), (3.0, -1.0, -1.0), (1.0, -3.0, 1.0)];
        for (u, v, expected) in cases {
            let found = JUNCTION.signed_distance(at(u, v)).expect("a surface");
            assert!((found - expected).abs() < 1e-12, "{u} {v}: {found}");
        }
    }
}
