//! Which bricks slices need where the volume comes brick by brick: of a tile of the picture, and from which slice to which.
//!
//! Blending goes on from slice to slice in every pixel by itself, so that tiles can be drawn one after another, each with as many
//! slices at a time as their bricks have room: the picture is the same to the last bit. What is needed is told a little too
//! large, by the boxes around bricks, never too small.

use std::ops::RangeInclusive;

use glam::Vec3;

use super::brick_atlas::BRICK;
use crate::frame::{Frame, PixelRays};
use crate::slicing::{SLACK, Slicing};

/// How far a piece of a ray may reach beyond its slice's own slab, in slabs: a ray's first and last slice stand for all that
/// is left, which is half a slab and what rounding adds.
const BEYOND: f32 = 0.5 + 2.0 * SLACK;
/// Texels around a brick: a single one is drawn half a texel to either side, those of coarser levels may end almost one before
/// what is drawn, and a place may be rounded.
const AROUND: f32 = 1.1;
/// Pixels that a place in the picture may be off by rounding. Rays go through the middles of pixels.
const OFF: f32 = 0.1;

/// A part of the picture: its first and, behind it, its last pixel to the right and down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tile {
    /// Left and upper.
    pub low: [u32; 2],
    /// Right and lower, one beyond.
    pub high: [u32; 2],
}

impl Tile {
    /// Its longer side cut in half; `None` for a single pixel.
    #[must_use]
    pub fn halves(self) -> Option<[Self; 2]> {
        let sides = [0, 1].map(|axis: usize| self.high[axis] - self.low[axis]);
        let axis = usize::from(sides[1] > sides[0]);
        let middle = self.low[axis] + sides[axis] / 2;
        let (mut first, mut second) = (self, self);
        first.high[axis] = middle;
        second.low[axis] = middle;
        (sides[axis] > 1).then_some([first, second])
    }
}

/// Where a brick is seen, and among which slices it lies.
#[derive(Clone, Copy, Debug)]
pub struct BrickExtent {
    /// Its number.
    pub brick: usize,
    /// Of slices.
    numbers: [f32; 2],
    /// Pixels, from and to.
    pixels: [[f32; 2]; 2],
}

impl BrickExtent {
    /// Of a brick that begins at a voxel.
    #[must_use]
    pub fn new(brick: usize, start: [u32; 3], frame: &Frame, slicing: &Slicing) -> Self {
        let low = Vec3::from_array(start.map(|voxel| voxel as f32)) - AROUND;
        let high = low + BRICK as f32 + 2.0 * AROUND;
        let corners: [Vec3; 8] = std::array::from_fn(|corner| {
            let is_high = |axis: usize| corner >> axis & 1 == 1;
            let voxel =
                Vec3::from_array(std::array::from_fn(|axis| if is_high(axis) { high[axis] } else { low[axis] }));
            voxel * frame.spacing
        });
        let numbers = corners.map(|corner| slicing.number(corner));
        Self { brick, numbers: span(numbers.into_iter()), pixels: seen(&frame.rays, corners, frame.image_size) }
    }

    /// Whether it can be seen in a tile.
    #[must_use]
    pub fn is_in(&self, tile: Tile) -> bool {
        (0..2).all(|axis| {
            let [low, high] = self.pixels[axis];
            low - OFF <= tile.high[axis] as f32 - 0.5 && high + OFF >= tile.low[axis] as f32 + 0.5
        })
    }

    /// The slices that need it.
    #[must_use]
    pub fn slices(&self) -> RangeInclusive<i32> {
        let [low, high] = self.numbers;
        (low - 1.0 - BEYOND).ceil() as i32..=(high + BEYOND).floor() as i32
    }

    /// From where to where slices need it, on a way upwards or downwards.
    fn way(&self, sense: i32) -> [i32; 2] {
        let slices = self.slices();
        let [start, end] = [sense * slices.start(), sense * slices.end()];
        [start.min(end), start.max(end)]
    }
}

/// The bricks that slices need, told for one after another on their way.
pub struct Needed<'a> {
    /// Slices count upwards on their way, or downwards.
    sense: i32,
    /// Bricks that are not needed yet, that which is needed first at the end.
    coming: Vec<&'a BrickExtent>,
    /// Bricks that are, and up to where on the way.
    there: Vec<(i32, usize)>,
    /// Where on the way the last slice lay that was asked for.
    last: i32,
}

