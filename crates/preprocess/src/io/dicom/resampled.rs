//! A tilted or uneven series on a rectangular, even grid.

use std::path::PathBuf;

use rayon::prelude::*;
use voxrole_pack::ScalarType;

use super::slices::Slices;
use super::stack::Stack;
use crate::io::placement::{FileFrame, Placement};
use crate::io::slabs::Slabs;
use crate::{Error, Result};

/// Most slices and pixels that a grid may have for each one that was measured.
const MOST_GROWTH: f64 = 8.0;
/// Weight of a sample that is left out, so that neighbours outside do not count where a slice is met exactly.
const NO_WEIGHT: f64 = 1e-6;

/// The grid: the slices' own pixels, widened by as much as they are shifted, and slices at their usual distance from the
/// first to the last. Values between are linear, along the normal between slices and within each; they are 32-bit floats, NaN
/// where nothing was measured.
#[derive(Debug)]
pub(super) struct Resampled {
    slices: Slices,
    columns: usize,
    rows: usize,
    count: usize,
    /// Distance of slices.
    distance: f64,
    /// By how many pixels each slice is shifted against the grid.
    shifts: Vec<[f64; 2]>,
}

impl Resampled {
    /// # Errors
    /// [`Error::Format`] where the slices lie so that the grid would be many times as large as they are.
    pub fn new(slices: Slices) -> Result<Self> {
        let Stack { columns, rows, pixel_spacing, heights, shifts, .. } = &slices.stack;
        let ends = |axis: usize| shifts.iter().fold(f64::MAX, |low, shift| low.min(shift[axis]));
        let lowest = [ends(0), ends(1)];
        let shifts: Vec<[f64; 2]> =
            shifts.iter().map(|shift| [0, 1].map(|axis| (shift[axis] - lowest[axis]) / pixel_spacing[axis])).collect();
        let widest = [0, 1].map(|axis| shifts.iter().fold(0.0, |high: f64, shift| high.max(shift[axis])));
        let total = heights[heights.len() - 1];
        let steps = (total / slices.stack.usual_gap().unwrap_or(1.0)).round().max(1.0);
        let pixels = [f64::from(*columns), f64::from(*rows)];
        let fits = steps <= MOST_GROWTH * heights.len() as f64
            && (0..2).all(|axis| pixels[axis] + widest[axis] <= MOST_GROWTH * pixels[axis]);
        if !fits {
            let message = format!(
                "expected slices that lie closer together, found {} over {total:.1} mm, shifted by up to {:.0} and {:.0} pixels",
                heights.len(),
                widest[0],
                widest[1]
            );
            return Err(Error::format(&slices.files()[0], message));
        }
        let size = |axis: usize| (pixels[axis] + (widest[axis] - NO_WEIGHT).ceil().max(0.0)) as usize;
        let (columns, rows, distance) = (size(0), size(1), total / steps);
        Ok(Self { columns, rows, count: steps as usize + 1, distance, shifts, slices })
    }

    /// Where the grid lies.
    pub fn placement(&self) -> Placement {
        let Stack { pixel_spacing: [x, y], origin, axes, shifts, .. } = &self.slices.stack;
        // The first slice is not shifted, but may lie inside the grid.
        let [right, down] = [0, 1].map(|axis| shifts.iter().fold(0.0, |low: f64, shift| low.min(shift[axis])));
        let dims = [self.columns, self.rows, self.count].map(|dim| dim as u32);
        Placement {
            origin: (*origin + axes[0] * right + axes[1] * down).to_array(),
            direction: axes.map(|axis| axis.to_array()),
            unit: "mm".into(),
            frame: FileFrame::LeftPosteriorSuperior,
            ..Placement::axis_aligned(dims, [*x, *y, self.distance])
        }
    }

