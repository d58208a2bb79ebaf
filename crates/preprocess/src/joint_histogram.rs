//! Histograms over all voxels, at full precision.

use std::convert::Infallible;

use multiversion::multiversion;
use rayon::prelude::*;
use voxrole_pack::histogram::HistogramShape;
use voxrole_pack::reused::Reused;
use voxrole_pack::scalar::{Scalar, par_range_within};
use voxrole_pack::{Histogram, HistogramAxis, HistogramKind, ScalarType, Scalars, with_scalars};

use crate::source::Source;

/// Most bins of an axis of a joint histogram.
pub const BINS: u32 = 256;
/// Bins of the distance histogram: a tenth of L_min each at the default `d_max`.
pub const DISTANCE_BINS: u32 = 300;

/// Voxels that one task counts.
const CHUNK: usize = 1 << 17;
/// Voxels whose bins are found at once: their bins stay in the first cache.
const BLOCK: usize = 1 << 10;
/// The last bits of the sum of this number and a smaller whole one are the smaller one.
const WHOLE: f64 = (1_u64 << 52) as f64;

/// The value axis of a volume: whole numbers per bin for integer types, so that no bin is favoured; [`BINS`] equal bins
/// over the finite range for floats. `range` is that of the finite stored numbers.
#[must_use]
pub fn value_axis(source: &Source<'_>, range: [f64; 2]) -> HistogramAxis {
    let [low, high] = range;
    let stored = if matches!(source.scalar_type(), ScalarType::F32 | ScalarType::F64) {
        widened(low, high, BINS)
    } else {
        let count = high - low + 1.0;
        let per_bin = (count / f64::from(BINS)).ceil();
        let bins = (count / per_bin).ceil();
        HistogramAxis { low: low - 0.5, high: low - 0.5 + bins * per_bin, bins: bins as u32 }
    };
    let [a, b] = [stored.low, stored.high].map(|end| source.slope.mul_add(end, source.intercept));
    // Numbers that differ may be one physical value, but for rounding.
    widened(a.min(b), a.max(b), stored.bins)
}

