//! Samples that wait to be worked out side by side.

// No iterators and closures in vector code: what std calls might be compiled without the level's instructions.
#![allow(clippy::needless_range_loop, reason = "see above")]

use fearless_simd::{Select, Simd, SimdBase, SimdFloat, SimdMask, f32x16, mask32x16, u32x16};
use glam::{Vec3, Vec4};

use super::by_role;
use super::by_value::{self, ByValue, Stretches};
use super::corners::Places;
use super::gathers::columns;
use super::lanes::{Directions, LANES, power, splat, store_columns};
use super::planes::Planes;
use super::sampling::Sampler;
use super::shading::shade;
use crate::classify::ValueTable;

/// Samples of a tile's rays, those of each in the order in which it meets them.
pub(super) struct Batch {
    len: usize,
    columns: Columns,
    /// Colour as it is lit, times the opacity of the step, and that.
    lights: Vec<[f32; 4]>,
    /// Colour as it is, and normals.
    own: [Vec<[f32; 4]>; 2],
}

/// Which ray a sample is on.
const RAY: usize = 0;
/// The lowest voxel of its cell, and where in that it lies: three columns each.
const CELL: usize = 1;
const FRACTION: usize = 4;
/// Where along its ray it lies, what of the ray it stands for, and half of what opacity is integrated along.
const ALONG: usize = 7;
const STEP: usize = 8;
const HALF_STEP: usize = 9;
/// By value, the values at both ends of that: two columns.
const END: usize = 10;
const COLUMNS: usize = 12;
/// Samples that there is room for at first, a power of two.
const FIRST_ROOM: usize = 4096;

/// What there is to know of samples: numbers, or whole numbers as such, in columns.
struct Columns {
    numbers: Vec<u32>,
    /// Samples that there is room for, a power of two.
    room: usize,
}

/// So many numbers lie between a column's room and the next column, so that what is known of a sample does not lie at addresses
/// which share a few lines of the caches: pictures by value take 1.07 times as long without.
const APART: usize = 5 * LANES;

impl Columns {
    fn new(room: usize) -> Self {
        Self { numbers: vec![0; COLUMNS * (room + APART)], room }
    }

    /// Doubles the room.
    fn grow(&mut self) {
        let mut grown = Self::new(2 * self.room);
        for column in 0..COLUMNS {
            let first = grown.first(column);
            grown.numbers[first..first + self.room].copy_from_slice(self.column(column, self.room));
        }
        *self = grown;
    }

    /// Where a column begins.
    #[inline(always)]
    fn first(&self, column: usize) -> usize {
        column * (self.room + APART)
    }

    /// So many of a column.
    #[inline(always)]
    fn column(&self, column: usize, len: usize) -> &[u32] {
        &self.numbers[self.first(column)..][..len]
    }

    /// Sixteen whole numbers of a column.
    #[inline(always)]
    fn whole<S: Simd>(&self, simd: S, column: usize, first: usize) -> u32x16<S> {
        let first = self.first(column) + first;
        u32x16::from_slice(simd, &self.numbers[first..first + LANES])
    }

    /// Sixteen numbers.
    #[inline(always)]
    fn numbers<S: Simd>(&self, simd: S, column: usize, first: usize) -> f32x16<S> {
        f32x16::from_bits(self.whole(simd, column, first))
    }

    /// Writes those of sixteen whole numbers that are in `lanes`, without gaps.
    #[inline(always)]
    fn write_whole<S: Simd>(&mut self, column: usize, first: usize, numbers: u32x16<S>, lanes: mask32x16<S>) {
        let first = self.first(column) + first;
        numbers.compress(lanes).store_slice(&mut self.numbers[first..first + LANES]);
    }

    /// The same of numbers.
    #[inline(always)]
    fn write<S: Simd>(&mut self, column: usize, first: usize, numbers: f32x16<S>, lanes: mask32x16<S>) {
        self.write_whole(column, first, numbers.to_bits(), lanes);
    }
}

/// The numbers of lanes.
const NUMBERS: [u32; LANES] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// A tile's rays, by their numbers.
#[derive(Default)]
pub(super) struct Ways {
    pub(super) origins: Vec<[f32; 4]>,
    pub(super) directions: Vec<[f32; 4]>,
}

impl Ways {
    /// Directions of rays.
    #[inline(always)]
    fn directions<S: Simd>(&self, simd: S, rays: u32x16<S>) -> Directions<S> {
        let [x, y, z, _] = columns(simd, &self.directions, rays);
        [x, y, z]
    }

    /// Directions and origins.
    #[inline(always)]
    fn of<S: Simd>(&self, simd: S, rays: u32x16<S>) -> [Directions<S>; 2] {
        let [x, y, z, _] = columns(simd, &self.origins, rays);
        [self.directions(simd, rays), [x, y, z]]
    }
}

