//! αu(v, g): the regions of a transfer function as a table over value and gradient magnitude at the hit.

use std::ops::Range;

use rayon::prelude::*;
use voxrole_pack::HitGradientQuantization;

use crate::state::{Region, Shape, TransferFunction};

/// Bins of value.
pub const VALUE_BINS: usize = 1024;
/// Bins of gradient magnitude at the hit.
pub const GRADIENT_BINS: usize = 512;

/// αu and the colour for every bin of (v, g), looked up without interpolation: g is label-like, never blended.
///
/// Several regions at once: the largest opacity counts, colours mix in proportion to opacity.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OpacityTable {
    /// Red, green, blue and αu as shares of 65535; value fastest.
    entries: Vec<[u16; 4]>,
    /// Which αd goes with each entry: that of the region with the largest opacity there.
    emphases: Vec<u16>,
}

impl OpacityTable {
    /// The table of a transfer function's regions and curve over the file's ranges.
    #[must_use]
    pub fn new(
        transfer_function: &TransferFunction,
        value_range: [f64; 2],
        hit_gradient: HitGradientQuantization,
    ) -> Self {
        let TransferFunction { regions, curve, .. } = transfer_function;
        let width = (value_range[1] - value_range[0]) / VALUE_BINS as f64;
        let middles = (0..VALUE_BINS).map(|bin| (bin as f64 + 0.5).mul_add(width, value_range[0]) as f32);
        let curve: Vec<_> = middles.filter_map(|value| curve.at(value)).collect();
        let axes = [(value_range, VALUE_BINS), ([hit_gradient.low, hit_gradient.high].map(f64::from), GRADIENT_BINS)];
        let mut own_emphases = 0;
        let binned = regions.iter().map(|region| {
            own_emphases += u16::from(region.emphasis.is_some());
            BinnedRegion::new(region, if region.emphasis.is_some() { own_emphases } else { 0 }, axes)
        });
        let binned: Vec<_> = binned.collect();
        let mut table =
            Self { entries: vec![[0; 4]; VALUE_BINS * GRADIENT_BINS], emphases: vec![0; VALUE_BINS * GRADIENT_BINS] };
        let rows = table.entries.par_chunks_exact_mut(VALUE_BINS).zip(table.emphases.par_chunks_exact_mut(VALUE_BINS));
        // A row at a time: its sums stay in the nearest cache.
        rows.enumerate().for_each(|(row, (entries, emphases))| {
            let mut sums = [RegionSum::default(); VALUE_BINS];
            for (sum, &(color, opacity)) in sums.iter_mut().zip(&curve) {
                sum.add(color, 0, opacity);
            }
            binned.iter().for_each(|region| region.add_to(row, &mut sums));
            for ((sum, entry), emphasis) in sums.iter().zip(entries).zip(emphases) {
                if sum.weight > 0.0 {
                    (*entry, *emphasis) = (sum.entry(), sum.emphasis);
                }
            }
        });
        table
    }

    /// All entries, value fastest, [`VALUE_BINS`] times [`GRADIENT_BINS`] of them.
    #[must_use]
    pub fn entries(&self) -> &[[u16; 4]] {
        &self.entries
    }

    /// The index of each entry's αd in [`super::EmphasisTable`], in the same order.
    #[must_use]
    pub fn emphases(&self) -> &[u16] {
        &self.emphases
    }

    /// Which bins have an opacity at all.
    #[must_use]
    pub fn lit_bins(&self) -> LitBins {
        let mut counts = vec![0; (VALUE_BINS + 1) * (GRADIENT_BINS + 1)];
        for (row, entries) in self.entries.chunks_exact(VALUE_BINS).enumerate() {
            let (before, after) = counts.split_at_mut((row + 1) * (VALUE_BINS + 1));
            let before = &before[row * (VALUE_BINS + 1)..];
            let mut in_row = 0;
            for (bin, entry) in entries.iter().enumerate() {
                in_row += u32::from(entry[3] > 0);
                after[bin + 1] = before[bin + 1] + in_row;
            }
        }
        LitBins { counts }
    }

