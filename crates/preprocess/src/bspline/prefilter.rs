//! From samples to B-spline coefficients: a symmetric filter along every line of the volume, axis by axis.
//!
//! The filter is recursive in the literature. Here it is its impulse response, cut where f32 holds nothing more of it: a
//! coefficient then depends on a bounded neighbourhood alone, so that a volume that is prepared block by block gets the same
//! bits, and the processor never waits for the sample before.

use std::sync::LazyLock;

use fearless_simd::{Simd, dispatch, prelude::*};
use ndarray::{ArrayViewMut2, Axis, s};
use rayon::prelude::*;

use super::Degree;
use crate::continuation::Continued;
use crate::padded_field::PaddedField;
use crate::simd;
use crate::working_field::Field;

/// Lines that are filtered side by side.
const LANES: usize = 32;

/// What padded fields promise.
const CONTIGUOUS: &str = "rows are contiguous";

/// A sample of every line.
type Lines = [f32; LANES];

/// Writes the coefficients of the spline through the samples of `source` inside the faces of `target`, which is of the same
/// dimensions. No sample may be NaN.
///
/// Beyond its ends a line goes on mirrored in its end points ([`Continued`]), which are their own coefficients then. Lines
/// of one or two samples need no filter.
///
/// Per voxel 8 bytes are read and 8 written, since a slice stays in the cache while it is filtered along x and y, for three
/// operations on f32 for each of [`Degree::reach`] neighbours along each axis: 216 for the quintic spline, 32 voxels at a time.
/// Where nothing changes far and wide, sums are those of the voxels before.
pub(super) fn prefilter(source: &Field, target: &mut PaddedField, degree: Degree) {
    let filters = target.dims().map(|len| if len < 3 { None } else { Some(LineFilter::new(degree, len)) });
    let mut target = target.inside_mut();
    let slices: Vec<_> = target.axis_iter_mut(Axis(0)).zip(source.axis_iter(Axis(0))).collect();
    slices.into_par_iter().for_each_init(Buffers::default, |buffers, (mut slice, source)| {
        slice.assign(&source);
        if let Some(filter) = &filters[0] {
            dispatch!(simd::level(), simd => filter_rows(simd, &mut slice, filter, buffers));
        }
        if let Some(filter) = &filters[1] {
            dispatch!(simd::level(), simd => filter_columns(simd, &mut slice, filter, buffers));
        }
    });
    if let Some(filter) = &filters[2] {
        let across: Vec<_> = target.axis_iter_mut(Axis(1)).collect();
        across.into_par_iter().for_each_init(Buffers::default, |buffers, mut plane| {
            dispatch!(simd::level(), simd => filter_columns(simd, &mut plane, filter, buffers));
        });
    }
}

/// The impulse response of a degree's recursive filter, a product of `(1 − z)² / ((1 − z·B)(1 − z·B⁻¹))` over its poles z with
/// B the shift by one sample.
struct Filter {
    /// Weights from the middle outwards; their sum over both sides is 1.
    half: Vec<f32>,
}

impl Filter {
    fn of(degree: Degree) -> &'static Self {
        static CUBIC: LazyLock<Filter> = LazyLock::new(|| Filter::new(Degree::Cubic));
        static QUINTIC: LazyLock<Filter> = LazyLock::new(|| Filter::new(Degree::Quintic));
        match degree {
            Degree::Cubic => &CUBIC,
            Degree::Quintic => &QUINTIC,
        }
    }

    fn new(degree: Degree) -> Self {
        let reach = degree.reach();
        // Long enough for what is cut off not to matter.
        let len = 4 * reach as i32;
        let mut response: Vec<f64> = (-len..=len).map(|at| f64::from(u8::from(at == 0))).collect();
        for &pole in degree.poles() {
            let weight = |at: usize, other: usize| (1.0 - pole) / (1.0 + pole) * pole.powi(at.abs_diff(other) as i32);
            response = (0..response.len())
                .map(|at| response.iter().enumerate().map(|(other, value)| value * weight(at, other)).sum())
                .collect();
        }
        let half = &response[len as usize..][..=reach];
        let sum = 2.0 * half[1..].iter().sum::<f64>() + half[0];
        Self { half: half.iter().map(|weight| (weight / sum) as f32).collect() }
    }

    fn reach(&self) -> usize {
        self.half.len() - 1
    }
}

/// A filter of lines of one length.
struct LineFilter {
    half: &'static [f32],
    /// Where in a buffer the samples beyond a line's ends lie, each with the samples inside that it is made of and their
    /// weights.
    beyond: Vec<(usize, Vec<(usize, f32)>)>,
}

impl LineFilter {
    fn new(degree: Degree, len: usize) -> Self {
        let filter = Filter::of(degree);
        let reach = filter.reach();
        let places = (0..reach).chain(reach + len..len + 2 * reach);
        let terms = |place: usize| Continued::new(place as isize - reach as isize, len).terms(len).collect();
        Self { half: &filter.half, beyond: places.map(|place| (place, terms(place))).collect() }
    }

    fn reach(&self) -> usize {
        self.half.len() - 1
    }
}

