//! The opacity of a stretch of a ray along which the distance to the boundary changes evenly: αu·αd, integrated beforehand.
//!
//! A path of length l with opacity α for each `L_min` lets `exp(−∫ τ)` through, with `τ = −ln(1 − α)` for each `L_min`. The
//! integral of τ(αu·αd(x)) from 0 to d is tabulated for levels of αu; the mean of τ between any two distances is then a
//! difference of two entries, so that a boundary within a step is seen, however thin αd is. After Engel, Kraus and Ertl, High-quality
//! pre-integrated volume rendering using hardware-accelerated pixel shading, 2001, for a product of which one factor stays.

use super::EmphasisTable;
use super::emphasis_table::INTERVALS;

/// Parts into which distances from 0 to `d_c` are cut.
pub const STRETCHES: usize = 512;
/// Levels of αu; level l is `1 − (1 − l/(LEVELS − 1))²`, because τ grows without end towards 1.
pub const LEVELS: usize = 64;
/// Numbers of a level: the integrals at the stretches' ends, and the last once more.
pub const LEVEL: usize = STRETCHES + 2;
/// Places between levels and numbers on one side of an emphasis.
pub const CELLS_OF_SIDE: usize = (LEVELS - 1) * (LEVEL - 1);
/// Stretches shorter than this many `L_min` are taken to be that long: differences of entries would be rounding alone.
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
    cells: Vec<[f32; 4]>,
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
                cells.extend(numbers.map(|(lower, upper)| [lower[0], lower[1], upper[0], upper[1]]));
            }
        }
        Self { cells }
    }

    /// Where the level below an opacity αu begins for the high-value side of an emphasis, and how far above it the opacity lies.
    #[must_use]
    pub fn level(emphasis: usize, opacity: f32) -> (u32, f32) {
        let level = (LEVELS - 1) as f32 * (1.0 - (1.0 - opacity).max(0.0).sqrt());
        let lower = (level as usize).min(LEVELS - 2);
        ((2 * emphasis * CELLS_OF_SIDE + lower * (LEVEL - 1)) as u32, level - lower as f32)
    }

    /// All places: the integrals at the ends of a stretch for the level below, then for the one above. The opacity that
    /// follows by linear interpolation is right to 0.004 for stretches that are not shorter than [`SHORTEST`].
    #[must_use]
    pub fn cells(&self) -> &[[f32; 4]] {
        &self.cells
    }
}