/// What is asked of a batch.
pub(super) struct Question<'a> {
    /// Where roles do not decide.
    pub(super) by_value: Option<ByValue<'a>>,
    /// Whether colours that no light falls on, and normals, are asked for.
    pub(super) keeps_own: bool,
}

impl Batch {
    /// None.
    pub(super) fn new() -> Self {
        let rows = || vec![[0.0; 4]; FIRST_ROOM];
        Self { len: 0, columns: Columns::new(FIRST_ROOM), lights: rows(), own: [rows(), rows()] }
    }

    pub(super) fn clear(&mut self) {
        self.len = 0;
    }

    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// For how many there is memory.
    #[cfg(test)]
    pub(super) fn room(&self) -> usize {
        self.columns.room
    }

    /// Of every sample, once they are worked out, its ray, where along that it lies, and colour as it is lit, times the opacity of
    /// its step, and that.
    #[inline(always)]
    pub(super) fn lights(&self) -> impl Iterator<Item = (usize, f32, Vec4)> {
        let (rays, alongs) = (self.columns.column(RAY, self.len), self.columns.column(ALONG, self.len));
        let samples = rays.iter().zip(alongs).zip(&self.lights[..self.len]);
        samples.map(|((&ray, &along), &light)| (ray as usize, f32::from_bits(along), Vec4::from_array(light)))
    }

    /// What of its ray a sample stands for, and its colour without light and normal, where those are kept.
    pub(super) fn own(&self, sample: usize) -> (f32, [Vec3; 2]) {
        let step = f32::from_bits(self.columns.column(STEP, self.len)[sample]);
        (step, [&self.own[0], &self.own[1]].map(|rows| Vec4::from_array(rows[sample]).truncate()))
    }

    /// Adds samples of those of the rays from `first_ray` on which `are_added`.
    #[inline(always)]
    pub(super) fn push<S: Simd>(
        &mut self,
        simd: S,
        are_added: mask32x16<S>,
        first_ray: usize,
        places: &Places<S>,
        [along, step, half_step]: [f32x16<S>; 3],
    ) {
        if self.len + LANES > self.columns.room {
            self.grow();
        }
        let rays = u32x16::from_slice(simd, &NUMBERS) + first_ray as u32;
        self.columns.write_whole(RAY, self.len, rays, are_added);
        for axis in 0..3 {
            self.columns.write_whole(CELL + axis, self.len, places.cells[axis], are_added);
            self.columns.write(FRACTION + axis, self.len, places.fractions[axis], are_added);
        }
        self.columns.write(ALONG, self.len, along, are_added);
        self.columns.write(STEP, self.len, step, are_added);
        self.columns.write(HALF_STEP, self.len, half_step, are_added);
        self.len += are_added.to_bitmask().count_ones() as usize;
    }

    #[cold]
    fn grow(&mut self) {
        self.columns.grow();
        let [color, normal] = &mut self.own;
        for rows in [&mut self.lights, color, normal] {
            rows.resize(self.columns.room, [0.0; 4]);
        }
    }

    /// Works all of them out, and leaves those that show something.
    #[inline(never)]
    pub(super) fn work_out<S: Simd>(&mut self, simd: S, sampler: &Sampler<'_>, question: &Question<'_>, ways: &Ways) {
        simd.vectorize(
            #[inline(always)]
            || {
                if let Some(ByValue::Curve(table, planes)) = question.by_value {
                    self.sift(simd, sampler, table, planes, ways);
                }
                let mut kept = 0;
                for first in (0..self.len).step_by(LANES) {
                    kept += self.work_out_sixteen(simd, sampler, question, ways, first, kept);
                }
                self.len = kept;
            },
        );
    }

    /// Finds values, and leaves the samples that may show something.
    #[inline(always)]
    fn sift<S: Simd>(&mut self, simd: S, sampler: &Sampler<'_>, table: &ValueTable, planes: &Planes, ways: &Ways) {
        let mut kept = 0;
        for first in (0..self.len).step_by(LANES) {
            let places = self.places(simd, first);
            let firsts = sampler.firsts(&places);
            let rays = self.columns.whole(simd, RAY, first);
            let alongs = self.columns.numbers(simd, ALONG, first);
            let ends = if sampler.frame.half_step > 0.0 {
                let [directions, origins] = ways.of(simd, rays);
                let half_steps = self.columns.numbers(simd, HALF_STEP, first);
                by_value::ends(simd, planes, sampler, &Stretches { origins, directions, alongs, half_steps })
            } else {
                [planes.value(simd, sampler, &firsts, places.fractions); 2]
            };
            let lit = self.are_there(simd, first) & by_value::can_show(simd, table, ends);
            if lit.any_true() {
                planes.ask_for_normals(&firsts);
            }
            let steps = self.columns.numbers(simd, STEP, first);
            // Nothing that is still to be read is written over.
            self.columns.write_whole(RAY, kept, rays, lit);
            for axis in 0..3 {
                self.columns.write_whole(CELL + axis, kept, places.cells[axis], lit);
                self.columns.write(FRACTION + axis, kept, places.fractions[axis], lit);
            }
            self.columns.write(ALONG, kept, alongs, lit);
            self.columns.write(STEP, kept, steps, lit);
            for end in 0..2 {
                self.columns.write(END + end, kept, ends[end], lit);
            }
            kept += lit.to_bitmask().count_ones() as usize;
        }
        self.len = kept;
    }