/// What a thread needs, kept from plane to plane: lines with their continuation.
#[derive(Default)]
struct Buffers {
    row: Vec<f32>,
    lines: Vec<Lines>,
}

/// Filters along the rows of a plane.
#[inline(always)]
fn filter_rows<S: Simd>(simd: S, plane: &mut ArrayViewMut2<'_, f32>, filter: &LineFilter, buffers: &mut Buffers) {
    let (reach, len) = (filter.reach(), plane.ncols());
    let row = &mut buffers.row;
    // The last vectors may begin at the last sample.
    row.resize(len + 2 * reach + LANES, 0.0);
    let mut sums = [0.0; LANES];
    for out in plane.rows_mut() {
        let out = out.into_slice().expect(CONTIGUOUS);
        row[reach..reach + len].copy_from_slice(out);
        for (place, terms) in &filter.beyond {
            let mut sum = 0.0;
            for (inside, weight) in terms {
                sum += weight * out[*inside];
            }
            row[*place] = sum;
        }
        // What is odd about an end point is filtered to something odd about it: the end points stay as they are.
        let inside = &mut out[1..len - 1];
        let mut is_flat_before = false;
        for (first, out) in (1..).step_by(LANES).zip(inside.chunks_mut(LANES)) {
            let samples = &row[first..];
            // Flat stretches side by side overlap, so that they are one, and come to the same.
            let is_flat = is_flat(&samples[..LANES + 2 * reach]);
            if !(is_flat && is_flat_before) {
                sums = weighted(simd, samples, 1, filter.half);
            }
            is_flat_before = is_flat;
            keep(&sums, out);
        }
    }
}

/// Filters along the columns of a plane.
#[inline(always)]
fn filter_columns<S: Simd>(simd: S, plane: &mut ArrayViewMut2<'_, f32>, filter: &LineFilter, buffers: &mut Buffers) {
    let reach = filter.reach();
    let (len, width) = plane.dim();
    let lines = &mut buffers.lines;
    lines.resize(len + 2 * reach, [0.0; LANES]);
    for first in (0..width).step_by(LANES) {
        let mut block = plane.slice_mut(s![.., first..(first + LANES).min(width)]);
        for (line, row) in lines[reach..].iter_mut().zip(block.rows()) {
            let row = row.to_slice().expect(CONTIGUOUS);
            match <&Lines>::try_from(row) {
                Ok(full) => *line = *full,
                Err(_) => line[..row.len()].copy_from_slice(row),
            }
        }
        for (place, terms) in &filter.beyond {
            let mut sum = [0.0; LANES];
            for (inside, weight) in terms {
                let line = &lines[reach + inside];
                for lane in 0..LANES {
                    sum[lane] += weight * line[lane];
                }
            }
            lines[*place] = sum;
        }
        // The last line that differs from the one before it.
        let mut changed = 0;
        for line in 1..1 + 2 * reach {
            changed = if are_same(&lines[line - 1], &lines[line]) { changed } else { line };
        }
        let mut sums = [0.0; LANES];
        for (at, row) in block.rows_mut().into_iter().enumerate().skip(1).take(len - 2) {
            let last = at + 2 * reach;
            changed = if are_same(&lines[last - 1], &lines[last]) { changed } else { last };
            // In a flat stretch each line comes to what the one before it did.
            if at == 1 || changed >= at {
                sums = weighted(simd, lines[at..].as_flattened(), LANES, filter.half);
            }
            keep(&sums, row.into_slice().expect(CONTIGUOUS));
        }
    }
}

/// Whether all samples are the same, bit by bit; there are more of them than [`LANES`].
#[inline(always)]
fn is_flat(samples: &[f32]) -> bool {
    let last = samples.len() - 1 - LANES;
    let is_flat_from = |first: usize| match (samples[first..].first_chunk(), samples[first + 1..].first_chunk()) {
        (Some(samples), Some(next)) => are_same(samples, next),
        _ => false,
    };
    let mut first = 0;
    while first < last && is_flat_from(first) {
        first += LANES;
    }
    first >= last && is_flat_from(last)
}

/// Whether lines are the same, bit by bit.
#[inline(always)]
fn are_same(a: &Lines, b: &Lines) -> bool {
    // Where there is noise, one lane is enough.
    if a[0].to_bits() != b[0].to_bits() {
        return false;
    }
    let mut difference = 0;
    for lane in 0..LANES {
        difference |= a[lane].to_bits() ^ b[lane].to_bits();
    }
    difference == 0
}

/// Keeps as many sums as there is room for.
#[inline(always)]
fn keep(sums: &Lines, out: &mut [f32]) {
    match <&mut Lines>::try_from(&mut *out) {
        Ok(all) => *all = *sums,
        Err(_) => out.copy_from_slice(&sums[..out.len()]),
    }
}

