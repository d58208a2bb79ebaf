//! Coarser levels of a layer, made while the finest one goes by.

use crate::brick::{BRICK_EDGE, BrickGrid};
use crate::levels::dims_of_level;
use crate::scalar::Scalar;

/// One layer of bricks of every level but the finest: no more of a level is in memory than that.
pub struct Pyramid<T> {
    slabs: Vec<Slab<T>>,
}

/// A layer of bricks of one level.
pub struct Slab<T> {
    /// The bricks of the level above.
    finer: BrickGrid,
    dims: [usize; 3],
    /// Slices `start` to `start + 32`, or to the last.
    values: Vec<T>,
    start: usize,
}

impl<T: Scalar> Pyramid<T> {
    /// Of a volume of `dims` voxels that has so many levels.
    pub fn new(dims: [usize; 3], levels: usize) -> Self {
        let slab = |level: usize| Slab {
            finer: BrickGrid::new(dims_of_level(dims, level - 1)),
            dims: dims_of_level(dims, level),
            values: Vec::new(),
            start: 0,
        };
        Self { slabs: (1..levels).map(slab).collect() }
    }

    /// The slab of a level from 1 on; none where there is no such level.
    pub fn slab(&mut self, level: usize) -> Option<&mut Slab<T>> {
        self.slabs.get_mut(level - 1)
    }
}

impl<T: Scalar> Slab<T> {
    /// Voxels of the slab along each axis.
    pub fn dims(&self) -> [usize; 3] {
        let [nx, ny, nz] = self.dims;
        [nx, ny, BRICK_EDGE.min(nz - self.start)]
    }

    /// The place of the slab's first brick in its level.
    pub fn first_brick(&self) -> usize {
        let [nx, ny, _] = self.dims.map(|dim| dim.div_ceil(BRICK_EDGE));
        nx * ny * (self.start / BRICK_EDGE)
    }

    /// The slab's voxels, x fastest.
    pub fn values(&self) -> &[T] {
        &self.values
    }

    /// Takes every second voxel of a brick of the level above, or a single number that all of them are; bricks come in the order
    /// of their grid. Says whether the slab is complete.
    pub fn take(&mut self, brick: usize, coarse: &[T]) -> bool {
        let ranges = self.finer.voxel_ranges(brick).map(|range| range.start / 2..range.end.div_ceil(2));
        let [x, y, z] = ranges.clone();
        if brick == 0 || z.start >= self.start + BRICK_EDGE {
            self.start = z.start;
            let [nx, ny, nz] = self.dims();
            self.values.clear();
            self.values.resize(nx * ny * nz, T::default());
        }
        let [nx, ny, _] = self.dims;
        let rows = z.clone().flat_map(|k| y.clone().map(move |j| (k, j)));
        for (index, (k, j)) in rows.enumerate() {
            let start = ((k - self.start) * ny + j) * nx;
            let row = &mut self.values[start + x.start..start + x.end];
            match coarse {
                [one] => row.fill(*one),
                _ => row.copy_from_slice(&coarse[index * x.len()..(index + 1) * x.len()]),
            }
        }
        let last_of_layer = x.end == nx && y.end == ny;
        last_of_layer && z.end == self.start + self.dims()[2]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slabs_hold_every_second_voxel() {
        for dims in [[70, 40, 131], [33, 1, 64], [1, 1, 65], [64, 64, 32]] {
            let [nx, ny, nz] = dims;
            let finest: Vec<u32> = (0..(nx * ny * nz) as u32).collect();
            let coarse_dims = dims_of_level(dims, 1);
            let mut expected = Vec::new();
            for k in (0..nz).step_by(2) {
                for j in (0..ny).step_by(2) {
                    expected.extend((0..nx).step_by(2).map(|i| finest[(k * ny + j) * nx + i]));
                }
            }
            let (mut pyramid, grid) = (Pyramid::new(dims, 2), BrickGrid::new(dims));
            let slab = pyramid.slab(1).expect("a second level");
            let mut found = Vec::new();
            for brick in 0..grid.len() {
                let [x, y, z] = grid.voxel_ranges(brick);
                let mut coarse = Vec::new();
                for k in z.step_by(2) {
                    for j in y.clone().step_by(2) {
                        coarse.extend(x.clone().step_by(2).map(|i| finest[(k * ny + j) * nx + i]));
                    }
                }
                if slab.take(brick, &coarse) {
                    assert_eq!(slab.dims()[..2], coarse_dims[..2]);
                    let [width, height, _] = coarse_dims;
                    let slices = found.len() / (width * height);
                    assert_eq!(slab.first_brick(), BrickGrid::new([width, height, slices]).len());
                    found.extend_from_slice(slab.values());
                }
            }
            assert_eq!(found, expected, "{dims:?}");
            assert!(pyramid.slab(2).is_none());
        }
    }
}
