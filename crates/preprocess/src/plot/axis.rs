//! Axes: the bins that are shown, and ticks that a person can read.

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use voxrole_pack::HistogramAxis;

use super::numbers::{group_thousands, short_number, ticks};

/// How many ticks an axis should have at most.
const MOST_TICKS: usize = 9;
/// Share of its occupied bins that a zoomed axis shows beside them, on either side.
const ZOOM_MARGIN: f64 = 0.05;

/// The bins of an axis that are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct BinWindow {
    /// First bin drawn.
    pub first: usize,
    /// One past the last bin drawn.
    pub end: usize,
    /// Value at the lower edge of the first bin.
    pub low: f64,
    /// Value at the upper edge of the last bin.
    pub high: f64,
    /// Whether bins were left out.
    pub zoomed: bool,
}

impl BinWindow {
    /// The whole axis; or, where the occupied bins span less than half of it, those and 5 % more on either side.
    pub fn around(axis: &HistogramAxis, occupied: Option<Range<usize>>) -> Self {
        let bins = axis.bins as usize;
        let mut window = Self { first: 0, end: bins, low: axis.low, high: axis.high, zoomed: false };
        let Some(occupied) = occupied.filter(|occupied| 2 * occupied.len() < bins) else { return window };
        let margin = ((occupied.len() as f64 * ZOOM_MARGIN).ceil() as usize).max(1);
        window.first = occupied.start.saturating_sub(margin);
        window.end = (occupied.end + margin).min(bins);
        window.zoomed = window.first > 0 || window.end < bins;
        if window.first > 0 {
            window.low = (window.first as f64).mul_add(axis.bin_width(), axis.low);
        }
        if window.end < bins {
            window.high = (window.end as f64).mul_add(axis.bin_width(), axis.low);
        }
        window
    }

    /// The bins that pixel `pixel` of `pixels` shows: at least one, and every bin is on a pixel.
    pub fn bins_of_pixel(&self, pixel: usize, pixels: usize) -> Range<usize> {
        let bins = self.end - self.first;
        if bins <= pixels {
            let bin = self.first + (2 * pixel + 1) * bins / (2 * pixels);
            return bin..bin + 1;
        }
        self.first + pixel * bins / pixels..self.first + ((pixel + 1) * bins).div_ceil(pixels)
    }
}

/// An axis with ticks at stated places.
#[derive(Clone, Debug)]
pub(super) struct TickedAxis {
    low: f64,
    high: f64,
    ticks: Vec<(f64, String)>,
}

impl TickedAxis {
    /// A linear axis with ticks at multiples of 1, 2 or 5 times a power of ten.
    pub fn linear(low: f64, high: f64) -> Self {
        Self { low, high, ticks: ticks([low, high], MOST_TICKS) }
    }

    /// An axis of decimal logarithms of counts, from that of `low` to that of `high`, with ticks at round counts.
    pub fn log_counts(low: f64, high: f64) -> Self {
        let decades = (high.log10() - low.log10()).max(0.0);
        let factors: &[f64] = if decades <= 3.0 { &[1.0, 2.0, 5.0] } else { &[1.0] };
        let stride = (decades / MOST_TICKS as f64).ceil().max(1.0) as usize;
        let ticks = (0..=20)
            .step_by(stride)
            .flat_map(|decade| factors.iter().map(move |factor| factor * 10_f64.powi(decade)))
            .filter(|count| (low..=high).contains(count))
            .map(|count| (count.log10(), count_label(count)))
            .collect();
        Self { low: low.log10(), high: high.log10(), ticks }
    }

    /// An axis of decimal logarithms, from that of `low` to that of `high`, with ticks at round numbers.
    pub fn log(low: f64, high: f64) -> Self {
        let [first, last] = [low, high].map(f64::log10);
        let factors: &[f64] = match last - first {
            decades if decades <= 4.0 => &[1.0, 2.0, 5.0],
            _ => &[1.0],
        };
        let stride = ((last - first) / MOST_TICKS as f64).ceil().max(1.0) as usize;
        let ticks = (first.floor() as i32..=last.ceil() as i32)
            .step_by(stride)
            .flat_map(|decade| factors.iter().map(move |factor| factor * 10_f64.powi(decade)))
            .filter(|number| (low * (1.0 - 1e-9)..=high * (1.0 + 1e-9)).contains(number))
            .map(|number| (number.log10(), round_label(number)))
            .collect();
        Self { low: first, high: last, ticks }
    }

