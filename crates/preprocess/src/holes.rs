//! Voxels without a number, for kernels that would carry them through the whole volume.
//!
//! A recursive filter makes every voxel of a line depend on every other: one NaN would destroy the volume. So holes are
//! filled from their rims first, and every voxel whose kernel reaches into a hole is masked afterwards.

use rayon::prelude::*;

use crate::working_field::{Field, dims_of, voxels, voxels_mut};

/// How many voxels deep a hole is filled layer by layer. What lies deeper is seen from outside the hole through 12 voxels
/// of the slowest decaying filter, that of the quintic spline: 0.43¹² is 4e-5.
const LAYERS: usize = 12;

/// The holes of a field, by voxel.
#[derive(Clone, Debug)]
pub struct Holes {
    voxels: Vec<usize>,
    dims: [usize; 3],
}

impl Holes {
    /// Fills every NaN of a field: layer by layer from the rim by the mean of the known neighbours, and the rest by 0.
    pub fn fill(field: &mut Field) -> Self {
        let dims = dims_of(field);
        let all: Vec<usize> = {
            let source = voxels(field);
            (0..source.len()).into_par_iter().filter(|&voxel| source[voxel].is_nan()).collect()
        };
        let mut unknown = all.clone();
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
        Self { voxels: all, dims }
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
