//! Boundaries whose profile follows the distance to a surface.

use std::f64::consts::{PI, SQRT_2};

use glam::DVec3;

use super::Surface;
use super::derivatives::{Derivatives, outer};
use super::part::Part;

/// A surface across which the value changes by `step`.
///
/// The profile is that of a sharp step blurred by a Gaussian, `step · ½ · erfc(−depth / (blur · √2))`. For a plane it
/// is exactly the blurred step; for a curved surface it is defined by the distance, so that the gradient magnitude has
/// its maximum on the surface itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Boundary {
    /// Where it is.
    pub surface: Surface,
    /// Value inside minus value outside; not 0.
    pub step: f64,
    /// Standard deviation of the blur in world units; positive.
    pub blur: f64,
}

impl Boundary {
    /// What the boundary adds to the value at `point`.
    #[must_use]
    pub fn value(&self, point: DVec3) -> f64 {
        self.step * 0.5 * libm::erfc(-self.surface.depth(point) / (self.blur * SQRT_2))
    }

    /// Gradient of [`Self::value`], in value per world unit.
    #[must_use]
    pub fn gradient(&self, point: DVec3) -> DVec3 {
        let depth = self.surface.depth(point) / self.blur;
        self.gradient_magnitude() * self.step.signum() * libm::exp(-0.5 * depth * depth) * self.surface.inward(point)
    }

    /// Gradient magnitude on the surface, `|step| / (blur · √(2π))`, in value per world unit.
    #[must_use]
    pub fn gradient_magnitude(&self) -> f64 {
        self.step.abs() / (self.blur * (2.0 * PI).sqrt())
    }

    /// Distance from `point` in world units, positive on the side of the higher value.
    #[must_use]
    pub fn signed_distance(&self, point: DVec3) -> f64 {
        self.surface.depth(point) * self.step.signum()
    }
}

impl Part for Boundary {
    fn value(&self, point: DVec3) -> f64 {
        Self::value(self, point)
    }

    fn derivatives(&self, point: DVec3) -> Derivatives {
        let depth = self.surface.depth(point);
        let inward = self.surface.inward(point);
        let scaled_depth = depth / self.blur;
        // step · φ(depth), where φ is the profile's derivative and φ' = −depth/blur² · φ.
        let slope = self.gradient_magnitude() * self.step.signum() * libm::exp(-0.5 * scaled_depth * scaled_depth);
        let bend = outer(inward, inward) * -(scaled_depth / self.blur);
        Derivatives { gradient: slope * inward, hessian: (bend + self.surface.curvature(point)) * slope }
    }

    fn signed_distance(&self, point: DVec3) -> Option<f64> {
        Some(Self::signed_distance(self, point))
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
    use crate::phantom::profile;
    use crate::phantom::test_support::{check_derivatives, scattered_points};

    fn surfaces() -> [Surface; 3] {
        let axis = DVec3::new(0.36, 0.48, 0.8);
        [
            Surface::Ball { centre: DVec3::new(1.0, 2.0, 3.0), radius: 4.0 },
            Surface::HalfSpace { normal: axis, offset: 1.5 },
            Surface::Torus { centre: DVec3::new(1.0, 2.0, 3.0), axis, major_radius: 5.0, minor_radius: 2.0 },
        ]
    }

    #[test]
    fn value_on_a_boundary_is_halfway_and_its_gradient_the_profiles_peak() {
        for surface in surfaces() {
            let boundary = Boundary { surface, step: -0.6, blur: 0.5 };
            let start = DVec3::new(3.0, 5.5, 4.0);
            let on = start - surface.depth(start) * surface.inward(start);
            assert!(surface.depth(on).abs() < 1e-12, "{surface:?}");
            assert!((boundary.value(on) + 0.3).abs() < 1e-12, "{surface:?}");
            assert!((boundary.gradient(on).length() - 0.6 / (0.5 * (2.0 * PI).sqrt())).abs() < 1e-12, "{surface:?}");
        }
    }

    #[test]
    fn derivatives_agree_with_differences() {
        for surface in surfaces() {
            check_derivatives(&Boundary { surface, step: -0.7, blur: 0.9 }, scattered_points(DVec3::ONE, 8.0));
        }
    }

    #[test]
    fn along_the_normal_the_second_derivative_is_the_profiles() {
        for surface in surfaces() {
            let boundary = Boundary { surface, step: 0.7, blur: 0.9 };
            for point in scattered_points(DVec3::new(2.0, 4.0, 3.0), 2.0) {
                let depth = surface.depth(point);
                let expected = 0.7 * profile::density(depth, 0.9) * -depth / 0.81;
                let found = boundary.second_derivative(point);
                assert!((found - expected).abs() < 1e-13, "{surface:?} {point}: {found} {expected}");
                // ∇²f = f'' + g · ∇²depth.
                let curvature = surface.curvature(point);
                let bend = curvature.x_axis.x + curvature.y_axis.y + curvature.z_axis.z;
                let laplacian = expected + 0.7 * profile::density(depth, 0.9) * bend;
                assert!((boundary.laplacian(point) - laplacian).abs() < 1e-12, "{surface:?} {point}");
            }
        }
    }

    #[test]
    fn curvature_of_a_surface_is_that_of_its_radii() {
        // Trace of the depth's Hessian: minus the sum of the principal curvatures.
        let [ball, plane, torus] = surfaces();
        let on_ball = DVec3::new(1.0, 2.0, 7.0);
        let trace = |surface: Surface, point| {
            let hessian = surface.curvature(point);
            hessian.x_axis.x + hessian.y_axis.y + hessian.z_axis.z
        };
        assert!((trace(ball, on_ball) + 2.0 / 4.0).abs() < 1e-14);
        assert_eq!(trace(plane, on_ball), 0.0);
        // Outermost and innermost circle of the torus: 1/2 + 1/7 and 1/2 − 1/3.
        let across = DVec3::new(0.8, -0.6, 0.0).cross(DVec3::new(0.36, 0.48, 0.8));
        let centre = DVec3::new(1.0, 2.0, 3.0);
        assert!((trace(torus, centre + 7.0 * across) + 0.5 + 1.0 / 7.0).abs() < 1e-14);
        assert!((trace(torus, centre + 3.0 * across) + 0.5 - 1.0 / 3.0).abs() < 1e-14);
    }

    #[test]
    fn distance_is_positive_where_the_value_is_higher() {
        for (surface, step) in surfaces().into_iter().flat_map(|surface| [(surface, 0.5), (surface, -0.5)]) {
            let boundary = Boundary { surface, step, blur: 0.3 };
            let start = DVec3::new(3.0, 5.5, 4.0);
            let on = start - surface.depth(start) * surface.inward(start);
            let uphill = boundary.gradient(on).normalize();
            assert!((boundary.signed_distance(on + 0.2 * uphill) - 0.2).abs() < 1e-9, "{surface:?} {step}");
            assert!((boundary.signed_distance(on - 0.2 * uphill) + 0.2).abs() < 1e-9, "{surface:?} {step}");
        }
    }
}
