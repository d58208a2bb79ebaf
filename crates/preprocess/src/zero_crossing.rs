//! Cells that can hold a zero crossing of f'', and how far every other cell is from one.

use rayon::prelude::*;

use crate::working_field::{Field, dims_of, voxels};

/// Distances beyond this many cells are not told apart: longer leaps are rare and save nothing measurable.
pub const FARTHEST: u8 = 16;

/// For every cell, the Chebyshev distance in cells to the nearest mixed cell.
///
/// A cell is the cube of eight neighbouring voxels, named by its lowest corner; an axis of one voxel has one cell. A
/// cell is *mixed* when the signs (negative, zero, positive) of f'' at its corners are not all equal, or when a corner
/// is NaN. Trilinear f'' inside a cell is bounded by its corners, so a sign can change, or a ray run into a masked voxel,
/// only inside a mixed cell: leaping over all others is exact.
#[derive(Clone, Debug)]
pub struct CellDistances {
    /// 0 for mixed cells, up to [`FARTHEST`] for those at least that far from one; x fastest.
    pub cells: Vec<u8>,
    /// Cells along x, y, z.
    pub dims: [usize; 3],
}

impl CellDistances {
    /// Classifies the cells of a field of f''.
    #[must_use]
    pub fn new(second_derivative: &Field) -> Self {
        let mut distances = Self::mixed_cells(second_derivative);
        distances.spread();
        distances
    }

    /// Number of mixed cells.
    #[must_use]
    pub fn mixed_count(&self) -> u64 {
        self.cells.par_iter().filter(|&&distance| distance == 0).count() as u64
    }

    /// 0 for mixed cells and [`FARTHEST`] for all others.
    fn mixed_cells(second_derivative: &Field) -> Self {
        let voxel_dims @ [nx, ny, nz] = dims_of(second_derivative);
        let dims = voxel_dims.map(|dim| dim.saturating_sub(1).max(1));
        let source = voxels(second_derivative);
        let mut cells = vec![FARTHEST; dims.iter().product()];
        cells.par_chunks_mut(dims[0] * dims[1]).enumerate().for_each_init(
            || vec![0_u8; nx],
            |column, (k, slice)| {
                for (j, row) in slice.chunks_mut(dims[0]).enumerate() {
                    column.fill(0);
                    for (k, j) in [(k, j), (k, j + 1), (k + 1, j), (k + 1, j + 1)] {
                        let start = (k.min(nz - 1) * ny + j.min(ny - 1)) * nx;
                        let samples = &source[start..start + nx];
                        column.iter_mut().zip(samples).for_each(|(signs, &sample)| *signs |= sign_bit(sample));
                    }
                    let next = column.iter().skip(1).chain(column.last());
                    for ((cell, &here), &there) in row.iter_mut().zip(&*column).zip(next) {
                        let signs = here | there;
                        *cell = if signs & NAN == 0 && signs.is_power_of_two() { FARTHEST } else { 0 };
                    }
                }
            },
        );
        Self { cells, dims }
    }

    /// Grows the mixed set by one cell at a time: after step n, every cell within distance n holds its distance. Each
    /// step takes the minimum over the 3×3×3 neighbourhood, axis by axis.
    fn spread(&mut self) {
        let [nx, ny, _] = self.dims;
        let slice_len = nx * ny;
        let mut rows = vec![0_u8; self.cells.len()];
        for distance in 1..FARTHEST {
            rows.par_chunks_mut(slice_len).zip(self.cells.par_chunks(slice_len)).for_each_init(
                || vec![0_u8; slice_len],
                |along_x, (out, slice)| {
                    for (out, row) in along_x.chunks_mut(nx).zip(slice.chunks(nx)) {
                        minimum_of_neighbours(out, row);
                    }
                    for (j, out) in out.chunks_mut(nx).enumerate() {
                        let row = |j: usize| &along_x[j * nx..][..nx];
                        minimum_of_three(out, row(j.saturating_sub(1)), row(j), row((j + 1).min(ny - 1)));
                    }
                },
            );
            let slices = rows.len() / slice_len;
            let changed = self
                .cells
                .par_chunks_mut(slice_len)
                .enumerate()
                .map(|(k, slice)| {
                    let other = |k: usize| &rows[k * slice_len..][..slice_len];
                    let neighbours =
                        other(k.saturating_sub(1)).iter().zip(other(k)).zip(other((k + 1).min(slices - 1)));
                    let mut changed = false;
                    for (cell, ((&low, &here), &high)) in slice.iter_mut().zip(neighbours) {
                        let reached = *cell == FARTHEST && low.min(here).min(high) == distance - 1;
                        *cell = if reached { distance } else { *cell };
                        changed |= reached;
                    }
                    changed
                })
                .reduce(|| false, |a, b| a | b);
            if !changed {
                break;
            }
        }
    }
}