/// Weighted sums of [`LANES`] samples and their neighbours, which are `stride` apart; `samples` begin with the first one's
/// farthest.
#[inline(always)]
fn weighted<S: Simd>(simd: S, samples: &[f32], stride: usize, half: &[f32]) -> Lines {
    match S::f32s::LEN {
        4 => weighted_vectors::<S, 8>(simd, samples, stride, half),
        8 => weighted_vectors::<S, 4>(simd, samples, stride, half),
        _ => weighted_vectors::<S, 2>(simd, samples, stride, half),
    }
}

/// [`weighted`] with so many vectors, which stay in registers.
#[inline(always)]
fn weighted_vectors<S: Simd, const VECTORS: usize>(simd: S, samples: &[f32], stride: usize, half: &[f32]) -> Lines {
    let lanes = S::f32s::LEN;
    let center = (half.len() - 1) * stride;
    let own = &samples[center..][..LANES];
    let mut sums = [S::f32s::splat(simd, 0.0); VECTORS];
    for vector in 0..VECTORS {
        sums[vector] = S::f32s::from_slice(simd, &own[vector * lanes..][..lanes]) * half[0];
    }
    for steps in 1..half.len() {
        let low = &samples[center - steps * stride..][..LANES];
        let high = &samples[center + steps * stride..][..LANES];
        for vector in 0..VECTORS {
            let low = S::f32s::from_slice(simd, &low[vector * lanes..][..lanes]);
            let high = S::f32s::from_slice(simd, &high[vector * lanes..][..lanes]);
            sums[vector] += (low + high) * half[steps];
        }
    }
    let mut all = [0.0; LANES];
    for vector in 0..VECTORS {
        sums[vector].store_slice(&mut all[vector * lanes..][..lanes]);
    }
    all
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::working_field::dims_of;

    /// The naive twin: one line at a time.
    fn naive(field: &mut Field, degree: Degree) {
        let half = Filter::new(degree).half;
        for axis in [2, 1, 0] {
            for mut line in field.lanes_mut(Axis(axis)).into_iter().filter(|line| line.len() > 2) {
                let (before, len) = (line.to_vec(), line.len());
                let sample = |at: isize| -> f32 {
                    Continued::new(at, len).terms(len).map(|(inside, weight)| weight * before[inside]).sum()
                };
                for at in 1..len - 1 {
                    line[at] = half.iter().enumerate().skip(1).fold(half[0] * before[at], |sum, (steps, weight)| {
                        let [low, high] = [-1, 1].map(|sign| sample(at as isize + sign * steps as isize));
                        sum + weight * (low + high)
                    });
                }
            }
        }
    }

    #[test]
    fn what_is_cut_off_f32_does_not_hold() {
        for degree in [Degree::Cubic, Degree::Quintic] {
            let slowest = degree.poles()[0].abs();
            let last = f64::from(Filter::new(degree).half[degree.reach()].abs());
            // A geometric series, on both sides.
            let beyond = 2.0 * last * slowest / (1.0 - slowest);
            assert!(beyond < f64::from(f32::EPSILON) / 4.0, "{degree:?}: {beyond:e}");
        }
    }

    #[test]
    fn flat_stretches_equal_their_naive_twin() {
        for axis in 0..3 {
            // Every end within a vector, so that one sample too many would be seen.
            for stretch in (130..=200).map(|end| end - 130..end) {
                let mut dims = [3, 4, 5];
                dims[axis] = 200;
                let mut field = Field::from_shape_fn(dims, |(k, j, i)| {
                    let at = [k, j, i][axis];
                    let is_changed = !stretch.contains(&at) || (at == 75 && [k, j, i][(axis + 1) % 3] == 2);
                    if is_changed { 1e4 + 3e3 * (at * 7 % 11) as f32 } else { 0.3 }
                });
                let mut found = PaddedField::unset(Vec::new(), dims_of(&field)).expect("fits");
                prefilter(&field, &mut found, Degree::Quintic);
                naive(&mut field, Degree::Quintic);
                assert_eq!(found.inside_mut(), field, "axis {axis}, {stretch:?}");
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn equals_its_naive_twin(
            short in prop::array::uniform3(1_usize..9),
            long in prop::option::of((0_usize..3, 1_usize..150)),
            (start, len) in (prop::array::uniform3(0_usize..40), prop::array::uniform3(1_usize..150)),
            flat in prop::sample::select(vec![0.3_f32, 0.0]),
            seed in any::<u32>(),
        ) {
            let mut dims = short;
            if let Some((axis, len)) = long {
                dims[axis] = len;
            }
            // Noise around a box in which nothing changes.
            let mut field = Field::from_shape_fn(dims, |(k, j, i)| {
                if [k, j, i].iter().zip(start).zip(len).all(|((at, start), len)| (start..start + len).contains(at)) {
                    return flat;
                }
                (((k * 91 + j) * 91 + i) as u32 ^ seed).wrapping_mul(2_654_435_761) as f32 / u32::MAX as f32
            });
            for degree in [Degree::Cubic, Degree::Quintic] {
                let mut found = PaddedField::unset(Vec::new(), dims_of(&field)).expect("fits");
                prefilter(&field, &mut found, degree);
                naive(&mut field, degree);
                prop_assert_eq!(found.inside_mut().to_owned(), field.clone());
            }
        }
    }
}
