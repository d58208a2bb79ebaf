//! Histograms over all voxels, at full precision.

use std::convert::Infallible;

use multiversion::multiversion;
use rayon::prelude::*;
use voxrole_pack::histogram::HistogramShape;
use voxrole_pack::reused::Reused;
use voxrole_pack::scalar::Scalar;
use voxrole_pack::{Histogram, HistogramAxis, HistogramKind, Scalars, with_scalars};

use crate::Grid;

/// Most bins of a value axis, and bins of the other axes of joint histograms.
pub const BINS: u32 = 256;
/// Bins of the distance histogram: a tenth of L_min each at the default `d_max`.
pub const DISTANCE_BINS: u32 = 300;

/// Voxels that one task counts.
const CHUNK: usize = 1 << 17;
/// Voxels whose bins are found at once: their bins stay in the first cache.
const BLOCK: usize = 1 << 10;
/// The last bits of the sum of this number and a smaller whole one are the smaller one.
const WHOLE: f64 = (1_u64 << 52) as f64;

/// The value axis of a grid: whole numbers per bin for integer types, so that no bin is favoured; [`BINS`] equal bins
/// over the finite range for floats. `range` is that of the finite stored numbers.
#[must_use]
pub fn value_axis(grid: &Grid, range: [f64; 2]) -> HistogramAxis {
    let [low, high] = range;
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

/// How a number becomes a bin: `slope · number + intercept` on an axis.
#[derive(Clone, Copy, Debug)]
pub struct Binning {
    /// Physical units per unit of the number.
    pub slope: f64,
    /// Physical value of the number 0.
    pub intercept: f64,
    /// In physical units.
    pub axis: HistogramAxis,
}

impl Binning {
    /// Writes every number's bin; where the physical value is NaN or infinite, one behind the last.
    fn write_bins<T: Scalar>(&self, numbers: &[T], bins: &mut [u32]) {
        write_bins(numbers, self, bins);
    }
}

/// As [`Binning::write_bins`]: the bin is [`HistogramAxis::bin_of`], in a form that has no branch and no conversion that
/// processors do one at a time. `mul_add` rounds once on every target.
#[multiversion(targets("x86_64+avx2+fma"))]
fn write_bins<T: Scalar>(numbers: &[T], binning: &Binning, bins: &mut [u32]) {
    let Binning { slope, intercept, axis } = *binning;
    let (extent, count, last) = (axis.high - axis.low, f64::from(axis.bins), f64::from(axis.bins - 1));
    for (bin, number) in bins.iter_mut().zip(numbers) {
        let physical = slope.mul_add(number.to_f64(), intercept);
        let place = ((physical - axis.low) / extent * count).max(0.0).min(last).trunc();
        let place = (place + WHOLE).to_bits() as u32;
        *bin = if physical.is_finite() { place } else { axis.bins };
    }
}

/// What the histograms of a volume count: numbers of every voxel, x fastest, each with its binning.
pub struct Quantities<'a> {
    /// The value as stored.
    pub value: (&'a Scalars, Binning),
    /// Gradient magnitude; its binning is that of `hit_gradient` too.
    pub gradient: (&'a [f32], Binning),
    /// Second derivative along the gradient.
    pub second_derivative: (&'a [f32], Binning),
    /// Gradient magnitude at the hit; NaN without one.
    pub hit_gradient: &'a [f32],
    /// Value at the hit, on the value's axis; NaN without one.
    pub hit_value: (&'a [f32], Binning),
    /// Signed distance to the boundary; NaN or infinite without one.
    pub distance: (&'a [f32], Binning),
}

/// Counts all voxels, in the order of [`HistogramKind::ALL`]. A voxel counts where all of a histogram's quantities are finite.
#[must_use]
pub fn count(quantities: &Quantities<'_>) -> Vec<Histogram> {
    let axes = quantities.axes();
    let counters = Reused::default();
    with_scalars!(quantities.value.0, values => {
        (0..values.len().div_ceil(CHUNK)).into_par_iter().with_max_len(1).for_each(|chunk| {
            let voxels = chunk * CHUNK..((chunk + 1) * CHUNK).min(values.len());
            let Ok(()) = counters.lend(
                || Ok::<_, Infallible>(Counters::new(&axes)),
                |counters| {
                    for start in voxels.clone().step_by(BLOCK) {
                        counters.count(quantities, values, start, (voxels.end - start).min(BLOCK));
                    }
                },
            );
        });
    });
    let sum = counters.into_all().into_iter().reduce(Counters::plus).unwrap_or_else(|| Counters::new(&axes));
    let kinds = HistogramKind::ALL.into_iter().zip(axes).zip(sum.tables);
    kinds
        .map(|((kind, axes), table)| Histogram { counts: table.counts(), shape: HistogramShape { kind, axes } })
        .collect()
}

impl Quantities<'_> {
    /// In the order of [`HistogramKind::ALL`].
    fn axes(&self) -> [Vec<HistogramAxis>; 5] {
        let [value, gradient] = [self.value.1.axis, self.gradient.1.axis];
        [
            vec![value, gradient],
            vec![value, self.second_derivative.1.axis],
            vec![value, gradient],
            vec![value, gradient],
            vec![self.distance.1.axis],
        ]
    }
}

/// One thread's counts, and the bins of the block at hand.
struct Counters {
    tables: [Table; 5],
    value: [u32; BLOCK],
    gradient: [u32; BLOCK],
    second_derivative: [u32; BLOCK],
    hit_value: [u32; BLOCK],
    distance: [u32; BLOCK],
}

impl Counters {
    fn new(axes: &[Vec<HistogramAxis>; 5]) -> Self {
        let tables = axes.each_ref().map(|axes| Table::new(axes));
        let bins = [0; BLOCK];
        Self { tables, value: bins, gradient: bins, second_derivative: bins, hit_value: bins, distance: bins }
    }

    /// Counts a block. Tables take turns, because one that counts the same bin twice in a row waits for itself.
    fn count<T: Scalar>(&mut self, quantities: &Quantities<'_>, values: &[T], start: usize, len: usize) {
        let block = start..start + len;
        let Self { tables: [value_gradient, value_second, value_hit, hit_hit, distances], .. } = self;
        let [value, gradient, second, hit_value, distance] = [
            &mut self.value[..len],
            &mut self.gradient[..len],
            &mut self.second_derivative[..len],
            &mut self.hit_value[..len],
            &mut self.distance[..len],
        ];
        quantities.value.1.write_bins(&values[block.clone()], value);
        quantities.gradient.1.write_bins(&quantities.gradient.0[block.clone()], gradient);
        quantities.second_derivative.1.write_bins(&quantities.second_derivative.0[block.clone()], second);
        for ((&v, &g), &f2) in value.iter().zip(&*gradient).zip(&*second) {
            value_gradient.add(v, g);
            value_second.add(v, f2);
        }

        let hits = &quantities.hit_gradient[block.clone()];
        if hits.iter().fold(true, |none, gradient| none & gradient.is_nan()) {
            return;
        }
        quantities.gradient.1.write_bins(hits, gradient);
        quantities.hit_value.1.write_bins(&quantities.hit_value.0[block.clone()], hit_value);
        quantities.distance.1.write_bins(&quantities.distance.0[block], distance);
        for (((&v, &g), &at_hit), &d) in value.iter().zip(&*gradient).zip(&*hit_value).zip(&*distance) {
            value_hit.add(v, g);
            hit_hit.add(at_hit, g);
            distances.add(d, 0);
        }
    }

    fn plus(mut self, other: Self) -> Self {
        self.tables.iter_mut().zip(other.tables).for_each(|(sum, table)| {
            sum.counts.iter_mut().zip(table.counts).for_each(|(sum, count)| *sum += count);
        });
        self
    }
}

/// Counts over one axis or two, with one bin more along each for what has no place on it.
struct Table {
    width: usize,
    counts: Vec<u64>,
}

impl Table {
    fn new(axes: &[HistogramAxis]) -> Self {
        let lens = axes.iter().map(|axis| axis.bins as usize + 1);
        Self { width: axes[0].bins as usize + 1, counts: vec![0; lens.product()] }
    }

    #[inline(always)]
    fn add(&mut self, x: u32, y: u32) {
        self.counts[y as usize * self.width + x as usize] += 1;
    }

    /// Without what has no place.
    fn counts(&self) -> Vec<u64> {
        let rows = (self.counts.len() / self.width - 1).max(1);
        self.counts.chunks(self.width).take(rows).flat_map(|row| &row[..self.width - 1]).copied().collect()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use voxrole_pack::GridGeometry;

    use super::*;

    fn axis_of(scalars: Scalars, slope: f64) -> HistogramAxis {
        let geometry = GridGeometry::axis_aligned([scalars.len() as u32, 1, 1], [1.0; 3]);
        let range = scalars.finite_range().expect("finite numbers");
        value_axis(&Grid::with_mapping("g", geometry, scalars, slope, 0.0).expect("a grid"), range)
    }

    #[test]
    fn integer_bins_hold_equally_many_numbers() {
        let axis = axis_of(Scalars::U16((0..=1300).collect()), 1.0);
        let mut counts = vec![0; axis.bins as usize];
        (0..=1300).for_each(|value| counts[axis.bin_of(f64::from(value))] += 1);
        assert!(counts[..counts.len() - 1].iter().all(|&count| count == 6), "{counts:?}");
        assert_eq!(axis_of(Scalars::U8(vec![3, 250]), 1.0).bins, 248);
    }

    #[test]
    fn negative_slopes_and_constants_still_give_rising_axes() {
        let axis = axis_of(Scalars::I16(vec![0, 10]), -2.0);
        assert_eq!((axis.low, axis.high, axis.bins), (-21.0, 1.0, 11));
        let axis = axis_of(Scalars::F32(vec![4.0, 4.0]), 1.0);
        assert!(axis.low < 4.0 && axis.high > 4.0);
    }

    /// One voxel after the other, by the axes' own rule.
    fn naive(quantities: &Quantities<'_>, voxels: usize) -> Vec<Vec<u64>> {
        let place = |number: f64, binning: &Binning| {
            let physical = binning.slope.mul_add(number, binning.intercept);
            physical.is_finite().then(|| binning.axis.bin_of(physical))
        };
        let float = |(numbers, binning): &(&[f32], Binning), voxel: usize| place(f64::from(numbers[voxel]), binning);
        let value = |voxel: usize| place(quantities.value.0.get(voxel), &quantities.value.1);
        let gradient = |voxel| float(&quantities.gradient, voxel);
        let second = |voxel| float(&quantities.second_derivative, voxel);
        let at_hit = |voxel| float(&(quantities.hit_gradient, quantities.gradient.1), voxel);
        let hit_value = |voxel| float(&quantities.hit_value, voxel);
        let distance = |voxel| float(&quantities.distance, voxel);
        let count = |axes: &[HistogramAxis], bins: &dyn Fn(usize) -> Option<(usize, usize)>| {
            let mut counts = vec![0; axes.iter().map(|axis| axis.bins as usize).product()];
            for (x, y) in (0..voxels).filter_map(bins) {
                counts[y * axes[0].bins as usize + x] += 1;
            }
            counts
        };
        let axes = quantities.axes();
        vec![
            count(&axes[0], &|voxel| value(voxel).zip(gradient(voxel))),
            count(&axes[1], &|voxel| value(voxel).zip(second(voxel))),
            count(&axes[2], &|voxel| value(voxel).zip(at_hit(voxel))),
            count(&axes[3], &|voxel| hit_value(voxel).zip(at_hit(voxel))),
            count(&axes[4], &|voxel| distance(voxel).map(|bin| (bin, 0))),
        ]
    }

    fn number() -> impl Strategy<Value = f32> {
        prop_oneof![8 => -20.0_f32..20.0, 1 => any::<f32>(), 1 => Just(f32::NAN), 1 => Just(f32::INFINITY)]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn counts_are_those_of_a_plain_loop(
            period in prop::collection::vec([number(), number(), number()], 1..300),
            bytes in any::<bool>(),
            slope in prop_oneof![Just(1.0), -3.0_f64..3.0, Just(1e300)],
            intercept in -5.0_f64..5.0,
        ) {
            let voxels = CHUNK + 1700;
            // Whole blocks without a hit among others.
            let none = |voxel: usize| (voxel >> 11).is_multiple_of(2);
            let field = |which: usize, step: usize| -> Vec<f32> {
                (0..voxels).map(|voxel| period[voxel * step % period.len()][which]).collect()
            };
            let [values, gradient, second] = [field(0, 1), field(1, 1), field(1, 7)];
            let [mut hit_gradient, mut hit_value, mut distance] = [field(2, 1), field(2, 3), field(1, 5)];
            for voxel in 0..voxels {
                if none(voxel) || hit_gradient[voxel].is_nan() {
                    [hit_gradient[voxel], hit_value[voxel], distance[voxel]] = [f32::NAN; 3];
                }
            }
            let scalars = if bytes {
                Scalars::U8(values.iter().map(|&value| value as u8).collect())
            } else {
                Scalars::F32(values)
            };
            let binning = |slope, intercept, bins| {
                Binning { slope, intercept, axis: HistogramAxis { low: -7.5, high: 11.0, bins } }
            };
            let quantities = Quantities {
                value: (&scalars, binning(slope, intercept, 19)),
                gradient: (&gradient, binning(0.7, 0.0, 13)),
                second_derivative: (&second, binning(1.3, 0.0, 8)),
                hit_gradient: &hit_gradient,
                hit_value: (&hit_value, binning(0.9, 1.0, 19)),
                distance: (&distance, binning(0.5, 0.0, 7)),
            };
            let found: Vec<_> = count(&quantities).into_iter().map(|histogram| histogram.counts).collect();
            prop_assert_eq!(found, naive(&quantities, voxels));
        }
    }
}
