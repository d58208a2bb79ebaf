//! How a volume is cut into blocks that fit in memory.

use voxrole_pack::ScalarType;
use voxrole_pack::brick::{BRICK_EDGE, BrickGrid};

use crate::differentiation::Kernel;
use crate::reconstruction::Reconstruction;
use crate::region::Region;
use crate::settings::{Automatic, Settings, Smoothing};

/// The largest volume that is one block, in voxels: one that is killed begins anew.
pub const MOST_AT_ONCE: usize = 1 << 26;
/// The largest block of several, in voxels: what is done anew at most after a run was killed.
const LARGEST_BLOCK: usize = 1 << 25;
/// What the program takes up beside the fields of a block, in bytes: code, stacks, histograms of every thread.
const OVERHEAD: u64 = 24 << 20;

/// Blocks on a regular lattice; their edges are multiples of a brick's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockPlan {
    dims: [usize; 3],
    block: [usize; 3],
}

/// Bytes of memory that a block takes up at most.
#[derive(Clone, Copy, Debug)]
pub struct Cost {
    /// For each voxel of the block and its surroundings.
    padded: u64,
    /// For each voxel of the block itself.
    interior: u64,
}

impl Cost {
    /// The cost of a volume's blocks; where something is left to the data, of what takes up most.
    #[must_use]
    pub fn new(settings: &Settings, scalar_type: ScalarType, has_bad: bool) -> Self {
        let open = settings.automatic != Automatic::default();
        let number = scalar_type.size_in_bytes() as u64;
        // Value, gradient magnitude, second derivative; distances of cells.
        let mut floats = 3;
        if open || settings.kernel != Kernel::Central2 {
            floats += 1;
        }
        let is_gaussian =
            settings.smoothing.placement == Smoothing::GaussianValue || matches!(settings.kernel, Kernel::Gaussian(_));
        if open || settings.smoothing.placement != Smoothing::None || is_gaussian {
            floats += 1;
        }
        // A Gaussian needs two, and the memory of the derivatives is kept meanwhile.
        if open || is_gaussian {
            floats += 1;
        }
        if matches!(settings.reconstruction, Reconstruction::Cubic | Reconstruction::Quintic) {
            floats += 3;
        }
        if has_bad {
            floats += 1;
        }
        // The roles, the numbers cropped, and what is packed, once more while it is written.
        let interior = 14 + 2 * number + 16 + if settings.keep_derivatives { 16 } else { 0 };
        Self { padded: number + 4 * floats + 1, interior }
    }

    /// Bytes for a block of `interior` voxels within `padded` ones.
    #[must_use]
    pub fn bytes(&self, interior: usize, padded: usize) -> u64 {
        OVERHEAD + self.interior * interior as u64 + self.padded * padded as u64
    }
}

impl BlockPlan {
    /// The blocks that make the least work of a volume, among those that take up at most `memory` bytes; `reach` is how far
    /// a block depends on its surroundings.
    ///
    /// # Errors
    /// When not even the smallest block fits, the bytes that it takes up.
    pub fn new(dims: [usize; 3], reach: [usize; 3], cost: Cost, memory: u64) -> Result<Self, u64> {
        let edges = |axis: usize| {
            let dim = dims[axis];
            (1..=dim.div_ceil(BRICK_EDGE)).map(move |bricks| (bricks * BRICK_EDGE).min(dim))
        };
        // Voxels that are computed along an axis over all its blocks.
        let work = |axis: usize, edge: usize| -> usize {
            (0..dims[axis].div_ceil(edge)).map(|block| padded_len(block * edge, edge, reach[axis], dims[axis])).sum()
        };
        let longest = |axis: usize, edge: usize| padded_edge(edge, reach[axis], dims[axis]);
        let along = [0, 1, 2]
            .map(|axis| edges(axis).map(|edge| (edge, longest(axis, edge), work(axis, edge))).collect::<Vec<_>>());
        let mut best: Option<(u128, usize, [usize; 3])> = None;
        let mut least = u64::MAX;
        for &(z, long_z, work_z) in &along[2] {
            for &(y, long_y, work_y) in &along[1] {
                for &(x, long_x, work_x) in &along[0] {
                    let bytes = cost.bytes(x * y * z, long_x * long_y * long_z);
                    least = least.min(bytes);
                    if bytes > memory || x * y * z > LARGEST_BLOCK {
                        continue;
                    }
                    let work = work_x as u128 * work_y as u128 * work_z as u128;
                    // Of equal work the fewest blocks.
                    let candidate = (work, usize::MAX - x * y * z, [x, y, z]);
                    if best.is_none_or(|best| candidate < best) {
                        best = Some(candidate);
                    }
                }
            }
        }
        best.map(|(.., block)| Self { dims, block }).ok_or(least)
    }

    /// The plan that an earlier run made, if it was one for a volume of `dims` voxels and its blocks fit into `memory` bytes.
    #[must_use]
    pub fn again(block: [u32; 3], dims: [usize; 3], reach: [usize; 3], cost: Cost, memory: u64) -> Option<Self> {
        let block = block.map(|edge| edge as usize);
        let is_edge = |axis: usize| {
            let (edge, dim) = (block[axis], dims[axis]);
            edge == dim || (0 < edge && edge < dim && edge.is_multiple_of(BRICK_EDGE))
        };
        let plan = Self { dims, block };
        let largest = || plan.region(0).voxel_count();
        let padded = || (0..3).map(|axis| padded_edge(block[axis], reach[axis], dims[axis])).product();
        ((0..3).all(is_edge) && cost.bytes(largest(), padded()) <= memory).then_some(plan)
    }

