//! Rays through the grid, and trilinear sampling along them.

use glam::{IVec3, Vec3};

/// How far outside the volume, in voxels, a place still counts as on its face: a ray along a face must not be lost to the
/// rounding of its direction.
pub const GRAZE: f32 = 1e-4;

/// Trilinear reconstruction of fields that share one grid.
#[derive(Clone, Copy, Debug)]
pub struct Sampler {
    dims: [usize; 3],
}

/// A place in the grid: the lowest corner of its cell, and where inside it lies, each coordinate in 0..=1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Lowest corner of the cell.
    pub cell: [usize; 3],
    /// Position inside the cell.
    pub fraction: Vec3,
}

/// A straight ray from a voxel.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    origin: IVec3,
    /// Voxels per unit of the ray's parameter.
    direction: Vec3,
    /// Offsets from the origin, in voxels, at which the volume ends.
    low: Vec3,
    high: Vec3,
}

impl Sampler {
    /// A sampler of fields of `dims` voxels.
    #[must_use]
    pub fn new(dims: [usize; 3]) -> Self {
        Self { dims }
    }

    /// The ray from voxel `origin` along `direction`, given in voxels per unit of the ray's parameter.
    #[must_use]
    pub fn ray(&self, origin: [usize; 3], direction: Vec3) -> Ray {
        let low = Vec3::from_array(origin.map(|index| -(index as f32)));
        let last = Vec3::from_array(self.dims.map(|dim| (dim - 1) as f32));
        Ray { origin: IVec3::from_array(origin.map(|index| index as i32)), direction, low, high: last + low }
    }

    /// The place at parameter `t`, or `None` outside the volume.
    ///
    /// Worked out as an offset from the ray's voxel, so that precision does not depend on where in the volume it is.
    #[inline(always)]
    #[must_use]
    pub fn place(&self, ray: &Ray, t: f32) -> Option<Place> {
        let offset = ray.direction * t;
        if offset.cmplt(ray.low - GRAZE).any() || offset.cmpgt(ray.high + GRAZE).any() {
            return None;
        }
        let offset = offset.clamp(ray.low, ray.high);
        let floor = offset.floor();
        let corner = (ray.origin + floor.as_ivec3()).to_array();
        let mut fraction = (offset - floor).to_array();
        let mut cell = [0; 3];
        for axis in 0..3 {
            // On the far face the cell before it is taken, at its end. An axis of one voxel has only a near face.
            let last_cell = self.dims[axis].saturating_sub(2) as i32;
            fraction[axis] = if corner[axis] > last_cell && self.dims[axis] > 1 { 1.0 } else { fraction[axis] };
            cell[axis] = corner[axis].min(last_cell) as usize;
        }
        Some(Place { cell, fraction: Vec3::from_array(fraction) })
    }

    /// The cell that the ray keeps to between two parameters. `None` where there is more than one, or one that
    /// [`Self::place`] treats specially: at the end of the volume, or with a NaN at a corner.
    #[inline(always)]
    #[must_use]
    pub fn span(&self, field: &[f32], ray: &Ray, ends: [f32; 2]) -> Option<Span> {
        // Rounded products and their floors grow with t, so what holds at both ends holds in between.
        let [begin, end] = ends.map(|t| ray.direction * t);
        let floor = begin.floor();
        if floor != end.floor() || floor.cmplt(ray.low).any() || floor.cmpge(ray.high).any() {
            return None;
        }
        let cell = (ray.origin + floor.as_ivec3()).to_array().map(|index| index as usize);
        let corners = self.corners(field, cell);
        (!corners.as_array().into_iter().sum::<f32>().is_nan()).then_some(Span { cell: floor, corners })
    }

    /// Trilinear value of `field` at `place`.
    ///
    /// Each interpolation is a sum of two products with weights in 0..=1, so the result has the corners' common sign
    /// where they have one, whatever the rounding.
    #[inline(always)]
    #[must_use]
    pub fn trilinear(&self, field: &[f32], place: &Place) -> f32 {
        self.corners(field, place.cell).interpolate(place.fraction)
    }

    /// The samples of `field` at the corners of a cell.
    #[inline(always)]
    #[must_use]
    pub fn corners(&self, field: &[f32], [i, j, k]: [usize; 3]) -> Corners {
        let [nx, ny, nz] = self.dims;
        let x = usize::from(nx > 1);
        let y = if ny > 1 { nx } else { 0 };
        let z = if nz > 1 { nx * ny } else { 0 };
        let low = (k * ny + j) * nx + i;
        let high = low + z;
        Corners([
            [[field[low], field[low + x]], [field[low + y], field[low + y + x]]],
            [[field[high], field[high + x]], [field[high + y], field[high + y + x]]],
        ])
    }
}

