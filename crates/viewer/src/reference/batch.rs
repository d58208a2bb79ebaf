//! Samples that wait to be worked out side by side.

// No iterators and closures in vector code: what std calls might be compiled without the level's instructions.
#![allow(clippy::needless_range_loop, reason = "see above")]

use fearless_simd::{Select, Simd, SimdBase, SimdMask, f32x16, mask32x16, u32x16};
use glam::Vec4;

use super::by_role;
use super::by_value::{self, ByValue, Stretches};
use super::corners::Places;
use super::gathers::columns;
use super::lanes::{LANES, power, splat, store_columns};
use super::sampling::{RoleSample, Sampler};
use super::shading::shade;

/// Samples of a tile's rays, those of each in the order in which it meets them.
#[derive(Default)]
pub(super) struct Batch {
    len: usize,
    /// Which ray each is on.
    rays: Vec<u32>,
    /// The lowest voxel of its cell, and where in that it lies.
    cells: [Vec<u32>; 3],
    fractions: [Vec<f32>; 3],
    /// Where along its ray it lies, what of the ray it stands for, and half of what opacity is integrated along.
    alongs: Vec<f32>,
    steps: Vec<f32>,
    half_steps: Vec<f32>,
    /// Colour as it is lit, and the opacity of the step.
    lights: Vec<[f32; 4]>,
    /// Colour as it is, and the opacity of a path of `L_min`; and normals.
    own: [Vec<[f32; 4]>; 2],
}

/// A tile's rays, by their numbers.
#[derive(Default)]
pub(super) struct Ways {
    pub(super) origins: Vec<[f32; 4]>,
    pub(super) directions: Vec<[f32; 4]>,
}

/// What is asked of a batch.
pub(super) struct Question<'a> {
    /// Where roles do not decide.
    pub(super) by_value: Option<ByValue<'a>>,
    /// Whether colours that no light falls on, and normals, are asked for.
    pub(super) keeps_own: bool,
}

impl Batch {
    pub(super) fn clear(&mut self) {
        self.len = 0;
    }

    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// The ray of a sample.
    #[inline(always)]
    pub(super) fn ray(&self, sample: usize) -> usize {
        self.rays[sample] as usize
    }

    /// Where along its ray a sample lies, and what of it that stands for.
    #[inline(always)]
    pub(super) fn step(&self, sample: usize) -> [f32; 2] {
        [self.alongs[sample], self.steps[sample]]
    }

    /// Lit colour and opacity of a sample's step, once that is worked out.
    #[inline(always)]
    pub(super) fn light(&self, sample: usize) -> Vec4 {
        Vec4::from_array(self.lights[sample])
    }

    /// What a sample is without light, where that is kept.
    pub(super) fn own(&self, sample: usize) -> RoleSample {
        let [color, normal] = [&self.own[0], &self.own[1]].map(|rows| Vec4::from_array(rows[sample]));
        RoleSample { opacity: color.w, color: color.truncate(), normal: normal.truncate() }
    }

