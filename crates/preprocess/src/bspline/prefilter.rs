//! From samples to B-spline coefficients: a recursive filter along every line of the volume, axis by axis.

use glam::{Mat4, Vec4};
use multiversion::multiversion;
use ndarray::{ArrayViewMut2, Axis, s};
use rayon::prelude::*;

use super::Degree;
use crate::continuation::Continued;
use crate::padded_field::PaddedField;
use crate::working_field::Field;

/// Lines that are filtered side by side: the recursion vectorises across them, and no vector waits for its own result.
const LANES: usize = 32;
/// A pole's power below this adds nothing in f32.
const NEGLIGIBLE: f32 = 1e-9;

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
/// Per voxel 8 bytes are read and 8 written, since a slice stays in the cache while it is filtered along x and y, for 15
/// operations on f32 a pole: three products and two sums along each axis.
pub(super) fn prefilter(source: &Field, target: &mut PaddedField, degree: Degree) {
    let [along_x, along_y, along_z] = target.dims().map(|len| filters(degree, len));
    let mut target = target.inside_mut();
    let slices: Vec<_> = target.axis_iter_mut(Axis(0)).zip(source.axis_iter(Axis(0))).collect();
    slices.into_par_iter().for_each_init(Vec::new, |lines, (mut slice, source)| {
        slice.assign(&source);
        filter_slice(&mut slice, [&along_x, &along_y], lines);
    });
    let across: Vec<_> = target.axis_iter_mut(Axis(1)).collect();
    across.into_par_iter().for_each_init(Vec::new, |lines, mut plane| filter_across(&mut plane, &along_z, lines));
}

/// Filters along both axes of a slice.
#[multiversion(targets("x86_64+avx2"))]
fn filter_slice(slice: &mut ArrayViewMut2<'_, f32>, [along_x, along_y]: [&[Filter]; 2], lines: &mut Vec<Lines>) {
    filter_rows(slice, along_x, lines);
    filter_columns(slice, along_y, lines);
}

#[multiversion(targets("x86_64+avx2"))]
fn filter_across(plane: &mut ArrayViewMut2<'_, f32>, filters: &[Filter], lines: &mut Vec<Lines>) {
    filter_columns(plane, filters, lines);
}

/// Filters along the rows of a plane.
#[inline(always)]
fn filter_rows(plane: &mut ArrayViewMut2<'_, f32>, filters: &[Filter], lines: &mut Vec<Lines>) {
    let (height, len) = plane.dim();
    if filters.is_empty() {
        return;
    }
    lines.resize(len, [0.0; LANES]);
    for first in (0..height).step_by(LANES) {
        let mut block = plane.slice_mut(s![first..(first + LANES).min(height), ..]);
        let count = block.nrows();
        for lane in (0..LANES).step_by(4) {
            // Lanes without a row of their own filter the last one once more.
            let row = |offset: usize| block.row((lane + offset).min(count - 1)).to_slice().expect(CONTIGUOUS);
            lanes_from_rows(lines, lane, [row(0), row(1), row(2), row(3)]);
        }
        filters.iter().for_each(|filter| filter.apply(lines));
        let mut rows = block.rows_mut().into_iter().map(|row| row.into_slice().expect(CONTIGUOUS));
        for lane in (0..count).step_by(4) {
            rows_from_lanes(lines, lane, [rows.next(), rows.next(), rows.next(), rows.next()]);
        }
    }
}

/// Filters along the columns of a plane.
#[inline(always)]
fn filter_columns(plane: &mut ArrayViewMut2<'_, f32>, filters: &[Filter], lines: &mut Vec<Lines>) {
    let (len, width) = plane.dim();
    if filters.is_empty() {
        return;
    }
    lines.resize(len, [0.0; LANES]);
    for first in (0..width).step_by(LANES) {
        let mut block = plane.slice_mut(s![.., first..(first + LANES).min(width)]);
        for (line, row) in lines.iter_mut().zip(block.rows()) {
            let row = row.to_slice().expect(CONTIGUOUS);
            match <&Lines>::try_from(row) {
                Ok(full) => *line = *full,
                Err(_) => line[..row.len()].copy_from_slice(row),
            }
        }
        filters.iter().for_each(|filter| filter.apply(lines));
        for (line, row) in lines.iter().zip(block.rows_mut()) {
            let row = row.into_slice().expect(CONTIGUOUS);
            match <&mut Lines>::try_from(&mut *row) {
                Ok(full) => *full = *line,
                Err(_) => row.copy_from_slice(&line[..row.len()]),
            }
        }
    }
}

