//! How much light is left at samples that lie among much that is drawn: the twin of `occlusion.wgsl`.

use glam::Vec3;

use crate::classify::Occlusion;
use crate::classify::macrocells::MACROCELL;
use crate::classify::occlusion::TOWARDS_VIEWER;
use crate::frame::{Frame, Ray};

/// What a ray's samples lose of their light.
pub(super) struct Darkening<'a> {
    occlusion: &'a Occlusion,
    strength: f32,
    /// The ray in multiples of macrocells' sides, from as far before its origin as samples look towards the viewer.
    origin: Vec3,
    direction: Vec3,
}

impl<'a> Darkening<'a> {
    #[inline(always)]
    pub(super) fn new(occlusion: &'a Occlusion, frame: &Frame, ray: &Ray) -> Self {
        let per_length = frame.spacing.recip() / MACROCELL as f32;
        let origin = (ray.origin - TOWARDS_VIEWER * ray.direction) * per_length;
        Self { occlusion, strength: frame.shading.occlusion, origin, direction: ray.direction * per_length }
    }

    /// The share of the light that is left so far along the ray.
    #[inline(always)]
    pub(super) fn light_at(&self, along: f32) -> f32 {
        1.0 - self.strength * self.occlusion.at(self.origin + along * self.direction)
    }
}
