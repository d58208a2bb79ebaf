//! The opacity of a stretch of a ray along which the distance to the boundary changes evenly: αu·αd, integrated beforehand.
//!
//! A path of length l with opacity α for each `L_min` lets `exp(−∫ τ)` through, with `τ = −ln(1 − α)` for each `L_min`. The
//! integral of τ(αu·αd(x)) from 0 to d is tabulated for levels of αu; the mean of τ between any two distances is then a
//! difference of two entries, so that a boundary within a step is seen, however thin αd is. After Engel, Kraus and Ertl, High-quality
//! pre-integrated volume rendering using hardware-accelerated pixel shading, 2001, for a product of which one factor stays.

use glam::Vec4;

use super::EmphasisTable;
use super::emphasis_table::INTERVALS;

/// Parts into which distances from 0 to `d_c` are cut.
pub const STRETCHES: usize = 512;
/// Levels of αu; level l is `1 − (1 − l/(LEVELS − 1))²`, because τ grows without end towards 1.
pub const LEVELS: usize = 64;
/// Numbers of a level: the integrals at the stretches' ends, and the last once more.
pub const LEVEL: usize = STRETCHES + 2;
/// Stretches shorter than this many `L_min` are looked at in one place: differences of entries would be rounding alone.
pub const SHORTEST: f32 = 1.0 / 64.0;

/// Pieces of a stretch that are summed up.
const PIECES: usize = INTERVALS / STRETCHES * 2;
/// No opacity is taken to be larger: τ of a path of `L_min` is 14 at most.
const MOST_OPACITY: f32 = 1.0 - 1e-6;

/// Integrals of τ for every emphasis of a transfer function.
#[derive(Clone, Debug)]
pub struct PreintegrationTable {
    /// Level after level, for the two sides of each emphasis, that of the high-value side first.
    numbers: Vec<f32>,
}

impl PreintegrationTable {
    /// Integrates every αd of a table.
    #[must_use]
    pub fn new(emphases: &EmphasisTable) -> Self {
        let mut numbers = Vec::with_capacity(emphases.rows() * LEVELS * LEVEL);
        for row in 0..emphases.rows() {
            let d_c = emphases.d_c(row);
            let piece = d_c / (STRETCHES * PIECES) as f32;
            let middles = (0..STRETCHES * PIECES).map(|index| (index as f32 + 0.5) * piece);
            let opacities: Vec<f32> = middles.map(|distance| emphases.look_up_row(row, distance)).collect();
            for level in 0..LEVELS {
                let share = 1.0 - level as f32 / (LEVELS - 1) as f32;
                let by_role = 1.0 - share * share;
                let mut integral = 0.0;
                numbers.push(0.0);
                for stretch in opacities.chunks_exact(PIECES) {
                    let transparency: f32 =
                        stretch.iter().map(|by_distance| 1.0 - (by_role * by_distance).min(MOST_OPACITY)).product();
                    integral -= piece * transparency.ln();
                    numbers.push(integral);
                }
                numbers.push(integral);
            }
        }
        Self { numbers }
    }

    /// All levels of [`LEVEL`] numbers.
    #[must_use]
    pub fn numbers(&self) -> &[f32] {
        &self.numbers
    }
}

/// The table as the CPU reads it: what lies around a place in it side by side.
#[derive(Clone, Debug)]
pub struct PreintegrationCells {
    /// Between two levels and two numbers: both of the lower level, then both of the upper one.
    cells: Vec<Vec4>,
    /// For every row of the table of emphases how many stretches there are to `L_min`.
    scales: Vec<f32>,
}

impl PreintegrationCells {
    /// Of the table of `emphases`.
    #[must_use]
    pub fn new(emphases: &EmphasisTable) -> Self {
        let table = PreintegrationTable::new(emphases);
        let mut cells = Vec::with_capacity(emphases.rows() * (LEVELS - 1) * (LEVEL - 1));
        for levels in table.numbers.chunks_exact(LEVELS * LEVEL) {
            for pair in levels.windows(2 * LEVEL).step_by(LEVEL) {
                let (lower, upper) = pair.split_at(LEVEL);
                let numbers = lower.windows(2).zip(upper.windows(2));
                cells.extend(numbers.map(|(lower, upper)| Vec4::new(lower[0], lower[1], upper[0], upper[1])));
            }
        }
        let scale = |row| STRETCHES as f32 / INTERVALS as f32 * emphases.scale(row);
        Self { cells, scales: (0..emphases.rows()).map(scale).collect() }
    }

