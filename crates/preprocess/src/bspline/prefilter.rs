//! From samples to B-spline coefficients: a recursive filter along every line of the volume, axis by axis.

use ndarray::{ArrayViewMut2, Axis};
use rayon::prelude::*;

use super::Degree;
use crate::continuation::Continued;
use crate::working_field::Field;

/// Lines that are filtered side by side, so that the recursion vectorises across them.
const LANES: usize = 16;
/// A pole's power below this adds nothing in f32.
const NEGLIGIBLE: f32 = 1e-9;

type Lines = [f32; LANES];

/// Replaces samples by coefficients of the spline through them. No sample may be NaN.
///
/// Beyond its ends a line goes on mirrored in its end points ([`Continued`]), which are their own coefficients then. Lines
/// of one or two samples need no filter.
pub(super) fn prefilter(field: &mut Field, degree: Degree) {
    let filter = |mut plane: ArrayViewMut2<'_, f32>| filter_plane(&mut plane, degree.poles());
    let slices: Vec<_> = field.axis_iter_mut(Axis(0)).collect();
    slices.into_par_iter().for_each(|mut slice| {
        filter(slice.view_mut().reversed_axes());
        filter(slice);
    });
    let across: Vec<_> = field.axis_iter_mut(Axis(1)).collect();
    across.into_par_iter().for_each(filter);
}

/// Filters along the first axis of a plane.
fn filter_plane(plane: &mut ArrayViewMut2<'_, f32>, poles: &[f32]) {
    let (len, width) = plane.dim();
    if len < 3 {
        return;
    }
    let mut lines = vec![[0.0; LANES]; len];
    for first in (0..width).step_by(LANES) {
        let mut block = plane.slice_mut(ndarray::s![.., first..(first + LANES).min(width)]);
        for (line, row) in lines.iter_mut().zip(block.rows()) {
            line.iter_mut().zip(row).for_each(|(to, from)| *to = *from);
        }
        for &pole in poles {
            filter_lines(&mut lines, pole);
        }
        for (line, row) in lines.iter().zip(block.rows_mut()) {
            row.into_iter().zip(line).for_each(|(to, from)| *to = *from);
        }
    }
}

/// One pole, there and back: `(1 − z)² / ((1 − z·B)(1 − z·B⁻¹))` with B the shift by one sample.
fn filter_lines(lines: &mut [Lines], pole: f32) {
    let last = lines.len() - 1;
    let [start, end] = [lines[0], lines[last]];
    let gain = (1.0 - pole) * (1.0 - pole);
    let mut before = sum_before(lines, pole);
    for line in &mut *lines {
        for (before, value) in before.iter_mut().zip(&mut *line) {
            *before = gain * *value + pole * *before;
        }
        *line = before;
    }
    // What is odd about an end point is filtered to something odd about it: the end points stay as they are.
    lines[0] = start;
    lines[last] = end;
    for k in (1..last).rev() {
        let next = lines[k + 1];
        lines[k].iter_mut().zip(next).for_each(|(value, next)| *value += pole * next);
    }
}

/// `Σ zᵏ·f(−1 − k)` times the gain: the causal filter's state before the first sample.
fn sum_before(lines: &[Lines], pole: f32) -> Lines {
    let gain = (1.0 - pole) * (1.0 - pole);
    let mut sum = [0.0; LANES];
    let mut power = gain;
    let mut beyond = 1;
    while power.abs() > NEGLIGIBLE {
        let continued = Continued::new(-beyond, lines.len());
        for (inside, weight) in continued.terms(lines.len()) {
            let weight = power * weight;
            sum.iter_mut().zip(&lines[inside]).for_each(|(sum, value)| *sum += weight * value);
        }
        power *= pole;
        beyond += 1;
    }
    sum
}
