//! The first look at a volume: what all of it has to be seen for.

use rayon::prelude::*;
use sha2::{Digest, Sha256};
use voxrole_pack::scalar::{LittleEndian, Scalar, range_within};
use voxrole_pack::{Scalars, with_scalars};

use crate::region::Region;
use crate::source::{Source, has_bad};
use crate::{Error, Result};

/// Bytes that are looked at together.
const CHUNK_BYTES: usize = 1 << 24;
/// Longest edge of the boxes that samples are taken from, in voxels.
const BOX_EDGE: usize = 96;
/// Boxes with less than this share of the strong ones' range are not looked at while there are others: air, and noise.
const LEAST_CONTRAST: f64 = 0.25;
/// Which share of the boxes counts as the strong ones.
const STRONG: f64 = 0.95;

/// What was seen.
#[derive(Clone, Debug)]
pub struct Scan {
    /// Smallest and largest finite number, as stored.
    pub range: [f64; 2],
    /// Whether a number is NaN or infinite.
    pub has_bad: bool,
    /// SHA-256 of the stored numbers, where it was asked for: own type, little-endian, x fastest.
    pub voxels_sha256: Option<[u8; 32]>,
    dims: [usize; 3],
    /// Stored range of every box, x fastest; `None` where no number is finite.
    boxes: Vec<Option<[f64; 2]>>,
}

impl Scan {
    /// Reads the whole volume once, some slices at a time.
    ///
    /// # Errors
    /// [`Error::Parameter`] when no voxel is finite, and as [`Source::read`].
    pub fn new(source: &Source<'_>, with_hash: bool) -> Result<Self> {
        let dims @ [nx, ny, nz] = source.dims();
        let counts = box_counts(dims);
        let mut boxes = vec![None; counts.iter().product()];
        let mut hasher = with_hash.then(Sha256::new);
        let mut has_bad_numbers = false;
        let slice_bytes = nx * ny * source.scalar_type().size_in_bytes();
        let step = if source.resident_bytes() > 0 { nz } else { (CHUNK_BYTES / slice_bytes).max(1) };
        for first in (0..nz).step_by(step) {
            let region = Region { start: [0, 0, first], end: [nx, ny, (first + step).min(nz)] };
            let scalars = source.read(&region)?;
            let (ranges, bad) = rayon::join(
                || rayon::join(|| box_ranges(&scalars, dims, region), || has_bad(&scalars)),
                || hasher.iter_mut().for_each(|hasher| hash(&scalars, hasher)),
            )
            .0;
            has_bad_numbers |= bad;
            for (k, slice) in (first..).zip(ranges) {
                let layer = box_of(k, nz) * counts[0] * counts[1];
                for (sum, range) in boxes[layer..].iter_mut().zip(slice) {
                    *sum = joined(*sum, range);
                }
            }
        }
        let range = boxes.iter().copied().fold(None, joined).ok_or_else(|| {
            Error::Parameter(format!("{}: every voxel is NaN or infinite; there is nothing to prepare", source.name))
        })?;
        let voxels_sha256 = hasher.map(|hasher| hasher.finalize().into());
        Ok(Self { range, has_bad: has_bad_numbers, voxels_sha256, dims, boxes })
    }

    /// All that was seen, as numbers to be kept.
    #[must_use]
    pub fn to_numbers(&self) -> Vec<u64> {
        let bits = |range: [f64; 2]| range.map(f64::to_bits);
        let hash = self.voxels_sha256.unwrap_or_default();
        let words = hash.as_chunks::<8>().0.iter().map(|word| u64::from_le_bytes(*word));
        let head = [u64::from(self.has_bad), u64::from(self.voxels_sha256.is_some())];
        let boxes = self.boxes.iter().flat_map(|range| bits(range.unwrap_or([f64::NAN; 2])));
        head.into_iter().chain(bits(self.range)).chain(words).chain(boxes).collect()
    }

