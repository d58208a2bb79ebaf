//! Rays sample by sample, past those that cannot matter.

use glam::Vec3;

use super::{Crossing, Probe, Rise, SignedRay, Tracer, Work};
use crate::root_finder::bisect;
use crate::sampler::Ray;

impl Tracer<'_> {
    /// The first sample at which g rises or falls, for a ray that starts where it does neither.
    pub(super) fn leave_plateau(&self, signed: SignedRay, work: &mut Work) -> Option<(u32, Rise)> {
        let slowness = signed.ray.slowness();
        let mut k = 1;
        // Whether the sample before lies in a cell that is known to have f'' = 0 throughout.
        let mut level_cell = true;
        while k <= self.last_step {
            let place = self.sampler.place(&signed.ray, self.t(k))?;
            let distance = self.distance_to_mixed(place.cell);
            if distance > 0 && level_cell {
                k = self.beyond(&signed.ray, slowness, place.cell, distance, k);
                continue;
            }
            level_cell = distance > 0;
            work.samples += 1;
            let q = signed.sign * self.sampler.trilinear(self.second_derivative, &place);
            if q.is_nan() {
                return None;
            }
            if q > 0.0 {
                return Some((k, Rise::Rises));
            }
            if q < 0.0 {
                let mut probe = Probe { tracer: self, signed, cell: None, known: true, work };
                let end = bisect(self.t(k - 1), self.t(k), |t| probe.rise(t) >= 0.0);
                return Some((k, Rise::Falls(end)));
            }
            k += 1;
        }
        None
    }

    /// Where q falls from positive to negative first, for a ray on which it is positive at sample `start`: `rise` at least.
    #[inline(always)]
    pub(super) fn climb_from(&self, signed: SignedRay, start: u32, rise: f32, work: &mut Work) -> Crossing {
        let slowness = signed.ray.slowness();
        // Of the mixed cell at hand.
        let (mut cell, mut fall) = ([usize::MAX; 3], [0.0; 2]);
        let mut k = start + 1;
        // Whether the sample before lies in a cell that is known to have q > 0 throughout. The voxel itself is a corner
        // of the first sample's cell.
        let mut rising_cell = start == 0;
        while k <= self.last_step {
            let Some(place) = self.sampler.place(&signed.ray, self.t(k)) else { return Crossing::Nowhere };
            let distance = self.distance_to_mixed(place.cell);
            if distance > 0 && rising_cell {
                k = self.beyond(&signed.ray, slowness, place.cell, distance, k);
                continue;
            }
            rising_cell = distance > 0;
            let corners = self.sampler.corners(self.second_derivative, place.cell);
            let is_mixed = distance == 0 && self.cells.is_some();
            if is_mixed && cell != place.cell {
                (cell, fall) = (place.cell, corners.steepest_fall(signed.sign * signed.ray.direction()));
                // The voxel is a corner of the first sample's cell, and that sample perhaps known by it.
                if k == 1 {
                    k = self.behind_rise(&signed.ray, slowness, cell, fall, [0.0, rise]);
                    if k > 1 {
                        continue;
                    }
                }
            }
            work.samples += 1;
            let q = signed.sign * corners.interpolate(place.fraction);
            if q < 0.0 {
                return self.refine(signed, start, k, work);
            }
            if q.is_nan() {
                return Crossing::Nowhere;
            }
            let behind = if is_mixed { self.behind_rise(&signed.ray, slowness, cell, fall, [self.t(k), q]) } else { 0 };
            k = behind.max(k + 1);
        }
        Crossing::Nowhere
    }

    /// The first sample that may not be positive, as far as is known by how steeply f'' falls in the cell that a ray is in; at
    /// parameter `t` it is `q`.
    #[inline(always)]
    fn behind_rise(
        &self,
        ray: &Ray,
        slowness: Vec3,
        cell: [usize; 3],
        [steepest, margin]: [f32; 2],
        [t, q]: [f32; 2],
    ) -> u32 {
        let length = (q - margin) / steepest;
        // Not where a corner is NaN.
        let end = if length > 0.0 { ray.leaves(slowness, cell, 1).min(t + length) } else { t };
        ((end * self.safe_steps_per_length) as u32).saturating_add(1)
    }

    /// How many cells away the nearest one is in which f'' may change its sign; 0 where nothing is leapt over.
    #[inline(always)]
    fn distance_to_mixed(&self, [i, j, k]: [usize; 3]) -> u8 {
        self.cells.map_or(0, |cells| cells.cells[(k * cells.dims[1] + j) * cells.dims[0] + i])
    }

    /// The first sample behind sample `k` that lies beyond all cells closer to `cell` than `distance`: those have its sign.
    #[inline(always)]
    fn beyond(&self, ray: &Ray, slowness: Vec3, cell: [usize; 3], distance: u8, k: u32) -> u32 {
        k.max((ray.leaves(slowness, cell, distance) * self.safe_steps_per_length) as u32).saturating_add(1)
    }
}
