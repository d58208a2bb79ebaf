//! Where in a volume something can be drawn: ranges over blocks of cells, held against a transfer function.
//!
//! A macrocell is a cube of [`MACROCELL`]³ cells with all their voxels, those on its faces included. What a sample in it can
//! show depends on nothing but its voxels' values, distances and gradient magnitudes: where no value between the smallest and
//! the largest has an opacity together with any of the magnitudes, or no distance is small enough, no sample needs to be taken. How far a ray may leap is a distance transform: Zuiderveld, Koning and
//! Viergever, Acceleration of ray-casting using 3D distance transforms, 1992.

use rayon::prelude::*;

use super::OpacityTable;
use crate::frame::Frame;
use crate::volume::VolumeTexels;

/// Cells along a side of a macrocell.
pub const MACROCELL: u32 = 4;

/// Distances beyond this many macrocells are not told apart: longer leaps are rare.
pub const FARTHEST: u8 = 16;

/// What the voxels of every macrocell hold, whatever is drawn of them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MacrocellRanges {
    pub(super) dims: [usize; 3],
    pub(super) ranges: Vec<Ranges>,
}

/// Smallest and largest numbers, as stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Ranges {
    value: [u16; 2],
    /// Of voxels with a boundary; the smaller is larger where there are none.
    gradient: [u16; 2],
    /// The smallest |distance| of a voxel with a boundary.
    nearest: u16,
}

impl Ranges {
    pub(super) const NONE: Self = Self { value: [u16::MAX, 0], gradient: [u16::MAX, 0], nearest: u16::MAX };

    pub(super) fn add(&mut self, texel: [u16; 4]) {
        let widen = |[low, high]: [u16; 2], number: u16| [low.min(number), high.max(number)];
        self.value = widen(self.value, texel[0]);
        if VolumeTexels::has_hit(texel) {
            self.gradient = widen(self.gradient, texel[2]);
            self.nearest = self.nearest.min((texel[1] as i16).unsigned_abs());
        }
    }

    pub(super) fn merge(&mut self, other: Self) {
        let widen = |a: [u16; 2], b: [u16; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        self.value = widen(self.value, other.value);
        self.gradient = widen(self.gradient, other.gradient);
        self.nearest = self.nearest.min(other.nearest);
    }
}

/// Macrocells along x, y, z of so many voxels.
pub(super) fn macrocells(voxels: [usize; 3]) -> [usize; 3] {
    voxels.map(|dim| dim.saturating_sub(1).max(1).div_ceil(MACROCELL as usize))
}

impl MacrocellRanges {
    /// Gathers the ranges of a volume's macrocells, on every thread.
    #[must_use]
    pub fn new(volume: &VolumeTexels) -> Self {
        let voxels = volume.description.texel_dims().map(|dim| dim as usize);
        let size = MACROCELL as usize;
        let dims @ [nx, ny, nz] = macrocells(voxels);
        let mut ranges = vec![Ranges::NONE; nx * ny * nz];
        ranges.par_chunks_mut(nx).enumerate().for_each(|(row, ranges)| {
            let ends = |first: usize, dim: usize| first * size..=(first * size + size).min(dim - 1);
            for z in ends(row / ny, voxels[2]) {
                for y in ends(row % ny, voxels[1]) {
                    let texels = &volume.texels[(z * voxels[1] + y) * voxels[0]..][..voxels[0]];
                    for (x, ranges) in ranges.iter_mut().enumerate() {
                        texels[ends(x, voxels[0])].iter().for_each(|&texel| ranges.add(texel));
                    }
                }
            }
        });
        Self { dims, ranges }
    }

    /// Macrocells along x, y, z.
    #[must_use]
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }
}

/// How far every macrocell is from one in which something can be drawn.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Occupancy {
    dims: [usize; 3],
    /// 0 where something can be drawn, else the Chebyshev distance in macrocells to the nearest such one, up to [`FARTHEST`];
    /// x fastest.
    distances: Vec<u8>,
}

impl Occupancy {
    /// Holds the ranges against a table; what lies [`Frame::reach`] or farther from its boundary is not drawn.
    #[must_use]
    pub fn new(volume: &MacrocellRanges, table: &OpacityTable, frame: &Frame) -> Self {
        let lit = table.lit_bins();
        let can_be_drawn = |ranges: &Ranges| {
            f32::from(ranges.nearest) * frame.distance_scale < frame.reach && lit.any(ranges.value, ranges.gradient)
        };
        Self::where_drawn(volume, can_be_drawn, 0.0)
    }

    /// Where value alone decides: holds the ranges of values against what says whether any of them has an opacity. A
    /// step reaches into macrocells beside that of its middle.
    #[must_use]
    pub fn of_values(volume: &MacrocellRanges, is_lit: impl Fn([u16; 2]) -> bool + Sync, frame: &Frame) -> Self {
        let margin = frame.half_step / (MACROCELL as f32 * frame.spacing.min_element());
        Self::where_drawn(volume, |ranges| is_lit(ranges.value), margin)
    }

