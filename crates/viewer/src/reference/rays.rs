//! Sixteen rays, from sample to sample.

// No iterators and closures in vector code: what std calls might be compiled without the level's instructions.
#![allow(clippy::needless_range_loop, reason = "see above")]

use fearless_simd::{Select, Simd, SimdBase, SimdFloat, SimdInt, SimdMask, f32x16, mask32x16, u32x16};
use glam::Vec3;

use super::active_cells::ActiveCells;
use super::batch::{Batch, Ways};
use super::corners::Places;
use super::gathers;
use super::lanes::{Directions, LANES, dot, splat, splat_vector, store_columns};
use super::planes::Planes;
use super::sampling::{Sampler, whole};
use super::steps::{Samples, Steps};
use super::tile::SQUARE;
use crate::classify::Occupancy;
use crate::classify::macrocells::MACROCELL;
use crate::frame::Frame;
use crate::slicing::share_of_face;

/// Rays rest after so many visits, whatever they find: the next one does not wait to know what the last one finds.
const MOST_VISITED: usize = 8;
/// Pieces of a cell, at most, that a visit takes: short steps cut it into many.
const MOST_PIECES: usize = 8;
/// Two sixteens rest once more samples of theirs wait than one for each of the visits.
const MOST_WAITING: usize = 2 * LANES * MOST_VISITED;

/// How far off rounding can put a sample, as a share of the lengths that it is worked out from: a few units in the last place.
const ROUNDING: f32 = 4e-6;

/// Where rays may leap.
#[derive(Clone, Copy)]
pub(super) struct Skipping<'a> {
    pub(super) occupancy: &'a Occupancy,
    /// Which cells can show anything, where roles decide.
    pub(super) active: Option<&'a ActiveCells>,
}

/// What rays go through.
pub(super) struct Space<'a> {
    pub(super) sampler: Sampler<'a>,
    /// What is read where values decide.
    pub(super) planes: Option<&'a Planes>,
    /// Where rays leap at all.
    pub(super) skipping: Option<Skipping<'a>>,
}

/// Where in their square pixels lie.
const WITHIN: [[u32; LANES]; 2] = {
    let (mut within, mut lane) = ([[0; LANES]; 2], 0);
    while lane < LANES {
        (within[0][lane], within[1][lane]) = ((lane % SQUARE) as u32, (lane / SQUARE) as u32);
        lane += 1;
    }
    within
};

/// A square of pixels, whose rays go side by side.
pub(super) struct Pixels {
    /// The left upper one, counted from the top left of the picture.
    pub(super) first: [u32; 2],
    /// Bits of those that there are.
    pub(super) are_there: u16,
    /// Where along the rays opaque geometry lies.
    pub(super) opaque: [f32; LANES],
}

/// The rays of sixteen pixels, and how far along they are.
pub(super) struct Rays<S: Simd> {
    pub(super) origin: Directions<S>,
    pub(super) direction: Directions<S>,
    inverse: Directions<S>,
    are_forward: [mask32x16<S>; 3],
    /// What of them is drawn.
    pub(super) entry: f32x16<S>,
    pub(super) exit: f32x16<S>,
    /// Normals of the planes that they enter through, 0 where those do not cut.
    cut: Directions<S>,
    /// Those that have not ended.
    go_on: mask32x16<S>,
    /// At equal distances how many samples lie behind; from cell to cell the place along the ray.
    progress: f32x16<S>,
    /// Where samples at equal distances lie.
    steps: Steps<S>,
    /// From cell to cell those that they are in, by the indices of the lowest voxel.
    cell: Directions<S>,
    /// Which of its pieces comes next.
    piece: f32x16<S>,
}

