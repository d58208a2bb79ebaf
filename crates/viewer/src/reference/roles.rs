//! Opacity and colour by role, out of tables that are made to be read fast by sixteen samples at once.

// No iterators and closures in vector code: what std calls might be compiled without the level's instructions.
#![allow(clippy::needless_range_loop, reason = "see above")]

use std::collections::HashMap;

use fearless_simd::{Bytes, Select, Simd, SimdBase, SimdFloat, SimdInt, f32x16, i32x16, u32x16};

use super::gathers::{columns, numbers, pairs};
use super::lanes::splat;
use crate::classify::emphasis_table::{INTERVALS, ROW};
use crate::classify::opacity::VALUE_BINS;
use crate::classify::preintegration::{CELLS_OF_SIDE, STRETCHES};
use crate::classify::{EmphasisTable, OpacityTable, PreintegrationCells};
use crate::state::TransferFunction;

/// A transfer function, ready to be looked up for sixteen places at once.
pub struct Roles {
    /// For every bin of gradient magnitude, and last for none: the number of its row of bins, below that of the run of rows
    /// alike which it lies in.
    runs: Vec<u32>,
    /// The first and, above it, the last bin of value with an opacity there; the first behind the last for none.
    lit: Vec<u32>,
    /// For every bin of value which of the roles it has, row after row: first one in which there is nothing, then those of
    /// gradient magnitudes, of which neighbours often share one.
    bins: Vec<u32>,
    /// Every colour, αu and αd that bins have, by their bits: red and green, blue and αu, as stored; where its level of the
    /// table of integrals begins; how far above that it lies, as a share of 65535, and the number of αd. The first is that of
    /// nothing.
    roles: Vec<[f32; 4]>,
    /// Intervals per `L_min` of every αd, on the high-value side and on the other.
    scales: Vec<f32>,
    emphases: EmphasisTable,
    cells: PreintegrationCells,
}

impl Roles {
    /// Of the tables of a transfer function.
    #[must_use]
    pub fn new(table: &OpacityTable, transfer_function: &TransferFunction) -> Self {
        let emphases = EmphasisTable::new(transfer_function);
        let ((rows, bins, roles), cells) = rayon::join(|| roles_of(table), || PreintegrationCells::new(&emphases));
        let mut runs = Vec::with_capacity(rows.len() + 1);
        let mut run = 0;
        for (bin, row) in rows.iter().enumerate() {
            run += u32::from(bin > 0 && rows[bin - 1].number != row.number);
            runs.push(run << 16 | row.number);
        }
        runs.push((run + 1) << 16);
        let mut lit: Vec<u32> = rows.iter().map(|row| u32::from(row.lit[0]) | u32::from(row.lit[1]) << 16).collect();
        lit.push(u32::from(u16::MAX));
        let scales = (0..emphases.rows()).map(|row| emphases.scale(row)).collect();
        Self { runs, lit, bins, roles, scales, emphases, cells }
    }

    /// Nothing farther from its boundary than this is drawn, steps of no length taken.
    #[must_use]
    #[inline(always)]
    pub fn largest_d_c(&self) -> f32 {
        self.emphases.largest_d_c()
    }

    /// The runs of bins of gradient magnitude, of which [`GRADIENT_BINS`](crate::classify::opacity::GRADIENT_BINS) is that of none.
    #[inline(always)]
    pub(super) fn runs<S: Simd>(&self, simd: S, gradient_bins: u32x16<S>) -> u32x16<S> {
        numbers(simd, &self.runs, gradient_bins)
    }

    /// The first bins of value, and above them the last ones, with an opacity in bins of gradient magnitude as in [`Self::runs`].
    #[inline(always)]
    pub(super) fn lit<S: Simd>(&self, simd: S, gradient_bins: u32x16<S>) -> u32x16<S> {
        numbers(simd, &self.lit, gradient_bins)
    }

    /// The numbers of the roles that bins of value have in runs; 0 where nothing is drawn.
    #[inline(always)]
    pub(super) fn numbers<S: Simd>(&self, simd: S, runs: u32x16<S>, value_bins: u32x16<S>) -> u32x16<S> {
        numbers(simd, &self.bins, (runs & 0xffff) * VALUE_BINS as u32 + value_bins)
    }
}

/// Roles side by side.
pub(super) struct RoleLanes<S: Simd> {
    /// Red and green, blue and αu.
    shares: [u32x16<S>; 2],
    /// Where the level below αu begins.
    cells: u32x16<S>,
    /// How far above it αu lies, and the number of αd.
    packed: u32x16<S>,
    /// On the high-value side, and on the other.
    scales: [f32x16<S>; 2],
}

