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

use std::sync::LazyLock;

use glam::{UVec3, Vec3};
use voxrole_pack::quantization::decode_normal;

use super::roles::{Roles, Stretch};
use crate::classify::opacity::{VALUE_BINS, gradient_bin, value_bin, value_bins};
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

/// The cell that the last samples of a ray lay in: successive ones often share it.
pub struct Cell {
    base: UVec3,
    half_step: f32,
    values: [f32; 8],
    /// Those of its corners that can be drawn somewhere in it, [`Self::count`] of them.
    corners: [Corner; 8],
    count: usize,
}

impl Default for Cell {
    /// None that a place lies in.
    fn default() -> Self {
        Self { base: UVec3::MAX, half_step: 0.0, values: [0.0; 8], corners: [Corner::default(); 8], count: 0 }
    }
}

/// What a corner says of every place in its cell.
#[derive(Clone, Copy, Default)]
struct Corner {
    /// Which of the cell's corners it is, x fastest.
    index: usize,
    /// The bins of its gradient magnitude.
    row: usize,
    normal: Vec3,
    /// Signed distance of its plane at the cell's lowest corner, and by how much that grows along the cell.
    distance: f32,
    growth: Vec3,
    stretch: Stretch,
    /// No place farther than this from the boundary can be drawn.
    reach: f32,
}

/// Reads one volume under one frame and transfer function.
pub struct Sampler<'a> {
    volume: &'a VolumeTexels,
    roles: &'a Roles,
    frame: &'a Frame,
    all_normals: &'static [Vec3],
    last: UVec3,
    inverse_spacing: Vec3,
}

