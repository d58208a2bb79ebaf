//! Opacity and colour by role, out of tables that are made to be read fast by one sample after another.

use std::collections::HashMap;

use glam::Vec3;

use crate::classify::opacity::LitRows;
use crate::classify::preintegration::SHORTEST;
use crate::classify::{EmphasisTable, OpacityTable, PreintegrationCells};
use crate::state::TransferFunction;

/// A transfer function, ready to be looked up for whole cells.
pub struct Roles {
    lit: LitRows,
    /// For every bin of value and gradient magnitude which of the roles it has.
    bins: Vec<u32>,
    /// Every colour, αu and αd that bins have; the first is that of nothing.
    roles: Vec<Role>,
    emphases: EmphasisTable,
    cells: PreintegrationCells,
}

/// What a bin has.
#[derive(Clone, Copy, Debug, Default)]
pub struct Role {
    /// Red, green, blue.
    pub color: Vec3,
    /// αu; 0 for nothing.
    pub opacity: f32,
    /// Where its level of the table of integrals begins, and how far above that it lies.
    cells: u32,
    level: f32,
    emphasis: u32,
}

impl Roles {
    /// Of the tables of a transfer function.
    #[must_use]
    pub fn new(table: &OpacityTable, transfer_function: &TransferFunction) -> Self {
        let emphases = EmphasisTable::new(transfer_function);
        let ((bins, roles), cells) = rayon::join(|| roles_of(table), || PreintegrationCells::new(&emphases));
        Self { lit: table.lit_rows(), bins, roles, cells, emphases }
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

    /// As [`LitRows::is_lit`].
    #[must_use]
    #[inline(always)]
    pub fn is_lit(&self, value_bins: [usize; 2], row: usize) -> bool {
        self.lit.is_lit(value_bins, row)
    }

    /// The role of a bin of value and gradient magnitude.
    #[must_use]
    #[inline(always)]
    pub fn of(&self, bin: usize) -> &Role {
        &self.roles[self.bins[bin] as usize]
    }

    /// The opacity for a path of `L_min` at a signed distance from the boundary, or around it along a stretch of distances.
    #[must_use]
    #[inline(always)]
    pub fn opacity(&self, role: &Role, distance: f32, stretch: &Stretch) -> f32 {
        if stretch.per_length == 0.0 {
            return role.opacity * self.emphases.look_up(role.emphasis as usize, distance);
        }
        let integral = |distance| self.cells.integral(role.cells, role.emphasis as usize, role.level, distance);
        let optical_depth = integral(distance + stretch.half) - integral(distance - stretch.half);
        1.0 - exp_of_negative(-optical_depth * stretch.per_length)
    }
}

/// The distances that a step takes at a corner of a cell.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stretch {
    half: f32,
    /// One over its length; 0 where that is so short that its middle stands for all of it.
    per_length: f32,
}

impl Stretch {
    /// So far to either side.
    #[must_use]
    #[inline(always)]
    pub fn new(half: f32) -> Self {
        let length = 2.0 * half;
        Self { half, per_length: if length < SHORTEST { 0.0 } else { 1.0 / length } }
    }
}

/// For every bin of a table which of the roles it has, and those roles.
fn roles_of(table: &OpacityTable) -> (Vec<u32>, Vec<Role>) {
    let mut roles = vec![Role::default()];
    let mut known = HashMap::new();
    let (mut last, mut last_role) = (([0; 4], 0), 0);
    let bins = table.entries().iter().zip(table.emphases()).map(|(&entry, &emphasis)| {
        // Most bins are as the one before.
        if entry[3] > 0 && (entry, emphasis) != last {
            last = (entry, emphasis);
            last_role = *known.entry(last).or_insert_with(|| {
                roles.push(Role::new(entry, emphasis));
                roles.len() as u32 - 1
            });
        }
        if entry[3] > 0 { last_role } else { 0 }
    });
    (bins.collect(), roles)
}

impl Role {
    fn new([red, green, blue, opacity]: [u16; 4], emphasis: u16) -> Self {
        let share = |share: u16| f32::from(share) / 65535.0;
        let opacity = share(opacity);
        let (cells, level) = PreintegrationCells::level(emphasis.into(), opacity);
        Self {
            color: Vec3::from_array([red, green, blue].map(share)),
            opacity,
            cells,
            level,
            emphasis: emphasis.into(),
        }
    }
}

/// e to the power of a negative number or 0, right to 1.2e-7, without a branch or a call.
#[inline(always)]
fn exp_of_negative(number: f32) -> f32 {
    /// Added to a number it leaves no bits behind its point, and the nearest integer in its lowest ones.
    const ROUND: f32 = 12_582_912.0;
    let power = (number * std::f32::consts::LOG2_E).max(-126.0);
    let rounded = power + ROUND;
    let rest = power - (rounded - ROUND);
    // The Taylor series of 2^x, whose first term left out is below half a unit in the last place for |x| ≤ 1/2; in pairs, which
    // wait for each other less than a chain does.
    let [a, b, c, d, e, f, g, h] = SERIES;
    let (square, [ab, cd, ef, gh]) = (rest * rest, [a * rest + b, c * rest + d, e * rest + f, g * rest + h]);
    let fraction = (ab * square + cd) * (square * square) + (ef * square + gh);
    f32::from_bits(rounded.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127) << 23) * fraction
}

/// Powers of ln 2 over factorials, the highest first.
const SERIES: [f32; 8] = {
    let (mut series, mut power) = ([1.0; 8], 1.0);
    let mut exponent = 1;
    while exponent < 8 {
        power *= std::f64::consts::LN_2 / exponent as f64;
        series[7 - exponent] = power as f32;
        exponent += 1;
    }
    series
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_of_e_are_right() {
        for step in 0..=87_000 {
            let number = -0.001 * step as f32;
            let exact = f64::from(number).exp();
            let off = (f64::from(exp_of_negative(number)) - exact).abs();
            assert!(off < 1.2e-7, "{number}: {off:e}");
        }
        assert_eq!(exp_of_negative(0.0), 1.0);
        assert!(exp_of_negative(-1e9) < 2e-38);
    }
}
