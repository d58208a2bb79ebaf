//! What is known of every macrocell, gathered from a packed file brick by brick: the same as from all texels at once.
//!
//! Voxels on the faces between bricks belong to the macrocells on both sides. So a brick says something of the macrocells
//! that begin in it and, by its first voxels, of the last ones of the bricks before it.

use voxrole_pack::brick::BRICK_EDGE;
use voxrole_pack::error::vec_with_capacity;

use super::macrocells::{MACROCELL, MacrocellRanges, Ranges, macrocells};
use super::occlusion::{MacrocellSamples, Sample, sample_of};
use crate::Result;
use crate::streaming::{PackedVolume, TexelBrick, TexelSource};

/// Macrocells that begin in a brick along each axis.
const OWN: usize = BRICK_EDGE / MACROCELL as usize;
/// With the last one of the brick before.
const TOUCHED: usize = OWN + 1;

/// What is kept for each macrocell when its ranges are known: these, and how far it is from what is drawn, with bits to find that
/// out.
const RANGES_BYTES: u64 = size_of::<Ranges>() as u64 + 3;
/// As [`RANGES_BYTES`] for samples, with the shares that become of them.
const SAMPLES_BYTES: u64 = size_of::<[Sample; 4]>() as u64 + 7;

impl MacrocellRanges {
    /// Gathers the ranges of a volume's macrocells, on every thread.
    ///
    /// # Errors
    /// [`crate::Error::Pack`], naming brick and layer, when a brick is damaged, [`crate::Error::TooMuchMemory`] when the ranges
    /// themselves take too much.
    pub fn of(source: &TexelSource) -> Result<Self> {
        match source {
            TexelSource::Memory(volume) => Ok(Self::new(volume)),
            TexelSource::File(volume) => Self::of_packed(volume),
        }
    }

    fn of_packed(volume: &PackedVolume) -> Result<Self> {
        let dims = macrocells(volume.description().texel_dims().map(|dim| dim as usize));
        let count = dims.iter().product::<usize>();
        volume.claim("knowing where something can be drawn", count as u64 * RANGES_BYTES)?;
        let mut ranges = vec_with_capacity(count, "macrocells")?;
        ranges.resize(count, Ranges::NONE);
        volume.for_each_brick(
            |_, brick| touched_ranges(brick),
            |brick, touched| {
                let first = volume.grid().voxel_ranges(brick).map(|range| range.start / MACROCELL as usize);
                for_each_place(first, dims, |place, number| ranges[number].merge(touched[place]));
            },
        )?;
        Ok(Self { dims, ranges })
    }
}

/// The ranges over a brick's voxels, for each macrocell that has any of them: the first ones along each axis are those of the
/// brick before.
fn touched_ranges(brick: &TexelBrick) -> Vec<Ranges> {
    if let Some(texel) = brick.constant() {
        let mut ranges = Ranges::NONE;
        ranges.add(texel);
        return vec![ranges; TOUCHED.pow(3)];
    }
    let [width, height, depth] = brick.dims();
    let mut texels = vec![[0; 4]; width * height * depth];
    brick.copy_to([0..width, 0..height, 0..depth], &mut texels, [width, height], [0; 3]);
    let mut touched = vec![Ranges::NONE; TOUCHED.pow(3)];
    let size = MACROCELL as usize;
    // Those before and behind a voxel that lies on the face between two.
    let around = |voxel: usize| voxel.div_ceil(size)..=voxel / size + 1;
    for (row, texels) in texels.chunks_exact(width).enumerate() {
        let mut along_row = [Ranges::NONE; TOUCHED];
        for (x, &texel) in texels.iter().enumerate() {
            around(x).for_each(|place| along_row[place].add(texel));
        }
        for (z, y) in around(row / height).flat_map(|z| around(row % height).map(move |y| (z, y))) {
            let touched = &mut touched[(z * TOUCHED + y) * TOUCHED..][..TOUCHED];
            touched.iter_mut().zip(along_row).for_each(|(touched, ranges)| touched.merge(ranges));
        }
    }
    touched
}

/// Calls `visit` with every place among what a brick touches and the macrocell's own number; `first` is the first macrocell that
/// begins in the brick.
fn for_each_place(first: [usize; 3], dims: [usize; 3], mut visit: impl FnMut(usize, usize)) {
    let along = |axis: usize| {
        (0..TOUCHED).filter_map(move |place| {
            let macrocell = (first[axis] + place).checked_sub(1)?;
            (macrocell < dims[axis]).then_some((place, macrocell))
        })
    };
    for (z, k) in along(2) {
        for (y, j) in along(1) {
            for (x, i) in along(0) {
                visit((z * TOUCHED + y) * TOUCHED + x, (k * dims[1] + j) * dims[0] + i);
            }
        }
    }
}

impl MacrocellSamples {
    /// Gathers the samples of a packed volume's macrocells, on every thread.
    ///
    /// # Errors
    /// As [`MacrocellRanges::of`].
    pub fn of_packed(volume: &PackedVolume) -> Result<Self> {
        let voxels = volume.description().texel_dims().map(|dim| dim as usize);
        let dims = macrocells(voxels);
        let count = dims.iter().product::<usize>();
        volume.claim("`--occlusion`", count as u64 * SAMPLES_BYTES)?;
        let mut samples = vec_with_capacity(count, "samples of macrocells")?;
        samples.resize(count, [[0; 3]; 4]);
        let first = |brick: usize| volume.grid().voxel_ranges(brick).map(|range| range.start / MACROCELL as usize);
        // Every macrocell's samples lie in the brick in which it begins.
        let own = |brick: usize| {
            let first = first(brick);
            let along = move |axis: usize| first[axis]..(first[axis] + OWN).min(dims[axis]);
            along(2).flat_map(move |k| along(1).flat_map(move |j| along(0).map(move |i| [i, j, k])))
        };
        volume.for_each_brick(
            |brick, texels| -> Vec<[Sample; 4]> {
                let start = first(brick).map(|macrocell| macrocell * MACROCELL as usize);
                let sample = |macrocell| {
                    Self::places(macrocell, voxels)
                        .map(|place| sample_of(texels.texel([0, 1, 2].map(|axis: usize| place[axis] - start[axis]))))
                };
                own(brick).map(sample).collect()
            },
            |brick, found| {
                let numbers = own(brick).map(|[i, j, k]| (k * dims[1] + j) * dims[0] + i);
                numbers.zip(found).for_each(|(number, found)| samples[number] = found);
            },
        )?;
        Ok(Self { dims, samples })
    }
}