impl<S: Simd> Rays<S> {
    /// The rays of pixels; adds to `count` how many samples there are along them.
    #[inline(always)]
    pub(super) fn new(simd: S, frame: &Frame, pixels: &Pixels, count: &mut u64) -> Self {
        let zero = splat(simd, 0.0);
        let [origin, direction] = pixel_rays(simd, frame, pixels);
        let (mut inverse, mut are_forward) = ([zero; 3], [mask32x16::splat(simd, false); 3]);
        for axis in 0..3 {
            are_forward[axis] = direction[axis].simd_ge(0.0);
            // As `Frame::inverse_direction`.
            let least = are_forward[axis].select(splat(simd, 1e-20), splat(simd, -1e-20));
            inverse[axis] = 1.0 / direction[axis].abs().simd_lt(1e-20).select(least, direction[axis]);
        }
        let go_on = mask32x16::from_bitmask(simd, pixels.are_there.into());
        let mut rays = Self {
            origin,
            direction,
            inverse,
            are_forward,
            entry: zero,
            exit: zero,
            cut: [zero; 3],
            go_on,
            progress: zero,
            steps: Steps::none(simd),
            cell: [zero; 3],
            piece: zero,
        };
        rays.enter(simd, frame);
        let opaque = f32x16::from_slice(simd, &pixels.opaque);
        rays.steps = Steps::new(simd, frame, &rays, first_samples(simd, frame, pixels), opaque);
        rays.exit = rays.exit.min(opaque);
        let counts = if frame.goes_by_cells {
            if frame.slicing.is_some() {
                // Slices together stand for all of a ray that meets any.
                rays.exit = rays.steps.count(simd, &rays).simd_gt(0.0).select(rays.exit, rays.entry);
            }
            rays.progress = rays.entry;
            rays.cell = rays.cell(simd, frame, rays.entry);
            rays.cells_between(simd, frame)
        } else {
            rays.steps.count(simd, &rays)
        };
        let counts: [f32; LANES] = go_on.select(counts, zero).into();
        for lane in 0..LANES {
            *count += counts[lane] as u64;
        }
        rays
    }

    /// Keeps what samples need to know of them.
    #[inline(always)]
    pub(super) fn store(&self, simd: S, ways: &mut Ways, first: usize) {
        let zero = splat(simd, 0.0);
        let ([x, y, z], [u, v, w]) = (self.origin, self.direction);
        ways.origins.resize(first + LANES, [0.0; 4]);
        ways.directions.resize(first + LANES, [0.0; 4]);
        store_columns(simd, [x, y, z, zero], &mut ways.origins[first..]);
        store_columns(simd, [u, v, w, zero], &mut ways.directions[first..]);
    }

    /// Whether any has not ended.
    #[inline(always)]
    pub(super) fn any_goes_on(&self) -> bool {
        self.go_on.any_true()
    }

    /// Ends those of `lanes`.
    #[inline(always)]
    pub(super) fn end(&mut self, simd: S, lanes: u16) {
        self.go_on &= !mask32x16::from_bitmask(simd, lanes.into());
    }

    /// The normal of the plane that a ray enters through, 0 where that does not cut.
    pub(super) fn cut(&self, lane: usize) -> Vec3 {
        Vec3::from_array(self.cut.map(|axis| axis[lane]))
    }

    /// The share of a ray's sample that lies on the face of the cut through which the ray enters, to a depth that does not
    /// depend on the step; at equal distances all of the first one, so that a face shows at any.
    pub(super) fn share_of_face(&self, simd: S, frame: &Frame, lane: usize, along: f32, step: f32) -> f32 {
        let is_first = !frame.goes_by_cells && along == self.steps.at(simd, frame, self, splat(simd, 0.0)).along[lane];
        if is_first { 1.0 } else { share_of_face(along, step, self.entry[lane]) }
    }

    /// Goes on by a few places or cells with one or two sixteens of rays, in turn: what the one waits for, the other does not. At
    /// how many places, or in how many cells, the volume is to be sampled.
    #[inline(never)]
    pub(super) fn advance(pair: &mut [Self], simd: S, space: &Space<'_>, first_ray: usize, batch: &mut Batch) -> u64 {
        simd.vectorize(
            #[inline(always)]
            || {
                let frame = space.sampler.frame;
                let mut taken = 0;
                let most = batch.len() + MOST_WAITING;
                for _ in 0..MOST_VISITED {
                    for (number, rays) in pair.iter_mut().enumerate() {
                        let first_ray = first_ray + number * LANES;
                        taken += if frame.goes_by_cells {
                            rays.visit_cell(simd, space, first_ray, batch)
                        } else {
                            rays.visit_place(simd, space, first_ray, batch)
                        };
                    }
                    if batch.len() > most {
                        break;
                    }
                }
                taken
            },
        )
    }

