//! Opacity, colour and normal between voxels.
//!
//! The rule, at a place `p` in a cell of eight voxels with trilinear weights `w_i`: the value is interpolated,
//! `v = Σ w_i v_i`. Every voxel with a hit predicts the signed distance at `p` by its own plane,
//! `d_i(p) = d_i + n_i · (p − x_i)`, because d grows along the normal towards the high-value side, and gives
//! `α_i = αu(v, g_i) · αd(d_i(p))` with its own gradient magnitude at the hit; where opacity is integrated along a step, αd is
//! that of the whole stretch of its plane's distances, see [`crate::classify::preintegration`]. Then `α = Σ w_i α_i`, and colour and
//! normal are the means weighted by `w_i α_i`.
//!
//! Distances are never interpolated, so that +m beside −m on the medial surface between two boundaries does not pass
//! through 0 and draw a phantom sheet; a voxel without a hit contributes nothing; gradient magnitudes, which are labels,
//! are never blended; and at a true boundary all planes agree, so that d passes through 0 there.

use glam::{UVec3, Vec3};

use super::roles::Roles;
use crate::frame::Frame;
use crate::volume::VolumeTexels;

/// What a place adds to a ray.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RoleSample {
    /// `α` for a path of `L_min`, 0 to 1.
    pub opacity: f32,
    /// Red, green, blue; black where the opacity is 0.
    pub color: Vec3,
    /// Unit vector to the high-value side in grid axes, or 0 where there is none.
    pub normal: Vec3,
}

/// Reads one volume under one frame and transfer function.
pub struct Sampler<'a> {
    volume: &'a VolumeTexels,
    pub(super) roles: &'a Roles,
    pub(super) frame: &'a Frame,
    last: UVec3,
    inverse_spacing: Vec3,
}

impl<'a> Sampler<'a> {
    /// Makes ready; costs nothing.
    #[must_use]
    pub fn new(volume: &'a VolumeTexels, roles: &'a Roles, frame: &'a Frame) -> Self {
        let (last, inverse_spacing) = (UVec3::from_array(frame.dims) - 1, frame.spacing.recip());
        Self { volume, roles, frame, last, inverse_spacing }
    }

    /// The cell of a place in the frame's space, by its lowest voxel, and where in it the place lies.
    #[must_use]
    #[inline(always)]
    pub fn place(&self, position: Vec3) -> (UVec3, Vec3) {
        let last = self.last.as_vec3();
        let index = (position * self.inverse_spacing).clamp(Vec3::ZERO, last);
        let base = index.floor().min((last - 1.0).max(Vec3::ZERO));
        (base.as_uvec3(), index - base)
    }

    /// Where in the volume the rows of a cell's voxels begin, y fastest.
    #[inline(always)]
    pub(super) fn rows(&self, base: UVec3) -> [usize; 4] {
        let [width, height, _] = self.frame.dims.map(|dim| dim as usize);
        let [x, y, z] = base.as_usizevec3().to_array();
        let up = usize::from(base.y < self.last.y) * width;
        let back = usize::from(base.z < self.last.z) * width * height;
        let first = (z * height + y) * width + x;
        [first, first + up, first + back, first + up + back]
    }

    /// The two voxels of a row of a cell.
    #[inline(always)]
    pub(super) fn pair(&self, first: usize) -> [[u16; 4]; 2] {
        let texels = &self.volume.texels;
        [texels[first], texels[first + usize::from(self.last.x > 0)]]
    }
}

/// A vector's direction, or 0 where opposite normals cancel.
pub(super) fn unit_or_zero(vector: Vec3) -> Vec3 {
    let squared = vector.dot(vector);
    if squared > 1e-8 { vector / squared.sqrt() } else { Vec3::ZERO }
}