impl<'a> Needed<'a> {
    /// By slices whose numbers go from one to another.
    #[must_use]
    pub fn new(extents: &'a [BrickExtent], [from, to]: [i32; 2]) -> Self {
        let sense = if from <= to { 1 } else { -1 };
        let mut coming: Vec<_> = extents.iter().collect();
        coming.sort_by_key(|extent| std::cmp::Reverse(extent.way(sense)[0]));
        Self { sense, coming, there: Vec::new(), last: i32::MIN }
    }

    /// The bricks of a slice, which lies behind those that were asked for.
    pub fn by(&mut self, slice: i32) -> impl Iterator<Item = usize> {
        let place = self.sense * slice;
        debug_assert!(place >= self.last, "slice {slice} lies before one that was asked for");
        self.last = place;
        self.there.retain(|(end, _)| *end >= place);
        while let Some(extent) = self.coming.pop_if(|extent| extent.way(self.sense)[0] <= place) {
            let [_, end] = extent.way(self.sense);
            if end >= place {
                self.there.push((end, extent.brick));
            }
        }
        self.there.iter().map(|(_, brick)| *brick)
    }

    /// How many one slice needs at most.
    #[must_use]
    pub fn most(extents: &[BrickExtent], [from, to]: [i32; 2]) -> usize {
        let [first, last] = [from.min(to), from.max(to)];
        // By how many more a slice needs than the one before.
        let mut more = vec![0_i64; (last - first) as usize + 2];
        for extent in extents {
            let slices = extent.slices();
            let [start, end] = [(*slices.start()).max(first), (*slices.end()).min(last)];
            if start <= end {
                more[(start - first) as usize] += 1;
                more[(end - first) as usize + 1] -= 1;
            }
        }
        let sums = more.iter().scan(0, |sum, more| {
            *sum += more;
            Some(*sum)
        });
        sums.max().unwrap_or(0) as usize
    }
}

/// From which pixel to which a convex body is seen, to the right and down: nowhere where all of it lies behind the eye, everywhere
/// where some of it may.
fn seen(rays: &PixelRays, corners: [Vec3; 8], image_size: [u32; 2]) -> [[f32; 2]; 2] {
    let is_perspective = rays.origin_right == Vec3::ZERO;
    // Either origins or directions move across the picture.
    let sides = [rays.origin_right + rays.direction_right, rays.origin_up + rays.direction_up];
    let depth = |corner: Vec3| {
        let from_origin = corner - rays.origin;
        if is_perspective { from_origin.dot(rays.direction) / rays.direction.length_squared() } else { 1.0 }
    };
    if corners.iter().all(|corner| depth(*corner) < 0.0) {
        return [span([].into_iter()); 2];
    }
    let mut places = [[0.0; 2]; 8];
    for (place, corner) in places.iter_mut().zip(corners) {
        let (from_origin, depth) = (corner - rays.origin, depth(corner));
        if depth <= 1e-3 * from_origin.length() {
            return [[f32::NEG_INFINITY, f32::INFINITY]; 2];
        }
        let [right, up] = sides.map(|side| from_origin.dot(side) / side.length_squared() / depth);
        let [width, height] = image_size.map(|side| 0.5 * side as f32);
        *place = [(1.0 + right) * width, (1.0 - up) * height];
    }
    [0, 1].map(|axis: usize| span(places.iter().map(|place| place[axis])))
}

fn span(numbers: impl Iterator<Item = f32>) -> [f32; 2] {
    numbers.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], number| [low.min(number), high.max(number)])
}

#[cfg(test)]
mod tests {
    use voxrole_pack::{GridGeometry, HitGradientQuantization, Precision};

    use super::*;
    use crate::ViewState;
    use crate::classify::EmphasisTable;
    use crate::reference::naive::samples::Samples;
    use crate::state::{Camera, Projection, Technique};
    use crate::volume::VolumeDescription;

    #[test]
    fn tiles_are_halved_down_to_pixels() {
        let tile = Tile { low: [2, 3], high: [7, 5] };
        let [left, right] = tile.halves().expect("is larger than a pixel");
        assert_eq!([left, right], [Tile { high: [4, 5], ..tile }, Tile { low: [4, 3], ..tile }]);
        assert_eq!(Tile { low: [2, 3], high: [3, 4] }.halves(), None);
    }

