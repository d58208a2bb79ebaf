//! Opacity and colour by role, out of tables that are made to be read fast by one sample after another.

// No iterators and closures in vector code: what std calls might be compiled without the level's instructions.
#![allow(clippy::needless_range_loop, reason = "see above")]

use std::collections::HashMap;

use fearless_simd::{Bytes, Select, Simd, SimdBase, SimdFloat, SimdInt, f32x8, i32x8, u32x8};

use super::lanes::columns;
use crate::classify::emphasis_table::{INTERVALS, ROW};
use crate::classify::opacity::VALUE_BINS;
use crate::classify::preintegration::{CELLS_OF_SIDE, STRETCHES};
use crate::classify::{EmphasisTable, OpacityTable, PreintegrationCells};
use crate::state::TransferFunction;

/// A transfer function, ready to be looked up for whole cells.
pub struct Roles {
    /// The row of every gradient magnitude.
    rows: Vec<Row>,
    /// For every bin of value which of the roles it has, row after row: first one in which there is nothing, then those of
    /// gradient magnitudes, of which neighbours often share one.
    bins: Vec<u32>,
    /// Every colour, αu and αd that bins have, as two rows each: red, green, blue, αu (as stored) with the number of αd
    /// above it; where its level of the table of integrals begins, how far above that it lies, and the intervals per
    /// `L_min` of αd on either side. The first is that of nothing. Whole numbers are there by their bits.
    roles: Vec<[f32; 4]>,
    emphases: EmphasisTable,
    cells: PreintegrationCells,
}

impl Roles {
    /// Of the tables of a transfer function.
    #[must_use]
    pub fn new(table: &OpacityTable, transfer_function: &TransferFunction) -> Self {
        let emphases = EmphasisTable::new(transfer_function);
        let ((rows, bins, roles), cells) =
            rayon::join(|| roles_of(table, &emphases), || PreintegrationCells::new(&emphases));
        Self { rows, bins, roles, cells, emphases }
    }

    /// αd by distance.
    #[must_use]
    pub fn emphases(&self) -> &EmphasisTable {
        &self.emphases
    }

    /// Nothing farther from its boundary than this is drawn, steps of no length taken.
    #[must_use]
    #[inline(always)]
    pub fn largest_d_c(&self) -> f32 {
        self.emphases.largest_d_c()
    }

    /// The row of a bin of gradient magnitude.
    #[inline(always)]
    pub(super) fn row(&self, gradient_bin: u32) -> Row {
        self.rows[gradient_bin as usize]
    }
}

/// What there is for a gradient magnitude.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    /// The first and the last bin of value with an opacity; the first behind the last for none.
    pub(super) lit: [u16; 2],
    /// Where its bins begin.
    pub(super) first: u32,
}

/// The roles that the corners of a cell have for a value.
pub(super) struct RoleLanes<S: Simd> {
    /// The corners' numbers.
    numbers: [u32; 8],
    /// Red, green, blue.
    pub(super) color: [f32x8<S>; 3],
    /// αu and the number of αd.
    packed: u32x8<S>,
    cells: u32x8<S>,
    level: f32x8<S>,
    /// On the high-value side, and on the other.
    scales: [f32x8<S>; 2],
}

impl<S: Simd> RoleLanes<S> {
    /// Those of nothing.
    #[inline(always)]
    pub(super) fn none(simd: S) -> Self {
        let (zero, no_bits) = (f32x8::splat(simd, 0.0), u32x8::splat(simd, 0));
        Self { numbers: [0; 8], color: [zero; 3], packed: no_bits, cells: no_bits, level: zero, scales: [zero; 2] }
    }

    /// The roles of a bin of value, in the rows that begin with `bins`; whether any of them has an opacity.
    #[inline(always)]
    pub(super) fn look_up(&mut self, simd: S, roles: &Roles, bins: &[u32; 8], value_bin: usize) -> bool {
        let mut numbers = [0; 8];
        let mut any = 0;
        for lane in 0..8 {
            numbers[lane] = roles.bins[bins[lane] as usize + value_bin];
            any |= numbers[lane];
        }
        // Most samples have the roles of the one before.
        if numbers != self.numbers {
            self.numbers = numbers;
            let numbers = u32x8::from_slice(simd, &numbers) << 1;
            let [red, green, blue, packed] = columns(simd, &roles.roles, &numbers.into());
            let [cells, level, high, low] = columns(simd, &roles.roles, &(numbers + 1).into());
            self.color = [red, green, blue];
            (self.packed, self.cells) = (packed.to_bits(), cells.to_bits());
            (self.level, self.scales) = (level, [high, low]);
        }
        any != 0
    }

