//! Where a volume's voxels lie in the world.

use glam::{DAffine3, DMat3, DVec3};
use serde::{Deserialize, Serialize};

use crate::{Error, Result};

/// What the world axes mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum WorldFrame {
    /// Nothing is known.
    Unspecified,
    /// Patient coordinates: x to the left, y to the back (posterior), z to the head (superior), as in DICOM and ITK.
    LeftPosteriorSuperior,
}

/// A regular grid of voxels: `world = origin + direction · (spacing ∘ index)`.
///
/// Voxel centres lie on integer indices. `direction[a]` is the unit vector in the world along index axis `a`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GridGeometry {
    /// Number of voxels along x, y, z.
    pub dims: [u32; 3],
    /// Distance between neighbouring voxels along each axis, in world units; positive.
    pub spacing: [f64; 3],
    /// World position of voxel (0, 0, 0).
    pub origin: [f64; 3],
    /// Orthonormal axes; a mirrored grid has determinant −1.
    pub direction: [[f64; 3]; 3],
    /// Unit of the world's lengths (`mm`, `µm`), or empty where none is known.
    pub unit: String,
    /// What the world axes mean.
    pub frame: WorldFrame,
}

/// By how much two axes' directions may fail to be orthonormal: header files round to about six digits.
const ORTHONORMAL_TOLERANCE: f64 = 1e-3;

impl GridGeometry {
    /// A grid at the world's origin, its axes along the world's.
    #[must_use]
    pub fn axis_aligned(dims: [u32; 3], spacing: [f64; 3]) -> Self {
        Self {
            dims,
            spacing,
            origin: [0.0; 3],
            direction: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            unit: String::new(),
            frame: WorldFrame::Unspecified,
        }
    }

    /// Number of voxels.
    ///
    /// # Panics
    /// When the product does not fit `usize`, which [`Self::validate`] rules out.
    #[must_use]
    pub fn voxel_count(&self) -> usize {
        self.dims_usize().iter().product()
    }

    /// The dimensions as `usize`.
    #[must_use]
    pub fn dims_usize(&self) -> [usize; 3] {
        self.dims.map(|dim| dim as usize)
    }

    /// `L_min`, the smallest spacing: the unit of steps and of `d_max`.
    #[must_use]
    pub fn smallest_spacing(&self) -> f64 {
        self.spacing[0].min(self.spacing[1]).min(self.spacing[2])
    }

    /// The rotation (or mirrored rotation) from grid axes to world axes.
    #[must_use]
    pub fn world_from_axes(&self) -> DMat3 {
        DMat3::from_cols_array_2d(&self.direction)
    }

    /// The affine map from index to world.
    #[must_use]
    pub fn world_from_index(&self) -> DAffine3 {
        let axes = self.world_from_axes() * DMat3::from_diagonal(DVec3::from_array(self.spacing));
        DAffine3::from_mat3_translation(axes, DVec3::from_array(self.origin))
    }

    /// Checks that the grid can be worked on.
    ///
    /// # Errors
    /// [`Error::Format`] for an empty axis, a count of voxels that no memory holds, a spacing that is not positive and
    /// finite, an origin that is not finite, or axes that are not orthonormal to 1e-3.
    pub fn validate(&self) -> Result<()> {
        let fail = |message: String| Err(Error::Format(message));
        if self.dims.contains(&0) {
            return fail(format!("dimensions {:?} hold no voxel", self.dims));
        }
        let voxels = self.dims.iter().fold(1_u128, |product, &dim| product * u128::from(dim));
        if voxels > (isize::MAX as u128) / 16 {
            return fail(format!("dimensions {:?} are {voxels} voxels, more than a machine can address", self.dims));
        }
        if let Some(spacing) = self.spacing.iter().find(|spacing| !(spacing.is_finite() && **spacing > 0.0)) {
            return fail(format!("spacing {:?}: {spacing} is not a positive length", self.spacing));
        }
        let (low, high) = (self.smallest_spacing(), self.spacing.iter().copied().fold(0.0, f64::max));
        if low < 1e-30 || high > 1e30 || high / low > 1e6 {
            return fail(format!("spacing {:?} spans more than this program's arithmetic can hold", self.spacing));
        }
        if self.origin.iter().any(|coordinate| !coordinate.is_finite()) {
            return fail(format!("origin {:?} is not finite", self.origin));
        }
        let axes = self.world_from_axes();
        let gram = axes.transpose() * axes - DMat3::IDENTITY;
        if !gram.is_finite() || gram.to_cols_array().iter().any(|entry| entry.abs() > ORTHONORMAL_TOLERANCE) {
            return fail(format!(
                "axis directions {:?} are not at right angles: resample the volume to a rectangular grid first",
                self.direction
            ));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn world_from_index_scales_then_rotates() {
        let mut geometry = GridGeometry::axis_aligned([4, 5, 6], [2.0, 3.0, 4.0]);
        geometry.origin = [10.0, 20.0, 30.0];
        geometry.direction = [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
        let world = geometry.world_from_index().transform_point3(DVec3::new(1.0, 1.0, 1.0));
        assert_eq!(world, DVec3::new(7.0, 22.0, 34.0));
        geometry.validate().expect("a rotated grid is valid");
    }

    #[test]
    fn bad_grids_are_refused() {
        let good = GridGeometry::axis_aligned([4, 5, 6], [1.0; 3]);
        for (dims, spacing) in [
            ([0, 1, 1], [1.0; 3]),
            ([u32::MAX; 3], [1.0; 3]),
            ([4, 4, 4], [1.0, -1.0, 1.0]),
            ([4, 4, 4], [1.0, f64::NAN, 1.0]),
            ([4, 4, 4], [1.0, 1e9, 1.0]),
        ] {
            let bad = GridGeometry { dims, spacing, ..good.clone() };
            assert!(matches!(bad.validate(), Err(Error::Format(_))), "{dims:?} {spacing:?}");
        }
        let sheared = GridGeometry { direction: [[1.0, 0.0, 0.0], [0.1, 1.0, 0.0], [0.0, 0.0, 1.0]], ..good };
        assert!(sheared.validate().is_err());
    }
}