    #[test]
    fn bricks_are_told_slice_by_slice() {
        let random = |index: usize| (index * 2_654_435_761) % 97;
        let extents: Vec<_> = (0..60)
            .map(|brick| {
                let low = random(brick) as f32 - 20.0;
                let numbers = [low, low + random(brick + 60) as f32 / 5.0];
                BrickExtent { brick, numbers, pixels: [[0.0; 2]; 2] }
            })
            .collect();
        for ends @ [from, to] in [[0, 50], [50, 0], [7, 7], [-30, 100]] {
            let step = if from <= to { 1 } else { -1 };
            let (mut needed, mut most) = (Needed::new(&extents, ends), 0);
            for slice in (0..=(to - from).abs()).map(|index| from + step * index) {
                let expected: Vec<_> = extents.iter().filter(|extent| extent.slices().contains(&slice)).collect();
                most = most.max(expected.len());
                // Not all slices need be asked for.
                if slice % 3 == 0 {
                    let mut found: Vec<_> = needed.by(slice).collect();
                    found.sort_unstable();
                    assert_eq!(found, expected.iter().map(|extent| extent.brick).collect::<Vec<_>>(), "{slice}");
                }
            }
            assert_eq!(Needed::most(&extents, ends), most);
        }
    }

    /// Against rays followed in small steps: no brick on a sample's way is left out, and most others are.
    #[test]
    fn every_brick_that_a_piece_of_a_ray_goes_through_is_told() {
        // On a coarse level what is drawn ends behind the last texel, here that of a last brick that is full.
        for (dims, level, step, parts) in [([150, 97, 70], 0, 3.0, 3), ([516, 516, 388], 2, 0.25, 2)] {
            let geometry = GridGeometry::axis_aligned(dims, [1.0, 1.5, 2.5]);
            let hit_gradient = HitGradientQuantization::new(0.0, 1.0, Precision::default());
            let volume = VolumeDescription::new(&geometry, 15.0, [0.0, 1.0], hit_gradient);
            tells_every_brick(&VolumeDescription { level, ..volume }, step, parts);
        }
    }

    /// And of so many parts of all bricks one at most; there are few on a coarse level.
    fn tells_every_brick(volume: &VolumeDescription, step: f32, parts: usize) {
        let dims = volume.texel_dims();
        let grid = dims.map(|dim: u32| (dim - 1).div_ceil(BRICK));
        for (technique, projection, zoom) in [
            (Technique::Slices, Projection::Perspective, 1.0),
            (Technique::Stacks, Projection::Perspective, 1.3),
            (Technique::Slices, Projection::Orthographic, 1.0),
            (Technique::Stacks, Projection::Perspective, 9.0),
        ] {
            let camera = Camera { azimuth: 35.0, elevation: 25.0, zoom, projection, ..Camera::default() };
            let mut state = ViewState { camera, ..ViewState::default() };
            (state.render_settings.technique, state.render_settings.step) = (technique, step);
            let frame = Frame::new(&state, volume, &EmphasisTable::new(&state.transfer_function), [23, 17]);
            let slicing = frame.slicing.expect("slices");
            let extents: Vec<_> = (0..grid.iter().product())
                .map(|brick| {
                    let place = [brick % grid[0], brick / grid[0] % grid[1], brick / (grid[0] * grid[1])];
                    BrickExtent::new(brick as usize, place.map(|place| place * BRICK), &frame, &slicing)
                })
                .collect();
            let (mut met, mut told, mut all) = (0, 0, 0);
            for (x, y) in (0..17).flat_map(|y| (0..23).map(move |x| (x, y))) {
                let tile = Tile { low: [x, y], high: [x + 1, y + 1] };
                let (ray, opaque) = (frame.ray(x, y), f32::INFINITY);
                let interval = frame.interval(&ray);
                let samples = Samples::new(&frame, &ray, &interval, 0.5, opaque);
                for index in 0..10_000 {
                    let Some(sample) = samples.at(index as f32) else { break };
                    let slice = (slicing.number(ray.origin + sample.along * ray.direction) - 0.5).round() as i32;
                    let needed: Vec<_> = extents
                        .iter()
                        .filter(|extent| extent.is_in(tile) && extent.slices().contains(&slice))
                        .collect();
                    told += needed.len();
                    all += extents.len();
                    for part in 0..=20 {
                        let along = sample.along + sample.step * (part as f32 / 20.0 - 0.5);
                        let place = (ray.origin + along * ray.direction) / frame.spacing;
                        let brick: [u32; 3] = std::array::from_fn(|axis| {
                            (place[axis].max(0.0) as u32).min(dims[axis].saturating_sub(2)) / BRICK
                        });
                        let brick = (brick[2] * grid[1] + brick[1]) * grid[0] + brick[0];
                        assert!(needed.iter().any(|extent| extent.brick == brick as usize), "{technique:?} {zoom}");
                        met += 1;
                    }
                }
            }
            assert!(met > 1000 && told * parts < all, "{met} places, {told} of {all} bricks");
        }
    }
}