impl<S: Simd> RoleLanes<S> {
    /// Those with these numbers.
    #[inline(always)]
    pub(super) fn look_up(simd: S, roles: &Roles, numbers: u32x16<S>) -> Self {
        let [first, second, cells, packed] = columns(simd, &roles.roles, numbers);
        let packed = packed.to_bits();
        let scales = match roles.scales[..] {
            // One for all, as mostly.
            [high, low] => [splat(simd, high), splat(simd, low)],
            _ => pairs(simd, &roles.scales, (packed >> 16) << 1),
        };
        Self { shares: [first.to_bits(), second.to_bits()], cells: cells.to_bits(), packed, scales }
    }

    /// Red, green, blue.
    #[inline(always)]
    pub(super) fn color(&self) -> [f32x16<S>; 3] {
        [share(self.shares[0] & 0xffff), share(self.shares[0] >> 16), share(self.shares[1] & 0xffff)]
    }

    /// The opacity for a path of `L_min` at a signed distance from the boundary.
    #[inline(always)]
    pub(super) fn opacity(&self, simd: S, roles: &Roles, distance: f32x16<S>) -> f32x16<S> {
        let is_low = distance.simd_lt(0.0);
        let [high, low] = self.scales;
        let place = (distance.abs() * is_low.select(low, high)).min(splat(simd, INTERVALS as f32));
        // No larger than a table has numbers: the shorter conversion.
        let interval = place.to_int::<i32x16<S>>();
        let side = is_low.select(u32x16::splat(simd, ROW as u32 + 1), u32x16::splat(simd, 1));
        let first = (self.packed >> 16) * (2 * ROW as u32) + side + interval.bitcast::<u32x16<S>>();
        let [start, end] = pairs(simd, roles.emphases.numbers(), first);
        share(self.shares[1] >> 16) * (start + (place - interval.to_float::<f32x16<S>>()) * (end - start))
    }

    /// The integral of the optical depth from 0 to a signed distance, out of [`PreintegrationCells::cells`].
    #[inline(always)]
    pub(super) fn integral(&self, simd: S, roles: &Roles, distance: f32x16<S>) -> f32x16<S> {
        let is_low = distance.simd_lt(0.0);
        let [high, low] = self.scales;
        let scale = is_low.select(low, high) * (STRETCHES as f32 / INTERVALS as f32);
        let place = (distance.abs() * scale).min(splat(simd, STRETCHES as f32));
        let stretch = place.to_int::<i32x16<S>>();
        let side = is_low.select(u32x16::splat(simd, CELLS_OF_SIDE as u32), u32x16::splat(simd, 0));
        let cells = self.cells + stretch.bitcast::<u32x16<S>>() + side;
        let [low_start, low_end, high_start, high_end] = columns(simd, roles.cells.cells(), cells);
        let along = place - stretch.to_float::<f32x16<S>>();
        let (below, above) = (low_start + along * (low_end - low_start), high_start + along * (high_end - high_start));
        (below + share(self.packed & 0xffff) * (above - below)).copysign(distance)
    }
}

/// Shares of 65535.
#[inline(always)]
fn share<S: Simd>(stored: u32x16<S>) -> f32x16<S> {
    stored.to_float::<f32x16<S>>() * (1.0 / 65535.0)
}

/// What there is for a gradient magnitude.
#[derive(Clone, Copy)]
struct Row {
    /// The first and the last bin of value with an opacity; the first behind the last for none.
    lit: [u16; 2],
    /// Of its bins among the rows of bins.
    number: u32,
}

/// The rows of a table's gradient magnitudes, which role every bin of them has, and those roles.
fn roles_of(table: &OpacityTable) -> (Vec<Row>, Vec<u32>, Vec<[f32; 4]>) {
    let mut roles = vec![role([0; 4], 0)];
    let mut bins = vec![0; VALUE_BINS];
    let mut known = HashMap::new();
    let entries = table.entries().chunks_exact(VALUE_BINS).zip(table.emphases().chunks_exact(VALUE_BINS));
    let mut before = (([].as_slice(), [].as_slice()), Row { lit: [u16::MAX, 0], number: 0 });
    let rows = entries.map(|of_row @ (entries, row_emphases)| {
        // Within a region most rows are as the one before.
        if of_row == before.0 {
            return before.1;
        }
        let is_lit = |entry: &[u16; 4]| entry[3] > 0;
        let ends = entries.iter().position(is_lit).zip(entries.iter().rposition(is_lit));
        let mut row = Row { lit: [u16::MAX, 0], number: 0 };
        if let Some((first, last)) = ends {
            row = Row { lit: [first as u16, last as u16], number: (bins.len() / VALUE_BINS) as u32 };
            let (mut same, mut number) = (([0; 4], 0), 0);
            bins.extend(entries.iter().zip(row_emphases).map(|(&entry, &emphasis)| {
                // Most bins are as the one before.
                if entry[3] > 0 && (entry, emphasis) != same {
                    same = (entry, emphasis);
                    number = *known.entry(same).or_insert_with(|| {
                        roles.push(role(entry, emphasis));
                        roles.len() as u32 - 1
                    });
                }
                if entry[3] > 0 { number } else { 0 }
            }));
        }
        before = (of_row, row);
        row
    });
    let rows = rows.collect();
    (rows, bins, roles)
}

