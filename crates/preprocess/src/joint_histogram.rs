//! Histograms over all voxels, at full precision.

use rayon::prelude::*;
use voxrole_pack::histogram::HistogramShape;
use voxrole_pack::{Histogram, HistogramAxis, HistogramKind, Scalars};

use crate::Grid;

/// Most bins of a value axis, and bins of the other axes of joint histograms.
pub const BINS: u32 = 256;
/// Bins of the distance histogram: a tenth of L_min each at the default `d_max`.
pub const DISTANCE_BINS: u32 = 300;

/// Voxels that one task counts.
const CHUNK: usize = 1 << 18;

/// The value axis of a grid: whole numbers per bin for integer types, so that no bin is favoured; [`BINS`] equal bins
/// over the finite range for floats.
#[must_use]
pub fn value_axis(grid: &Grid) -> HistogramAxis {
    let [low, high] = grid.scalars.finite_range().unwrap_or([0.0, 1.0]);
    let stored = if matches!(grid.scalars, Scalars::F32(_) | Scalars::F64(_)) {
        widened(low, high, BINS)
    } else {
        let count = high - low + 1.0;
        let per_bin = (count / f64::from(BINS)).ceil();
        let bins = (count / per_bin).ceil();
        HistogramAxis { low: low - 0.5, high: low - 0.5 + bins * per_bin, bins: bins as u32 }
    };
    let ends = [stored.low, stored.high].map(|end| grid.slope.mul_add(end, grid.intercept));
    HistogramAxis { low: ends[0].min(ends[1]), high: ends[0].max(ends[1]), bins: stored.bins }
}

/// An axis over a range that may be empty.
#[must_use]
pub fn widened(low: f64, high: f64, bins: u32) -> HistogramAxis {
    if low < high && (high - low).is_finite() {
        return HistogramAxis { low, high, bins };
    }
    let margin = if low == 0.0 { 1.0 } else { low.abs() * 0.5 };
    HistogramAxis { low: low - margin, high: low + margin, bins }
}

/// Counts voxels over one axis or two; `position` gives a voxel's physical coordinates, or `None` to leave it out. With
/// one axis the second coordinate is ignored.
pub fn count(
    kind: HistogramKind,
    axes: Vec<HistogramAxis>,
    voxels: usize,
    position: impl Fn(usize) -> Option<[f64; 2]> + Sync,
) -> Histogram {
    let bins = axes.iter().map(|axis| axis.bins as usize).product::<usize>();
    let counts = (0..voxels.div_ceil(CHUNK))
        .into_par_iter()
        .fold(
            || vec![0_u64; bins],
            |mut counts, chunk| {
                for voxel in chunk * CHUNK..((chunk + 1) * CHUNK).min(voxels) {
                    if let Some(coordinates) = position(voxel) {
                        let mut bin = 0;
                        for (axis, coordinate) in axes.iter().zip(coordinates).rev() {
                            bin = bin * axis.bins as usize + axis.bin_of(coordinate);
                        }
                        counts[bin] += 1;
                    }
                }
                counts
            },
        )
        .reduce(
            || vec![0; bins],
            |mut sum, other| {
                sum.iter_mut().zip(other).for_each(|(sum, other)| *sum += other);
                sum
            },
        );
    Histogram { shape: HistogramShape { kind, axes }, counts }
}

#[cfg(test)]
mod tests {
    use voxrole_pack::GridGeometry;

    use super::*;

    fn grid(scalars: Scalars, slope: f64) -> Grid {
        let geometry = GridGeometry::axis_aligned([scalars.len() as u32, 1, 1], [1.0; 3]);
        Grid::with_mapping("g", geometry, scalars, slope, 0.0).expect("a grid")
    }

    #[test]
    fn integer_bins_hold_equally_many_numbers() {
        let axis = value_axis(&grid(Scalars::U16((0..=1300).collect()), 1.0));
        let mut counts = vec![0; axis.bins as usize];
        (0..=1300).for_each(|value| counts[axis.bin_of(f64::from(value))] += 1);
        assert!(counts[..counts.len() - 1].iter().all(|&count| count == 6), "{counts:?}");
        assert_eq!(value_axis(&grid(Scalars::U8(vec![3, 250]), 1.0)).bins, 248);
    }

    #[test]
    fn negative_slopes_and_constants_still_give_rising_axes() {
        let axis = value_axis(&grid(Scalars::I16(vec![0, 10]), -2.0));
        assert_eq!((axis.low, axis.high, axis.bins), (-21.0, 1.0, 11));
        let axis = value_axis(&grid(Scalars::F32(vec![4.0, 4.0]), 1.0));
        assert!(axis.low < 4.0 && axis.high > 4.0);
    }

    #[test]
    fn counts_are_those_of_a_plain_loop() {
        let axis = |bins| HistogramAxis { low: 0.0, high: 10.0, bins };
        let position = |voxel: usize| (!voxel.is_multiple_of(7)).then_some([(voxel % 10) as f64, (voxel % 13) as f64]);
        let voxels = CHUNK + 1000;
        let found = count(HistogramKind::ValueGradient, vec![axis(5), axis(4)], voxels, position);
        let mut expected = vec![0; 20];
        for [x, y] in (0..voxels).filter_map(position) {
            expected[axis(4).bin_of(y) * 5 + axis(5).bin_of(x)] += 1;
        }
        assert_eq!(found.counts, expected);
    }
}