    /// Puts a tick for 0 at `place`, below all others, and the axis' lower end at `low`.
    pub fn with_zero_at(mut self, place: f64, low: f64) -> Self {
        self.low = low;
        self.ticks.insert(0, (place, "0".to_owned()));
        self
    }
}

impl Ranged for TickedAxis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let share = ((value - self.low) / (self.high - self.low)).clamp(0.0, 1.0);
        limit.0 + (share * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        let places = self.ticks.iter().map(|(place, _)| *place);
        if hint.weight().allow_light_points() { Vec::new() } else { places.collect() }
    }

    fn range(&self) -> Range<f64> {
        self.low..self.high
    }
}

impl ValueFormatter<f64> for TickedAxis {
    fn format_ext(&self, value: &f64) -> String {
        self.ticks.iter().find(|(place, _)| place == value).map(|(_, label)| label.clone()).unwrap_or_default()
    }
}

/// A round count; as a power of ten from a million, which leaves room for the axis' title.
fn count_label(count: f64) -> String {
    if count < 1e6 { group_thousands(count as u64) } else { format!("{count:.0e}") }
}

/// 1, 2 or 5 times a power of ten.
fn round_label(number: f64) -> String {
    if (0.999e-4..1e6).contains(&number) { short_number(number) } else { format!("{number:.0e}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: &TickedAxis) -> Vec<&str> {
        axis.ticks.iter().map(|(_, label)| label.as_str()).collect()
    }

    #[test]
    fn ticks_of_counts_are_round_and_few() {
        assert_eq!(labels(&TickedAxis::log_counts(1.0, 12_345_678.0)).last(), Some(&"1e7"));
        assert_eq!(labels(&TickedAxis::log_counts(1.0, 12_345_678.0))[5], "100,000");
        assert_eq!(labels(&TickedAxis::log_counts(0.5, 30.0)), ["1", "2", "5", "10", "20"]);
        assert!(TickedAxis::log_counts(1.0, u64::MAX as f64).ticks.len() <= 21);
    }

    #[test]
    fn ticks_of_logarithms_are_round() {
        assert_eq!(labels(&TickedAxis::log(0.0004, 0.02)), ["0.0005", "0.001", "0.002", "0.005", "0.01", "0.02"]);
        assert_eq!(labels(&TickedAxis::log(1e-6, 2.0)).first(), Some(&"1e-6"));
        assert_eq!(labels(&TickedAxis::log(3.0, 40.0).with_zero_at(0.0, -0.1))[..2], ["0", "5"]);
        assert!(TickedAxis::log(1e-30, 1e30).ticks.len() <= 10);
    }

    #[test]
    fn a_mostly_empty_axis_is_zoomed() {
        let axis = HistogramAxis { low: 0.0, high: 100.0, bins: 100 };
        let whole = BinWindow { first: 0, end: 100, low: 0.0, high: 100.0, zoomed: false };
        assert_eq!(BinWindow::around(&axis, Some(30..80)), whole);
        assert_eq!(BinWindow::around(&axis, None), whole);
        let zoomed = BinWindow { first: 0, end: 42, low: 0.0, high: 42.0, zoomed: true };
        assert_eq!(BinWindow::around(&axis, Some(0..40)), zoomed);
        assert_eq!(BinWindow::around(&axis, Some(99..100)).first, 98);
    }

    #[test]
    fn every_bin_is_on_a_pixel() {
        for (bins, pixels) in [(3, 700), (256, 700), (699, 700), (701, 700), (4096, 700), (1, 1)] {
            let axis = HistogramAxis { low: 0.0, high: 1.0, bins: bins as u32 };
            let window = BinWindow::around(&axis, None);
            let mut next = 0;
            for pixel in 0..pixels {
                let shown = window.bins_of_pixel(pixel, pixels);
                assert!(shown.start <= next && !shown.is_empty(), "{bins} {pixels} {pixel}: {shown:?} after {next}");
                next = shown.end;
            }
            assert_eq!(next, bins);
        }
    }
}