/// An axis over a range that may be empty.
#[must_use]
pub fn widened(low: f64, high: f64, bins: u32) -> HistogramAxis {
    if low < high && (high - low).is_finite() {
        return HistogramAxis { low, high, bins };
    }
    let margin = if low == 0.0 { 1.0 } else { (low.abs() * 0.5).max(f64::MIN_POSITIVE) };
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

/// How many bins of a power of two wide hold numbers of a magnitude: what lets parts of a volume be counted one by one,
/// each with bins as wide as it needs, and be put together exactly.
#[derive(Clone, Copy, Debug, PartialEq)]
struct PowerOfTwoBins {
    /// The largest magnitude that there is.
    largest: f32,
    /// Bins below 0.
    below: u32,
}

impl PowerOfTwoBins {
    /// For numbers from 0 up.
    fn positive(largest: f32) -> Self {
        Self { largest, below: 0 }
    }

    /// For numbers of both signs.
    fn signed(largest: f32) -> Self {
        Self { largest, below: BINS / 2 }
    }

    /// log₂ of a bin's width: the smallest with which all numbers have a bin. Of nothing but zeros it is that of f32's
    /// smallest number.
    fn exponent(self) -> i32 {
        let above = if self.largest > 0.0 { (f64::from(self.largest).to_bits() >> 52) as i32 - 1022 } else { -148 };
        above - (BINS - self.below).ilog2() as i32
    }

    /// Writes every number's bin; one behind the last for NaN and infinite ones.
    fn write_bins(self, numbers: &[f32], bins: &mut [u32]) {
        write_bins_of_width(numbers, f64::from(-self.exponent()).exp2(), self.below, bins);
    }

    /// For the numbers of both.
    fn joined(self, other: Self) -> Self {
        Self { largest: self.largest.max(other.largest), ..self }
    }

    /// The bins that are needed, and the axis that they make where a number of 1 is `scale` in physical units.
    fn axis(self, scale: f64) -> (std::ops::Range<usize>, HistogramAxis) {
        let (below, all) = (self.below as usize, BINS as usize);
        let low_end = |bins: f64| if below > 0 { -bins } else { 0.0 };
        if self.largest == 0.0 {
            return (0..all, HistogramAxis { low: low_end(1.0), high: 1.0, bins: BINS });
        }
        let width = f64::from(self.exponent()).exp2();
        let place = f64::from(self.largest) / width;
        let needed = if below > 0 { place.ceil().max(place.floor() + 1.0) } else { place.floor() + 1.0 };
        let (low, high) = (low_end(needed) * width * scale, needed * width * scale);
        let range = if below > 0 { below - needed as usize..below + needed as usize } else { 0..needed as usize };
        let bins = range.len() as u32;
        (range, widened(low, high, bins))
    }
}

/// As [`PowerOfTwoBins::write_bins`]: exact, because nothing is rounded before the floor.
#[multiversion(targets("x86_64+avx2+fma"))]
fn write_bins_of_width(numbers: &[f32], per_width: f64, below: u32, bins: &mut [u32]) {
    for (bin, &number) in bins.iter_mut().zip(numbers) {
        let place = (f64::from(number) * per_width).floor() + f64::from(below);
        let place = (place + WHOLE).to_bits() as u32;
        *bin = if number.is_finite() { place } else { BINS };
    }
}

/// What the histograms count: numbers of voxels, x fastest.
pub struct Quantities<'a> {
    /// The value as stored.
    pub value: &'a Scalars,
    /// Gradient magnitude.
    pub gradient: &'a [f32],
    /// Second derivative along the gradient.
    pub second_derivative: &'a [f32],
    /// Gradient magnitude at the hit; NaN without one.
    pub hit_gradient: &'a [f32],
    /// Value at the hit; NaN without one.
    pub hit_value: &'a [f32],
    /// Signed distance to the boundary; NaN or infinite without one.
    pub distance: &'a [f32],
}

/// How the numbers of a volume become physical, and bins of those axes that are known beforehand.
#[derive(Clone, Copy, Debug)]
pub struct Axes {
    /// Of stored values.
    pub value: Binning,
    /// Of values at hits.
    pub hit_value: Binning,
    /// Of distances.
    pub distance: Binning,
    /// Physical gradient magnitude per working one.
    pub gradient_scale: f64,
    /// Physical second derivative per working one.
    pub second_derivative_scale: f64,
}

/// Counts of a part of a volume. A voxel counts where all of a histogram's quantities are finite.
#[derive(Clone, Debug, PartialEq)]
pub struct Tally {
    gradient: PowerOfTwoBins,
    second_derivative: PowerOfTwoBins,
    /// In the order of [`HistogramKind::ALL`].
    tables: [Table; 5],
}

impl Tally {
    /// Counts nothing.
    #[must_use]
    pub fn empty(axes: &Axes) -> Self {
        let bins = axes.value.axis.bins;
        let tables = [Table::new(bins, BINS), Table::new(bins, BINS), Table::new(bins, BINS), Table::new(bins, BINS)];
        let [a, b, c, d] = tables;
        Self {
            gradient: PowerOfTwoBins::positive(0.0),
            second_derivative: PowerOfTwoBins::signed(0.0),
            tables: [a, b, c, d, Table::new(axes.distance.axis.bins, 1)],
        }
    }