    /// What was done, for people.
    pub fn description(&self, wrong: &str) -> String {
        format!(
            "resampled because of {wrong}: {} slices of {} x {} became {} of {} x {}, {:.3} mm apart, by linear \
             interpolation; NaN where nothing was measured",
            self.slices.stack.heights.len(),
            self.slices.stack.columns,
            self.slices.stack.rows,
            self.count,
            self.columns,
            self.rows,
            self.distance
        )
    }

    /// A slice of the grid between slices `pair` of the series, `weight` of the way to the second.
    fn between(&self, pair: [(&[f32], [f64; 2]); 2], weight: f64) -> Vec<u8> {
        let columns = usize::from(self.slices.stack.columns);
        let mut bytes = vec![0; self.columns * self.rows * size_of::<f32>()];
        bytes.par_chunks_mut(self.columns * size_of::<f32>()).enumerate().for_each(|(j, row)| {
            for (i, bytes) in row.chunks_exact_mut(size_of::<f32>()).enumerate() {
                let mut sum = 0.0;
                for ((slice, [right, down]), weight) in pair.iter().zip([1.0 - weight, weight]) {
                    if weight > NO_WEIGHT {
                        sum += weight * bilinear(slice, columns, [i as f64 - right, j as f64 - down]);
                    }
                }
                bytes.copy_from_slice(&(sum as f32).to_le_bytes());
            }
        });
        bytes
    }
}

/// The value at a point of a slice, in pixels; NaN outside.
fn bilinear(slice: &[f32], columns: usize, [x, y]: [f64; 2]) -> f64 {
    let rows = slice.len() / columns;
    // Exactly on a pixel up to rounding is on it.
    let near =
        |position: f64| if (position - position.round()).abs() < NO_WEIGHT { position.round() } else { position };
    let [x, y] = [near(x), near(y)];
    if x < 0.0 || y < 0.0 || x > (columns - 1) as f64 || y > (rows - 1) as f64 {
        return f64::NAN;
    }
    let (i, j) = (x as usize, y as usize);
    let (u, v) = (x.fract(), y.fract());
    let mut sum = 0.0;
    for (di, dj, weight) in [(0, 0, (1.0 - u) * (1.0 - v)), (1, 0, u * (1.0 - v)), (0, 1, (1.0 - u) * v), (1, 1, u * v)]
    {
        if weight > 0.0 {
            sum += weight * f64::from(slice[(j + dj) * columns + i + di]);
        }
    }
    sum
}

impl Slabs for Resampled {
    fn scalar_type(&self) -> ScalarType {
        ScalarType::F32
    }

    fn files(&self) -> &[PathBuf] {
        self.slices.files()
    }

    /// Two slices of the series are in memory at a time, and one of the grid.
    fn decode(&self, sink: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let heights = &self.slices.stack.heights;
        let mut lower = 0;
        let mut slices = [self.slices.physical(0)?, self.slices.physical(1)?];
        for k in 0..self.count {
            let height = (self.distance * k as f64).min(heights[heights.len() - 1]);
            while lower + 2 < heights.len() && heights[lower + 1] <= height {
                lower += 1;
                slices = [std::mem::take(&mut slices[1]), self.slices.physical(lower + 1)?];
            }
            let weight = (height - heights[lower]) / (heights[lower + 1] - heights[lower]);
            let pair = [0, 1].map(|end| (slices[end].as_slice(), self.shifts[lower + end]));
            sink(&self.between(pair, weight))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_met_exactly_and_mixed_between() {
        let slice = [0.0, 1.0, 10.0, 11.0, f32::NAN, 21.0];
        assert_eq!(bilinear(&slice, 2, [1.0, 1.0]), 11.0);
        assert_eq!(bilinear(&slice, 2, [0.5, 0.25]), 3.0);
        // A neighbour of no weight is not looked at, others are.
        assert_eq!(bilinear(&slice, 2, [1.0, 1.5]), 16.0);
        assert!(bilinear(&slice, 2, [0.5, 1.5]).is_nan());
        for outside in [[-0.01, 0.0], [0.0, 2.01], [1.1, 0.0]] {
            assert!(bilinear(&slice, 2, outside).is_nan());
        }
    }
}
