//! Boxes of voxels.

use std::borrow::Cow;
use std::ops::Range;

/// A box of voxels of a volume: from `start` up to but not including `end`, along x, y, z.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// The first voxel.
    pub start: [usize; 3],
    /// Behind the last voxel.
    pub end: [usize; 3],
}

impl Region {
    /// A whole volume.
    #[must_use]
    pub fn whole(dims: [usize; 3]) -> Self {
        Self { start: [0; 3], end: dims }
    }

    /// Voxels along x, y, z.
    #[must_use]
    pub fn dims(&self) -> [usize; 3] {
        std::array::from_fn(|axis| self.end[axis] - self.start[axis])
    }

    /// Number of voxels.
    #[must_use]
    pub fn voxel_count(&self) -> usize {
        self.dims().iter().product()
    }

    /// The region and its surroundings up to `reach` voxels away, as far as a volume of `dims` voxels goes.
    #[must_use]
    pub fn grown(&self, reach: [usize; 3], dims: [usize; 3]) -> Self {
        Self {
            start: std::array::from_fn(|axis| self.start[axis].saturating_sub(reach[axis])),
            end: std::array::from_fn(|axis| (self.end[axis] + reach[axis]).min(dims[axis])),
        }
    }

    /// The region as seen from the first voxel of one that contains it.
    #[must_use]
    pub fn within(&self, outer: &Self) -> Self {
        let from = |place: [usize; 3]| std::array::from_fn(|axis| place[axis] - outer.start[axis]);
        Self { start: from(self.start), end: from(self.end) }
    }

    /// The region's rows, x fastest, as ranges of an array over all voxels of a volume of `dims` voxels.
    pub fn rows(&self, dims: [usize; 3]) -> impl Iterator<Item = Range<usize>> + use<> {
        let Self { start, end } = *self;
        (start[2]..end[2]).flat_map(move |k| {
            (start[1]..end[1]).map(move |j| {
                let row = (k * dims[1] + j) * dims[0];
                row + start[0]..row + end[0]
            })
        })
    }

    /// What an array over all voxels of a volume of `dims` voxels has in the region.
    #[must_use]
    pub fn crop<'a, T: Copy>(&self, values: &'a [T], dims: [usize; 3]) -> Cow<'a, [T]> {
        if self.dims() == dims {
            return Cow::Borrowed(values);
        }
        let mut cropped = Vec::with_capacity(self.voxel_count());
        self.rows(dims).for_each(|row| cropped.extend_from_slice(&values[row]));
        Cow::Owned(cropped)
    }

    /// The same, moved to the array's front; what is behind it is left over.
    pub fn gather<'a, T: Copy>(&self, values: &'a mut [T], dims: [usize; 3]) -> &'a mut [T] {
        if self.dims() != dims {
            let mut gathered = 0;
            for row in self.rows(dims) {
                let len = row.len();
                values.copy_within(row, gathered);
                gathered += len;
            }
        }
        &mut values[..self.voxel_count()]
    }
}

/// Every how many voxels along each axis to look at parts of these dimensions, so that no more than about `most` are looked
/// at: one of each part at least.
#[must_use]
pub fn lattice_stride(parts: &[[usize; 3]], most: usize) -> usize {
    let count = |stride: usize| {
        parts.iter().map(|dims| dims.map(|dim| dim.div_ceil(stride)).iter().product::<usize>()).sum::<usize>()
    };
    (1..).find(|&stride| count(stride) <= most.max(parts.len())).unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_grow_up_to_the_faces_and_crop_what_they_hold() {
        let region = Region { start: [1, 2, 3], end: [3, 4, 5] };
        let outer = region.grown([2, 1, 9], [8, 5, 6]);
        assert_eq!(outer, Region { start: [0, 1, 0], end: [5, 5, 6] });
        let place = |index: usize| [index % 8, index / 8 % 5, index / 40];
        let volume: Vec<_> = (0..8 * 5 * 6).map(place).collect();
        let cropped = outer.crop(&volume, [8, 5, 6]);
        let inner = region.within(&outer).crop(&cropped, outer.dims()).into_owned();
        assert_eq!(inner, region.crop(&volume, [8, 5, 6]).into_owned());
        assert_eq!(region.gather(&mut volume.clone(), [8, 5, 6]), inner);
        assert_eq!((inner.len(), inner[0], inner[7]), (region.voxel_count(), [1, 2, 3], [2, 3, 4]));
        assert!(matches!(Region::whole([8, 5, 6]).crop(&volume, [8, 5, 6]), Cow::Borrowed(_)));
    }
}
