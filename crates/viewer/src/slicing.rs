//! Slices through a volume. What of a ray each stands for is [`crate::reference`]'s to say, by this rule.
//!
//! Space between two neighbouring planes halfway between slices is a slab; a slice stands for the part of each ray that
//! lies in its slab, so that its step is the slab's thickness over the cosine of the ray's angle to it. A ray's first
//! and last slice stand for all that is left up to where the ray enters and leaves: nothing is counted twice, and
//! nothing is left out where a ray meets any slice at all. What of a volume lies between two slices, as a corner of it
//! may, is not seen.

use glam::Vec3;

use crate::frame::PixelRays;
use crate::reference::FACE_DEPTH;
use crate::state::Technique;

/// How far outside of what is drawn a slice still counts for a ray, in slabs, and at most [`NEAR`]: rounding must not
/// decide over slices that lie on a volume's very face.
pub(crate) const SLACK: f32 = 1.0 / 32.0;
/// Slices nearer than this to an eye within the volume are not seen, in multiples of `L_min`.
pub(crate) const NEAR: f32 = 0.01;
/// Rays that meet slices at a smaller cosine than one over this are integrated as if it was that one.
const MOST_STRETCH: f32 = 16.0;

/// Parallel slices at equal distances. Slab k reaches from number k to number k + 1, and its slice is at k + 1/2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slicing {
    /// By how much numbers grow along each axis: the slices' normal, over the distance between two of them.
    pub growth: Vec3,
    /// The number of the place at the origin, negated.
    pub offset: f32,
    /// At least half of what a slice stands for along any ray.
    pub longest_half_step: f32,
}

impl Slicing {
    /// The slices of a technique, `step` apart or, for [`Technique::Stacks`], a whole fraction of the voxels' distance
    /// that is no larger; `None` for rays.
    #[must_use]
    pub fn new(
        technique: Technique,
        rays: &PixelRays,
        [box_low, box_high]: [Vec3; 2],
        spacing: Vec3,
        step: f32,
    ) -> Option<Self> {
        let widest = (rays.direction_right.length_squared() + rays.direction_up.length_squared()).sqrt();
        let (normal, distance, offset, angle) = match technique {
            Technique::Rays => return None,
            Technique::Slices => {
                let normal = rays.direction.normalize_or(Vec3::Z);
                // One of them goes through the middle, however thin the volume is.
                (normal, step, normal.dot(0.5 * (box_low + box_high)) / step - 0.5, 0.0)
            }
            Technique::Stacks => {
                let axis = [Vec3::X, Vec3::Y, Vec3::Z][rays.direction.abs().max_position()];
                let between = spacing.dot(axis);
                // Rounding must not make one more of a whole number.
                let parts = (between / step - 1e-3).ceil().max(1.0);
                // No axis is farther from the nearest one than a cube's diagonal.
                (axis, between / parts, -0.5, 2.0_f32.sqrt().atan())
            }
        };
        // Whatever the camera's angles: what leaps depends on this.
        let cosine = (angle + widest.atan()).cos();
        let stretch = if cosine * MOST_STRETCH > 1.0 { (16.0 / cosine - 1e-3).ceil() / 16.0 } else { MOST_STRETCH };
        Some(Self { growth: normal / distance, offset, longest_half_step: stretch * distance })
    }

    /// The number at a place.
    #[must_use]
    #[inline(always)]
    pub fn number(&self, place: Vec3) -> f32 {
        self.growth.dot(place) - self.offset
    }
}

/// The share of a step, 0 to 1, that is on the face of a cut: of a step around `along` on a ray that enters at `entry`, all of
/// them in multiples of `L_min`.
#[inline(always)]
pub(crate) fn share_of_face(along: f32, step: f32, entry: f32) -> f32 {
    ((entry + FACE_DEPTH - along) / step + 0.5).clamp(0.0, 1.0)
}

#[cfg(test)]
pub(crate) mod tests {
    use voxrole_pack::{GridGeometry, HitGradientQuantization, Precision};

    use super::*;
    use crate::ViewState;
    use crate::classify::EmphasisTable;
    use crate::frame::Frame;
    use crate::state::{Camera, CameraPreset};
    use crate::volume::VolumeDescription;

    /// A frame of a volume that one free plane cuts, in 32 by 24 pixels.
    pub(crate) fn frame(technique: Technique, camera: Camera, dims: [u32; 3], step: f32) -> Frame {
        let geometry = GridGeometry::axis_aligned(dims, [1.0, 2.0, 3.0]);
        let hit_gradient = HitGradientQuantization::new(0.0, 1.0, Precision::default());
        let volume = VolumeDescription::new(&geometry, 15.0, [0.0, 1.0], hit_gradient);
        let mut state = ViewState { camera, ..ViewState::default() };
        state.render_settings.technique = technique;
        state.render_settings.step = step;
        state.clipping.planes = vec!["40,10,0.3".parse().expect("a plane")];
        Frame::new(&state, &volume, &EmphasisTable::new(&state.transfer_function), [32, 24])
    }

    #[test]
    fn stacks_hold_the_voxels_planes() {
        // 3 voxel spacings along z, in steps of at most 1.25: two planes between.
        let frame = frame(Technique::Stacks, Camera::from_preset(CameraPreset::Top), [20, 12, 9], 1.25);
        let slicing = frame.slicing.expect("slices");
        assert_eq!(slicing.growth, Vec3::Z);
        for plane in 0..9 {
            let number = slicing.number(Vec3::new(3.0, 5.0, 3.0 * plane as f32));
            assert_eq!(number - number.floor(), 0.5);
        }
    }

    #[test]
    fn what_leaps_does_not_depend_on_the_camera_s_angles() {
        for technique in Technique::ALL {
            let reach = |azimuth| frame(technique, Camera { azimuth, ..Camera::default() }, [20, 12, 9], 0.25).reach;
            assert!((0..90).all(|angle| reach(angle as f32 * 4.1) == reach(0.0)), "{technique:?}");
        }
    }
}