    /// Visits the next of samples at equal distances; of how many rays there is one to be taken.
    #[inline(always)]
    fn visit_place(&mut self, simd: S, space: &Space<'_>, first_ray: usize, batch: &mut Batch) -> u64 {
        let (sampler, frame) = (&space.sampler, space.sampler.frame);
        let steps = &self.steps;
        let Samples { exist, along, step, half_step } = steps.at(simd, frame, self, self.progress);
        self.go_on &= exist;
        if !self.go_on.any_true() {
            return 0;
        }
        let mut position = self.origin;
        for axis in 0..3 {
            position[axis] += along * self.direction[axis];
        }
        let [cell, fractions] = sampler.cells(simd, &position);
        let Seen { are_sampled, leap, distance } = space.look(simd, &cell, self.go_on);
        if are_sampled.any_true() {
            let places = sampler.places(&cell, fractions);
            batch.push(simd, are_sampled, first_ray, &places, [along, step, half_step]);
            space.ask_for(simd, are_sampled, &places);
        }
        // Not a running sum of places, whose rounding errors would add up.
        let mut next = self.progress + 1.0;
        if leap.any_true() {
            // To the first sample beyond all that is known to be empty.
            let beyond = self.leaves_macrocells(simd, frame, &cell, distance);
            next = leap.select(((beyond - steps.start) / steps.step).floor().max(next), next);
        }
        self.progress = next;
        u64::from(are_sampled.to_bitmask().count_ones())
    }

    /// Visits the next cell. What lies in it of a ray is cut into equal pieces, so that the voxels that decide are the same along
    /// all of a piece, and nothing of the ray is left out. Of how many rays something is to be sampled.
    #[inline(always)]
    fn visit_cell(&mut self, simd: S, space: &Space<'_>, first_ray: usize, batch: &mut Batch) -> u64 {
        let (sampler, frame) = (&space.sampler, space.sampler.frame);
        let (along, cell) = (self.progress, self.cell);
        self.go_on &= along.simd_lt(self.exit);
        if !self.any_goes_on() {
            return 0;
        }
        let Seen { are_sampled, leap, distance } = space.look(simd, &cell, self.go_on);
        let exits = self.exits(simd, frame, &cell);
        let end = exits[0].min(exits[1]).min(exits[2]).min(self.exit);
        let zero = splat(simd, 0.0);
        // Those go on behind the cell of which nothing is left in it.
        let mut go_on = mask32x16::splat(simd, true);
        let mut piece = self.piece;
        let are_new = are_sampled & piece.simd_eq(0.0);
        if are_sampled.any_true() {
            let pieces = ((end - along) / (2.0 * frame.half_step)).ceil();
            let step = (end - along) / pieces;
            let mut are_left = are_sampled & piece.simd_lt(pieces);
            for _ in 0..MOST_PIECES {
                if !are_left.any_true() {
                    break;
                }
                let middle = along + (piece + 0.5) * step;
                let places = sampler.places(&cell, self.fractions(simd, sampler, &cell, middle));
                batch.push(simd, are_left, first_ray, &places, [middle, step, step * 0.5]);
                space.ask_for(simd, are_left, &places);
                piece = are_left.select(piece + 1.0, piece);
                are_left &= piece.simd_lt(pieces);
            }
            go_on = !are_left;
        }
        let (mut next_along, mut next_cell) = (end, self.next_cell(simd, &cell, &exits));
        if leap.any_true() {
            let (beyond, cell_beyond) = self.leap(simd, frame, &cell, distance);
            next_along = leap.select(beyond, next_along);
            for axis in 0..3 {
                next_cell[axis] = leap.select(cell_beyond[axis], next_cell[axis]);
            }
        }
        self.piece = go_on.select(zero, piece);
        self.progress = go_on.select(next_along, along);
        for axis in 0..3 {
            self.cell[axis] = go_on.select(next_cell[axis], cell[axis]);
        }
        u64::from(are_new.to_bitmask().count_ones())
    }