    /// `margin` in macrocells.
    fn where_drawn(volume: &MacrocellRanges, can_be_drawn: impl Fn(&Ranges) -> bool + Sync, margin: f32) -> Self {
        let [nx, _, _] = volume.dims;
        let mut drawn = BitRows::new(volume.dims);
        let rows = drawn.words.par_chunks_mut(nx.div_ceil(64)).zip(volume.ranges.par_chunks(nx));
        rows.for_each(|(words, ranges)| {
            for (x, _) in ranges.iter().enumerate().filter(|(_, ranges)| can_be_drawn(ranges)) {
                words[x / 64] |= 1 << (x % 64);
            }
        });
        for _ in 0..margin.ceil() as usize {
            let before = drawn.words.clone();
            drawn.spread(&before);
        }
        Self { dims: volume.dims, distances: drawn.distances() }
    }

    /// Macrocells along x, y, z.
    #[must_use]
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// The distance of every macrocell, x fastest.
    #[must_use]
    pub fn distances(&self) -> &[u8] {
        &self.distances
    }

    /// Whether something can be drawn in blocks of `side` macrocells along each axis, x fastest.
    #[must_use]
    pub fn drawn_blocks(&self, side: usize) -> Vec<bool> {
        let [nx, ny, _] = self.dims;
        let [width, height, depth] = self.dims.map(|dim| dim.div_ceil(side));
        let mut blocks = vec![false; width * height * depth];
        for (row, distances) in self.distances.chunks_exact(nx).enumerate() {
            let first = (row / ny / side * height + row % ny / side) * width;
            for (x, _) in distances.iter().enumerate().filter(|(_, distance)| **distance == 0) {
                blocks[first + x / side] = true;
            }
        }
        blocks
    }
}

/// A bit for every macrocell, each row in words of its own.
struct BitRows {
    dims: [usize; 3],
    words: Vec<u64>,
}

impl BitRows {
    fn new(dims: [usize; 3]) -> Self {
        Self { dims, words: vec![0; dims[0].div_ceil(64) * dims[1] * dims[2]] }
    }

    /// The Chebyshev distance of every bit to the nearest one that is set.
    fn distances(mut self) -> Vec<u8> {
        let [nx, ny, nz] = self.dims;
        let width = nx.div_ceil(64);
        let mut distances = vec![FARTHEST; nx * ny * nz];
        let mut before = vec![0; self.words.len()];
        for distance in 0..FARTHEST {
            let mut is_complete = true;
            for (row, distances) in distances.chunks_exact_mut(nx).enumerate() {
                for word in 0..width {
                    let mut fresh = self.words[row * width + word] & !before[row * width + word];
                    is_complete &= fresh == 0;
                    while fresh != 0 {
                        let x = 64 * word + fresh.trailing_zeros() as usize;
                        fresh &= fresh - 1;
                        // Bits spread beyond the row's end, too.
                        if x < nx {
                            distances[x] = distance;
                        }
                    }
                }
            }
            if is_complete {
                break;
            }
            before.copy_from_slice(&self.words);
            self.spread(&before);
        }
        distances
    }

    /// Sets the neighbours of all bits of `before`, which are those of `self`, too.
    fn spread(&mut self, before: &[u64]) {
        let [nx, ny, nz] = self.dims;
        let width = nx.div_ceil(64);
        for (row, words) in self.words.chunks_exact_mut(width).enumerate() {
            let (y, z) = (row % ny, row / ny);
            let neighbours = (z.saturating_sub(1)..=(z + 1).min(nz - 1))
                .flat_map(|z| (y.saturating_sub(1)..=(y + 1).min(ny - 1)).map(move |y| z * ny + y));
            for row in neighbours {
                let line = &before[row * width..][..width];
                for (word, bits) in words.iter_mut().enumerate() {
                    let low = if word > 0 { line[word - 1] >> 63 } else { 0 };
                    let high = if word + 1 < width { line[word + 1] << 63 } else { 0 };
                    *bits |= line[word] | line[word] << 1 | line[word] >> 1 | low | high;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn distances_equal_their_naive_twin(
            dims in (1_usize..150, 1_usize..6, 1_usize..6),
            set in prop::collection::vec(any::<u32>(), 0..4),
        ) {
            let dims = [dims.0, dims.1, dims.2];
            let [nx, ny, nz] = dims;
            let mut bits = BitRows::new(dims);
            let place = |cell: usize| [cell % nx, cell / nx % ny, cell / (nx * ny)];
            let set: Vec<_> = set.into_iter().map(|cell| place(cell as usize % (nx * ny * nz))).collect();
            for [x, y, z] in &set {
                bits.words[(z * ny + y) * nx.div_ceil(64) + x / 64] |= 1 << (x % 64);
            }
            let naive: Vec<u8> = (0..nx * ny * nz).map(place).map(|cell| {
                let far = |other: &[usize; 3]| (0..3).map(|axis| other[axis].abs_diff(cell[axis])).max().unwrap_or(0);
                set.iter().map(far).min().map_or(FARTHEST, |distance| distance.min(usize::from(FARTHEST)) as u8)
            }).collect();
            prop_assert_eq!(bits.distances(), naive);
        }
    }
}
