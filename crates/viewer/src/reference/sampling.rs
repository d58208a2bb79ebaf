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
use voxrole_pack::quantization::decode_normal;

use crate::classify::{EmphasisTable, OpacityTable, PreintegrationTable};
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

/// The cell that the last sample lay in: successive samples often share it.
#[derive(Default)]
pub struct CellCache(Option<Cell>);

#[derive(Clone, Copy)]
struct Cell {
    base: UVec3,
    texels: [[u16; 4]; 8],
    /// Whether anything in this cell can be drawn.
    is_active: bool,
}

/// Reads one volume under one frame and table.
pub struct Sampler<'a> {
    volume: &'a VolumeTexels,
    table: &'a OpacityTable,
    emphases: &'a EmphasisTable,
    preintegration: &'a PreintegrationTable,
    frame: &'a Frame,
}

impl<'a> Sampler<'a> {
    /// Makes ready; costs nothing.
    #[must_use]
    pub fn new(
        volume: &'a VolumeTexels,
        table: &'a OpacityTable,
        emphases: &'a EmphasisTable,
        preintegration: &'a PreintegrationTable,
        frame: &'a Frame,
    ) -> Self {
        Self { volume, table, emphases, preintegration, frame }
    }

    /// The sample at a place in the frame's space, for a step along `direction`.
    #[must_use]
    pub fn sample(&self, position: Vec3, direction: Vec3, cache: &mut CellCache) -> RoleSample {
        self.sample_at(self.place(position), direction, cache)
    }

    /// The cell of a place in the frame's space, by its lowest voxel, and where in it the place lies.
    #[must_use]
    pub fn place(&self, position: Vec3) -> (UVec3, Vec3) {
        let last = (UVec3::from_array(self.frame.dims) - 1).as_vec3();
        let index = (position * self.frame.spacing.recip()).clamp(Vec3::ZERO, last);
        let base = index.floor().min((last - 1.0).max(Vec3::ZERO));
        (base.as_uvec3(), index - base)
    }

    /// The sample at a place that [`Self::place`] gave.
    #[must_use]
    pub fn sample_at(&self, (base, fraction): (UVec3, Vec3), direction: Vec3, cache: &mut CellCache) -> RoleSample {
        let cell = self.cell(base, cache);
        if cell.is_active { self.sample_cell(&cell, fraction, direction) } else { RoleSample::default() }
    }

    fn cell(&self, base: UVec3, cache: &mut CellCache) -> Cell {
        if let Some(cell) = cache.0.filter(|cell| cell.base == base) {
            return cell;
        }
        let dims = UVec3::from_array(self.frame.dims);
        let texels = CORNERS.map(|corner| {
            let voxel = (base + corner).min(dims - 1).as_usizevec3();
            self.volume.texels[(voxel.z * dims.y as usize + voxel.y) * dims.x as usize + voxel.x]
        });
        // A plane's distance changes within the cell by no more than the cell's diagonal.
        let is_active = texels
            .iter()
            .any(|&texel| VolumeTexels::has_hit(texel) && self.stored_distance(texel).abs() < self.frame.reach);
        *cache.0.insert(Cell { base, texels, is_active })
    }

    fn sample_cell(&self, cell: &Cell, fraction: Vec3, direction: Vec3) -> RoleSample {
        let weights = CORNERS.map(|corner| {
            let axes = Vec3::select(corner.cmpeq(UVec3::ONE), fraction, 1.0 - fraction);
            axes.x * axes.y * axes.z
        });
        let mut value = 0.0;
        for (texel, weight) in cell.texels.iter().zip(weights) {
            value += weight * f32::from(texel[0]);
        }
        let (mut opacity, mut color, mut normal) = (0.0, Vec3::ZERO, Vec3::ZERO);
        for ((&texel, weight), corner) in cell.texels.iter().zip(weights).zip(CORNERS) {
            if weight == 0.0 || !VolumeTexels::has_hit(texel) {
                continue;
            }
            let ([red, green, blue, opacity_by_role], emphasis) = self.table.look_up(value, texel[2]);
            if opacity_by_role == 0.0 {
                continue;
            }
            let corner_normal = decode_normal(texel[3]).unwrap_or(Vec3::ZERO);
            let offset = (fraction - corner.as_vec3()) * self.frame.spacing;
            let distance = self.stored_distance(texel) + corner_normal.dot(offset);
            let half = corner_normal.dot(direction).abs() * self.frame.half_step;
            let share = weight * self.preintegration.look_up(self.emphases, emphasis, opacity_by_role, distance, half);
            opacity += share;
            color += share * Vec3::new(red, green, blue);
            normal += share * corner_normal;
        }
        if opacity > 0.0 {
            RoleSample { opacity: opacity.min(1.0), color: color / opacity, normal: unit_or_zero(normal / opacity) }
        } else {
            RoleSample::default()
        }
    }

    fn stored_distance(&self, texel: [u16; 4]) -> f32 {
        f32::from(texel[1] as i16) * self.frame.distance_scale
    }
}

/// A vector's direction, or 0 where opposite normals cancel.
fn unit_or_zero(vector: Vec3) -> Vec3 {
    let squared = vector.dot(vector);
    if squared > 1e-8 { vector / squared.sqrt() } else { Vec3::ZERO }
}

/// The cell's corners, x fastest.
const CORNERS: [UVec3; 8] = [
    UVec3::new(0, 0, 0),
    UVec3::new(1, 0, 0),
    UVec3::new(0, 1, 0),
    UVec3::new(1, 1, 0),
    UVec3::new(0, 0, 1),
    UVec3::new(1, 0, 1),
    UVec3::new(0, 1, 1),
    UVec3::new(1, 1, 1),
];
