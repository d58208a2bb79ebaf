//! The role of every voxel of a volume.

use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use voxrole_pack::error::with_capacity;
use voxrole_pack::quantization::{NO_NORMAL, encode_normal};

use crate::Result;
use crate::boundary::{Bracketed, Brackets, LANES, Role, Traced, Tracer, Work};
use crate::progress::Progress;
use crate::region::Region;
use crate::simd;

/// Roles of the voxels of a region, x fastest, in working units.
#[derive(Clone, Debug, Default)]
pub struct Roles {
    /// Signed distance in multiples of L_min; NaN without a boundary, infinite for masked voxels.
    pub distance: Vec<f32>,
    /// Gradient magnitude at the hit; NaN without one.
    pub hit_gradient: Vec<f32>,
    /// Value at the hit; NaN without one.
    pub hit_value: Vec<f32>,
    /// Octahedral n, [`NO_NORMAL`] without a boundary.
    pub normal: Vec<u16>,
    /// What there was to do.
    pub work: Work,
    /// Voxels with a boundary.
    pub hits: u64,
    /// Those whose boundary has less than [`FAINT`] times the gradient that one must have at least.
    pub faint: u64,
    /// Voxels with a NaN or infinite sample in their stencil.
    pub masked: u64,
}

/// Boundaries are faint with gradients up to this multiple of what they must have at least.
pub const FAINT: f32 = 2.0;

/// Marks a masked voxel in [`Roles::distance`].
pub const MASKED: f32 = f32::INFINITY;

impl Roles {
    /// Traces every voxel of a region of the tracer's fields, one slice at a time on every thread.
    ///
    /// # Errors
    /// [`crate::Error::Pack`] when memory runs out.
    pub fn new(tracer: &Tracer<'_>, region: Region, progress: &dyn Progress) -> Result<Self> {
        Self::new_in(Self::default(), tracer, region, progress)
    }

    /// The same in the memory of roles that are needed no longer.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn new_in(memory: Self, tracer: &Tracer<'_>, region: Region, progress: &dyn Progress) -> Result<Self> {
        let [nx, ny, _] = region.dims();
        let count = region.voxel_count();
        let mut roles = Self {
            distance: filled(memory.distance, count, f32::NAN)?,
            hit_gradient: filled(memory.hit_gradient, count, f32::NAN)?,
            hit_value: filled(memory.hit_value, count, f32::NAN)?,
            normal: filled(memory.normal, count, NO_NORMAL)?,
            ..Self::default()
        };
        let slice = nx * ny;
        let totals = roles
            .distance
            .par_chunks_mut(slice)
            .zip(roles.hit_gradient.par_chunks_mut(slice))
            .zip(roles.hit_value.par_chunks_mut(slice))
            .zip(roles.normal.par_chunks_mut(slice))
            .enumerate()
            .map(|(k, (((distance, hit_gradient), hit_value), normal))| {
                let mut slice = Slice { distance, hit_gradient, hit_value, normal };
                let totals = dispatch!(simd::level(), simd => trace_slice(simd, tracer, &region, k, &mut slice));
                progress.step();
                totals
            })
            .reduce(Totals::default, Totals::plus);
        (roles.work, roles.masked) = (totals.work, totals.masked);
        (roles.hits, roles.faint) = (totals.hits, totals.faint);
        Ok(roles)
    }

    /// Voxels without a boundary that are not masked.
    #[must_use]
    pub fn misses(&self) -> u64 {
        self.distance.len() as u64 - self.hits - self.masked
    }
}

/// A vector of one value, written on every thread: memory is slow when it is written first.
fn filled<T: Copy + Send + Sync>(memory: Vec<T>, count: usize, value: T) -> Result<Vec<T>> {
    let mut values = with_capacity(memory, count, "the voxel roles")?;
    rayon::iter::repeat_n(value, count).collect_into_vec(&mut values);
    Ok(values)
}

/// Voxels of a row that are looked at together.
const RUN: usize = 32;

/// One slice of every layer.
struct Slice<'a> {
    distance: &'a mut [f32],
    hit_gradient: &'a mut [f32],
    hit_value: &'a mut [f32],
    normal: &'a mut [u16],
}

/// Traces the voxels of slice `k` of a region.
#[inline(always)]
fn trace_slice<S: Simd>(simd: S, tracer: &Tracer<'_>, region: &Region, k: usize, slice: &mut Slice<'_>) -> Totals {
    let mut totals = Totals::default();
    let (width, [x, y, z]) = (region.dims()[0], region.start);
    let mut voxel = 0;
    let mut flat_before = 0;
    let (mut brackets, mut waiting) = (Brackets::default(), Vec::with_capacity(LANES));
    while voxel < slice.distance.len() {
        // Where there is nothing, whole runs are passed over at once.
        if voxel >= flat_before {
            let run = (width - voxel % width).min(RUN);
            flat_before = voxel + run;
            if tracer.is_flat([x + voxel % width, y + voxel / width, z + k], run) {
                totals.work.flat += run as u64;
                voxel += run;
                continue;
            }
        }
        match tracer.trace([x + voxel % width, y + voxel / width, z + k], &mut totals.work) {
            Traced::Role(role) => slice.set(tracer, voxel, role, &mut totals),
            Traced::Bracketed(bracketed) => {
                brackets.set(waiting.len(), &bracketed.bracket);
                waiting.push((voxel, bracketed));
                if waiting.len() == LANES {
                    slice.set_all(simd, tracer, &brackets, &mut waiting, &mut totals);
                }
            }
        }
        voxel += 1;
    }
    slice.set_all(simd, tracer, &brackets, &mut waiting, &mut totals);
    totals
}

impl Slice<'_> {
    #[inline(always)]
    fn set(&mut self, tracer: &Tracer<'_>, voxel: usize, role: Role, totals: &mut Totals) {
        match role {
            Role::Masked => {
                self.distance[voxel] = MASKED;
                totals.masked += 1;
            }
            Role::Miss => {}
            Role::Hit(hit) => {
                self.distance[voxel] = hit.distance;
                self.hit_gradient[voxel] = hit.gradient_magnitude;
                self.hit_value[voxel] = hit.value;
                self.normal[voxel] = encode_normal(hit.normal);
                totals.hits += 1;
                totals.faint += u64::from(hit.gradient_magnitude < FAINT * tracer.least_gradient(hit.value));
            }
        }
    }

    /// Pins down the boundaries of the voxels that wait for it.
    #[inline(always)]
    fn set_all<S: Simd>(
        &mut self,
        simd: S,
        tracer: &Tracer<'_>,
        brackets: &Brackets,
        waiting: &mut Vec<(usize, Bracketed)>,
        totals: &mut Totals,
    ) {
        for ((voxel, bracketed), t) in waiting.drain(..).zip(brackets.bisect(simd)) {
            let role = tracer.role_at(&bracketed, t, &mut totals.work);
            self.set(tracer, voxel, role, totals);
        }
    }
}

#[derive(Clone, Copy, Default)]
struct Totals {
    work: Work,
    hits: u64,
    faint: u64,
    masked: u64,
}

impl Totals {
    fn plus(mut self, other: Self) -> Self {
        self.work += other.work;
        self.hits += other.hits;
        self.faint += other.faint;
        self.masked += other.masked;
        self
    }
}
