//! A box truly convolved with a Gaussian.

use glam::{DMat3, DVec3};

use super::derivatives::Derivatives;
use super::part::Part;
use super::profile;

/// A sharp box with faces along the world's axes, blurred by an isotropic Gaussian.
///
/// Gaussian and box are products over the axes, and so is the value: `step · Π (Φ((x+a)/s) − Φ((x−a)/s))`, `a` the half
/// extents. Blur rounds the edges and corners: there the zero crossing of f'' lies inside the sharp box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlurredBox {
    /// Its centre.
    pub centre: DVec3,
    /// Half of its extents along x, y, z; positive.
    pub half_extents: DVec3,
    /// Value inside minus value outside; not 0.
    pub step: f64,
    /// Standard deviation of the Gaussian in world units; positive.
    pub blur: f64,
}

impl BlurredBox {
    /// A blurred interval of half extent `a` at `x`, and its first two derivatives.
    fn interval(x: f64, a: f64, blur: f64) -> [f64; 3] {
        // Mirrored to the side where both terms are small, so that their difference keeps its digits.
        let far = x.abs();
        let [entering, leaving] = [x + a, x - a];
        let [rise, fall] = [profile::density(entering, blur), profile::density(leaving, blur)];
        [
            profile::step(a - far, blur) - profile::step(-a - far, blur),
            rise - fall,
            (leaving * fall - entering * rise) / blur / blur,
        ]
    }

    fn intervals(&self, point: DVec3) -> [[f64; 3]; 3] {
        let offset = point - self.centre;
        [0, 1, 2].map(|axis| Self::interval(offset[axis], self.half_extents[axis], self.blur))
    }
}

impl Part for BlurredBox {
    fn value(&self, point: DVec3) -> f64 {
        let [x, y, z] = self.intervals(point);
        self.step * (x[0] * y[0] * z[0])
    }

    fn derivatives(&self, point: DVec3) -> Derivatives {
        let [x, y, z] = self.intervals(point);
        let product = |i: usize, j: usize, k: usize| self.step * (x[i] * y[j] * z[k]);
        let [xy, xz, yz] = [product(1, 1, 0), product(1, 0, 1), product(0, 1, 1)];
        Derivatives {
            gradient: DVec3::new(product(1, 0, 0), product(0, 1, 0), product(0, 0, 1)),
            hessian: DMat3::from_cols(
                DVec3::new(product(2, 0, 0), xy, xz),
                DVec3::new(xy, product(0, 2, 0), yz),
                DVec3::new(xz, yz, product(0, 0, 2)),
            ),
        }
    }

    fn signed_distance(&self, point: DVec3) -> Option<f64> {
        let beyond = (point - self.centre).abs() - self.half_extents;
        let outside = beyond.max(DVec3::ZERO).length();
        Some((-beyond.max_element().min(0.0) - outside) * self.step.signum())
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

    const BOX: BlurredBox = BlurredBox {
        centre: DVec3::new(0.3, -0.2, 0.1),
        half_extents: DVec3::new(4.0, 3.0, 1.5),
        step: 1.3,
        blur: 0.9,
    };

    #[test]
    fn the_closed_form_is_the_convolution() {
        let [x, y, z] = BOX.half_extents.to_array();
        for offset in [
            DVec3::ZERO,
            DVec3::new(4.0, 0.5, 0.2),
            DVec3::new(-4.0, 3.0, 1.5),
            DVec3::new(4.5, -3.3, -2.0),
            DVec3::new(1.0, 2.0, 3.0),
        ] {
            // The Gaussian as one function of the distance, summed over the volume of the box.
            let convolved = integrate(-x, x, 16, |px| {
                integrate(-y, y, 12, |py| {
                    integrate(-z, z, 8, |pz| {
                        let squared = (DVec3::new(px, py, pz) - offset).length_squared();
                        (-0.5 * squared / 0.81).exp() / (0.9_f64.powi(3) * (2.0 * std::f64::consts::PI).powf(1.5))
                    })
                })
            });
            let error = Part::value(&BOX, BOX.centre + offset) - 1.3 * convolved;
            assert!(error.abs() < 1e-8, "{offset}: {error}");
        }
    }

    #[test]
    fn derivatives_agree_with_differences() {
        check_derivatives(&BOX, scattered_points(BOX.centre, 6.0));
    }

    #[test]
    fn distance_is_that_to_faces_edges_and_corners() {
        let distance = |x, y, z| BOX.signed_distance(BOX.centre + DVec3::new(x, y, z)).expect("a surface");
        assert_eq!(distance(0.0, 0.0, 0.0), 1.5);
        assert_eq!(distance(-3.5, 0.0, 0.0), 0.5);
        assert!((distance(0.0, 0.0, 3.5) + 2.0).abs() < 1e-14);
        assert!((distance(7.0, -7.0, 0.0) + 5.0).abs() < 1e-14);
        assert!((distance(5.0, 5.0, -3.5) + 3.0).abs() < 1e-14);
        let hole = BlurredBox { step: -1.0, ..BOX };
        assert_eq!(hole.signed_distance(BOX.centre), Some(-1.5));
    }

    #[test]
    fn far_tails_keep_their_digits() {
        // Twelve blurs outside a face: the other faces' factors are 1, the tail is Φ(−12).
        let point = BOX.centre + DVec3::new(4.0 + 12.0 * 0.9, 0.0, 0.0);
        let tail = 1.776_482_112_077_678_6e-33 * 1.3;
        let sides = BlurredBox::interval(0.0, 3.0, 0.9)[0] * BlurredBox::interval(0.0, 1.5, 0.9)[0];
        assert!((Part::value(&BOX, point) / (tail * sides) - 1.0).abs() < 1e-12);
    }
}
