//! Levels of detail: level `l` has every `2^l`-th voxel along each axis.
//!
//! A voxel's role is a statement about its own place: how far the boundary is along its own gradient, and how strong it is
//! there. It holds for that place whatever becomes of the neighbours, so coarse levels keep voxels as they are. Averaged
//! distances would move boundaries; roles recomputed on averaged values move them by their curvature and lower every gradient
//! magnitude, so that regions of (v, g) chosen on one level would miss on another.

use crate::geometry::GridGeometry;

/// Most levels that a file may have.
pub const MOST_LEVELS: u32 = 16;
/// The longest axis of the coarsest level, where nothing else is asked for.
const COARSEST: u32 = 64;

/// Voxels along each axis on a level.
#[must_use]
pub fn dims_of_level(dims: [usize; 3], level: usize) -> [usize; 3] {
    dims.map(|dim| dim.div_ceil(1 << level))
}

/// How many levels a volume gets so that the coarsest has at most 64 voxels along each axis.
#[must_use]
pub fn usual_levels(dims: [u32; 3]) -> u32 {
    let longest = dims.into_iter().fold(1, u32::max);
    (1..MOST_LEVELS).find(|level| longest.div_ceil(1 << (level - 1)) <= COARSEST).unwrap_or(MOST_LEVELS)
}

impl GridGeometry {
    /// Where the voxels of a level lie: origin and direction stay, spacing doubles from level to level.
    #[must_use]
    pub fn at_level(&self, level: usize) -> Self {
        Self {
            dims: dims_of_level(self.dims_usize(), level).map(|dim| dim as u32),
            spacing: self.spacing.map(|spacing| spacing * f64::from(1_u32 << level)),
            ..self.clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_coarsest_level_is_small() {
        let levels = [1, 64, 65, 128, 129, 256, 1024, 4096, u32::MAX].map(|dim| usual_levels([dim, 1, 3]));
        assert_eq!(levels, [1, 1, 2, 2, 3, 3, 5, 7, 16]);
    }

    #[test]
    fn voxels_stay_where_they_are() {
        let mut geometry = GridGeometry::axis_aligned([33, 1, 6], [1.0, 2.0, 3.0]);
        geometry.origin = [5.0, 6.0, 7.0];
        let coarse = geometry.at_level(2);
        assert_eq!((coarse.dims, coarse.spacing), ([9, 1, 2], [4.0, 8.0, 12.0]));
        let place = coarse.world_from_index().transform_point3(glam::DVec3::new(8.0, 0.0, 1.0));
        assert_eq!(place, geometry.world_from_index().transform_point3(glam::DVec3::new(32.0, 0.0, 4.0)));
    }
}