    /// Finds what of the rays is drawn: as [`Frame::interval`].
    #[inline(always)]
    fn enter(&mut self, simd: S, frame: &Frame) {
        let (mut entry, mut exit) = (splat(simd, 0.0), splat(simd, f32::INFINITY));
        for axis in 0..3 {
            let to_low = (frame.box_low[axis] - self.origin[axis]) * self.inverse[axis];
            let to_high = (frame.box_high[axis] - self.origin[axis]) * self.inverse[axis];
            entry = entry.max(to_low.min(to_high));
            exit = exit.min(to_low.max(to_high));
        }
        for plane in 0..frame.plane_count as usize {
            let plane = frame.planes[plane];
            let normal = splat_vector(simd, plane.truncate());
            let (along, room) = (dot(&normal, &self.direction), plane.w - dot(&normal, &self.origin));
            // A ray along the plane lies on one side of it as a whole.
            let is_parallel = along.abs().simd_lt(1e-20);
            let crossing = room / along;
            let is_exit = !is_parallel & along.simd_gt(0.0);
            let is_entry = !is_parallel & !is_exit & crossing.simd_gt(entry);
            exit = is_exit.select(exit.min(crossing), exit);
            exit = (is_parallel & room.simd_lt(0.0)).select(splat(simd, -1.0), exit);
            entry = is_entry.select(crossing, entry);
            for axis in 0..3 {
                self.cut[axis] = is_entry.select(normal[axis], self.cut[axis]);
            }
        }
        (self.entry, self.exit) = (entry, exit);
    }

    /// How far off rounding can put a sample.
    #[inline(always)]
    fn slack(&self, simd: S, frame: &Frame) -> f32x16<S> {
        let [x, y, z] = self.origin;
        let farthest = x.abs().max(y.abs()).max(z.abs());
        (farthest + splat(simd, (frame.box_high - frame.box_low).length())) * ROUNDING
    }

    /// Up to where every sample lies in a macrocell closer than `distance` to that of its cell, rounding included.
    #[inline(always)]
    fn leaves_macrocells(&self, simd: S, frame: &Frame, cell: &Directions<S>, distance: f32x16<S>) -> f32x16<S> {
        let slack = self.slack(simd, frame);
        let mut nearest = splat(simd, f32::INFINITY);
        for axis in 0..3 {
            let corner = self.beyond_macrocells(axis, cell, distance);
            let plane = corner * frame.spacing[axis] + self.are_forward[axis].select(-slack, slack);
            nearest = nearest.min((plane - self.origin[axis]) * self.inverse[axis]);
        }
        nearest
    }

    /// Where the cube of macrocells is left that are all closer than `distance` to that of a cell, and the cell there.
    #[inline(always)]
    fn leap(&self, simd: S, frame: &Frame, cell: &Directions<S>, distance: f32x16<S>) -> (f32x16<S>, Directions<S>) {
        let never = splat(simd, f32::INFINITY);
        let (mut planes, mut places) = ([never; 3], [never; 3]);
        for axis in 0..3 {
            planes[axis] = self.beyond_macrocells(axis, cell, distance);
            places[axis] = self.crossing(simd, frame, axis, planes[axis], f32::INFINITY);
        }
        let along = places[0].min(places[1]).min(places[2]);
        // Whatever rounding does far from the eye, a leap ends behind the plane that it leads to.
        let mut beyond = self.cell(simd, frame, along);
        for axis in 0..3 {
            let (found, plane) = (beyond[axis], planes[axis]);
            let behind = self.are_forward[axis].select(found.max(plane), found.min(plane - 1.0));
            beyond[axis] = places[axis].simd_le(along).select(behind, found);
        }
        (along, beyond)
    }

    /// The voxel across an axis at which macrocells begin that are `distance` away from that of a cell.
    #[inline(always)]
    fn beyond_macrocells(&self, axis: usize, cell: &Directions<S>, distance: f32x16<S>) -> f32x16<S> {
        let macrocell = (cell[axis] * (1.0 / MACROCELL as f32)).floor();
        self.are_forward[axis].select(macrocell + distance, macrocell + 1.0 - distance) * MACROCELL as f32
    }

    /// Where planes between voxels are crossed; `never`, where there is no cell behind.
    #[inline(always)]
    fn crossing(&self, simd: S, frame: &Frame, axis: usize, plane: f32x16<S>, never: f32) -> f32x16<S> {
        let is_inside = plane.simd_gt(0.0) & plane.simd_le(last_cell(frame, axis));
        let place = (plane * frame.spacing[axis] - self.origin[axis]) * self.inverse[axis];
        is_inside.select(place, splat(simd, never))
    }

