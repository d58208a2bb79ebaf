//! The test signal of Marschner and Lobb.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DMat3, DVec3};

use super::derivatives::{Derivatives, outer};
use super::part::Part;

/// Number of oscillations per unit length along r, `f_M` of the source.
const FREQUENCY: f64 = 6.0;
/// Share of the oscillation, `α` of the source.
const ALPHA: f64 = 0.25;

/// `(1 − sin(πz/2) + α·(1 + cos(2πf_M·cos(πr/2)))) / (2(1 + α))`, `r² = x² + y²`, over a cube from −1 to 1, with
/// `f_M = 6` and `α = 0.25`.
///
/// Most of its spectrum lies just below what 40 samples per edge can hold. It has no sharp surface: what is true of it is
/// its zero crossing of f''.
///
/// Source: Marschner and Lobb, An evaluation of reconstruction filters for volume rendering, IEEE Visualization 1994,
/// section 5.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MarschnerLobb {
    /// Where x = y = z = 0.
    pub centre: DVec3,
    /// Half the cube's edge in world units; positive.
    pub half_edge: f64,
    /// Largest value minus smallest; not 0.
    pub step: f64,
}

impl MarschnerLobb {
    /// Place in the cube from −1 to 1, and the distance from its axis.
    fn coordinates(&self, point: DVec3) -> (DVec3, f64) {
        let place = (point - self.centre) / self.half_edge;
        (place, libm::hypot(place.x, place.y))
    }
}

impl Part for MarschnerLobb {
    fn value(&self, point: DVec3) -> f64 {
        let (place, r) = self.coordinates(point);
        let oscillation = libm::cos(TAU * FREQUENCY * libm::cos(FRAC_PI_2 * r));
        let sum = 1.0 - libm::sin(FRAC_PI_2 * place.z) + ALPHA * (1.0 + oscillation);
        self.step * (sum / (2.0 * (1.0 + ALPHA)))
    }

    fn derivatives(&self, point: DVec3) -> Derivatives {
        let (place, r) = self.coordinates(point);
        let factor = self.step / (2.0 * (1.0 + ALPHA) * self.half_edge);
        let depth = TAU * FREQUENCY;
        let (sine, cosine) = libm::sincos(FRAC_PI_2 * r);
        let (outer_sine, outer_cosine) = libm::sincos(depth * cosine);
        // φ(r) = cos(depth · cos(πr/2)): φ'/r and φ'', both even in r and finite on the axis.
        let sine_over_r = if r == 0.0 { FRAC_PI_2 } else { sine / r };
        let over_r = ALPHA * depth * FRAC_PI_2 * outer_sine * sine_over_r;
        let second = ALPHA * depth * FRAC_PI_2 * FRAC_PI_2 * (cosine * outer_sine - depth * sine * sine * outer_cosine);
        let across = DVec3::new(place.x, place.y, 0.0);
        let direction = across.normalize_or_zero();
        let (sine_z, cosine_z) = libm::sincos(FRAC_PI_2 * place.z);
        let gradient = over_r * across - FRAC_PI_2 * cosine_z * DVec3::Z;
        let diagonal = DVec3::new(over_r, over_r, FRAC_PI_2 * FRAC_PI_2 * sine_z);
        let hessian = DMat3::from_diagonal(diagonal) + outer(direction, direction) * (second - over_r);
        Derivatives { gradient: factor * gradient, hessian: hessian * (factor / self.half_edge) }
    }

    fn signed_distance(&self, _: DVec3) -> Option<f64> {
        None
    }

    fn step(&self) -> f64 {
        self.step.abs()
    }

    fn detail(&self) -> f64 {
        // The highest angular frequency of cos(2πf_M·cos(πr/2)) is 2πf_M · π/2.
        self.half_edge / (PI * PI * FREQUENCY)
    }

    fn scale(&mut self, factor: f64) {
        self.step *= factor;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phantom::test_support::{check_derivatives, scattered_points};

    const SIGNAL: MarschnerLobb = MarschnerLobb { centre: DVec3::new(0.3, -0.2, 0.1), half_edge: 32.0, step: 1.0 };

    #[test]
    fn values_are_those_of_the_formula() {
        let at = |x, y, z| Part::value(&SIGNAL, SIGNAL.centre + 32.0 * DVec3::new(x, y, z));
        // On the axis cos(12π) = 1; where cos(πr/2) = 1/2, r = 2/3, cos(6π) = 1; where it is 11/24, cos(5.5π) = 0.
        assert!((at(0.0, 0.0, 0.0) - 0.6).abs() < 1e-12);
        assert!((at(0.0, 2.0 / 3.0, 1.0) - 0.2).abs() < 1e-12);
        let r = (11.0_f64 / 24.0).acos() / FRAC_PI_2;
        assert!((at(0.6 * r, 0.8 * r, -1.0) - 0.9).abs() < 1e-12);
    }

    #[test]
    fn derivatives_agree_with_differences_also_on_the_axis() {
        let on_axis = [0.0, 1e-6, 1e-2].map(|x| SIGNAL.centre + DVec3::new(x, 0.0, 5.0));
        check_derivatives(&SIGNAL, scattered_points(SIGNAL.centre, 40.0).chain(on_axis));
    }
}