    /// Counts all voxels of a part.
    #[must_use]
    pub fn new(quantities: &Quantities<'_>, axes: &Axes) -> Self {
        let range = |values| par_range_within(values, f32::MIN, f32::MAX).unwrap_or_default();
        let magnitude = |values| range(values).into_iter().fold(0.0_f32, |largest, end| largest.max(end.abs()));
        // A spline may be steeper between the voxels than on any of them.
        let steepest = magnitude(quantities.gradient).max(magnitude(quantities.hit_gradient));
        let gradient = PowerOfTwoBins::positive(steepest);
        let second_derivative = PowerOfTwoBins::signed(magnitude(quantities.second_derivative));
        let empty = Self { gradient, second_derivative, ..Self::empty(axes) };
        let counters = Reused::default();
        with_scalars!(quantities.value, values => {
            (0..values.len().div_ceil(CHUNK)).into_par_iter().with_max_len(1).for_each(|chunk| {
                let voxels = chunk * CHUNK..((chunk + 1) * CHUNK).min(values.len());
                let Ok(()) = counters.lend(
                    || Ok::<_, Infallible>(Counters::new(empty.clone(), *axes)),
                    |counters| {
                        for start in voxels.clone().step_by(BLOCK) {
                            counters.count(quantities, values, start, (voxels.end - start).min(BLOCK));
                        }
                    },
                );
            });
        });
        counters.into_all().into_iter().fold(empty, |sum, counters| sum.plus(counters.tally))
    }

    /// The counts of both parts.
    #[must_use]
    pub fn plus(mut self, mut other: Self) -> Self {
        let gradient = self.gradient.joined(other.gradient);
        let second_derivative = self.second_derivative.joined(other.second_derivative);
        for tally in [&mut self, &mut other] {
            let wider = gradient.exponent() - tally.gradient.exponent();
            for table in [0, 2, 3] {
                tally.tables[table].widen(wider as u32, 0);
            }
            let wider = second_derivative.exponent() - tally.second_derivative.exponent();
            tally.tables[1].widen(wider as u32, second_derivative.below);
            (tally.gradient, tally.second_derivative) = (gradient, second_derivative);
        }
        for (sum, table) in self.tables.iter_mut().zip(&other.tables) {
            sum.counts.iter_mut().zip(&table.counts).for_each(|(sum, count)| *sum += count);
        }
        self
    }

    /// Largest gradient magnitude of a voxel or a hit, in working units.
    #[must_use]
    pub fn largest_gradient(&self) -> f32 {
        self.gradient.largest
    }

    /// Largest magnitude of a second derivative, in working units.
    #[must_use]
    pub fn largest_second_derivative(&self) -> f32 {
        self.second_derivative.largest
    }

    /// The histograms, in the order of [`HistogramKind::ALL`]; bins of gradient magnitude and second derivative are as wide as a
    /// power of two, and as many as are needed, more than [`BINS`]/2.
    #[must_use]
    pub fn histograms(&self, axes: &Axes) -> Vec<Histogram> {
        let gradient = self.gradient.axis(axes.gradient_scale);
        let second_derivative = self.second_derivative.axis(axes.second_derivative_scale);
        let joint = [&gradient, &second_derivative, &gradient, &gradient];
        let of_kind = |(kind, table): (usize, &Table)| {
            let (rows, shape) = match joint.get(kind) {
                Some((rows, axis)) => (rows.clone(), vec![axes.value.axis, *axis]),
                None => (0..1, vec![axes.distance.axis]),
            };
            let shape = HistogramShape { kind: HistogramKind::ALL[kind], axes: shape };
            Histogram { counts: table.rows(rows), shape }
        };
        self.tables.iter().enumerate().map(of_kind).collect()
    }

    /// All there is, as numbers to be kept.
    #[must_use]
    pub fn to_numbers(&self) -> Vec<u64> {
        let largest =
            [self.gradient.largest, self.second_derivative.largest].map(|largest| u64::from(largest.to_bits()));
        let mut numbers = Vec::from(largest);
        for table in &self.tables {
            // Most bins of a small part are empty: only the others are kept, each behind its place.
            let counted = table.counts.iter().zip(0..).filter(|(count, _)| **count > 0);
            let start = numbers.len();
            numbers.push(0);
            numbers.extend(counted.flat_map(|(&count, place)| [place, count]));
            numbers[start] = (numbers.len() - start - 1) as u64;
        }
        numbers
    }