fn role([red, green, blue, opacity]: [u16; 4], emphasis: u16) -> [f32; 4] {
    let (cells, above) = PreintegrationCells::level(emphasis.into(), f32::from(opacity) / 65535.0);
    let pair = |low: u16, high: u16| u32::from(low) | u32::from(high) << 16;
    [pair(red, green), pair(blue, opacity), cells, pair((above * 65535.0).round() as u16, emphasis)].map(f32::from_bits)
}

#[cfg(test)]
mod tests {
    use fearless_simd::{SimdMask, dispatch};
    use voxrole_pack::{HitGradientQuantization, Precision};
    use voxrole_preprocess::simd;

    use super::super::lanes::LANES;
    use super::*;
    use crate::classify::opacity_by_distance;
    use crate::classify::preintegration::SHORTEST;
    use crate::state::TwoSidedEmphasis;

    /// The opacity of a stretch, from ten thousand places along it.
    fn naive(emphasis: &TwoSidedEmphasis, by_role: f32, [start, end]: [f32; 2]) -> f32 {
        let count = 10_000;
        let mut sum = 0.0_f64;
        for place in 0..count {
            let distance = start + (end - start) * (place as f32 + 0.5) / count as f32;
            let by_distance = opacity_by_distance(emphasis.side(distance), distance.abs());
            sum -= (1.0 - f64::from(by_role * by_distance).min(1.0 - 1e-6)).ln();
        }
        1.0 - (-sum / f64::from(count)).exp() as f32
    }

    /// One role for every bin.
    fn roles(emphasis: TwoSidedEmphasis, by_role: f32) -> Roles {
        let region = format!("0:1,0:1,FFFFFF,{by_role},0");
        let regions = vec![region.parse().expect("a region")];
        let transfer_function = TransferFunction { emphasis, regions, ..TransferFunction::default() };
        let hit_gradient = HitGradientQuantization::new(0.0, 1.0, Precision::default());
        Roles::new(&OpacityTable::new(&transfer_function, [0.0, 1.0], hit_gradient), &transfer_function)
    }

    /// Optical depth for each `L_min` of a stretch, and the opacity in its middle.
    fn look_up(roles: &Roles, distance: f32, half: f32) -> [f32; 2] {
        let [begin, end, opacity]: [[f32; LANES]; 3] = dispatch!(simd::level(), simd => {
            let bins = |bin| u32x16::splat(simd, bin);
            let numbers = roles.numbers(simd, roles.runs(simd, bins(200)), bins(300));
            assert!(numbers.simd_gt(0).all_true());
            let lanes = RoleLanes::look_up(simd, roles, numbers);
            let place = |distance| splat(simd, distance);
            let integral = |distance| lanes.integral(simd, roles, place(distance)).into();
            [integral(distance - half), integral(distance + half), lanes.opacity(simd, roles, place(distance)).into()]
        });
        for lanes in [begin, end, opacity] {
            assert!(lanes.iter().all(|lane| *lane == lanes[0]));
        }
        [(end[0] - begin[0]) / (2.0 * half), opacity[0]]
    }

    #[test]
    fn stretches_are_integrated() {
        for emphasis in ["concave,1,3,7", "linear,0.1,15", "convex,1,2,3/concave,0.5,4,2", "concave,0.9,0.5,7"] {
            let emphasis: TwoSidedEmphasis = emphasis.parse().expect("an emphasis");
            for by_role in [0.02, 0.3, 0.75, 0.99, 1.0] {
                let roles = roles(emphasis, by_role);
                for half in [0.5 * SHORTEST, 0.05, 0.5, 1.0] {
                    for distance in [-3.2, -1.0, -0.3, 0.0, 0.01, 0.4, 1.7, 8.0, 20.0] {
                        let [depth, opacity] = look_up(&roles, distance, half);
                        let found = 1.0 - (-depth).exp();
                        let exact = naive(&emphasis, by_role, [distance - half, distance + half]);
                        let place = format!("{emphasis:?} {by_role} {distance} ± {half}");
                        assert!((found - exact).abs() < 0.004, "{place}: {found} is not {exact}");
                        let exact = by_role * opacity_by_distance(emphasis.side(distance), distance.abs());
                        assert!((opacity - exact).abs() < 1e-4, "{place}: {opacity} is not {exact}");
                    }
                }
            }
        }
    }
}