    /// The opacity for a path of `L_min` at a signed distance from the boundary.
    #[inline(always)]
    pub(super) fn opacity(&self, simd: S, roles: &Roles, distance: f32x8<S>) -> f32x8<S> {
        let is_low = distance.simd_lt(0.0);
        let [high, low] = self.scales;
        let place = (distance.abs() * is_low.select(low, high)).min(f32x8::splat(simd, INTERVALS as f32));
        let interval = place.to_int::<u32x8<S>>();
        let side = is_low.select(u32x8::splat(simd, 1), u32x8::splat(simd, 0));
        let first: [u32; 8] = (((self.packed >> 16) * 2 + side) * ROW as u32 + interval + 1).into();
        let [mut start, mut end] = [[0.0; 8]; 2];
        for lane in 0..8 {
            [start[lane], end[lane]] = roles.emphases.pair(first[lane] as usize);
        }
        let (start, end) = (f32x8::from_slice(simd, &start), f32x8::from_slice(simd, &end));
        let by_role = (self.packed & 0xffff).to_float::<f32x8<S>>() / 65535.0;
        by_role * (start + (place - interval.to_float::<f32x8<S>>()) * (end - start))
    }

    /// The integral of the optical depth from 0 to a signed distance, out of [`PreintegrationCells::cells`].
    #[inline(always)]
    pub(super) fn integral(&self, simd: S, roles: &Roles, distance: f32x8<S>) -> f32x8<S> {
        let is_low = distance.simd_lt(0.0);
        let [high, low] = self.scales;
        let scale = is_low.select(low, high) * (STRETCHES as f32 / INTERVALS as f32);
        let place = (distance.abs() * scale).min(f32x8::splat(simd, STRETCHES as f32));
        // No larger than a table has cells: the shorter conversion.
        let stretch = place.to_int::<i32x8<S>>();
        let side = is_low.select(u32x8::splat(simd, CELLS_OF_SIDE as u32), u32x8::splat(simd, 0));
        let cells = (self.cells + stretch.bitcast::<u32x8<S>>() + side).into();
        let [low_start, low_end, high_start, high_end] = columns(simd, roles.cells.cells(), &cells);
        let along = place - stretch.to_float::<f32x8<S>>();
        let (below, above) = (low_start + along * (low_end - low_start), high_start + along * (high_end - high_start));
        (below + self.level * (above - below)).copysign(distance)
    }
}

/// The rows of a table's gradient magnitudes, which role every bin of them has, and those roles.
fn roles_of(table: &OpacityTable, emphases: &EmphasisTable) -> (Vec<Row>, Vec<u32>, Vec<[f32; 4]>) {
    let mut roles = role([0; 4], 0, emphases).to_vec();
    let mut bins = vec![0; VALUE_BINS];
    let mut known = HashMap::new();
    let entries = table.entries().chunks_exact(VALUE_BINS).zip(table.emphases().chunks_exact(VALUE_BINS));
    let mut before = (([].as_slice(), [].as_slice()), Row { lit: [u16::MAX, 0], first: 0 });
    let rows = entries.map(|of_row @ (entries, row_emphases)| {
        // Within a region most rows are as the one before.
        if of_row == before.0 {
            return before.1;
        }
        let is_lit = |entry: &[u16; 4]| entry[3] > 0;
        let ends = entries.iter().position(is_lit).zip(entries.iter().rposition(is_lit));
        let mut row = Row { lit: [u16::MAX, 0], first: 0 };
        if let Some((first, last)) = ends {
            row = Row { lit: [first as u16, last as u16], first: bins.len() as u32 };
            let (mut same, mut number) = (([0; 4], 0), 0);
            bins.extend(entries.iter().zip(row_emphases).map(|(&entry, &emphasis)| {
                // Most bins are as the one before.
                if entry[3] > 0 && (entry, emphasis) != same {
                    same = (entry, emphasis);
                    number = *known.entry(same).or_insert_with(|| {
                        roles.extend(role(entry, emphasis, emphases));
                        roles.len() as u32 / 2 - 1
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

fn role([red, green, blue, opacity]: [u16; 4], emphasis: u16, emphases: &EmphasisTable) -> [[f32; 4]; 2] {
    let share = |share: u16| f32::from(share) / 65535.0;
    let (cells, level) = PreintegrationCells::level(emphasis.into(), share(opacity));
    let packed = f32::from_bits(u32::from(opacity) | u32::from(emphasis) << 16);
    let [high, low] = [0, 1].map(|side| emphases.scale(2 * usize::from(emphasis) + side));
    [[share(red), share(green), share(blue), packed], [f32::from_bits(cells), level, high, low]]
}

#[cfg(test)]
mod tests {
    use fearless_simd::dispatch;
    use voxrole_pack::{HitGradientQuantization, Precision};
    use voxrole_preprocess::simd;

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
        let [begin, end, opacity]: [[f32; 8]; 3] = dispatch!(simd::level(), simd => {
            let mut lanes = RoleLanes::none(simd);
            assert!(lanes.look_up(simd, roles, &[roles.row(200).first; 8], 300));
            let place = |distance| f32x8::splat(simd, distance);
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