    /// Where cells are left through the planes across each axis.
    #[inline(always)]
    fn exits(&self, simd: S, frame: &Frame, cell: &Directions<S>) -> Directions<S> {
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        let mut exits = [zero; 3];
        for axis in 0..3 {
            let plane = cell[axis] + self.are_forward[axis].select(one, zero);
            exits[axis] = self.crossing(simd, frame, axis, plane, f32::INFINITY);
        }
        exits
    }

    /// The cells behind the nearest of cells' exits.
    #[inline(always)]
    fn next_cell(&self, simd: S, cell: &Directions<S>, exits: &Directions<S>) -> Directions<S> {
        // One at a time, so that cells can be counted.
        let is_x = exits[0].simd_le(exits[1]) & exits[0].simd_le(exits[2]);
        let is_y = !is_x & exits[1].simd_le(exits[2]);
        let are_next = [is_x, is_y, !is_x & !is_y];
        let mut next = *cell;
        for axis in 0..3 {
            next[axis] = are_next[axis].select(cell[axis] + self.one_cell(simd, axis), cell[axis]);
        }
        next
    }

    /// One cell on along an axis.
    #[inline(always)]
    fn one_cell(&self, simd: S, axis: usize) -> f32x16<S> {
        self.are_forward[axis].select(splat(simd, 1.0), splat(simd, -1.0))
    }

    /// The cells at places along the rays: those that are entered there where that is on a plane.
    #[inline(always)]
    fn cell(&self, simd: S, frame: &Frame, along: f32x16<S>) -> Directions<S> {
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        let per_spacing = frame.spacing.recip();
        let mut cell = [zero; 3];
        for axis in 0..3 {
            let index = (self.origin[axis] + along * self.direction[axis]) * per_spacing[axis];
            // Rounding can be off by a cell, but not by two.
            let guess = index.floor().max(zero).min(splat(simd, last_cell(frame, axis)));
            let is_forward = self.are_forward[axis];
            let exit = self.crossing(simd, frame, axis, guess + is_forward.select(one, zero), f32::INFINITY);
            let entry = self.crossing(simd, frame, axis, guess + is_forward.select(zero, one), f32::NEG_INFINITY);
            let step = self.one_cell(simd, axis);
            cell[axis] = guess + along.simd_ge(exit).select(step, zero) - along.simd_lt(entry).select(step, zero);
        }
        cell
    }

    /// How many cells lie between the entry and the exit.
    #[inline(always)]
    fn cells_between(&self, simd: S, frame: &Frame) -> f32x16<S> {
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        let last = self.cell(simd, frame, self.exit);
        let mut count = one;
        for axis in 0..3 {
            let plane = last[axis] + self.are_forward[axis].select(zero, one);
            let entry = self.crossing(simd, frame, axis, plane, f32::NEG_INFINITY);
            let is_left = entry.simd_ge(self.exit);
            count += (last[axis] - is_left.select(self.one_cell(simd, axis), zero) - self.cell[axis]).abs();
        }
        // A ray that misses has an exit before its entry.
        self.entry.simd_lt(self.exit).select(count, zero)
    }

    /// Where in cells places along the rays lie, 0 to 1 along each axis.
    #[inline(always)]
    fn fractions(&self, simd: S, sampler: &Sampler<'_>, cell: &Directions<S>, along: f32x16<S>) -> Directions<S> {
        let zero = splat(simd, 0.0);
        let mut fractions = [zero; 3];
        for axis in 0..3 {
            let index = (self.origin[axis] + along * self.direction[axis]) * sampler.inverse_spacing[axis];
            let farthest = splat(simd, (sampler.frame.dims[axis].min(2) - 1) as f32);
            fractions[axis] = (index - cell[axis]).max(zero).min(farthest);
        }
        fractions
    }
}

/// The farthest cell along an axis.
#[inline(always)]
fn last_cell(frame: &Frame, axis: usize) -> f32 {
    frame.dims[axis].saturating_sub(2) as f32
}

/// What rays see of the cells that they are in.
struct Seen<S: Simd> {
    are_sampled: mask32x16<S>,
    /// Those that leap over all macrocells closer than a distance.
    leap: mask32x16<S>,
    distance: f32x16<S>,
}

