//! The bilateral filter over a cut neighbourhood.
//!
//! A volume is cut into boxes, which are copied with their surroundings (`padded_box`), so that no inner loop knows a
//! border, and filtered in whichever way takes less time:
//!
//! - neighbour by neighbour (`row`), with fast weights at 16 floating-point operations for each: 1,984 for each voxel with
//!   radius 2, 5,472 with radius 3;
//! - with fast weights, where values differ by some σr only, by moments (`moments`): with radius 3, some 60 operations for
//!   each of 3 to 25 terms;
//! - a box whose values are all the same is left as it is.
//!
//! Boxes stay in the processor's caches: main memory is read and written once. Which way is taken depends on the values in a
//! box and around it alone.

mod convolution;
mod expansion;
mod moments;
mod neighbourhood;
mod padded_box;
mod range_weight;
mod row;
#[cfg(test)]
mod tests;

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use ndarray::Array3;
use rayon::prelude::*;

use self::expansion::Expansion;
use self::moments::{Moments, RangeExpansion};
use self::neighbourhood::{is_later, neighbourhood, shift, spatial_weight};
use self::padded_box::{LANES, MISSING, PaddedBox};
use self::range_weight::{LARGEST_DEVIATION, TRUNCATION, deviation_bound};
use self::row::{ExactNeighbours, FastNeighbours, filter_row_exact, filter_row_fast};
use crate::working_field::{Field, dims_of, voxels_mut};

pub use self::range_weight::RangeWeights;

/// Voxels along x, y, z of the boxes that a volume is cut into, the first one at its first voxel: with their surroundings
/// they fit the processor's second-level cache.
const BOX: [usize; 3] = [32, 16, 8];

/// How far along x, y, z, in voxels, the field matters to a result: as far as the surroundings of the voxel's box go.
#[must_use]
pub fn reach(radius: usize) -> [usize; 3] {
    BOX.map(|len| radius + len - 1)
}

/// Width and reach of a bilateral filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BilateralSettings {
    /// σd in multiples of L_min; positive.
    pub spatial_sigma: f32,
    /// σr in the field's own units; counts as 1e-30 below that, and as 1e12 above.
    pub range_sigma: f32,
    /// Neighbours on each side along each axis, in voxels.
    pub radius: usize,
    /// How range weights are computed.
    pub weights: RangeWeights,
}

/// The bilateral filter for fields of one size, eqs. (3)–(5) of the paper (Tomasi and Manduchi, ICCV 1998):
/// `h(x) = Σ Wd·Wr·h(y) / Σ Wd·Wr` with `Wd = exp(−‖x−y‖²/2σd²)` and `Wr = exp(−(h(x)−h(y))²/2σr²)`.
///
/// Spacing is in multiples of L_min, so Wd is right on anisotropic grids. Neighbours outside the volume and neighbours that
/// are NaN or infinite have no weight; such voxels become NaN. Values' magnitudes may be up to 1e6.
///
/// Exact weights that matter are right to 1e-6. With fast ones a result is off by at most `6.5e-5 + 1e-6·Σ Wd` of the range
/// of the values around it ([`Self::deviation_bound`]): 0.008 % for σd = 1. Where that would be more than 0.1 % (σd of 3.9
/// voxels and more), exact weights are used. Results are the same bits for any number of threads and any processor, and
/// wherever a part of a volume is cut out of it: see [`Self::filter`].
#[derive(Clone, Debug)]
pub struct Bilateral {
    dims: [usize; 3],
    /// The radius, as far as fields go.
    reach: [usize; 3],
    /// A power of two, so that no digit changes, which brings σr to between 1 and 2.
    scale: f32,
    /// σr in units of the scaled field.
    range_sigma: f32,
    /// Spatial weights along each axis, from the voxel itself to the farthest neighbour on either side.
    spatial: [Vec<f32>; 3],
    /// The sum of the spatial weights of all neighbours and the voxel itself.
    total: f64,
    /// With fast weights one of each two opposite neighbours, the later one; with exact ones all, and the voxel itself.
    offsets: Vec<[isize; 3]>,
    weights: Weights,
}

/// A field that was filtered.
#[derive(Clone, Debug)]
pub struct Filtered {
    /// The field.
    pub values: Field,
    /// The share of boxes that were not left as they were for want of two different values.
    pub boxes_filtered: f64,
}

