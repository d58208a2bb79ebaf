//! The cells that a ray goes through.
//!
//! A ray crosses the planes between cells where one formula says so, whichever way it got there: what is drawn does not
//! depend on the cells that were leapt over. Source: Amanatides and Woo, A fast voxel traversal algorithm for ray
//! tracing, 1987, with every plane's place worked out anew instead of a running sum.

use std::cmp::Ordering;

use glam::{BVec3, Vec3};

use crate::frame::{Frame, Ray};

/// A ray through a grid of cells, which are given by the indices of their lowest voxels; the outermost ones have no outer
/// side. Places along the ray are in multiples of `L_min`, as the frame's space is.
#[derive(Clone, Copy, Debug)]
pub struct CellRay {
    origin: Vec3,
    direction: Vec3,
    inverse: Vec3,
    is_forward: BVec3,
    spacing: Vec3,
    inverse_spacing: Vec3,
    /// The cell in the far corner.
    last: Vec3,
    /// The farthest place in a cell: 0 along an axis with one voxel.
    farthest: Vec3,
}

impl CellRay {
    /// Makes ready to follow a ray.
    pub fn new(frame: &Frame, ray: &Ray) -> Self {
        let of_dims = |number: fn(u32) -> u32| Vec3::from_array(frame.dims.map(|dim| number(dim) as f32));
        Self {
            origin: ray.origin,
            direction: ray.direction,
            inverse: Frame::inverse_direction(ray),
            is_forward: ray.direction.cmpge(Vec3::ZERO),
            spacing: frame.spacing,
            inverse_spacing: frame.spacing.recip(),
            last: of_dims(|dim| dim.saturating_sub(2)),
            farthest: of_dims(|dim| dim.min(2) - 1),
        }
    }

    /// The cell at a place along the ray: the one that is entered there where that is on a plane.
    pub fn cell(&self, along: f32) -> Vec3 {
        let index = (self.origin + along * self.direction) * self.inverse_spacing;
        // Rounding can be off by a cell, but not by two.
        let guess = index.floor().clamp(Vec3::ZERO, self.last);
        let along = Vec3::splat(along);
        let ahead = along.cmpge(self.exits(guess));
        let behind = along.cmplt(self.entries(guess));
        guess + Vec3::select(ahead, self.step(), Vec3::ZERO) - Vec3::select(behind, self.step(), Vec3::ZERO)
    }

    /// The cell behind the nearest of a cell's exits.
    pub fn next(&self, cell: Vec3, exits: Vec3) -> Vec3 {
        // One at a time, so that cells can be counted.
        let is_x = exits.x <= exits.y && exits.x <= exits.z;
        let is_y = !is_x && exits.y <= exits.z;
        cell + Vec3::select(BVec3::new(is_x, is_y, !is_x && !is_y), self.step(), Vec3::ZERO)
    }

    /// Where along the ray a cell is left through the planes across each axis.
    pub fn exits(&self, cell: Vec3) -> Vec3 {
        self.crossings(cell + Vec3::select(self.is_forward, Vec3::ONE, Vec3::ZERO))
    }

    /// Where it is entered.
    fn entries(&self, cell: Vec3) -> Vec3 {
        let planes = cell + Vec3::select(self.is_forward, Vec3::ZERO, Vec3::ONE);
        let is_inside = planes.cmpgt(Vec3::ZERO) & planes.cmple(self.last);
        Vec3::select(is_inside, self.places(planes), Vec3::splat(f32::NEG_INFINITY))
    }

    /// Where planes between voxels are crossed; never, where there is no cell behind.
    fn crossings(&self, planes: Vec3) -> Vec3 {
        let is_inside = planes.cmpgt(Vec3::ZERO) & planes.cmple(self.last);
        Vec3::select(is_inside, self.places(planes), Vec3::INFINITY)
    }

    fn places(&self, planes: Vec3) -> Vec3 {
        (planes * self.spacing - self.origin) * self.inverse
    }

    /// One cell on along each axis.
    fn step(&self) -> Vec3 {
        Vec3::select(self.is_forward, Vec3::ONE, Vec3::NEG_ONE)
    }

