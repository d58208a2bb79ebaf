//! Surfaces whose distance is known exactly, with its derivatives.

use glam::{DMat3, DVec3};

use super::derivatives::outer;

/// A closed or endless surface with an inside, in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Surface {
    /// A sphere.
    Ball {
        /// Its centre.
        centre: DVec3,
        /// Its radius.
        radius: f64,
    },
    /// A plane; the inside is where `normal · x > offset`.
    HalfSpace {
        /// Unit vector towards the inside.
        normal: DVec3,
        /// Distance of the plane from the world's origin along `normal`.
        offset: f64,
    },
    /// A ring torus: a tube around a circle.
    Torus {
        /// Centre of the circle.
        centre: DVec3,
        /// Unit vector at right angles to the circle's plane.
        axis: DVec3,
        /// The circle's radius.
        major_radius: f64,
        /// The tube's radius, below `major_radius`.
        minor_radius: f64,
    },
}

impl Surface {
    /// Exact distance from `point` to the surface in world units, positive inside.
    #[must_use]
    pub fn depth(&self, point: DVec3) -> f64 {
        match *self {
            Self::Ball { centre, radius } => radius - point.distance(centre),
            Self::HalfSpace { normal, offset } => normal.dot(point) - offset,
            Self::Torus { centre, axis, major_radius, minor_radius } => {
                let along = axis.dot(point - centre);
                let across = (point - centre - along * axis).length();
                minor_radius - libm::hypot(across - major_radius, along)
            }
        }
    }

    /// Unit vector at `point` in which the depth grows; zero where there is none (a ball's centre, a torus' circle).
    #[must_use]
    pub fn inward(&self, point: DVec3) -> DVec3 {
        match *self {
            Self::Ball { centre, .. } => (centre - point).normalize_or_zero(),
            Self::HalfSpace { normal, .. } => normal,
            Self::Torus { centre, axis, major_radius, .. } => {
                let offset = point - centre;
                let across = (offset - axis.dot(offset) * axis).normalize_or_zero();
                (centre + major_radius * across - point).normalize_or_zero()
            }
        }
    }

    /// Hessian of [`Self::depth`] at `point`, in 1 / world unit; zero where there is none (a ball's centre, a torus'
    /// circle and axis).
    #[must_use]
    pub fn curvature(&self, point: DVec3) -> DMat3 {
        match *self {
            Self::Ball { centre, .. } => {
                let distance = point.distance(centre);
                if distance == 0.0 {
                    return DMat3::ZERO;
                }
                let radial = (point - centre) / distance;
                (outer(radial, radial) - DMat3::IDENTITY) * distance.recip()
            }
            Self::HalfSpace { .. } => DMat3::ZERO,
            Self::Torus { centre, axis, major_radius, .. } => {
                let along = axis.dot(point - centre);
                let from_axis = point - centre - along * axis;
                let across = from_axis.length();
                let distance = libm::hypot(across - major_radius, along);
                if across == 0.0 || distance == 0.0 {
                    return DMat3::ZERO;
                }
                let radial = from_axis / across;
                // Around the tube the curvature is that of its own circle, around the axis that of the circle of latitude.
                let around_tube = (along * radial - (across - major_radius) * axis) / distance;
                let around_axis = axis.cross(radial);
                let latitude = (across - major_radius) / (distance * across);
                outer(around_tube, around_tube) * -distance.recip() - outer(around_axis, around_axis) * latitude
            }
        }
    }
}