#[derive(Clone, Debug)]
enum Weights {
    Fast(FastNeighbours),
    Exact(ExactNeighbours),
}

/// How a box is filtered.
enum Way {
    Flat,
    Moments(RangeExpansion),
    Neighbours,
}

/// Memory that filtering boxes needs, kept from box to box: at most 2 MB for small radii.
#[derive(Debug, Default)]
struct Scratch {
    window: PaddedBox,
    moments: Moments,
    /// From a sample of the window to the one at each offset.
    shifts: Vec<isize>,
    row: Vec<f32>,
}

impl Bilateral {
    /// A filter for fields of `dims` voxels along x, y, z.
    #[must_use]
    pub fn new(dims: [usize; 3], spacing: [f32; 3], settings: BilateralSettings) -> Self {
        let reach = dims.map(|dim| settings.radius.min(dim - 1));
        let exponent = |axis: usize, steps: usize| {
            0.5 * (steps as f64 * f64::from(spacing[axis]) / f64::from(settings.spatial_sigma)).powi(2)
        };
        let exponent_at = |offset: &[isize; 3]| (0..3).map(|axis| exponent(axis, offset[axis].unsigned_abs())).sum();
        let spatial = [0, 1, 2].map(|axis| (0..=reach[axis]).map(|steps| libm::exp(-exponent(axis, steps))).collect());
        let total = spatial.iter().map(|weights: &Vec<f64>| 2.0 * weights.iter().sum::<f64>() - 1.0).product();

        let range_sigma = settings.range_sigma.clamp(1e-30, 1e12);
        // The power of two below σr is σr without its digits.
        let scale = 1.0 / f32::from_bits(range_sigma.to_bits() & 0x7f80_0000);
        let range_sigma = range_sigma * scale;
        let mut offsets = neighbourhood(reach);
        let weights = if settings.weights == RangeWeights::Fast && deviation_bound(total) <= LARGEST_DEVIATION {
            // Farther away f32 holds no weight.
            offsets.retain(|offset| is_later(offset) && exponent_at(offset) < 87.0);
            let falloff = 0.5 / f64::from(range_sigma).powi(2);
            Weights::Fast(FastNeighbours::new(offsets.iter().map(exponent_at), falloff))
        } else {
            let spatial =
                offsets.iter().map(|offset| spatial_weight(offset, spacing, settings.spatial_sigma)).collect();
            Weights::Exact(ExactNeighbours { spatial, falloff: 0.5 / (range_sigma * range_sigma) })
        };
        let spatial = spatial.map(|weights| weights.into_iter().map(|weight| weight as f32).collect());
        Self { dims, reach, scale, range_sigma, spatial, total, offsets, weights }
    }

    /// How range weights are computed indeed.
    #[must_use]
    pub fn range_weights(&self) -> RangeWeights {
        match self.weights {
            Weights::Fast(..) => RangeWeights::Fast,
            Weights::Exact(..) => RangeWeights::Exact,
        }
    }

    /// How far results are from those of exact weights at most, as a share of the field's range; rounding comes on top.
    #[must_use]
    pub fn deviation_bound(&self) -> f64 {
        match self.weights {
            Weights::Fast(..) => deviation_bound(self.total),
            Weights::Exact(..) => 0.0,
        }
    }

    /// Filters a field, the first voxel of which is `origin` (x, y, z) of the volume that it is a part of; of a whole volume
    /// it is 0.
    ///
    /// Boxes lie at multiples of their size in the volume, and nothing but a box and the radius around it changes its
    /// results. So the voxels of a part that are at least [`reach`] away from where it was cut out get the same bits as in
    /// the whole volume.
    ///
    /// # Panics
    /// When the field is not of this filter's size.
    #[must_use]
    pub fn filter(&self, field: &Field, origin: [usize; 3]) -> Filtered {
        assert_eq!(dims_of(field), self.dims, "a filter is made for fields of one size");
        let [nx, ny, _] = self.dims;
        let [xs, ys, zs] = [0, 1, 2].map(|axis| cuts(origin[axis], self.dims[axis], BOX[axis]));
        let mut values: Field = Array3::zeros(field.dim());
        let mut rest = voxels_mut(&mut values);
        let slabs: Vec<_> = zs
            .into_iter()
            .map(|z| {
                let (slab, after) = std::mem::take(&mut rest).split_at_mut(nx * ny * z.len());
                rest = after;
                (slab, z)
            })
            .collect();
        let (boxes, flat) = (xs.len() * ys.len() * slabs.len(), AtomicUsize::new(0));
        slabs.into_par_iter().for_each_init(Scratch::default, |scratch, (slab, z)| {
            for y in &ys {
                for x in &xs {
                    let way = self.filter_box(field, &[x.clone(), y.clone(), z.clone()], scratch, |[j, k], row| {
                        slab[((k - z.start) * ny + j) * nx..][x.clone()].copy_from_slice(row);
                    });
                    flat.fetch_add(usize::from(matches!(way, Way::Flat)), Ordering::Relaxed);
                }
            }
        });
        Filtered { values, boxes_filtered: 1.0 - flat.into_inner() as f64 / boxes as f64 }
    }

