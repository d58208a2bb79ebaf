//! Coarser levels of a packed file's layers: level l has every 2ˡ-th voxel of level 0 along each axis.

use voxrole_pack::scalar::Scalar;
use voxrole_pack::{GridGeometry, LayerKind, Reader, Scalars};

use crate::{Error, Result};

/// Halving goes on until no axis is longer: what any viewer shows at once.
const COARSEST_EDGE: u32 = 64;

/// Number of levels, level 0 included.
#[must_use]
pub fn level_count(reader: &Reader) -> u32 {
    let longest = reader.header().geometry.dims.into_iter().max().unwrap_or(1);
    (0..u32::BITS).find(|&level| halved(longest, level) <= COARSEST_EDGE).map_or(1, |coarsest| coarsest + 1)
}

/// Where the voxels of a level lie: `ceil(dims / 2ˡ)` of them, from the same origin, `2ˡ` times as far apart.
///
/// # Errors
/// [`Error::Parameter`] when the file has no such level.
pub fn level_geometry(reader: &Reader, level: u32) -> Result<GridGeometry> {
    let levels = level_count(reader);
    if level >= levels {
        return Err(Error::Parameter(format!("--level {level}: the file has the levels 0 to {}", levels - 1)));
    }
    let finest = &reader.header().geometry;
    Ok(GridGeometry {
        dims: finest.dims.map(|dim| halved(dim, level)),
        spacing: finest.spacing.map(|spacing| spacing * f64::from(level).exp2()),
        ..finest.clone()
    })
}

/// All stored numbers of a layer at a level, x fastest.
///
/// # Errors
/// As [`Reader::read_layer`] and [`level_geometry`].
pub fn read_layer<T: Scalar>(reader: &Reader, kind: LayerKind, level: u32) -> Result<Vec<T>> {
    level_geometry(reader, level)?;
    Ok(subsampled(reader.read_layer(kind)?, reader.header().geometry.dims_usize(), level))
}

/// The input's numbers at a level in their own type, with the factor and offset that make them physical.
///
/// # Errors
/// As [`read_layer`].
pub fn read_value(reader: &Reader, level: u32) -> Result<(Scalars, f64, f64)> {
    level_geometry(reader, level)?;
    let dims = reader.header().geometry.dims_usize();
    let (scalars, slope, intercept) = reader.read_value()?;
    let scalars = match scalars {
        Scalars::U8(values) => Scalars::U8(subsampled(values, dims, level)),
        Scalars::I8(values) => Scalars::I8(subsampled(values, dims, level)),
        Scalars::U16(values) => Scalars::U16(subsampled(values, dims, level)),
        Scalars::I16(values) => Scalars::I16(subsampled(values, dims, level)),
        Scalars::U32(values) => Scalars::U32(subsampled(values, dims, level)),
        Scalars::I32(values) => Scalars::I32(subsampled(values, dims, level)),
        Scalars::F32(values) => Scalars::F32(subsampled(values, dims, level)),
        Scalars::F64(values) => Scalars::F64(subsampled(values, dims, level)),
    };
    Ok((scalars, slope, intercept))
}

/// `ceil(dim / 2ˡ)`.
fn halved(dim: u32, level: u32) -> u32 {
    dim.div_ceil(1_u32.checked_shl(level).unwrap_or(u32::MAX))
}

/// Every 2ˡ-th number along each axis, moved to the front of the memory they are in.
fn subsampled<T: Copy>(mut values: Vec<T>, [nx, ny, nz]: [usize; 3], level: u32) -> Vec<T> {
    let step = 1 << level;
    if step == 1 {
        return values;
    }
    let mut kept = 0;
    for z in (0..nz).step_by(step) {
        for y in (0..ny).step_by(step) {
            for x in (0..nx).step_by(step) {
                values[kept] = values[(z * ny + y) * nx + x];
                kept += 1;
            }
        }
    }
    values.truncate(kept);
    values.shrink_to_fit();
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_second_voxel_is_kept_from_the_first_on() {
        let values: Vec<usize> = (0..5 * 3 * 2).collect();
        assert_eq!(subsampled(values.clone(), [5, 3, 2], 1), [0, 2, 4, 10, 12, 14]);
        assert_eq!(subsampled(values.clone(), [5, 3, 2], 2), [0, 4]);
        assert_eq!(subsampled(values.clone(), [5, 3, 2], 3), [0]);
        assert_eq!(subsampled(values.clone(), [5, 3, 2], 0), values);
        assert_eq!([0, 1, 2, 3].map(|level| halved(5, level)), [5, 3, 2, 1]);
    }
}
