//! How a volume is cut into bricks.

use std::ops::Range;

/// Edge of a brick in voxels; bricks at the far faces are cut short.
pub const BRICK_EDGE: usize = 32;

/// The bricks of a volume, x fastest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BrickGrid {
    dims: [usize; 3],
    bricks: [usize; 3],
}

impl BrickGrid {
    /// Cuts a volume of `dims` voxels.
    #[must_use]
    pub fn new(dims: [usize; 3]) -> Self {
        Self { dims, bricks: dims.map(|dim| dim.div_ceil(BRICK_EDGE)) }
    }

    /// Number of bricks.
    #[must_use]
    pub fn len(&self) -> usize {
        self.bricks.iter().product()
    }

    /// Whether there are no bricks, as for a volume without voxels.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The voxels of brick `index`, as a range along each axis.
    #[must_use]
    pub fn voxel_ranges(&self, index: usize) -> [Range<usize>; 3] {
        let [nx, ny, _] = self.bricks;
        let position = [index % nx, index / nx % ny, index / (nx * ny)];
        std::array::from_fn(|axis| {
            let start = position[axis] * BRICK_EDGE;
            start..(start + BRICK_EDGE).min(self.dims[axis])
        })
    }

    /// Voxels along each axis of brick `index`.
    #[must_use]
    pub fn dims_of(&self, index: usize) -> [usize; 3] {
        self.voxel_ranges(index).map(|range| range.len())
    }

    /// Number of voxels of brick `index`.
    #[must_use]
    pub fn voxel_count(&self, index: usize) -> usize {
        self.dims_of(index).iter().product()
    }

    /// The brick's rows as ranges of the dense volume, in the order in which a brick stores them.
    pub fn rows(&self, index: usize) -> impl Iterator<Item = Range<usize>> + use<> {
        let [x, y, z] = self.voxel_ranges(index);
        let [nx, ny, _] = self.dims;
        z.flat_map(move |k| y.clone().map(move |j| (k, j))).map(move |(k, j)| {
            let start = (k * ny + j) * nx;
            start + x.start..start + x.end
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bricks_cover_every_voxel_once() {
        let dims = [70, 33, 5];
        let grid = BrickGrid::new(dims);
        let mut seen = vec![0; dims.iter().product()];
        for brick in 0..grid.len() {
            let rows: Vec<_> = grid.rows(brick).collect();
            assert_eq!(rows.iter().map(ExactSizeIterator::len).sum::<usize>(), grid.voxel_count(brick));
            rows.into_iter().flatten().for_each(|voxel| seen[voxel] += 1);
        }
        assert_eq!(grid.len(), 3 * 2);
        assert!(seen.iter().all(|&count| count == 1));
    }
}
