//! From samples to B-spline coefficients: a symmetric filter along every line of the volume, axis by axis.
//!
//! The filter is recursive in the literature. Here it is its impulse response, cut where f32 holds nothing more of it: a
//! coefficient then depends on a bounded neighbourhood alone, so that a volume that is prepared block by block gets the same
//! bits, and the processor never waits for the sample before.

use std::sync::LazyLock;

use multiversion::multiversion;
use ndarray::{ArrayViewMut2, Axis, s};
use rayon::prelude::*;

use super::Degree;
use crate::continuation::Continued;
use crate::padded_field::PaddedField;
use crate::row_windows::{WINDOW, windows};
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
/// operations on f32 for each of [`Degree::reach`] neighbours along each axis: 216 for the quintic spline, 32 or 64 voxels at a
/// time.
pub(super) fn prefilter(source: &Field, target: &mut PaddedField, degree: Degree) {
    let filters = target.dims().map(|len| if len < 3 { None } else { Some(Filter::of(degree)) });
    let mut target = target.inside_mut();
    let slices: Vec<_> = target.axis_iter_mut(Axis(0)).zip(source.axis_iter(Axis(0))).collect();
    slices.into_par_iter().for_each_init(Buffers::default, |buffers, (mut slice, source)| {
        slice.assign(&source);
        if let Some(filter) = filters[0] {
            filter_rows(&mut slice, filter, buffers);
        }
        if let Some(filter) = filters[1] {
            filter_columns(&mut slice, filter, buffers);
        }
    });
    if let Some(filter) = filters[2] {
        let across: Vec<_> = target.axis_iter_mut(Axis(1)).collect();
        across
            .into_par_iter()
            .for_each_init(Buffers::default, |buffers, mut plane| filter_columns(&mut plane, filter, buffers));
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

/// What a thread needs, kept from plane to plane: lines with their continuation.
#[derive(Default)]
struct Buffers {
    row: Vec<f32>,
    lines: Vec<Lines>,
}

/// Filters along the rows of a plane.
#[multiversion(targets("x86_64+avx2"))]
fn filter_rows(plane: &mut ArrayViewMut2<'_, f32>, filter: &Filter, buffers: &mut Buffers) {
    let (reach, len) = (filter.reach(), plane.ncols());
    let row = &mut buffers.row;
    row.resize(len + 2 * reach, 0.0);
    for out in plane.rows_mut() {
        let out = out.into_slice().expect(CONTIGUOUS);
        row[reach..reach + len].copy_from_slice(out);
        for (place, beyond) in beyond_ends(reach, len) {
            row[place] = Continued::new(beyond, len).terms(len).map(|(inside, weight)| weight * out[inside]).sum();
        }
        for part in windows(len) {
            if part.len() == WINDOW {
                weigh(&mut out[part.start..part.start + WINDOW], &row[part.start..], &filter.half);
            } else {
                weigh(&mut out[part.clone()], &row[part.start..], &filter.half);
            }
        }
        // What is odd about an end point is filtered to something odd about it: the end points stay as they are.
        (out[0], out[len - 1]) = (row[reach], row[reach + len - 1]);
    }
}

/// Weighted sums of the neighbours of samples; `row` begins as many samples before the first as the filter reaches.
#[inline(always)]
fn weigh(out: &mut [f32], row: &[f32], half: &[f32]) {
    let (len, reach) = (out.len(), half.len() - 1);
    for (out, value) in out.iter_mut().zip(&row[reach..]) {
        *out = half[0] * value;
    }
    for (steps, weight) in half.iter().enumerate().skip(1) {
        let (low, high) = (&row[reach - steps..][..len], &row[reach + steps..][..len]);
        for i in 0..len {
            out[i] += weight * (low[i] + high[i]);
        }
    }
}

/// Filters along the columns of a plane.
#[multiversion(targets("x86_64+avx2"))]
fn filter_columns(plane: &mut ArrayViewMut2<'_, f32>, filter: &Filter, buffers: &mut Buffers) {
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
        for (place, beyond) in beyond_ends(reach, len) {
            let mut sum = [0.0; LANES];
            for (inside, weight) in Continued::new(beyond, len).terms(len) {
                let line = &lines[reach + inside];
                for lane in 0..LANES {
                    sum[lane] += weight * line[lane];
                }
            }
            lines[place] = sum;
        }
        for (at, row) in block.rows_mut().into_iter().enumerate().skip(1).take(len - 2) {
            let sum = weighted(&lines[at..], &filter.half);
            let row = row.into_slice().expect(CONTIGUOUS);
            match <&mut Lines>::try_from(&mut *row) {
                Ok(full) => *full = sum,
                Err(_) => row.copy_from_slice(&sum[..row.len()]),
            }
        }
    }
}

/// The weighted sum around the sample that lies as far behind the first as the filter reaches.
#[inline(always)]
fn weighted(lines: &[Lines], half: &[f32]) -> Lines {
    let reach = half.len() - 1;
    let mut sum = [0.0; LANES];
    for lane in 0..LANES {
        sum[lane] = half[0] * lines[reach][lane];
    }
    for (steps, weight) in half.iter().enumerate().skip(1) {
        let (low, high) = (&lines[reach - steps], &lines[reach + steps]);
        for lane in 0..LANES {
            sum[lane] += weight * (low[lane] + high[lane]);
        }
    }
    sum
}

/// Where in a buffer the samples beyond a line's ends lie, each with its index on the line.
#[inline(always)]
fn beyond_ends(reach: usize, len: usize) -> impl Iterator<Item = (usize, isize)> {
    let places = (0..reach).chain(reach + len..len + 2 * reach);
    places.map(move |place| (place, place as isize - reach as isize))
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

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn equals_its_naive_twin(
            short in prop::array::uniform3(1_usize..9),
            long in prop::option::of((0_usize..3, 1_usize..150)),
            seed in any::<u32>(),
        ) {
            let mut dims = short;
            if let Some((axis, len)) = long {
                dims[axis] = len;
            }
            let mut field = Field::from_shape_fn(dims, |(k, j, i)| {
                (((k * 91 + j) * 91 + i) as u32 ^ seed).wrapping_mul(2_654_435_761) as f32 / u32::MAX as f32
            });
            for degree in [Degree::Cubic, Degree::Quintic] {
                let mut found = PaddedField::zeros(dims_of(&field)).expect("fits");
                prefilter(&field, &mut found, degree);
                naive(&mut field, degree);
                prop_assert_eq!(found.inside_mut().to_owned(), field.clone());
            }
        }
    }
}