    /// Works out those from `first`, and writes what shows something from `kept` on, which is not behind them; how many those
    /// are.
    #[inline(always)]
    fn work_out_sixteen<S: Simd>(
        &mut self,
        simd: S,
        sampler: &Sampler<'_>,
        question: &Question<'_>,
        ways: &Ways,
        first: usize,
        kept: usize,
    ) -> usize {
        let frame = sampler.frame;
        let places = self.places(simd, first);
        let rays = self.columns.whole(simd, RAY, first);
        let directions = ways.directions(simd, rays);
        let found = match question.by_value {
            None => {
                let half_steps = self.columns.numbers(simd, HALF_STEP, first);
                let half_steps = (frame.half_step > 0.0).then_some(half_steps);
                by_role::sample(simd, sampler, &places, &directions, half_steps)
            }
            Some(ByValue::Curve(table, planes)) => {
                let ends = [self.columns.numbers(simd, END, first), self.columns.numbers(simd, END + 1, first)];
                by_value::sample(simd, table, planes, sampler, &places, ends)
            }
            Some(ByValue::Stored) => by_value::stored(simd, sampler, &places),
        };
        let lit = self.are_there(simd, first) & found.opacity.simd_gt(0.0);
        let (steps, alongs) = (self.columns.numbers(simd, STEP, first), self.columns.numbers(simd, ALONG, first));
        // As `correct_opacity`, without rounding where nothing changes.
        let is_whole = steps.simd_eq(1.0);
        let mut opacity = found.opacity;
        if !is_whole.all_true() {
            opacity = is_whole.select(opacity, 1.0 - power(simd, 1.0 - opacity, steps));
        }
        let color = shade(simd, &frame.shading, frame.light, &directions, &found.color, &found.normal);
        let light = [color[0] * opacity, color[1] * opacity, color[2] * opacity, opacity];
        self.columns.write_whole(RAY, kept, rays, lit);
        self.columns.write(ALONG, kept, alongs, lit);
        let rows = kept..kept + LANES;
        store_columns(simd, compressed(light, lit), &mut self.lights[rows.clone()]);
        if question.keeps_own {
            let ([red, green, blue], [x, y, z], zero) = (found.color, found.normal, splat(simd, 0.0));
            self.columns.write(STEP, kept, steps, lit);
            store_columns(simd, compressed([red, green, blue, zero], lit), &mut self.own[0][rows.clone()]);
            store_columns(simd, compressed([x, y, z, zero], lit), &mut self.own[1][rows]);
        }
        lit.to_bitmask().count_ones() as usize
    }

    /// Where those from `first` lie. What is left of the last sixteen are zeros or other samples, of before: places in the volume
    /// all the same.
    #[inline(always)]
    fn places<S: Simd>(&self, simd: S, first: usize) -> Places<S> {
        let columns = &self.columns;
        Places {
            cells: [
                columns.whole(simd, CELL, first),
                columns.whole(simd, CELL + 1, first),
                columns.whole(simd, CELL + 2, first),
            ],
            fractions: [
                columns.numbers(simd, FRACTION, first),
                columns.numbers(simd, FRACTION + 1, first),
                columns.numbers(simd, FRACTION + 2, first),
            ],
        }
    }

    /// Which of the sixteen from `first` there are.
    #[inline(always)]
    fn are_there<S: Simd>(&self, simd: S, first: usize) -> mask32x16<S> {
        u32x16::from_slice(simd, &NUMBERS).simd_lt((self.len - first) as u32)
    }
}

/// The lanes of a mask, the others left out.
#[inline(always)]
fn compressed<S: Simd>(columns: [f32x16<S>; 4], lanes: mask32x16<S>) -> [f32x16<S>; 4] {
    let mut left = columns;
    for column in 0..4 {
        left[column] = columns[column].compress(lanes);
    }
    left
}