    /// Red, green, blue and αu for an interpolated value in 0..=65535 (shares of the value range) and a stored
    /// gradient magnitude, and the index of the αd that goes with them; `stored_gradient` is not 0, which means that there
    /// is none.
    #[must_use]
    pub fn look_up(&self, value: f32, stored_gradient: u16) -> ([f32; 4], usize) {
        let bin = gradient_bin(stored_gradient) * VALUE_BINS + value_bin(value);
        (self.entries[bin].map(|share| f32::from(share) / 65535.0), usize::from(self.emphases[bin]))
    }

    /// αu of a stored value, as a share of 65535, and the index of the αd that goes with it: those of [`Self::look_up`].
    #[must_use]
    #[inline]
    pub fn opacity_of(&self, stored_value: u16, stored_gradient: u16) -> (u16, usize) {
        let bin = gradient_bin(stored_gradient) * VALUE_BINS + usize::from(stored_value) * VALUE_BINS / 65536;
        (self.entries[bin][3], usize::from(self.emphases[bin]))
    }
}

/// Whether any of a rectangle of bins has an opacity, at the cost of four numbers: a summed-area table.
#[derive(Clone, Debug)]
pub struct LitBins {
    /// Bins with an opacity below and to the left of each corner of a bin.
    counts: Vec<u32>,
}

impl LitBins {
    /// Whether any value that is interpolated between two stored ones has an opacity together with any stored gradient
    /// magnitude between two; `gradient` without any, its first larger than its last, has none.
    #[must_use]
    pub fn any(&self, value: [u16; 2], gradient: [u16; 2]) -> bool {
        if gradient[0] > gradient[1] {
            return false;
        }
        let [left, last] = value_bins(value);
        let right = last + 1;
        let [below, above] = [gradient_bin(gradient[0]), gradient_bin(gradient[1]) + 1];
        let count = |row: usize, bin: usize| self.counts[row * (VALUE_BINS + 1) + bin];
        count(above, right) + count(below, left) > count(above, left) + count(below, right)
    }
}

/// The bin of an interpolated value in 0..=65535. The factor is a power of two: exact on the CPU and the GPU.
pub(crate) fn value_bin(value: f32) -> usize {
    ((value * (VALUE_BINS as f32 / 65536.0)) as usize).min(VALUE_BINS - 1)
}

/// The first and the last bin of values that are interpolated between two stored ones. Interpolation rounds: far less than
/// half a stored number.
#[inline(always)]
pub(crate) fn value_bins(value: [u16; 2]) -> [usize; 2] {
    [value_bin(f32::from(value[0]) - 0.5), value_bin(f32::from(value[1]) + 0.5)]
}

/// The bin of a stored gradient magnitude, 1..=65535, in integers: the same everywhere.
pub(crate) fn gradient_bin(stored: u16) -> usize {
    usize::from(stored.saturating_sub(1)) * GRADIENT_BINS / 65535
}

/// A region over the bins.
struct BinnedRegion<'a> {
    region: &'a Region,
    /// Which αd is its own.
    emphasis: u16,
    /// Whether it is drawn as the rectangle around it.
    is_rectangle: bool,
    /// Of every bin of value and of gradient magnitude: of a rectangle its weight, of other shapes where in the region
    /// it lies.
    places: [Vec<f32>; 2],
    /// The first bin of value inside, and the one behind the last.
    bins: Range<usize>,
}

impl<'a> BinnedRegion<'a> {
    /// `axes`: the range of value and that of gradient magnitude, and into how many bins each is cut.
    fn new(region: &'a Region, emphasis: u16, axes: [([f64; 2], usize); 2]) -> Self {
        let extents = [region.value, region.gradient];
        // Only a rectangle is sure to hold the middle of a bin that it is narrower than.
        let is_narrow = extents
            .iter()
            .zip(axes)
            .any(|(extent, (range, bins))| f64::from(extent[1] - extent[0]) < (range[1] - range[0]) / bins as f64);
        let is_painted = matches!(region.shape, Shape::Painted(_));
        let is_rectangle = region.shape == Shape::Box || (is_narrow && !is_painted);
        let places = [0, 1].map(|axis: usize| {
            let (extent, (range, bins)) = (extents[axis], axes[axis]);
            if is_rectangle {
                axis_weights(extent, region.softness, range, bins)
            } else if is_painted {
                axis_shares(widened(extent, range, bins), range, bins)
            } else {
                axis_shares(extent.map(f64::from), range, bins)
            }
        });
        let is_inside = |&place: &f32| if is_rectangle { place > 0.0 } else { (0.0..=1.0).contains(&place) };
        let ends = places[0].iter().position(is_inside).zip(places[0].iter().rposition(is_inside));
        let bins = ends.map_or(0..0, |(first, last)| first..last + 1);
        Self { region, emphasis, is_rectangle, places, bins }
    }