impl<'a> Sampler<'a> {
    /// Makes ready; costs nothing.
    #[must_use]
    pub fn new(volume: &'a VolumeTexels, roles: &'a Roles, frame: &'a Frame) -> Self {
        let (last, inverse_spacing) = (UVec3::from_array(frame.dims) - 1, frame.spacing.recip());
        Self { volume, roles, frame, all_normals: all_normals(), last, inverse_spacing }
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

    /// The sample at a place that [`Self::place`] gave, for a step along `direction`, which is that of all samples that `cell` was
    /// used for, over `half_step` to either side; that is 0 where the place counts for all of it.
    #[must_use]
    #[inline(always)]
    pub fn sample(
        &self,
        (base, fraction): (UVec3, Vec3),
        direction: Vec3,
        half_step: f32,
        cell: &mut Cell,
    ) -> RoleSample {
        if cell.base != base || cell.half_step != half_step {
            cell.half_step = half_step;
            self.enter(cell, base, direction);
        }
        if cell.count == 0 { RoleSample::default() } else { self.sample_cell(cell, fraction) }
    }

    /// Reads a cell's voxels.
    #[inline(always)]
    fn enter(&self, cell: &mut Cell, base: UVec3, direction: Vec3) {
        cell.base = base;
        cell.count = 0;
        let texels = self.texels(base);
        cell.values = texels.map(|texel| f32::from(texel[0]));
        let value = texels.iter().fold([u16::MAX, 0], |[low, high], texel| [low.min(texel[0]), high.max(texel[0])]);
        let value_bins = value_bins(value);
        for (index, texel) in texels.into_iter().enumerate() {
            let distance = f32::from(texel[1] as i16) * self.frame.distance_scale;
            // A plane's distance changes within the cell by no more than the cell's diagonal.
            if !VolumeTexels::has_hit(texel) || distance.abs() >= self.frame.reach {
                continue;
            }
            let row = gradient_bin(texel[2]);
            if !self.roles.is_lit(value_bins, row) {
                continue;
            }
            let normal = self.normal(texel[3]);
            let growth = normal * self.frame.spacing;
            let half = normal.dot(direction).abs() * cell.half_step;
            cell.corners[cell.count] = Corner {
                index,
                row: row * VALUE_BINS,
                normal,
                distance: distance - growth.dot(CORNERS[index]),
                growth,
                stretch: Stretch::new(half),
                reach: self.roles.largest_d_c() + half,
            };
            cell.count += 1;
        }
    }

    /// The unit vector of a stored normal, or 0 for none.
    #[inline(always)]
    pub(super) fn normal(&self, stored: u16) -> Vec3 {
        self.all_normals[usize::from(stored)]
    }

    /// The voxels at a cell's corners.
    #[inline(always)]
    pub(super) fn texels(&self, base: UVec3) -> [[u16; 4]; 8] {
        let [width, height, _] = self.frame.dims.map(|dim| dim as usize);
        let [x, y, z] = base.as_usizevec3().to_array();
        let steps = (base.cmplt(self.last)).into();
        let [next_x, next_y, next_z]: [bool; 3] = steps;
        let (right, up, back) =
            (usize::from(next_x), usize::from(next_y) * width, usize::from(next_z) * width * height);
        let first = (z * height + y) * width + x;
        let rows = [first, first + up, first + back, first + up + back];
        let mut texels = [[0; 4]; 8];
        for (pair, row) in texels.as_chunks_mut::<2>().0.iter_mut().zip(rows) {
            *pair = [self.volume.texels[row], self.volume.texels[row + right]];
        }
        texels
    }

    #[inline(always)]
    fn sample_cell(&self, cell: &Cell, fraction: Vec3) -> RoleSample {
        let ([x1, y1, z1], [x0, y0, z0]) = (fraction.to_array(), (1.0 - fraction).to_array());
        let low = [x0 * y0, x1 * y0, x0 * y1, x1 * y1];
        let weights: [f32; 8] = std::array::from_fn(|corner| low[corner % 4] * if corner < 4 { z0 } else { z1 });
        let mut value = 0.0;
        for (number, weight) in cell.values.iter().zip(weights) {
            value += weight * number;
        }
        let bin = value_bin(value);
        let (mut opacity, mut color, mut normal) = (0.0, Vec3::ZERO, Vec3::ZERO);
        for corner in &cell.corners[..cell.count] {
            let weight = weights[corner.index];
            let distance = corner.distance + corner.growth.dot(fraction);
            if distance.abs() >= corner.reach || weight == 0.0 {
                continue;
            }
            let role = self.roles.of(corner.row + bin);
            if role.opacity == 0.0 {
                continue;
            }
            let share = weight * self.roles.opacity(role, distance, &corner.stretch);
            opacity += share;
            color += share * role.color;
            normal += share * corner.normal;
        }
        if opacity > 0.0 {
            RoleSample { opacity: opacity.min(1.0), color: color / opacity, normal: unit_or_zero(normal / opacity) }
        } else {
            RoleSample::default()
        }
    }
}

/// Every normal that there is, by its stored form; 0 where that stands for none.
fn all_normals() -> &'static [Vec3] {
    static NORMALS: LazyLock<Vec<Vec3>> =
        LazyLock::new(|| (0..=u16::MAX).map(|stored| decode_normal(stored).unwrap_or(Vec3::ZERO)).collect());
    &NORMALS
}

/// A vector's direction, or 0 where opposite normals cancel.
pub(super) fn unit_or_zero(vector: Vec3) -> Vec3 {
    let squared = vector.dot(vector);
    if squared > 1e-8 { vector / squared.sqrt() } else { Vec3::ZERO }
}

/// The cell's corners, x fastest.
const CORNERS: [Vec3; 8] = [
    Vec3::new(0.0, 0.0, 0.0),
    Vec3::new(1.0, 0.0, 0.0),
    Vec3::new(0.0, 1.0, 0.0),
    Vec3::new(1.0, 1.0, 0.0),
    Vec3::new(0.0, 0.0, 1.0),
    Vec3::new(1.0, 0.0, 1.0),
    Vec3::new(0.0, 1.0, 1.0),
    Vec3::new(1.0, 1.0, 1.0),
];