    /// Adds samples of those of the rays from `first_ray` on which `are_added`.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "vectors, which stay in registers")]
    pub(super) fn push<S: Simd>(
        &mut self,
        simd: S,
        are_added: mask32x16<S>,
        first_ray: usize,
        places: &Places<S>,
        along: f32x16<S>,
        step: f32x16<S>,
        half_step: f32x16<S>,
    ) {
        const NUMBERS: [u32; LANES] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];
        let (first, end) = (self.len, self.len + LANES);
        if end > self.rays.len() {
            self.grow();
        }
        let rays = u32x16::from_slice(simd, &NUMBERS) + first_ray as u32;
        rays.compress(are_added).store_slice(&mut self.rays[first..end]);
        for axis in 0..3 {
            places.cells[axis].compress(are_added).store_slice(&mut self.cells[axis][first..end]);
            places.fractions[axis].compress(are_added).store_slice(&mut self.fractions[axis][first..end]);
        }
        along.compress(are_added).store_slice(&mut self.alongs[first..end]);
        step.compress(are_added).store_slice(&mut self.steps[first..end]);
        half_step.compress(are_added).store_slice(&mut self.half_steps[first..end]);
        self.len += are_added.to_bitmask().count_ones() as usize;
    }

    #[cold]
    fn grow(&mut self) {
        let room = (2 * self.rays.len()).max(1024);
        let [x, y, z] = &mut self.cells;
        for numbers in [&mut self.rays, x, y, z] {
            numbers.resize(room, 0);
        }
        let [x, y, z] = &mut self.fractions;
        for numbers in [x, y, z, &mut self.alongs, &mut self.steps, &mut self.half_steps] {
            numbers.resize(room, 0.0);
        }
        let [color, normal] = &mut self.own;
        for rows in [&mut self.lights, color, normal] {
            rows.resize(room, [0.0; 4]);
        }
    }

    /// Works all of them out.
    #[inline(never)]
    pub(super) fn work_out<S: Simd>(&mut self, simd: S, sampler: &Sampler<'_>, question: &Question<'_>, ways: &Ways) {
        simd.vectorize(
            #[inline(always)]
            || {
                // What is left of the last sixteen are zeros or samples of earlier batches: places in the volume all the same.
                for first in (0..self.len).step_by(LANES) {
                    self.work_out_sixteen(simd, sampler, question, ways, first);
                }
            },
        );
    }

    #[inline(always)]
    fn work_out_sixteen<S: Simd>(
        &mut self,
        simd: S,
        sampler: &Sampler<'_>,
        question: &Question<'_>,
        ways: &Ways,
        first: usize,
    ) {
        let Question { by_value, keeps_own } = question;
        let all = first..first + LANES;
        let places = Places {
            cells: [
                u32x16::from_slice(simd, &self.cells[0][all.clone()]),
                u32x16::from_slice(simd, &self.cells[1][all.clone()]),
                u32x16::from_slice(simd, &self.cells[2][all.clone()]),
            ],
            fractions: [
                f32x16::from_slice(simd, &self.fractions[0][all.clone()]),
                f32x16::from_slice(simd, &self.fractions[1][all.clone()]),
                f32x16::from_slice(simd, &self.fractions[2][all.clone()]),
            ],
        };
        let rays = u32x16::from_slice(simd, &self.rays[all.clone()]);
        let is_integrated = sampler.frame.half_step > 0.0;
        let half_steps = is_integrated.then_some(f32x16::from_slice(simd, &self.half_steps[all.clone()]));
        let [x, y, z, _] = columns(simd, &ways.directions, rays);
        let directions = [x, y, z];
        let found = match *by_value {
            None => by_role::sample(simd, sampler, &places, &directions, half_steps),
            Some(by_value) => {
                let [x, y, z, _] = columns(simd, &ways.origins, rays);
                let alongs = f32x16::from_slice(simd, &self.alongs[all.clone()]);
                let steps = Stretches { origins: [x, y, z], directions, alongs, half_steps };
                by_value::sample(simd, by_value, sampler, &places, &steps)
            }
        };
        let frame = sampler.frame;
        let steps = f32x16::from_slice(simd, &self.steps[all.clone()]);
        // As `correct_opacity`, without rounding where nothing changes.
        let is_whole = steps.simd_eq(1.0);
        let mut opacity = found.opacity;
        if !is_whole.all_true() {
            opacity = is_whole.select(opacity, 1.0 - power(simd, 1.0 - opacity, steps));
        }
        let [red, green, blue] = shade(simd, &frame.shading, frame.light, &directions, &found.color, &found.normal);
        store_columns(simd, [red, green, blue, opacity], &mut self.lights[all.clone()]);
        if *keeps_own {
            let ([red, green, blue], [x, y, z]) = (found.color, found.normal);
            store_columns(simd, [red, green, blue, found.opacity], &mut self.own[0][all.clone()]);
            store_columns(simd, [x, y, z, splat(simd, 0.0)], &mut self.own[1][all]);
        }
    }
}