const NEGATIVE: u8 = 1;
const ZERO: u8 = 2;
const POSITIVE: u8 = 4;
const NAN: u8 = 8;

#[inline(always)]
fn sign_bit(sample: f32) -> u8 {
    let [negative, zero, positive] = [sample < 0.0, sample == 0.0, sample > 0.0].map(u8::from);
    let ordered = negative * NEGATIVE + zero * ZERO + positive * POSITIVE;
    if ordered == 0 { NAN } else { ordered }
}

fn minimum_of_neighbours(out: &mut [u8], row: &[u8]) {
    let last = row.len() - 1;
    out[0] = row[0].min(row[last.min(1)]);
    out[last] = row[last].min(row[last.saturating_sub(1)]);
    if last >= 2 {
        minimum_of_three(&mut out[1..last], &row[..last - 1], &row[1..last], &row[2..]);
    }
}

fn minimum_of_three(out: &mut [u8], low: &[u8], here: &[u8], high: &[u8]) {
    for (((out, &low), &here), &high) in out.iter_mut().zip(low).zip(here).zip(high) {
        *out = low.min(here).min(high);
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;
    use proptest::prelude::*;

    use super::*;

    /// The naive twin: looks at every corner of every cell, and at every pair of cells.
    fn naive(field: &Field) -> Vec<u8> {
        let dims @ [nx, ny, nz] = dims_of(field).map(|dim| dim.saturating_sub(1).max(1));
        let (vz, vy, vx) = field.dim();
        let mut mixed = Vec::new();
        for k in 0..nz {
            for j in 0..ny {
                for i in 0..nx {
                    let corners: Vec<f32> = (0..8)
                        .map(|c| field[[(k + c / 4).min(vz - 1), (j + c / 2 % 2).min(vy - 1), (i + c % 2).min(vx - 1)]])
                        .collect();
                    let sign = |value: f32| if value == 0.0 { 0.0 } else { value.signum() };
                    if corners.iter().any(|&corner| corner.is_nan() || sign(corner) != sign(corners[0])) {
                        mixed.push([i, j, k]);
                    }
                }
            }
        }
        (0..nx * ny * nz)
            .map(|cell| {
                let position = [cell % dims[0], cell / dims[0] % dims[1], cell / (dims[0] * dims[1])];
                mixed
                    .iter()
                    .map(|other| (0..3).map(|axis| other[axis].abs_diff(position[axis])).max().unwrap_or(0))
                    .min()
                    .map_or(FARTHEST, |distance| distance.min(usize::from(FARTHEST)) as u8)
            })
            .collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        #[test]
        fn equals_its_naive_twin(
            dims in prop::array::uniform3(1_usize..9),
            odd in prop::collection::vec((any::<u16>(), prop::sample::select(vec![-1.0_f32, 0.0, f32::NAN])), 0..4),
            long in 1_usize..40,
        ) {
            let mut field = Array3::from_elem((dims[0], dims[1], long), 1.0_f32);
            let len = field.len();
            for (place, value) in odd {
                crate::working_field::voxels_mut(&mut field)[usize::from(place) % len] = value;
            }
            prop_assert_eq!(CellDistances::new(&field).cells, naive(&field));
        }
    }

    #[test]
    fn a_plateau_is_not_mixed_but_its_rim_is() {
        let field = Array3::from_shape_vec((1, 1, 6), vec![1.0, 0.0, 0.0, 0.0, -1.0, -1.0]).expect("shape");
        assert_eq!(CellDistances::new(&field).cells, [0, 1, 1, 0, 1]);
    }
}
