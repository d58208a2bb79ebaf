//! Where places in space appear in a picture: the inverse of [`Frame::ray`].

use glam::{Vec2, Vec3};

use crate::frame::Frame;

/// What is closer to the eye than this is not drawn, in multiples of `L_min`.
pub const NEAR: f32 = 0.01;

/// Maps places in the frame's space to the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelProjection {
    /// The eye, or the middle of the plane that parallel rays start from.
    pub origin: Vec3,
    /// Unit vector into the picture.
    pub forward: Vec3,
    /// Whether rays start from one place.
    pub is_perspective: bool,
    /// From the picture's middle to its right edge: at a distance of 1 along `forward` in perspective, at any
    /// otherwise.
    pub right: Vec3,
    /// From the picture's middle to its upper edge.
    pub up: Vec3,
}

impl From<&Frame> for PixelProjection {
    fn from(frame: &Frame) -> Self {
        let rays = &frame.rays;
        let is_perspective = rays.direction_right != Vec3::ZERO;
        let (right, up) = if is_perspective {
            (rays.direction_right, rays.direction_up)
        } else {
            (rays.origin_right, rays.origin_up)
        };
        Self { origin: rays.origin, forward: rays.direction, is_perspective, right, up }
    }
}

impl PixelProjection {
    /// Homogeneous coordinates: x and y over the third are the place in the picture, −1 to 1, x to the right and y
    /// upwards.
    #[must_use]
    pub fn project(&self, position: Vec3) -> Vec3 {
        let from_eye = position - self.origin;
        let x = from_eye.dot(self.right) / self.right.dot(self.right);
        let y = from_eye.dot(self.up) / self.up.dot(self.up);
        Vec3::new(x, y, if self.is_perspective { from_eye.dot(self.forward) } else { 1.0 })
    }

    /// How far a place lies from the eye's plane, into the picture.
    #[must_use]
    pub fn depth(&self, position: Vec3) -> f32 {
        (position - self.origin).dot(self.forward)
    }

    /// Width of a pixel at a depth, in multiples of `L_min`; 0 behind the eye.
    #[must_use]
    pub fn pixel_width(&self, depth: f32, image_size: [u32; 2]) -> f32 {
        let at_depth = if self.is_perspective { depth.max(0.0) } else { 1.0 };
        2.0 * self.right.length() * at_depth / image_size[0] as f32
    }

    /// Unit vector from the eye to a place.
    #[must_use]
    pub fn direction_to(&self, position: Vec3) -> Vec3 {
        let from_eye = if self.is_perspective { position - self.origin } else { self.forward };
        from_eye.normalize_or(self.forward)
    }
}

/// The place of a pixel's middle in the picture, −1 to 1, as that of its ray.
#[must_use]
pub(super) fn pixel_middle([x, y]: [u32; 2], image_size: [u32; 2]) -> Vec2 {
    let [width, height] = image_size.map(|side| side as f32);
    Vec2::new((x as f32 + 0.5) / width * 2.0 - 1.0, 1.0 - (y as f32 + 0.5) / height * 2.0)
}