    /// Voxels of a block along x, y, z, but for the last ones of an axis, which may have fewer.
    #[must_use]
    pub fn block(&self) -> [u32; 3] {
        self.block.map(|edge| edge as u32)
    }

    /// Number of blocks along x, y, z.
    fn counts(&self) -> [usize; 3] {
        std::array::from_fn(|axis| self.dims[axis].div_ceil(self.block[axis]))
    }

    /// Number of blocks.
    #[must_use]
    pub fn len(&self) -> usize {
        self.counts().iter().product()
    }

    /// Whether there are no blocks, as for a volume without voxels.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The voxels of a block; blocks are counted with x fastest.
    #[must_use]
    pub fn region(&self, block: usize) -> Region {
        let [nx, ny, _] = self.counts();
        let at = [block % nx, block / nx % ny, block / (nx * ny)];
        let start: [usize; 3] = std::array::from_fn(|axis| at[axis] * self.block[axis]);
        Region { start, end: std::array::from_fn(|axis| (start[axis] + self.block[axis]).min(self.dims[axis])) }
    }

    /// The block that a brick of the volume is in, and which of the block's bricks it is.
    #[must_use]
    pub fn locate(&self, brick: usize) -> (usize, usize) {
        let voxel = BrickGrid::new(self.dims).voxel_ranges(brick).map(|range| range.start);
        let at: [usize; 3] = std::array::from_fn(|axis| voxel[axis] / self.block[axis]);
        let [nx, ny, _] = self.counts();
        let block = (at[2] * ny + at[1]) * nx + at[0];
        let region = self.region(block);
        let inside: [usize; 3] = std::array::from_fn(|axis| (voxel[axis] - region.start[axis]) / BRICK_EDGE);
        let [bricks_x, bricks_y, _] = region.dims().map(|dim| dim.div_ceil(BRICK_EDGE));
        (block, (inside[2] * bricks_y + inside[1]) * bricks_x + inside[0])
    }
}

/// The longest edge of a block with its surroundings.
fn padded_edge(edge: usize, reach: usize, dim: usize) -> usize {
    (edge + 2 * reach).min(dim)
}

fn padded_len(start: usize, len: usize, reach: usize, dim: usize) -> usize {
    (start + len + reach).min(dim) - start.saturating_sub(reach)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Method;

    fn cost() -> Cost {
        Cost::new(&Settings::new(Method::Fast), ScalarType::U16, false)
    }

    #[test]
    fn blocks_fill_the_volume_brick_by_brick() {
        for (dims, memory) in [([100, 70, 200], 40_u64 << 20), ([64, 64, 64], 1 << 30), ([5, 300, 1], 32 << 20)] {
            let plan = BlockPlan::new(dims, [18, 18, 7], cost(), memory).expect("fits");
            let voxels: usize = (0..plan.len()).map(|block| plan.region(block).voxel_count()).sum();
            assert_eq!(voxels, dims.iter().product::<usize>());
            let grid = BrickGrid::new(dims);
            for brick in 0..grid.len() {
                let (block, own) = plan.locate(brick);
                let region = plan.region(block);
                let ranges = BrickGrid::new(region.dims()).voxel_ranges(own);
                for (axis, range) in grid.voxel_ranges(brick).into_iter().enumerate() {
                    assert_eq!(range.start, ranges[axis].start + region.start[axis]);
                    assert_eq!(range.len(), ranges[axis].len());
                }
            }
        }
    }

    #[test]
    fn blocks_fit_or_are_refused() {
        let reach = [18; 3];
        for memory in [64_u64 << 20, 256 << 20, 1 << 30] {
            let plan = BlockPlan::new([2048, 2048, 1024], reach, cost(), memory).expect("fits");
            let block = plan.region(plan.len() / 2);
            let padded = block.grown(reach, [2048, 2048, 1024]);
            assert!(cost().bytes(block.voxel_count(), padded.voxel_count()) <= memory, "{block:?}");
        }
        let plan = BlockPlan::new([100, 70, 200], reach, cost(), 40 << 20).expect("fits");
        let again = |block: [u32; 3], memory: u64| BlockPlan::again(block, [100, 70, 200], reach, cost(), memory);
        assert_eq!(again(plan.block(), 40 << 20), Some(plan));
        assert_eq!(again(plan.block(), 25 << 20), None, "too little memory");
        for block in [[0, 32, 32], [33, 32, 32], [128, 32, 32], [u32::MAX, 32, 32]] {
            assert_eq!(again(block, u64::MAX), None, "{block:?}");
        }
        let least = BlockPlan::new([2048; 3], reach, cost(), 8 << 20).expect_err("too little");
        assert!(BlockPlan::new([2048; 3], reach, cost(), least - 1).is_err());
        assert!(BlockPlan::new([2048; 3], reach, cost(), least).is_ok());
    }
}
