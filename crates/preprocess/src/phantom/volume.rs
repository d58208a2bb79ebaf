//! One number for every voxel of a grid.

use glam::DVec3;
use rayon::prelude::*;
use voxrole_pack::GridGeometry;

use crate::{Error, Result};

/// `number` of each voxel's index and place in the world, x fastest.
///
/// # Errors
/// [`Error::OutOfMemory`] for a volume that does not fit.
pub(super) fn fill<T, F>(geometry: &GridGeometry, number: F) -> Result<Vec<T>>
where
    T: Copy + Default + Send,
    F: Fn(usize, DVec3) -> T + Sync,
{
    let count = geometry.voxel_count();
    let mut volume = Vec::new();
    volume.try_reserve_exact(count).map_err(|_| Error::OutOfMemory {
        what: format!("a phantom of {:?} voxels", geometry.dims),
        bytes: count as u128 * size_of::<T>() as u128,
    })?;
    volume.resize(count, T::default());

    let [width, height, _] = geometry.dims_usize();
    let world_from_index = geometry.world_from_index();
    volume.par_chunks_mut(width).enumerate().for_each(|(row_index, row)| {
        let (y, z) = (row_index % height, row_index / height);
        for (x, voxel) in row.iter_mut().enumerate() {
            let point = world_from_index.transform_point3(DVec3::new(x as f64, y as f64, z as f64));
            *voxel = number(row_index * width + x, point);
        }
    });
    Ok(volume)
}
