//! αd of a whole transfer function as a table over distance: one for all, and those of regions that have their own.

use super::opacity_by_distance;
use crate::frame::within;
use crate::state::{BoundaryEmphasis, TransferFunction, TwoSidedEmphasis};

/// Parts into which distances from 0 to `d_c` are cut; αd is linear in each, which is off by n²/8 · 10⁻⁶ at most.
pub const INTERVALS: usize = 1024;
/// Numbers of a row: intervals per unit of distance, αd at the intervals' ends, and 0 behind them.
pub const ROW: usize = INTERVALS + 3;

/// αd on both sides of a boundary, for every emphasis that a transfer function has.
#[derive(Clone, Debug, PartialEq)]
pub struct EmphasisTable {
    /// Two rows for each emphasis, that of the high-value side first.
    numbers: Vec<f32>,
    largest_d_c: f32,
}

impl EmphasisTable {
    /// The table of a transfer function: its own emphasis first, then those of its regions that have one, in their order.
    #[must_use]
    pub fn new(transfer_function: &TransferFunction) -> Self {
        let own = transfer_function.regions.iter().filter_map(|region| region.emphasis);
        let mut table = Self { numbers: Vec::new(), largest_d_c: 0.0 };
        for TwoSidedEmphasis { high, low } in std::iter::once(transfer_function.emphasis).chain(own) {
            for side in [high, low].map(usable) {
                table.largest_d_c = table.largest_d_c.max(side.d_c);
                table.numbers.push(INTERVALS as f32 / side.d_c);
                let ends = (0..INTERVALS).map(|end| side.d_c * (end as f32 / INTERVALS as f32));
                table.numbers.extend(ends.map(|distance| opacity_by_distance(&side, distance)));
                table.numbers.extend([0.0; 2]);
            }
        }
        table
    }

    /// αd of emphasis `index` at a signed distance in multiples of `L_min`.
    #[must_use]
    #[inline]
    pub fn look_up(&self, index: usize, distance: f32) -> f32 {
        self.look_up_row(2 * index + usize::from(distance < 0.0), distance.abs())
    }

    /// αd of a row at an unsigned distance in multiples of `L_min`.
    #[must_use]
    #[inline]
    pub fn look_up_row(&self, row: usize, distance: f32) -> f32 {
        let row = &self.numbers[row * ROW..][..ROW];
        let place = (distance * row[0]).min(INTERVALS as f32);
        // Through the shorter conversion.
        let interval = place as u32 as usize;
        let (start, end) = (row[1 + interval], row[2 + interval]);
        start + (place - interval as f32) * (end - start)
    }

    /// Number of rows: two for each emphasis.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.numbers.len() / ROW
    }

    /// Intervals of a row per `L_min` of distance.
    #[must_use]
    #[inline]
    pub fn scale(&self, row: usize) -> f32 {
        self.numbers[row * ROW]
    }

    /// The distance at which a row's αd ends, in multiples of `L_min`.
    #[must_use]
    pub fn d_c(&self, row: usize) -> f32 {
        INTERVALS as f32 / self.scale(row)
    }

    /// All rows, each of [`ROW`] numbers.
    #[must_use]
    pub fn numbers(&self) -> &[f32] {
        &self.numbers
    }

    /// The distance from which on nothing is drawn, in multiples of `L_min`.
    #[must_use]
    pub fn largest_d_c(&self) -> f32 {
        self.largest_d_c
    }
}

/// Settings brought into the range that they can have.
fn usable(emphasis: BoundaryEmphasis) -> BoundaryEmphasis {
    BoundaryEmphasis {
        kind: emphasis.kind,
        a: within(emphasis.a, [0.0, 1.0], 1.0),
        d_c: within(emphasis.d_c, [1e-3, 1e6], 3.0),
        n: within(emphasis.n, [1.0, 100.0], 3.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::{EmphasisKind, Region};

    #[test]
    fn every_emphasis_is_followed_on_both_sides() {
        let emphasis = |kind, a, d_c, n| BoundaryEmphasis { kind, a, d_c, n };
        let shared = TwoSidedEmphasis {
            high: emphasis(EmphasisKind::Concave, 1.0, 15.0, 7.0),
            low: emphasis(EmphasisKind::Linear, 0.1, 2.0, 1.0),
        };
        let own = TwoSidedEmphasis::from(emphasis(EmphasisKind::Convex, 0.7, 1.5, 3.0));
        let plain: Region = "0:1,0:1,ffffff".parse().expect("a region");
        let regions = vec![plain.clone(), Region { emphasis: Some(own), ..plain }];
        let table = EmphasisTable::new(&TransferFunction { regions, emphasis: shared, ..TransferFunction::default() });
        assert_eq!((table.numbers().len(), table.largest_d_c()), (4 * ROW, 15.0));
        for step in -4000..=4000 {
            let distance = step as f32 * 0.005;
            for (index, emphasis) in [shared, own].into_iter().enumerate() {
                let side = if distance < 0.0 { emphasis.low } else { emphasis.high };
                let exact = opacity_by_distance(&side, distance.abs());
                let found = table.look_up(index, distance);
                assert!((found - exact).abs() < 1e-5, "{found} is not {exact} at {distance}");
                assert!(distance.abs() < side.d_c || found == 0.0);
            }
        }
        assert_eq!([table.look_up(0, 1e30), table.look_up(1, f32::INFINITY)], [0.0; 2]);
    }

    #[test]
    fn nonsense_is_brought_into_range() {
        let nonsense = BoundaryEmphasis { a: f32::NAN, d_c: 0.0, n: -1.0, ..BoundaryEmphasis::default() };
        let table = EmphasisTable::new(&TransferFunction { emphasis: nonsense.into(), ..TransferFunction::default() });
        assert!(table.numbers().iter().all(|number| number.is_finite()) && table.largest_d_c() > 0.0);
    }
}