/// A cell that a part of a ray keeps to.
#[derive(Clone, Copy, Debug)]
pub struct Span {
    /// The cell's lowest corner as an offset from the ray's voxel, in voxels. The fraction at parameter t is
    /// `direction · t − cell`.
    pub cell: Vec3,
    /// What the field has at its corners.
    pub corners: Corners,
}

/// What a field has at the corners of a cell, indexed (z, y, x).
#[derive(Clone, Copy, Debug)]
pub struct Corners([[[f32; 2]; 2]; 2]);

impl Corners {
    /// From corners with x fastest.
    #[inline(always)]
    #[must_use]
    pub fn from_array([a, b, c, d, e, f, g, h]: [f32; 8]) -> Self {
        Self([[[a, b], [c, d]], [[e, f], [g, h]]])
    }

    /// The corners, x fastest.
    #[inline(always)]
    #[must_use]
    pub fn as_array(&self) -> [f32; 8] {
        let [[[a, b], [c, d]], [[e, f], [g, h]]] = self.0;
        [a, b, c, d, e, f, g, h]
    }

    /// The corners of the field times a factor.
    #[inline(always)]
    #[must_use]
    pub fn times(&self, factor: f32) -> Self {
        Self::from_array(self.as_array().map(|corner| factor * corner))
    }

    /// The most by which the trilinear value falls along a direction anywhere in the cell, per unit of it, and a bound of what
    /// rounding makes of values and places; NaN with a NaN at a corner.
    ///
    /// Its derivative along an axis is a mean of the four edges' differences.
    #[inline(always)]
    #[must_use]
    pub fn steepest_fall(&self, direction: Vec3) -> [f32; 2] {
        let [a, b, c, d, e, f, g, h] = self.as_array();
        let along = |rises: [f32; 4], speed: f32| {
            let [p, q, r, s] = rises;
            ((-speed * p).max(-speed * q)).max((-speed * r).max(-speed * s))
        };
        let [x, y, z] = direction.to_array();
        let fall = [
            along([b - a, d - c, f - e, h - g], x),
            along([c - a, d - b, g - e, h - f], y),
            along([e - a, f - b, g - c, h - d], z),
        ];
        // A sum, because maxima pass over NaN.
        let magnitudes = (a.abs() + b.abs() + c.abs() + d.abs()) + (e.abs() + f.abs() + g.abs() + h.abs());
        [fall[0].max(0.0) + fall[1].max(0.0) + fall[2].max(0.0), 1e-5 * magnitudes]
    }

    /// Trilinear value, see [`Sampler::trilinear`].
    #[inline(always)]
    #[must_use]
    pub fn interpolate(&self, Vec3 { x, y, z }: Vec3) -> f32 {
        let [[[a, b], [c, d]], [[e, f], [g, h]]] = self.0;
        between(between(between(a, b, x), between(c, d, x), y), between(between(e, f, x), between(g, h, x), y), z)
    }
}

#[inline(always)]
fn between(low: f32, high: f32, share: f32) -> f32 {
    low * (1.0 - share) + high * share
}

impl Ray {
    /// The same ray the other way.
    #[must_use]
    pub fn reversed(self) -> Self {
        Self { direction: -self.direction, ..self }
    }

    /// The parameters between two at which the ray passes from one cell into the next, in their order.
    #[must_use]
    pub fn planes_between(&self, from: f32, to: f32) -> Vec<f32> {
        let mut planes = Vec::new();
        for speed in self.direction.to_array().into_iter().filter(|speed| *speed != 0.0) {
            let [start, end] = [from * speed, to * speed];
            let [low, high] = [start.min(end), start.max(end)];
            let first = low.floor() as i32 + 1;
            planes.extend((first..high.ceil() as i32).map(|plane| plane as f32 / speed));
        }
        planes.retain(|t| (from.min(to)..from.max(to)).contains(t));
        planes.sort_by(|a, b| if from <= to { a.total_cmp(b) } else { b.total_cmp(a) });
        planes
    }

    /// Voxels per unit of the ray's parameter.
    #[must_use]
    pub fn direction(&self) -> Vec3 {
        self.direction
    }

    /// How much the parameter grows per voxel along each axis, infinite across the ray.
    #[must_use]
    pub fn slowness(&self) -> Vec3 {
        self.direction.abs().recip()
    }