    /// Adds the region to a row of bins.
    fn add_to(&self, row: usize, sums: &mut [RegionSum]) {
        let Self { region, emphasis, bins, places: [values, gradients], .. } = self;
        let gradient = gradients[row];
        let (sums, values) = (&mut sums[bins.clone()], &values[bins.clone()]);
        if self.is_rectangle {
            if gradient > 0.0 {
                for (sum, value) in sums.iter_mut().zip(values) {
                    sum.add(region.color, *emphasis, region.opacity * (gradient * value));
                }
            }
        } else if (0.0..=1.0).contains(&gradient) {
            let mut weights = [0.0; VALUE_BINS];
            let weights = &mut weights[..values.len()];
            region.shape.weights(region.softness, values, gradient, weights);
            for (sum, &weight) in sums.iter_mut().zip(&*weights).filter(|(_, weight)| **weight > 0.0) {
                sum.add(region.color, *emphasis, region.opacity * weight);
            }
        }
    }
}

/// How far each bin's middle lies inside a region along one axis, 0 to 1.
fn axis_weights(extent: [f32; 2], softness: f32, range: [f64; 2], bins: usize) -> Vec<f32> {
    let bin_width = (range[1] - range[0]) / bins as f64;
    let [low, high] = widened(extent, range, bins);
    let is_wider = high - low > f64::from(extent[1]) - f64::from(extent[0]);
    let fade = if is_wider { 0.0 } else { f64::from(softness.clamp(0.0, 0.5)) * (high - low) };
    (0..bins)
        .map(|bin| {
            let inside = {
                let middle = (bin as f64 + 0.5).mul_add(bin_width, range[0]);
                (middle - low).min(high - middle)
            };
            match (inside < 0.0, fade > 0.0) {
                (true, _) => 0.0,
                (false, true) => (inside / fade).min(1.0) as f32,
                (false, false) => 1.0,
            }
        })
        .collect()
}

/// Where each bin's middle lies in a region along one axis: 0 at its lower end, 1 at its upper one.
fn axis_shares([low, high]: [f64; 2], range: [f64; 2], bins: usize) -> Vec<f32> {
    let width = (range[1] - range[0]) / bins as f64;
    (0..bins).map(|bin| (((bin as f64 + 0.5).mul_add(width, range[0]) - low) / (high - low)) as f32).collect()
}

/// An extent, or a bin's width around it: a region between two bins' middles must not be lost, not even by rounding.
fn widened(extent: [f32; 2], range: [f64; 2], bins: usize) -> [f64; 2] {
    let [low, high] = extent.map(f64::from);
    let bin_width = (range[1] - range[0]) / bins as f64;
    if high - low >= bin_width {
        return [low, high];
    }
    let (middle, half) = (0.5 * (low + high), (0.5 + 1e-3) * bin_width);
    [middle - half, middle + half]
}

/// What the regions say of one bin.
#[derive(Clone, Copy, Default)]
struct RegionSum {
    opacity: f32,
    weight: f32,
    color: [f32; 3],
    emphasis: u16,
}

impl RegionSum {
    fn add(&mut self, color: [f32; 3], emphasis: u16, opacity: f32) {
        if opacity > self.opacity {
            (self.opacity, self.emphasis) = (opacity, emphasis);
        }
        self.weight += opacity;
        for (sum, channel) in self.color.iter_mut().zip(color) {
            *sum += opacity * channel;
        }
    }