    /// Filters the voxels of a box, given as ranges along x, y, z, and hands over its rows with their place along y and z.
    fn filter_box(
        &self,
        field: &Field,
        region: &[Range<usize>; 3],
        scratch: &mut Scratch,
        mut write: impl FnMut([usize; 2], &[f32]),
    ) -> Way {
        let Scratch { window, moments, shifts, row } = scratch;
        window.load(field, region, self.reach, self.scale);
        let [width, height, depth] = region.each_ref().map(Range::len);
        let [low, high] = window.extremes();
        let way = self.way([low, high]);
        if let Way::Moments(range) = &way {
            moments.load(window, depth, range, &self.spatial[2]);
        }
        let strides = [1, window.strides[0], window.strides[1]];
        shifts.clear();
        shifts.extend(self.offsets.iter().map(|offset| shift(*offset, strides)));
        row.resize(width.next_multiple_of(LANES), 0.0);
        for z in 0..depth {
            if let Way::Moments(_) = way {
                moments.load_slice(z, height, &self.spatial[0], &self.spatial[1]);
            }
            for y in 0..height {
                let (start, samples) = (window.row_start([y, z]), &window.samples);
                match (&way, &self.weights) {
                    (Way::Flat, _) => row.iter_mut().zip(&samples[start..]).for_each(|(out, &sample)| *out = sample),
                    (Way::Moments(range), _) => moments.filter_row(y, &samples[start..], range, row),
                    (Way::Neighbours, Weights::Fast(weights)) => filter_row_fast(samples, start, shifts, weights, row),
                    (Way::Neighbours, Weights::Exact(weights)) => {
                        filter_row_exact(samples, start, shifts, weights, row)
                    }
                }
                if matches!((&way, &self.weights), (Way::Moments(_) | Way::Neighbours, Weights::Fast(_))) {
                    // A mean lies between what it is a mean of; a sum of terms of both signs may round beyond that.
                    row.iter_mut().for_each(|value| *value = value.max(low).min(high));
                }
                unscale(row, &samples[start..], 1.0 / self.scale);
                write([region[1].start + y, region[2].start + z], &row[..width]);
            }
        }
        way
    }

    /// The way that takes least time for values between two others.
    fn way(&self, [low, high]: [f32; 2]) -> Way {
        if low >= high {
            return Way::Flat;
        }
        let Weights::Fast(_) = self.weights else { return Way::Neighbours };
        let extent = 0.5 * f64::from(high - low) / f64::from(self.range_sigma);
        match Expansion::new(extent, TRUNCATION / self.total) {
            // Measured: a term takes the time of some two pairs of neighbours, what else there is to do that of twelve.
            Some(expansion) if 12 + 2 * expansion.terms() < self.offsets.len() => {
                Way::Moments(RangeExpansion { middle: 0.5 * (low + high), sigma: self.range_sigma, expansion })
            }
            _ => Way::Neighbours,
        }
    }
}

/// Turns filtered samples back into the field's own units, and what is missing into NaN.
fn unscale(filtered: &mut [f32], samples: &[f32], factor: f32) {
    for (filtered, &sample) in filtered.iter_mut().zip(samples) {
        *filtered = if sample < MISSING { *filtered * factor } else { f32::NAN };
    }
}

/// The ranges of a field's voxels along an axis that end where a position in the volume is a multiple of `step`.
fn cuts(origin: usize, len: usize, step: usize) -> Vec<Range<usize>> {
    let range = |start: usize| start..(start + step - (origin + start) % step).min(len);
    std::iter::successors(Some(range(0)), |before| (before.end < len).then(|| range(before.end))).collect()
}
