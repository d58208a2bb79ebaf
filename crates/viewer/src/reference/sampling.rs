//! Opacity, colour and normal between voxels.
//!
//! The rule, at a place `p` in a cell of eight voxels with trilinear weights `w_i`: the value is interpolated,
//! `v = Σ w_i v_i`. Every voxel with a hit predicts the signed distance at `p` by its own plane,
//! `d_i(p) = d_i + n_i · (p − x_i)`, because d grows along the normal towards the high-value side, and gives
//! `α_i = αu(v, g_i) · αd(d_i(p))` with its own gradient magnitude at the hit; where opacity is integrated along a step, αd is
//! that of the whole stretch of its plane's distances, see [`crate::classify::preintegration`]. Then `α = Σ w_i α_i`, and
//! colour and normal are the means weighted by `w_i α_i`.
//!
//! Distances are never interpolated, so that +m beside −m on the medial surface between two boundaries does not pass
//! through 0 and draw a phantom sheet; a voxel without a hit contributes nothing; gradient magnitudes, which are labels,
//! are never blended; and at a true boundary all planes agree, so that d passes through 0 there.

// No iterators and closures in vector code: what std calls might be compiled without the level's instructions.
#![allow(clippy::needless_range_loop, reason = "see above")]

use fearless_simd::{Bytes, Simd, SimdBase, SimdFloat, f32x16, i32x16, u32x16};
use glam::Vec3;

use super::corners::Places;
use super::gathers::Firsts;
use super::lanes::{Directions, splat};
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

/// The same for sixteen places.
pub(super) struct Found<S: Simd> {
    pub(super) opacity: f32x16<S>,
    pub(super) color: [f32x16<S>; 3],
    pub(super) normal: Directions<S>,
}

impl<S: Simd> Found<S> {
    /// Nothing at any.
    #[inline(always)]
    pub(super) fn nothing(simd: S) -> Self {
        let zero = splat(simd, 0.0);
        Self { opacity: zero, color: [zero; 3], normal: [zero; 3] }
    }
}

/// Reads one volume under one frame and transfer function.
pub(super) struct Sampler<'a> {
    volume: &'a VolumeTexels,
    pub(super) roles: &'a Roles,
    pub(super) frame: &'a Frame,
    /// How far behind the lowest voxel of a cell each of its rows begins, y fastest.
    pub(super) offsets: [usize; 4],
    /// Whether there is but one voxel along a row.
    pub(super) is_one_wide: bool,
    pub(super) inverse_spacing: Vec3,
}

impl<'a> Sampler<'a> {
    /// Makes ready; costs nothing.
    pub(super) fn new(volume: &'a VolumeTexels, roles: &'a Roles, frame: &'a Frame) -> Self {
        let [width, height, depth] = frame.dims.map(|dim| dim as usize);
        let up = if height > 1 { width } else { 0 };
        let back = if depth > 1 { width * height } else { 0 };
        let offsets = [0, up, back, up + back];
        Self { volume, roles, frame, offsets, is_one_wide: width == 1, inverse_spacing: frame.spacing.recip() }
    }

    #[inline(always)]
    pub(super) fn texels(&self) -> &'a [[u16; 4]] {
        &self.volume.texels
    }

    /// The cells of places in the frame's space, by their lowest voxels in whole numbers, and where in them the places lie.
    #[inline(always)]
    pub(super) fn cells<S: Simd>(&self, simd: S, positions: &Directions<S>) -> [Directions<S>; 2] {
        let mut cells = [[splat(simd, 0.0); 3]; 2];
        for axis in 0..3 {
            let last = (self.frame.dims[axis] - 1) as f32;
            let index = (positions[axis] * self.inverse_spacing[axis]).max(splat(simd, 0.0)).min(splat(simd, last));
            let base = index.floor().min(splat(simd, (last - 1.0).max(0.0)));
            (cells[0][axis], cells[1][axis]) = (base, index - base);
        }
        cells
    }

    /// The same as places.
    #[inline(always)]
    pub(super) fn places<S: Simd>(&self, cells: &Directions<S>, fractions: Directions<S>) -> Places<S> {
        Places { cells: [whole(cells[0]), whole(cells[1]), whole(cells[2])], fractions }
    }

    /// Where in the volume the lowest voxels of places' cells lie.
    #[inline(always)]
    pub(super) fn firsts<S: Simd>(&self, places: &Places<S>) -> Firsts {
        Firsts::new(places.cells, [self.frame.dims[0] as usize, self.frame.dims[1] as usize])
    }
}

/// Whole numbers that are not negative, as such.
#[inline(always)]
pub(super) fn whole<S: Simd>(numbers: f32x16<S>) -> u32x16<S> {
    numbers.to_int::<i32x16<S>>().bitcast()
}