/// Rows, transposed, into lanes.
#[inline(always)]
fn lanes_from_rows(lines: &mut [Lines], lane: usize, rows: [&[f32]; 4]) {
    let whole = lines.len() / 4 * 4;
    for x in (0..whole).step_by(4) {
        let [a, b, c, d] = rows;
        let transposed = Mat4::from_cols(four(a, x), four(b, x), four(c, x), four(d, x)).transpose();
        for (line, column) in lines[x..x + 4].iter_mut().zip(columns(&transposed)) {
            column.write_to_slice(&mut line[lane..]);
        }
    }
    for x in whole..lines.len() {
        lines[x][lane..lane + 4].copy_from_slice(&rows.map(|row| row[x]));
    }
}

/// Lanes, transposed, into those rows that there are.
#[inline(always)]
fn rows_from_lanes(lines: &[Lines], lane: usize, mut rows: [Option<&mut [f32]>; 4]) {
    let whole = lines.len() / 4 * 4;
    for x in (0..whole).step_by(4) {
        let [a, b, c, d] = [&lines[x], &lines[x + 1], &lines[x + 2], &lines[x + 3]];
        let transposed = Mat4::from_cols(four(a, lane), four(b, lane), four(c, lane), four(d, lane)).transpose();
        for (row, column) in rows.iter_mut().flatten().zip(columns(&transposed)) {
            column.write_to_slice(&mut row[x..]);
        }
    }
    for x in whole..lines.len() {
        for (row, value) in rows.iter_mut().flatten().zip(&lines[x][lane..]) {
            row[x] = *value;
        }
    }
}

#[inline(always)]
fn four(samples: &[f32], start: usize) -> Vec4 {
    Vec4::from_slice(&samples[start..])
}

#[inline(always)]
fn columns(matrix: &Mat4) -> [Vec4; 4] {
    [matrix.x_axis, matrix.y_axis, matrix.z_axis, matrix.w_axis]
}

/// `(1 − z)² / ((1 − z·B)(1 − z·B⁻¹))` with a pole z and B the shift by one sample.
struct Filter {
    pole: f32,
    gain: f32,
    /// The causal part's state before the first sample, `Σ zᵏ·f(−1 − k)` times the gain: samples inside and their weights.
    before: Vec<(usize, f32)>,
}

impl Filter {
    /// For lines of `len` samples.
    fn new(pole: f32, len: usize) -> Self {
        let gain = (1.0 - pole) * (1.0 - pole);
        let mut before = Vec::new();
        let mut power = gain;
        let mut beyond = 1;
        while power.abs() > NEGLIGIBLE {
            before.extend(Continued::new(-beyond, len).terms(len).map(|(inside, weight)| (inside, power * weight)));
            power *= pole;
            beyond += 1;
        }
        Self { pole, gain, before }
    }

    /// There and back.
    #[inline(always)]
    fn apply(&self, lines: &mut [Lines]) {
        let Self { pole, gain, .. } = *self;
        let last = lines.len() - 1;
        let [start, end] = [lines[0], lines[last]];
        let mut state = [0.0; LANES];
        for &(inside, weight) in &self.before {
            let line = &lines[inside];
            for lane in 0..LANES {
                state[lane] += weight * line[lane];
            }
        }
        for line in &mut *lines {
            for lane in 0..LANES {
                state[lane] = gain * line[lane] + pole * state[lane];
            }
            *line = state;
        }
        // What is odd about an end point is filtered to something odd about it: the end points stay as they are.
        lines[0] = start;
        lines[last] = end;
        let mut state = end;
        for line in lines[1..last].iter_mut().rev() {
            for lane in 0..LANES {
                state[lane] = line[lane] + pole * state[lane];
            }
            *line = state;
        }
    }
}

/// The filters of a degree for lines of `len` samples; none where lines are too short.
fn filters(degree: Degree, len: usize) -> Vec<Filter> {
    let poles = if len < 3 { &[] } else { degree.poles() };
    poles.iter().map(|&pole| Filter::new(pole, len)).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::working_field::dims_of;

    /// The naive twin: one line at a time.
    fn naive(field: &mut Field, degree: Degree) {
        for axis in [2, 1, 0] {
            for mut line in field.lanes_mut(Axis(axis)) {
                let len = line.len();
                for &pole in if len < 3 { &[] } else { degree.poles() } {
                    let gain = (1.0 - pole) * (1.0 - pole);
                    let (mut state, mut power, mut beyond) = (0.0, gain, 1);
                    while power.abs() > NEGLIGIBLE {
                        for (inside, weight) in Continued::new(-beyond, len).terms(len) {
                            state += power * weight * line[inside];
                        }
                        power *= pole;
                        beyond += 1;
                    }
                    let [start, end] = [line[0], line[len - 1]];
                    for value in &mut line {
                        state = gain * *value + pole * state;
                        *value = state;
                    }
                    (line[0], line[len - 1]) = (start, end);
                    for at in (1..len - 1).rev() {
                        line[at] += pole * line[at + 1];
                    }
                }
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn equals_its_naive_twin(
            short in prop::array::uniform3(1_usize..9),
            long in prop::option::of((0_usize..3, 1_usize..80)),
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