    /// What [`Self::to_numbers`] made numbers of; `None` where those are others.
    #[must_use]
    pub fn from_numbers(numbers: &[u64], axes: &Axes) -> Option<Self> {
        let mut tally = Self::empty(axes);
        let [gradient, second_derivative, counts @ ..] = numbers else { return None };
        tally.gradient.largest = f32::from_bits(*gradient as u32);
        tally.second_derivative.largest = f32::from_bits(*second_derivative as u32);
        let mut rest = counts;
        for table in &mut tally.tables {
            let (&len, behind) = rest.split_first()?;
            let (own, others) = behind.split_at_checked(usize::try_from(len).ok()?)?;
            for &[place, count] in own.as_chunks().0 {
                *table.counts.get_mut(usize::try_from(place).ok()?)? = count;
            }
            rest = others;
        }
        rest.is_empty().then_some(tally)
    }
}

/// One thread's counts, and the bins of the block at hand.
struct Counters {
    tally: Tally,
    axes: Axes,
    value: [u32; BLOCK],
    gradient: [u32; BLOCK],
    second_derivative: [u32; BLOCK],
    hit_value: [u32; BLOCK],
    distance: [u32; BLOCK],
}

impl Counters {
    fn new(tally: Tally, axes: Axes) -> Self {
        let bins = [0; BLOCK];
        Self { tally, axes, value: bins, gradient: bins, second_derivative: bins, hit_value: bins, distance: bins }
    }

    /// Counts a block. Tables take turns, because one that counts the same bin twice in a row waits for itself.
    fn count<T: Scalar>(&mut self, quantities: &Quantities<'_>, values: &[T], start: usize, len: usize) {
        let block = start..start + len;
        let Tally { gradient: gradients, second_derivative: seconds, tables } = &mut self.tally;
        let [value_gradient, value_second, value_hit, hit_hit, distances] = tables;
        let [value, gradient, second, hit_value, distance] = [
            &mut self.value[..len],
            &mut self.gradient[..len],
            &mut self.second_derivative[..len],
            &mut self.hit_value[..len],
            &mut self.distance[..len],
        ];
        self.axes.value.write_bins(&values[block.clone()], value);
        gradients.write_bins(&quantities.gradient[block.clone()], gradient);
        seconds.write_bins(&quantities.second_derivative[block.clone()], second);
        for ((&v, &g), &f2) in value.iter().zip(&*gradient).zip(&*second) {
            value_gradient.add(v, g);
            value_second.add(v, f2);
        }

        let hits = &quantities.hit_gradient[block.clone()];
        if hits.iter().fold(true, |none, gradient| none & gradient.is_nan()) {
            return;
        }
        gradients.write_bins(hits, gradient);
        self.axes.hit_value.write_bins(&quantities.hit_value[block.clone()], hit_value);
        self.axes.distance.write_bins(&quantities.distance[block], distance);
        for (((&v, &g), &at_hit), &d) in value.iter().zip(&*gradient).zip(&*hit_value).zip(&*distance) {
            value_hit.add(v, g);
            hit_hit.add(at_hit, g);
            distances.add(d, 0);
        }
    }
}

/// Counts over two axes, or over one, with one bin more along each for what has no place on it.
#[derive(Clone, Debug, PartialEq)]
struct Table {
    width: usize,
    counts: Vec<u64>,
}

impl Table {
    fn new(across: u32, up: u32) -> Self {
        let [width, height] = [across, up].map(|bins| bins as usize + 1);
        Self { width, counts: vec![0; width * height] }
    }

    #[inline(always)]
    fn add(&mut self, x: u32, y: u32) {
        self.counts[y as usize * self.width + x as usize] += 1;
    }

    /// Makes the bins along y wider by a power of two; `below` of them lie below 0.
    fn widen(&mut self, power: u32, below: u32) {
        if power == 0 {
            return;
        }
        let mut counts = vec![0; self.counts.len()];
        for (y, row) in self.counts.chunks_exact(self.width).enumerate() {
            // What has no place stays so.
            let wide = ((y as i64 - i64::from(below)) >> power.min(63)) + i64::from(below);
            let wide = if y == BINS as usize { y } else { wide as usize };
            counts[wide * self.width..][..self.width].iter_mut().zip(row).for_each(|(sum, count)| *sum += count);
        }
        self.counts = counts;
    }