    /// Colour and αu, where there is something.
    fn entry(&self) -> [u16; 4] {
        let share = |number: f32| (number.clamp(0.0, 1.0) * 65535.0 + 0.5) as u16;
        let [red, green, blue] = self.color.map(|channel| share(channel / self.weight));
        [red, green, blue, share(self.opacity)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::{PaintedMap, Region};

    const HIT_GRADIENT: HitGradientQuantization =
        HitGradientQuantization { low: 10.0, high: 50.0, steps: HitGradientQuantization::MOST_STEPS };
    const VALUE_RANGE: [f64; 2] = [-1000.0, 3000.0];

    fn region(value: [f32; 2], gradient: [f32; 2], color: [f32; 3], opacity: f32, softness: f32) -> Region {
        Region { shape: Shape::Box, value, gradient, color, opacity, softness, emphasis: None }
    }

    fn table_of(regions: &[Region], value_range: [f64; 2], hit_gradient: HitGradientQuantization) -> OpacityTable {
        let transfer_function = TransferFunction { regions: regions.to_vec(), ..TransferFunction::default() };
        OpacityTable::new(&transfer_function, value_range, hit_gradient)
    }

    /// The table at physical values.
    fn at(table: &OpacityTable, value: f64, gradient: f32) -> [f32; 4] {
        let share = (value - VALUE_RANGE[0]) / (VALUE_RANGE[1] - VALUE_RANGE[0]);
        table.look_up((share * 65535.0) as f32, HIT_GRADIENT.encode(gradient)).0
    }

    #[test]
    fn a_hard_region_is_all_or_nothing() {
        let table =
            table_of(&[region([0.0, 1000.0], [20.0, 30.0], [1.0, 0.5, 0.0], 0.6, 0.0)], VALUE_RANGE, HIT_GRADIENT);
        let [red, green, blue, opacity] = at(&table, 500.0, 25.0);
        assert!((opacity - 0.6).abs() < 1e-4 && red == 1.0 && (green - 0.5).abs() < 1e-4 && blue == 0.0);
        for (value, gradient) in [(-10.0, 25.0), (1010.0, 25.0), (500.0, 19.8), (500.0, 30.2)] {
            assert_eq!(at(&table, value, gradient)[3], 0.0, "{value} {gradient}");
        }
        for (value, gradient) in [(10.0, 20.2), (990.0, 29.8)] {
            assert!((at(&table, value, gradient)[3] - 0.6).abs() < 1e-4, "{value} {gradient}");
        }
    }

    #[test]
    fn soft_edges_fade_inwards() {
        let table = table_of(&[region([0.0, 1000.0], [10.0, 50.0], [1.0; 3], 1.0, 0.2)], VALUE_RANGE, HIT_GRADIENT);
        assert!((at(&table, 100.0, 30.0)[3] - 0.5).abs() < 0.02);
        assert!((at(&table, 900.0, 30.0)[3] - 0.5).abs() < 0.02);
        assert_eq!(at(&table, 300.0, 30.0)[3], 1.0);
        assert_eq!(at(&table, -5.0, 30.0)[3], 0.0);
    }

    #[test]
    fn shapes_light_what_lies_inside_them() {
        let of = |text: &str| table_of(&[text.parse().expect("a region")], VALUE_RANGE, HIT_GRADIENT);
        for (text, inside, outside) in [
            ("ellipse,0:1000,20:40,FFFFFF,0.6,0", [(500.0, 30.0), (150.0, 30.0)], [(100.0, 22.0), (900.0, 38.0)]),
            ("triangle,0:1000,20:40,FFFFFF,0.6,0", [(500.0, 25.0), (100.0, 39.0)], [(100.0, 25.0), (900.0, 25.0)]),
            ("polygon,0:20,1000:20,0:40,FFFFFF,0.6,0", [(100.0, 25.0), (100.0, 36.0)], [(900.0, 36.0), (600.0, 35.0)]),
        ] {
            let table = of(text);
            for (value, gradient) in inside {
                assert!((at(&table, value, gradient)[3] - 0.6).abs() < 1e-4, "{text} {value} {gradient}");
            }
            for (value, gradient) in outside {
                assert_eq!(at(&table, value, gradient)[3], 0.0, "{text} {value} {gradient}");
            }
        }
        // Soft inwards: halfway through the fade, half of the opacity.
        let soft = of("ellipse,0:1000,20:40,FFFFFF,1,0.2");
        assert!((at(&soft, 100.0, 30.0)[3] - 0.5).abs() < 0.02 && at(&soft, 500.0, 30.0)[3] == 1.0);
        // Narrower than a bin, and not lost.
        let narrow = of("ellipse,501.9:502.1,20:40,FFFFFF");
        assert_eq!(at(&narrow, 502.0, 30.0)[3], 1.0);
    }

    #[test]
    fn a_painted_map_weighs_the_opacity_of_its_rectangle() {
        let mut map = PaintedMap::blank();
        map.stroke([0.2, 0.75], [0.8, 0.75], [0.1, 0.1], false);
        let painted = |value| Region {
            shape: Shape::Painted(map.clone()),
            ..region(value, [20.0, 40.0], [0.0, 1.0, 0.0], 0.8, 0.0)
        };
        let table = table_of(&[painted([0.0, 1000.0])], VALUE_RANGE, HIT_GRADIENT);
        for (value, gradient, expected) in [
            (500.0, 35.0, 0.8),
            (250.0, 35.5, 0.8),
            // Halfway through the brush's soft half.
            (500.0, 36.5, 0.4),
            (500.0, 32.0, 0.0),
            (500.0, 25.0, 0.0),
            (50.0, 35.0, 0.0),
            (-50.0, 35.0, 0.0),
            (500.0, 45.0, 0.0),
        ] {
            let [_, green, _, opacity] = at(&table, value, gradient);
            assert!((opacity - expected).abs() < 0.03, "{value} {gradient}: {opacity}");
            assert!(green == 1.0 || opacity == 0.0);
        }
        // Narrower than a bin, and not lost; where nothing is painted there is nothing still.
        let narrow = table_of(&[painted([501.9, 502.1])], VALUE_RANGE, HIT_GRADIENT);
        assert!((at(&narrow, 502.0, 35.0)[3] - 0.8).abs() < 0.01 && at(&narrow, 502.0, 25.0)[3] == 0.0);
        let everywhere = [painted([f32::MIN, f32::MAX])];
        assert!((at(&table_of(&everywhere, VALUE_RANGE, HIT_GRADIENT), 0.0, 35.0)[3] - 0.8).abs() < 0.01);
    }

    #[test]
    fn a_curve_counts_for_every_gradient_magnitude() {
        let mut transfer_function = TransferFunction {
            curve: "0,FF0000,0;1000,0000FF,1".parse().expect("a curve"),
            ..TransferFunction::default()
        };
        let table = OpacityTable::new(&transfer_function, VALUE_RANGE, HIT_GRADIENT);
        for gradient in [10.0, 30.0, 50.0] {
            let [red, _, blue, opacity] = at(&table, 250.0, gradient);
            assert!((opacity - 0.25).abs() < 4e-3 && (red - 0.75).abs() < 4e-3 && (blue - 0.25).abs() < 4e-3);
            assert_eq!((at(&table, -10.0, gradient)[3], at(&table, 2000.0, gradient)[3]), (0.0, 1.0));
        }
        transfer_function.regions = vec![region([0.0, 1000.0], [20.0, 30.0], [0.0, 1.0, 0.0], 0.6, 0.0)];
        let both = OpacityTable::new(&transfer_function, VALUE_RANGE, HIT_GRADIENT);
        assert!((at(&both, 250.0, 25.0)[3] - 0.6).abs() < 1e-4 && (at(&both, 900.0, 25.0)[3] - 0.9).abs() < 4e-3);
    }

    #[test]
    fn overlapping_regions_keep_the_largest_opacity_and_mix_colours_by_opacity() {
        let regions = [
            region([0.0, 1000.0], [10.0, 50.0], [1.0, 0.0, 0.0], 0.6, 0.0),
            region([500.0, 1500.0], [10.0, 50.0], [0.0, 0.0, 1.0], 0.2, 0.0),
        ];
        let [red, _, blue, opacity] = at(&table_of(&regions, VALUE_RANGE, HIT_GRADIENT), 750.0, 30.0);
        assert!((opacity - 0.6).abs() < 1e-4 && (red - 0.75).abs() < 1e-4 && (blue - 0.25).abs() < 1e-4);
    }

    #[test]
    fn the_most_opaque_of_overlapping_regions_gives_the_opacity_by_distance() {
        let faint = region([0.0, 1000.0], [10.0, 50.0], [1.0, 0.0, 0.0], 0.2, 0.0);
        let own = |extent, opacity| Region {
            emphasis: Some("concave,1,2,7".parse().expect("an emphasis")),
            ..region(extent, [10.0, 50.0], [0.0, 0.0, 1.0], opacity, 0.0)
        };
        let regions = [own([0.0, 300.0], 0.1), faint, own([500.0, 1500.0], 0.6)];
        let table = table_of(&regions, VALUE_RANGE, HIT_GRADIENT);
        let emphasis = |value: f64| {
            let share = (value - VALUE_RANGE[0]) / (VALUE_RANGE[1] - VALUE_RANGE[0]);
            table.look_up((share * 65535.0) as f32, HIT_GRADIENT.encode(30.0)).1
        };
        assert_eq!([100.0, 400.0, 750.0, 1250.0].map(emphasis), [0, 0, 2, 2]);
    }

    #[test]
    fn a_region_narrower_than_a_bin_is_not_lost() {
        let table = table_of(&[region([501.9, 502.1], [30.04, 30.041], [1.0; 3], 1.0, 0.5)], VALUE_RANGE, HIT_GRADIENT);
        let lit = table.entries().iter().filter(|entry| entry[3] > 0).count();
        assert!((1..=4).contains(&lit), "{lit}");
        assert_eq!(at(&table, 502.0, 30.04)[3], 1.0);
    }

    #[test]
    fn flat_ranges_have_one_bin_that_counts() {
        let hit_gradient = HitGradientQuantization { low: 5.0, high: 5.0, ..HIT_GRADIENT };
        let whole = [region([6.0, 8.0], [4.0, 6.0], [1.0; 3], 1.0, 0.1)];
        let table = table_of(&whole, [7.0, 7.0], hit_gradient);
        assert_eq!(table.look_up(0.0, hit_gradient.encode(5.0)).0[3], 1.0);
    }

    #[test]
    fn lit_bins_are_found_in_every_rectangle() {
        let table =
            table_of(&[region([0.0, 1000.0], [20.0, 30.0], [1.0, 0.5, 0.0], 0.6, 0.0)], VALUE_RANGE, HIT_GRADIENT);
        let lit = table.lit_bins();
        let values = [0, 16000, 16400, 20000, 32700, 33000, 65535];
        let gradients = [1, 16000, 16500, 20000, 32700, 33000, 65535];
        for value in values.iter().flat_map(|&low| values.map(|high| [low, high])).filter(|[low, high]| low <= high) {
            for gradient in gradients.iter().flat_map(|&low| gradients.map(|high| [low, high])) {
                let bins = |[low, high]: [usize; 2]| low..=high;
                let naive = bins(gradient.map(gradient_bin)).any(|row| {
                    bins(value.map(|value| value_bin(f32::from(value))))
                        .any(|bin| table.entries()[row * VALUE_BINS + bin][3] > 0)
                });
                assert_eq!(lit.any(value, gradient), naive && gradient[0] <= gradient[1], "{value:?} {gradient:?}");
            }
        }
    }

    #[test]
    fn every_stored_number_has_a_bin() {
        let table = table_of(&[region([0.0, 900.0], [20.0, 30.0], [1.0; 3], 0.6, 0.4)], VALUE_RANGE, HIT_GRADIENT);
        for value in (0..=u16::MAX).step_by(7) {
            let (entry, emphasis) = table.look_up(f32::from(value), 23_000);
            let (opacity, of) = table.opacity_of(value, 23_000);
            assert_eq!((f32::from(opacity) / 65535.0, of), (entry[3], emphasis));
        }
        assert_eq!([value_bin(0.0), value_bin(63.99), value_bin(64.0), value_bin(65535.0)], [0, 0, 1, 1023]);
        assert_eq!([gradient_bin(1), gradient_bin(128), gradient_bin(129), gradient_bin(65535)], [0, 0, 1, 511]);
    }
}
