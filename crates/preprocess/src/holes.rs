//! Voxels without a number, for kernels that would carry them through the whole volume.
//!
//! A spline's filter would spread one NaN over a cube of 49 voxels, though weights fall off within a few. So holes are filled
//! from their rims first, and every voxel whose kernel reaches into a hole is masked afterwards.

use std::borrow::Cow;

use rayon::prelude::*;

use crate::working_field::{Field, dims_of, voxels, voxels_mut};

/// How many voxels deep a hole is filled layer by layer. What lies deeper is seen from outside the hole through 12 voxels
/// of the slowest decaying filter, that of the quintic spline: 0.43¹² is 4e-5.
pub const LAYERS: usize = 12;
/// Voxels that are looked at together.
const BLOCK: usize = 1 << 14;

/// The holes of a field, by voxel.
#[derive(Clone, Debug)]
pub struct Holes {
    voxels: Vec<usize>,
    dims: [usize; 3],
}

impl Holes {
    /// The NaN of a field.
    fn find(field: &Field) -> Self {
        let blocks = voxels(field).par_chunks(BLOCK).enumerate();
        // Whole vectors first: most blocks have no hole.
        let with_holes = blocks.filter(|(_, block)| block.iter().fold(false, |found, value| found | value.is_nan()));
        let voxels = with_holes.flat_map_iter(|(index, block)| {
            let holes = block.iter().enumerate().filter(|(_, value)| value.is_nan());
            holes.map(move |(place, _)| index * BLOCK + place)
        });
        Self { voxels: voxels.collect(), dims: dims_of(field) }
    }

    /// A field without its holes, itself where it has none.
    pub fn filled(field: &Field) -> (Cow<'_, Field>, Self) {
        let holes = Self::find(field);
        if holes.voxels.is_empty() {
            return (Cow::Borrowed(field), holes);
        }
        let mut filled = field.clone();
        holes.fill_into(&mut filled);
        (Cow::Owned(filled), holes)
    }

    /// Fills every NaN of a field: layer by layer from the rim by the mean of the known neighbours, and the rest by 0.
    pub fn fill(field: &mut Field) -> Self {
        let holes = Self::find(field);
        holes.fill_into(field);
        holes
    }

    fn fill_into(&self, field: &mut Field) {
        let dims = self.dims;
        let mut unknown = self.voxels.clone();
        for _ in 0..LAYERS {
            if unknown.is_empty() {
                break;
            }
            let source = voxels(field);
            let layer: Vec<(usize, f32)> =
                unknown.par_iter().map(|&voxel| (voxel, mean_of_neighbours(source, dims, voxel))).collect();
            let target = voxels_mut(field);
            for &(voxel, mean) in &layer {
                target[voxel] = mean;
            }
            unknown = layer.into_iter().filter(|(_, mean)| mean.is_nan()).map(|(voxel, _)| voxel).collect();
        }
        let target = voxels_mut(field);
        unknown.into_iter().for_each(|voxel| target[voxel] = 0.0);
    }

    /// Makes NaN of every voxel within `radius` voxels along each axis of a hole.
    pub fn mask(&self, field: &mut Field, radius: usize) {
        let target = voxels_mut(field);
        for &voxel in &self.voxels {
            for_each_around(self.dims, voxel, radius, |voxel| target[voxel] = f32::NAN);
        }
    }
}

/// NaN where no neighbour is known.
fn mean_of_neighbours(source: &[f32], dims: [usize; 3], voxel: usize) -> f32 {
    let (mut sum, mut count) = (0.0, 0.0);
    for_each_around(dims, voxel, 1, |voxel| {
        if !source[voxel].is_nan() {
            sum += source[voxel];
            count += 1.0;
        }
    });
    // 0/0 where none is known.
    sum / count
}

fn for_each_around([nx, ny, nz]: [usize; 3], voxel: usize, radius: usize, mut take: impl FnMut(usize)) {
    let around = |at: usize, len: usize| at.saturating_sub(radius)..(at + radius + 1).min(len);
    for k in around(voxel / (nx * ny), nz) {
        for j in around(voxel / nx % ny, ny) {
            for i in around(voxel % nx, nx) {
                take((k * ny + j) * nx + i);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;

    #[test]
    fn a_hole_is_filled_from_its_rim_and_masked_with_its_surroundings() {
        let mut field = Array3::from_elem((5, 6, 7), 0.5_f32);
        field[[2, 3, 3]] = f32::NAN;
        field[[0, 0, 0]] = f32::NAN;
        let holes = Holes::fill(&mut field);
        assert!(voxels(&field).iter().all(|&value| value == 0.5));
        holes.mask(&mut field, 1);
        assert_eq!(voxels(&field).iter().filter(|value| value.is_nan()).count(), 27 + 8);
    }

    #[test]
    fn large_holes_are_filled_throughout() {
        let mut field = Array3::from_elem((1, 1, 60), f32::NAN);
        field[[0, 0, 0]] = 1.0;
        Holes::fill(&mut field);
        assert_eq!(voxels(&field)[..13], [1.0; 13]);
        assert_eq!(voxels(&field)[13..], [0.0; 47]);
    }
}
