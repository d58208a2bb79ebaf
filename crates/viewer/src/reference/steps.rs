//! Samples of sixteen rays at equal distances: on rays, or where those meet slices.

use fearless_simd::{Select, Simd, SimdBase, SimdFloat, SimdMask, f32x16, mask32x16};

use super::lanes::{dot, splat, splat_vector};
use super::rays::Rays;
use crate::frame::Frame;
use crate::slicing::{NEAR, SLACK, Slicing};

/// Where they lie.
#[derive(Clone, Copy)]
pub(super) struct Steps<S: Simd> {
    /// Where the first step begins: at the entry, or with the first slice's slab.
    pub(super) start: f32x16<S>,
    pub(super) step: f32x16<S>,
    /// Where in its step a sample lies.
    share: f32x16<S>,
    /// Of slices how many follow the first one.
    last: Option<f32x16<S>>,
    /// How many steps end before something opaque, where any is.
    whole: Option<f32x16<S>>,
}

/// A sample of each ray.
pub(super) struct Samples<S: Simd> {
    pub(super) exist: mask32x16<S>,
    pub(super) along: f32x16<S>,
    pub(super) step: f32x16<S>,
    pub(super) half_step: f32x16<S>,
}

impl<S: Simd> Steps<S> {
    /// Nowhere.
    #[inline(always)]
    pub(super) fn none(simd: S) -> Self {
        let zero = splat(simd, 0.0);
        Self { start: zero, step: zero, share: zero, last: None, whole: None }
    }

    #[inline(always)]
    pub(super) fn new(simd: S, frame: &Frame, rays: &Rays<S>, share: f32x16<S>, opaque: f32x16<S>) -> Self {
        let step = splat(simd, frame.step);
        if let Some(slicing) = &frame.slicing {
            return Self::on_slices(simd, slicing, rays, rays.exit.min(opaque));
        }
        let is_cut_short = opaque.simd_lt(rays.exit);
        // Samples lie in the middles of steps, the first one so far into the ray's first step.
        let whole = ((opaque - rays.entry) / step - share + 0.5).floor().max(splat(simd, 0.0));
        let whole = is_cut_short.any_true().then_some(is_cut_short.select(whole, splat(simd, f32::INFINITY)));
        Self { start: rays.entry, step, share, last: None, whole }
    }

    #[inline(always)]
    fn on_slices(simd: S, slicing: &Slicing, rays: &Rays<S>, exit: f32x16<S>) -> Self {
        let growth = splat_vector(simd, slicing.growth);
        let along = dot(&growth, &rays.direction);
        // Counted in the ray's direction.
        let number = dot(&growth, &rays.origin) - slicing.offset;
        let (origin, per_length) = (number * splat(simd, 1.0).copysign(along), along.abs());
        let slack = (per_length * NEAR).min(splat(simd, SLACK));
        // A ray that starts within the volume sees no slice that its eye lies in.
        let within = splat(simd, -NEAR * slicing.growth.length());
        let before = rays.entry.simd_gt(0.0).select(slack, within);
        let first = (origin + rays.entry * per_length - 0.5 - before).ceil();
        let last = (origin + exit * per_length - 0.5 + slack).floor();
        let last = exit.simd_gt(rays.entry).select(last - first, splat(simd, -1.0));
        let step = 1.0 / per_length;
        Self { start: (first - origin) * step, step, share: splat(simd, 0.5), last: Some(last), whole: None }
    }

    /// How many there are.
    #[inline(always)]
    pub(super) fn count(&self, simd: S, rays: &Rays<S>) -> f32x16<S> {
        let zero = splat(simd, 0.0);
        if let Some(last) = self.last {
            return (last + 1.0).max(zero);
        }
        // A ray that misses has an exit before its entry.
        let count = ((rays.exit - rays.entry) / self.step + (1.0 - self.share)).max(zero).floor();
        let Some(whole) = self.whole else { return count };
        let rest = rays.exit - self.cut_short(rays, whole);
        whole.simd_lt(f32::INFINITY).select(whole + rest.simd_gt(0.0).select(zero + 1.0, zero), count)
    }

    /// Where the step begins that ends at something opaque, behind `whole` others.
    #[inline(always)]
    fn cut_short(&self, rays: &Rays<S>, whole: f32x16<S>) -> f32x16<S> {
        rays.entry.max(rays.entry + (whole + self.share - 0.5) * self.step)
    }

    /// The samples with numbers, counted from 0.
    #[inline(always)]
    pub(super) fn at(&self, simd: S, frame: &Frame, rays: &Rays<S>, count: f32x16<S>) -> Samples<S> {
        let half_step = splat(simd, frame.half_step);
        if let Some(last) = self.last {
            let begin = count.simd_eq(0.0).select(rays.entry, self.start + count * self.step);
            let end = count.simd_eq(last).select(rays.exit, self.start + (count + 1.0) * self.step);
            let step = end - begin;
            let along = (begin + end) * 0.5;
            return Samples { exist: count.simd_le(last), along, step, half_step: half_step.min(step * 0.5) };
        }
        let along = self.start + (count + self.share) * self.step;
        let samples = Samples { exist: along.simd_lt(rays.exit), along, step: self.step, half_step };
        let Some(whole) = self.whole else { return samples };
        let begin = self.cut_short(rays, whole);
        let rest = rays.exit - begin;
        let is_whole = count.simd_lt(whole);
        Samples {
            exist: (is_whole & samples.exist) | (count.simd_eq(whole) & rest.simd_gt(0.0)),
            along: is_whole.select(along, begin + rest * 0.5),
            step: is_whole.select(self.step, rest),
            half_step: is_whole.select(half_step, half_step.min(rest * 0.5)),
        }
    }
}