    /// What [`Self::to_numbers`] made numbers of, for a volume of `dims` voxels; `None` where those are others.
    #[must_use]
    pub fn from_numbers(numbers: &[u64], dims: [usize; 3]) -> Option<Self> {
        let [has_bad, has_hash, low, high, a, b, c, d, boxes @ ..] = numbers else { return None };
        let range = [low, high].map(|end| f64::from_bits(*end));
        let mut hash = [0; 32];
        hash.copy_from_slice([a, b, c, d].map(|word| word.to_le_bytes()).as_flattened());
        let ends = boxes.as_chunks::<2>().0.iter().map(|ends| ends.map(f64::from_bits));
        let boxes: Vec<_> = ends.map(|ends| (!ends[0].is_nan()).then_some(ends)).collect();
        let expected: usize = box_counts(dims).iter().product();
        (boxes.len() == expected && range[0] <= range[1]).then(|| Self {
            range,
            has_bad: *has_bad == 1,
            voxels_sha256: (*has_hash == 1).then_some(hash),
            dims,
            boxes,
        })
    }

    /// Boxes that stand for the volume, with about `voxels` voxels together: evenly spread over those of some contrast.
    #[must_use]
    pub fn sample(&self, voxels: usize) -> Vec<Region> {
        let contrast = |range: &Option<[f64; 2]>| range.map_or(0.0, |[low, high]| high - low);
        let mut sorted: Vec<f64> = self.boxes.iter().map(contrast).collect();
        sorted.sort_by(f64::total_cmp);
        let least = LEAST_CONTRAST * sorted[(STRONG * (sorted.len() - 1) as f64) as usize];
        let good: Vec<usize> = (0..self.boxes.len()).filter(|&index| contrast(&self.boxes[index]) >= least).collect();
        let counts = box_counts(self.dims);
        let volume: usize = self.dims.iter().product();
        let wanted = (voxels * self.boxes.len()).div_ceil(volume).clamp(1, good.len());
        let region = |place: usize| {
            let index = good[(2 * place + 1) * good.len() / (2 * wanted)];
            let at = [index % counts[0], index / counts[0] % counts[1], index / (counts[0] * counts[1])];
            let cut = |axis: usize, at: usize| (at * self.dims[axis]).div_ceil(counts[axis]);
            Region {
                start: std::array::from_fn(|axis| cut(axis, at[axis])),
                end: std::array::from_fn(|axis| cut(axis, at[axis] + 1)),
            }
        };
        (0..wanted).map(region).collect()
    }
}

/// Boxes along each axis: of nearly the same size, so that none is thin.
fn box_counts(dims: [usize; 3]) -> [usize; 3] {
    dims.map(|dim| dim.div_ceil(BOX_EDGE))
}

/// The box along an axis of `len` voxels that holds a voxel: the last one that begins at `⌈box·len/count⌉` or before.
fn box_of(voxel: usize, len: usize) -> usize {
    voxel * len.div_ceil(BOX_EDGE) / len
}

/// For every slice the ranges of its part of the boxes, x fastest.
fn box_ranges(scalars: &Scalars, dims: [usize; 3], region: Region) -> Vec<Vec<Option<[f64; 2]>>> {
    fn of<T: Scalar>(values: &[T], [nx, ny, _]: [usize; 3]) -> Vec<Vec<Option<[f64; 2]>>> {
        let [across, down, _] = box_counts([nx, ny, 1]);
        let slice_ranges = |slice: &[T]| {
            let mut ranges = vec![None; across * down];
            for (j, row) in slice.chunks_exact(nx).enumerate() {
                for (i, sum) in ranges[box_of(j, ny) * across..][..across].iter_mut().enumerate() {
                    let part = &row[(i * nx).div_ceil(across)..((i + 1) * nx).div_ceil(across)];
                    *sum = joined(*sum, range_within(part, T::LOWEST, T::HIGHEST));
                }
            }
            ranges.into_iter().map(|range| range.map(|ends| ends.map(T::to_f64))).collect()
        };
        values.par_chunks(nx * ny).map(slice_ranges).collect()
    }
    debug_assert_eq!(scalars.len(), region.voxel_count(), "whole slices");
    with_scalars!(scalars, values => of(values, dims))
}