impl Space<'_> {
    /// Asks for the memory that samples at some of the places will be worked out from.
    #[inline(always)]
    fn ask_for<S: Simd>(&self, simd: S, are_sampled: mask32x16<S>, places: &Places<S>) {
        let mut places = *places;
        for axis in 0..3 {
            // Rays that have ended may be anywhere.
            places.cells[axis] = are_sampled.select(places.cells[axis], u32x16::splat(simd, 0));
        }
        let firsts = self.sampler.firsts(&places);
        match self.planes {
            Some(planes) => planes.ask_for_values(&firsts),
            None => gathers::ask_for(self.sampler.texels(), &firsts),
        }
    }

    /// What those rays see that run.
    #[inline(always)]
    fn look<S: Simd>(&self, simd: S, cell: &Directions<S>, run: mask32x16<S>) -> Seen<S> {
        let none = mask32x16::splat(simd, false);
        let Some(Skipping { occupancy, active }) = self.skipping else {
            return Seen { are_sampled: run, leap: none, distance: splat(simd, 0.0) };
        };
        let [nx, ny, _] = occupancy.dims();
        let zero = u32x16::splat(simd, 0);
        // Those that have ended may be anywhere.
        let [x, y, z] =
            [run.select(whole(cell[0]), zero), run.select(whole(cell[1]), zero), run.select(whole(cell[2]), zero)];
        let macrocells = ((z >> 2) * ny as u32 + (y >> 2)) * nx as u32 + (x >> 2);
        let mut distance = gathers::numbers(simd, occupancy.distances(), macrocells);
        let mut leap = run & distance.simd_gt(0);
        let mut are_sampled = run & !leap;
        if let Some(active) = active {
            let macrocells: [u32; LANES] = macrocells.into();
            let bits: [u32; LANES] = ((x & 3) | (y & 3) << 2 | (z & 3) << 4).into();
            let (mut left, mut lit, mut dark) = (are_sampled.to_bitmask(), 0_u64, 0_u64);
            while left != 0 {
                let lane = left.trailing_zeros() as usize;
                left &= left - 1;
                let mask = active.mask(simd, &self.sampler, macrocells[lane] as usize);
                dark |= u64::from(mask == 0) << lane;
                lit |= (mask >> bits[lane] & 1) << lane;
            }
            are_sampled = mask32x16::from_bitmask(simd, lit);
            let dark = mask32x16::from_bitmask(simd, dark);
            leap |= dark;
            distance = dark.select(u32x16::splat(simd, 1), distance);
        }
        Seen { are_sampled, leap, distance: distance.to_float() }
    }
}

/// Origins and directions of pixels' rays: as [`Frame::ray`].
#[inline(always)]
fn pixel_rays<S: Simd>(simd: S, frame: &Frame, pixels: &Pixels) -> [Directions<S>; 2] {
    let [width, height] = [frame.image_size[0] as f32, frame.image_size[1] as f32];
    let x = u32x16::from_slice(simd, &WITHIN[0]) + pixels.first[0];
    let y = u32x16::from_slice(simd, &WITHIN[1]) + pixels.first[1];
    let right = (x.to_float::<f32x16<S>>() + 0.5) / width * 2.0 - 1.0;
    let up = 1.0 - (y.to_float::<f32x16<S>>() + 0.5) / height * 2.0;
    let rays = &frame.rays;
    let (mut origin, mut direction) = ([right; 3], [right; 3]);
    for axis in 0..3 {
        origin[axis] = rays.origin[axis] + right * rays.origin_right[axis] + up * rays.origin_up[axis];
        direction[axis] = rays.direction[axis] + right * rays.direction_right[axis] + up * rays.direction_up[axis];
    }
    // Not times the inverse: to the same bits, or rays through an edge of cells count one more or less.
    let length = dot(&direction, &direction).sqrt();
    [origin, [direction[0] / length, direction[1] / length, direction[2] / length]]
}

/// As [`Frame::first_sample`].
#[inline(always)]
fn first_samples<S: Simd>(simd: S, frame: &Frame, pixels: &Pixels) -> f32x16<S> {
    if !frame.jitter {
        return splat(simd, 0.5);
    }
    let mut shares = [0.0; LANES];
    for lane in 0..LANES {
        shares[lane] = frame.first_sample(pixels.first[0] + WITHIN[0][lane], pixels.first[1] + WITHIN[1][lane]);
    }
    f32x16::from_slice(simd, &shares)
}