    /// Where the level below an opacity αu begins for the high-value side of an emphasis, and how far above it the opacity lies.
    #[must_use]
    pub fn level(emphasis: usize, opacity: f32) -> (u32, f32) {
        let level = (LEVELS - 1) as f32 * (1.0 - (1.0 - opacity).max(0.0).sqrt());
        let lower = (level as usize).min(LEVELS - 2);
        (((2 * emphasis * (LEVELS - 1) + lower) * (LEVEL - 1)) as u32, level - lower as f32)
    }

    /// The integral of the optical depth from 0 to a signed distance in multiples of `L_min`, for what [`Self::level`] gave. The
    /// opacity that follows for a stretch is right to 0.004 where that is not shorter than [`SHORTEST`].
    #[must_use]
    #[inline(always)]
    pub fn integral(&self, first: u32, emphasis: usize, level: f32, distance: f32) -> f32 {
        let side = usize::from(distance < 0.0);
        let place = (distance.abs() * self.scales[2 * emphasis + side]).min(STRETCHES as f32);
        // No larger than a table has cells: the shorter conversion.
        let stretch = place as i32;
        let cell = self.cells[first as usize + side * (LEVELS - 1) * (LEVEL - 1) + stretch as usize];
        let along = place - stretch as f32;
        let (below, above) = (cell.x + along * (cell.y - cell.x), cell.z + along * (cell.w - cell.z));
        (below + level * (above - below)).copysign(distance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::TransferFunction;

    /// The opacity of a stretch, from ten thousand places along it.
    fn naive(emphasis: &str, by_role: f32, [start, end]: [f32; 2]) -> f32 {
        let emphasis: crate::state::TwoSidedEmphasis = emphasis.parse().expect("an emphasis");
        let count = 10_000;
        let mut sum = 0.0_f64;
        for place in 0..count {
            let distance = start + (end - start) * (place as f32 + 0.5) / count as f32;
            let by_distance = crate::classify::opacity_by_distance(emphasis.side(distance), distance.abs());
            sum -= (1.0 - f64::from(by_role * by_distance).min(1.0 - 1e-6)).ln();
        }
        1.0 - (-sum / f64::from(count)).exp() as f32
    }

    /// What the ray marchers make of the table, with the exact power of e.
    fn look_up(emphases: &EmphasisTable, cells: &PreintegrationCells, by_role: f32, distance: f32, half: f32) -> f32 {
        if 2.0 * half < SHORTEST {
            return by_role * emphases.look_up(0, distance);
        }
        let (first, level) = PreintegrationCells::level(0, by_role);
        let integral = |distance| cells.integral(first, 0, level, distance);
        1.0 - (-(integral(distance + half) - integral(distance - half)) / (2.0 * half)).exp()
    }

    #[test]
    fn stretches_are_integrated() {
        for emphasis in ["concave,1,3,7", "linear,0.1,15", "convex,1,2,3/concave,0.5,4,2", "concave,0.9,0.5,7"] {
            let transfer_function =
                TransferFunction { emphasis: emphasis.parse().expect("an emphasis"), ..TransferFunction::default() };
            let emphases = EmphasisTable::new(&transfer_function);
            let table = PreintegrationCells::new(&emphases);
            for by_role in [0.0, 0.02, 0.3, 0.75, 0.99, 1.0] {
                for half in [0.005, 0.05, 0.5, 1.0] {
                    for distance in [-3.2, -1.0, -0.3, 0.0, 0.01, 0.4, 1.7, 8.0, 20.0] {
                        let found = look_up(&emphases, &table, by_role, distance, half);
                        let exact = naive(emphasis, by_role, [distance - half, distance + half]);
                        // Where a stretch is looked at in one place, that place counts for all of it.
                        let is_one_place = 2.0 * half < SHORTEST;
                        if is_one_place && distance == 0.0 {
                            continue;
                        }
                        let tolerance = if is_one_place { 0.03 } else { 0.004 };
                        assert!(
                            (found - exact).abs() < tolerance,
                            "{emphasis} {by_role} {distance} ± {half}: {found} is not {exact}"
                        );
                    }
                }
            }
        }
    }
}