    /// The parameter at which the ray leaves the cube of all cells that are closer to `cell` than `distance`, in the
    /// Chebyshev metric. `slowness` is the ray's.
    #[inline(always)]
    #[must_use]
    pub fn leaves(&self, slowness: Vec3, cell: [usize; 3], distance: u8) -> f32 {
        let cell = IVec3::from_array(cell.map(|index| index as i32)) - self.origin;
        let [ahead, behind] = [cell + i32::from(distance), i32::from(distance - 1) - cell];
        let room = IVec3::select(self.direction.cmpge(Vec3::ZERO), ahead, behind);
        // Along a face no room across the ray is 0 · ∞: `f32::min` passes over NaN, glam's `min_element` may not.
        let [x, y, z] = (room.as_vec3() * slowness).to_array();
        x.min(y).min(z)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn linear_field(dims: [usize; 3]) -> Vec<f32> {
        let [nx, ny, nz] = dims;
        (0..nx * ny * nz)
            .map(|v| (v % nx) as f32 + 10.0 * (v / nx % ny) as f32 + 100.0 * (v / (nx * ny)) as f32)
            .collect()
    }

    #[test]
    fn linear_fields_are_reproduced_to_the_faces() {
        let dims = [4, 5, 6];
        let (sampler, field) = (Sampler::new(dims), linear_field(dims));
        let ray = sampler.ray([1, 2, 3], Vec3::new(2.0, -2.0, 0.5));
        for (t, expected) in [(0.0, Some(321.0)), (0.5, Some(337.0)), (1.0, Some(353.0)), (1.1, None)] {
            let found = sampler.place(&ray, t).map(|place| sampler.trilinear(&field, &place));
            assert_eq!(found, expected, "t = {t}");
        }
    }

    #[test]
    fn single_voxel_axes_are_sampled_only_in_their_plane() {
        let dims = [3, 1, 1];
        let (sampler, field) = (Sampler::new(dims), linear_field(dims));
        let along = sampler.ray([0, 0, 0], Vec3::X);
        let value = sampler.place(&along, 1.25).map(|place| sampler.trilinear(&field, &place));
        assert_eq!(value, Some(1.25));
        assert_eq!(sampler.place(&sampler.ray([0, 0, 0], Vec3::Y), 0.1), None);
    }

    proptest! {
        #[test]
        fn nothing_falls_faster_than_the_steepest_fall(
            corners in prop::array::uniform8(-1.0_f32..1.0),
            ends in prop::array::uniform2(prop::array::uniform3(0.0_f32..1.0)),
            hole in 0_usize..8,
        ) {
            let [from, to] = ends.map(Vec3::from_array);
            let [fall, margin] = Corners::from_array(corners).steepest_fall(to - from);
            let [begin, end] = [from, to].map(|place| Corners::from_array(corners).interpolate(place));
            prop_assert!(begin - end <= fall + margin, "{begin} {end} {fall}");
            let mut masked = corners;
            masked[hole] = f32::NAN;
            let [_, margin] = Corners::from_array(masked).steepest_fall(to - from);
            prop_assert!(margin.is_nan());
        }
    }

    #[test]
    fn the_steepest_fall_of_a_ramp_is_its_own() {
        let ramp = Corners::from_array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
        for (direction, expected) in [(Vec3::X, 0.0), (-Vec3::X, 1.0), (Vec3::new(1.0, -1.0, -0.5), 4.0)] {
            assert_eq!(ramp.steepest_fall(direction)[0], expected, "{direction}");
        }
    }

    #[test]
    fn cells_are_left_along_the_far_faces_too() {
        let sampler = Sampler::new([20, 18, 16]);
        for origin in [[14, 17, 8], [14, 8, 15], [14, 17, 15], [14, 0, 0]] {
            let cell = [14, origin[1].min(16), origin[2].min(14)];
            for (direction, expected) in [(Vec3::X, [1.0, 3.0]), (-Vec3::X, [0.0, 2.0])] {
                let ray = sampler.ray(origin, direction);
                let found = [1, 3].map(|distance| ray.leaves(ray.slowness(), cell, distance));
                assert_eq!(found, expected, "{origin:?} along {direction}");
            }
        }
    }

    #[test]
    fn planes_are_passed_in_order() {
        let sampler = Sampler::new([9, 9, 9]);
        let ray = sampler.ray([4, 4, 4], Vec3::new(1.0, -0.5, 0.0));
        assert_eq!(ray.planes_between(0.5, 2.5), [1.0, 2.0, 2.0]);
        assert_eq!(ray.planes_between(-0.5, -2.5), [-1.0, -2.0, -2.0]);
        assert!(ray.planes_between(0.1, 0.3).is_empty());
    }

    proptest! {
        #[test]
        fn a_common_sign_is_kept(
            corners in prop::array::uniform8(1e-30_f32..1e30),
            fraction in prop::array::uniform3(0.0_f32..=1.0),
        ) {
            let sampler = Sampler::new([2, 2, 2]);
            let place = Place { cell: [0; 3], fraction: Vec3::from_array(fraction) };
            prop_assert!(sampler.trilinear(&corners, &place) > 0.0);
            prop_assert!(sampler.trilinear(&corners.map(|corner| -corner), &place) < 0.0);
        }
    }
}