/// The range of both.
fn joined<T: PartialOrd + Copy>(a: Option<[T; 2]>, b: Option<[T; 2]>) -> Option<[T; 2]> {
    match (a, b) {
        (Some([a, b]), Some([c, d])) => Some([if c < a { c } else { a }, if d > b { d } else { b }]),
        (a, b) => a.or(b),
    }
}

/// Adds stored numbers to a hash, little-endian.
pub(crate) fn hash(scalars: &Scalars, hasher: &mut Sha256) {
    fn of<T: LittleEndian>(values: &[T], hasher: &mut Sha256) {
        let mut bytes = Vec::new();
        for chunk in values.chunks(1 << 13) {
            bytes.clear();
            T::append_le(chunk, &mut bytes);
            hasher.update(&bytes);
        }
    }
    with_scalars!(scalars, values => of(values, hasher));
}

#[cfg(test)]
mod tests {
    use voxrole_pack::GridGeometry;

    use super::*;
    use crate::Grid;

    fn grid(dims: [u32; 3], value: impl Fn([usize; 3]) -> f32) -> Grid {
        let [nx, ny, nz] = dims.map(|dim| dim as usize);
        let values = (0..nx * ny * nz).map(|voxel| value([voxel % nx, voxel / nx % ny, voxel / (nx * ny)])).collect();
        Grid::new("test", GridGeometry::axis_aligned(dims, [1.0; 3]), Scalars::F32(values)).expect("a grid")
    }

    #[test]
    fn everything_is_seen() {
        let grid = grid([70, 3, 130], |[x, y, z]| match [x, y, z] {
            [69, 2, 129] => 9.0,
            [0, 1, 64] => f32::NAN,
            [33, 0, 5] => -4.0,
            _ => x as f32 / 100.0,
        });
        let scan = Scan::new(&Source::from(&grid), true).expect("finite numbers");
        assert_eq!((scan.range, scan.has_bad), ([-4.0, 9.0], true));
        assert_eq!(scan.voxels_sha256, Some(grid.voxels_sha256()));
        let kept = Scan::from_numbers(&scan.to_numbers(), [70, 3, 130]).expect("its own numbers");
        assert_eq!((kept.to_numbers(), kept.boxes.len()), (scan.to_numbers(), scan.boxes.len()));
        assert!(Scan::from_numbers(&scan.to_numbers(), [70, 3, 700]).is_none());
    }

    #[test]
    fn boxes_are_of_a_size_and_lie_where_there_is_contrast() {
        // A thin bright sheet in a large dark volume.
        let grid = grid([200, 130, 65], |[x, ..]| if x == 150 { 1.0 } else { 0.0 });
        let scan = Scan::new(&Source::from(&grid), false).expect("finite numbers");
        let boxes = scan.sample(600_000);
        assert!(boxes.len() > 1 && boxes.iter().map(Region::voxel_count).sum::<usize>() < 1_000_000, "{boxes:?}");
        for region in boxes {
            assert!((region.start[0]..region.end[0]).contains(&150), "{region:?}");
            assert!(region.dims().iter().all(|&dim| (48..=96).contains(&dim)), "{region:?}");
        }
    }

    #[test]
    fn voxels_are_in_the_boxes_that_they_are_counted_for() {
        for len in [1_usize, 63, 64, 65, 127, 128, 129, 1000] {
            let count = len.div_ceil(BOX_EDGE);
            for at in 0..count {
                let (start, end) = ((at * len).div_ceil(count), ((at + 1) * len).div_ceil(count));
                assert!(start < end && (start..end).all(|voxel| box_of(voxel, len) == at), "box {at} of {len}");
            }
        }
    }
}