    /// Some rows, without what has no place.
    fn rows(&self, rows: std::ops::Range<usize>) -> Vec<u64> {
        let rows = rows.map(|y| &self.counts[y * self.width..][..self.width - 1]);
        rows.flatten().copied().collect()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use voxrole_pack::GridGeometry;

    use super::*;
    use crate::Grid;

    fn axis_of(scalars: Scalars, slope: f64) -> HistogramAxis {
        mapped_axis_of(scalars, slope, 0.0)
    }

    fn mapped_axis_of(scalars: Scalars, slope: f64, intercept: f64) -> HistogramAxis {
        let geometry = GridGeometry::axis_aligned([scalars.len() as u32, 1, 1], [1.0; 3]);
        let range = scalars.finite_range().expect("finite numbers");
        value_axis(&Source::from(&Grid::with_mapping("g", geometry, scalars, slope, intercept).expect("a grid")), range)
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
        let axis = axis_of(Scalars::F64(vec![5e-324; 2]), 1.0);
        assert!(axis.low < 5e-324 && axis.high > 5e-324);
        // All the same but for rounding.
        let axis = mapped_axis_of(Scalars::I16(vec![0, 10]), 1e-17, 1000.0);
        assert!(axis.low < 1000.0 && axis.high > 1000.0);
    }

    /// One voxel after the other, by the axes' own rule.
    fn naive(quantities: &Quantities<'_>, axes: &Axes, histograms: &[Histogram]) -> Vec<Vec<u64>> {
        let place = |number: f64, binning: &Binning| {
            let physical = binning.slope.mul_add(number, binning.intercept);
            physical.is_finite().then(|| binning.axis.bin_of(physical))
        };
        let of_width = |number: f32, axis: &HistogramAxis, scale: f64| {
            // Widths are powers of two in working units, where rounding is none of this test's concern.
            let width = ((axis.high - axis.low) / f64::from(axis.bins) / scale).log2().round().exp2();
            let below = (-axis.low / (axis.high - axis.low) * f64::from(axis.bins)).round();
            number.is_finite().then(|| ((f64::from(number) / width).floor() + below) as usize)
        };
        let axis = |kind: usize| &histograms[kind].shape.axes[1];
        let value = |voxel: usize| place(quantities.value.get(voxel), &axes.value);
        let gradient = |voxel: usize| of_width(quantities.gradient[voxel], axis(0), axes.gradient_scale);
        let second =
            |voxel: usize| of_width(quantities.second_derivative[voxel], axis(1), axes.second_derivative_scale);
        let at_hit = |voxel: usize| of_width(quantities.hit_gradient[voxel], axis(2), axes.gradient_scale);
        let hit_value = |voxel: usize| place(f64::from(quantities.hit_value[voxel]), &axes.hit_value);
        let distance = |voxel: usize| place(f64::from(quantities.distance[voxel]), &axes.distance);
        let count = |kind: usize, bins: &dyn Fn(usize) -> Option<(usize, usize)>| {
            let axes = &histograms[kind].shape.axes;
            let mut counts = vec![0; axes.iter().map(|axis| axis.bins as usize).product()];
            for (x, y) in (0..quantities.value.len()).filter_map(bins) {
                counts[y * axes[0].bins as usize + x] += 1;
            }
            counts
        };
        vec![
            count(0, &|voxel| value(voxel).zip(gradient(voxel))),
            count(1, &|voxel| value(voxel).zip(second(voxel))),
            count(2, &|voxel| value(voxel).zip(at_hit(voxel))),
            count(3, &|voxel| hit_value(voxel).zip(at_hit(voxel))),
            count(4, &|voxel| distance(voxel).map(|bin| (bin, 0))),
        ]
    }

    fn number() -> impl Strategy<Value = f32> {
        prop_oneof![8 => -20.0_f32..20.0, 1 => any::<f32>(), 1 => Just(f32::NAN), 1 => Just(f32::INFINITY)]
    }

    #[test]
    fn bins_are_as_few_and_as_wide_as_they_must_be() {
        for largest in [1e-30_f32, 0.7, 1.0, 255.9, 256.0, 3e38] {
            for bins in [PowerOfTwoBins::positive(largest), PowerOfTwoBins::signed(largest)] {
                let (rows, axis) = bins.axis(1.0);
                let mut found = [0; 2];
                bins.write_bins(&[largest, if bins.below > 0 { -largest } else { 0.0 }], &mut found);
                assert!(found.iter().all(|&bin| rows.contains(&(bin as usize))), "{largest}: {found:?} {rows:?}");
                assert!((129..=256).contains(&axis.bins) && axis.high > f64::from(largest), "{largest}: {axis:?}");
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn counts_are_those_of_a_plain_loop_however_the_volume_is_cut(
            period in prop::collection::vec([number(), number(), number()], 1..300),
            bytes in any::<bool>(),
            slope in prop_oneof![Just(1.0), -3.0_f64..3.0, Just(1e300)],
            intercept in -5.0_f64..5.0,
            cut in 0..CHUNK + 1700,
        ) {
            let voxels = CHUNK + 1700;
            // Whole blocks without a hit among others.
            let none = |voxel: usize| (voxel >> 11).is_multiple_of(2);
            let field = |which: usize, step: usize| -> Vec<f32> {
                (0..voxels).map(|voxel| period[voxel * step % period.len()][which]).collect()
            };
            let [values, second] = [field(0, 1), field(1, 7)];
            let gradient: Vec<f32> = field(1, 1).into_iter().map(f32::abs).collect();
            let [mut hit_gradient, mut hit_value, mut distance] = [field(2, 1), field(2, 3), field(1, 5)];
            for voxel in 0..voxels {
                hit_gradient[voxel] = hit_gradient[voxel].abs();
                if none(voxel) || hit_gradient[voxel].is_nan() {
                    [hit_gradient[voxel], hit_value[voxel], distance[voxel]] = [f32::NAN; 3];
                }
            }
            let scalars = |range: std::ops::Range<usize>| if bytes {
                Scalars::U8(values[range].iter().map(|&value| value as u8).collect())
            } else {
                Scalars::F32(values[range].to_vec())
            };
            let binning = |slope, intercept, bins| {
                Binning { slope, intercept, axis: HistogramAxis { low: -7.5, high: 11.0, bins } }
            };
            let axes = Axes {
                value: binning(slope, intercept, 19),
                hit_value: binning(0.9, 1.0, 19),
                distance: binning(0.5, 0.0, 7),
                gradient_scale: 0.7,
                second_derivative_scale: 1.3,
            };
            let part = |range: std::ops::Range<usize>| {
                let value = scalars(range.clone());
                let quantities = Quantities {
                    value: &value,
                    gradient: &gradient[range.clone()],
                    second_derivative: &second[range.clone()],
                    hit_gradient: &hit_gradient[range.clone()],
                    hit_value: &hit_value[range.clone()],
                    distance: &distance[range],
                };
                Tally::new(&quantities, &axes)
            };
            let whole = part(0..voxels);
            let histograms = whole.histograms(&axes);
            prop_assert!(part(0..cut).plus(part(cut..voxels)).histograms(&axes) == histograms);
            let kept = Tally::from_numbers(&whole.to_numbers(), &axes);
            prop_assert!(kept.as_ref() == Some(&whole));
            let value = scalars(0..voxels);
            let quantities = Quantities {
                value: &value,
                gradient: &gradient,
                second_derivative: &second,
                hit_gradient: &hit_gradient,
                hit_value: &hit_value,
                distance: &distance,
            };
            let expected = naive(&quantities, &axes, &histograms);
            let found: Vec<_> = histograms.into_iter().map(|histogram| histogram.counts).collect();
            prop_assert!(found == expected);
        }
    }
}