    /// Where in a cell a place along the ray lies, 0 to 1 along each axis.
    pub fn fraction(&self, cell: Vec3, along: f32) -> Vec3 {
        let index = (self.origin + along * self.direction) * self.inverse_spacing;
        (index - cell).clamp(Vec3::ZERO, self.farthest)
    }

    /// How many cells a stretch of the ray goes through.
    pub fn count(&self, [entry, exit]: [f32; 2]) -> u64 {
        // A ray that misses has an exit before its entry, or none at all.
        let Some(Ordering::Less) = entry.partial_cmp(&exit) else { return 0 };
        let last = self.cell(exit);
        let is_left = self.entries(last).cmpge(Vec3::splat(exit));
        let last = last - Vec3::select(is_left, self.step(), Vec3::ZERO);
        1 + (last - self.cell(entry)).abs().element_sum() as u64
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use voxrole_pack::{GridGeometry, HitGradientQuantization, Precision};

    use super::*;
    use crate::ViewState;
    use crate::classify::EmphasisTable;
    use crate::state::{Camera, Projection};
    use crate::volume::VolumeDescription;

    fn frame(camera: Camera, dims: [u32; 3]) -> Frame {
        let geometry = GridGeometry::axis_aligned(dims, [1.0, 1.5, 2.0]);
        let hit_gradient = HitGradientQuantization::new(0.0, 1.0, Precision::default());
        let volume = VolumeDescription::new(&geometry, 15.0, [0.0, 1.0], hit_gradient);
        let state = ViewState { camera, ..ViewState::default() };
        Frame::new(&state, &volume, &EmphasisTable::new(&state.transfer_function), [16, 16])
    }

    /// Cells with the stretches of a ray in them, one after another.
    fn walk(ray: &CellRay, [entry, exit]: [f32; 2]) -> Vec<(Vec3, [f32; 2])> {
        let (mut along, mut cell, mut all) = (entry, ray.cell(entry), Vec::new());
        while along < exit {
            let exits = ray.exits(cell);
            let end = exits.min_element().min(exit);
            all.push((cell, [along, end]));
            (along, cell) = (end, ray.next(cell, exits));
        }
        all
    }

    proptest! {
        #[test]
        fn rays_go_through_every_cell_on_their_way(
            (azimuth, elevation) in (0_u32..24, 0_u32..13),
            (zoom, is_parallel) in (0.5_f32..6.0, any::<bool>()),
            dims in prop::array::uniform3(1_u32..20),
            pixel in 0_u32..256,
        ) {
            // Multiples of 15 degrees: along axes and diagonals too, where planes are crossed at once.
            let (azimuth, elevation) = (15.0 * azimuth as f32, 15.0 * elevation as f32 - 90.0);
            let projection = if is_parallel { Projection::Orthographic } else { Projection::Perspective };
            let frame = frame(Camera { azimuth, elevation, zoom, projection, ..Camera::default() }, dims);
            let ray = frame.ray(pixel % 16, pixel / 16);
            let ends = frame.intersect_box(&ray);
            let cells = CellRay::new(&frame, &ray);
            let all = walk(&cells, ends);
            prop_assert_eq!(all.len() as u64, cells.count(ends));
            let last = Vec3::from_array(dims.map(|dim| dim.saturating_sub(2) as f32));
            for &(cell, [begin, end]) in &all {
                prop_assert!(cell.cmpge(Vec3::ZERO).all() && cell.cmple(last).all() && begin <= end);
                // What is in between lies in the cell, but for rounding.
                let index = (ray.origin + 0.5 * (begin + end) * ray.direction) / frame.spacing;
                let inside = index.clamp(cell - 1e-4, cell + 1.0 + 1e-4);
                let is_slab = Vec3::from_array(dims.map(|dim| f32::from(u8::from(dim == 1))));
                prop_assert!(((index - inside) * (1.0 - is_slab)).abs().max_element() == 0.0, "{index} {cell}");
            }
        }
    }
}
