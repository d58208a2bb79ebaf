//! Bricks of a layer, ready to be written.

use std::ops::Range;

use rayon::prelude::*;

use crate::Result;
use crate::brick::BrickGrid;
use crate::compression::{Encoding, Packer, Sparse, Unpacker, all_same};
use crate::layer::{Layer, LayerKind};
use crate::mask;
use crate::reused::Reused;
use crate::scalar::{LittleEndian, Scalar};
use crate::value_range::ValueRange;

/// A brick, ready to be written.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedBrick {
    /// How `bytes` are to be unpacked.
    pub encoding: Encoding,
    /// The stored bytes.
    pub bytes: Vec<u8>,
    /// Their CRC-32.
    pub crc32: u32,
    /// Range of the physical values, or `None` if no voxel has one.
    pub range: Option<ValueRange>,
}

impl PackedBrick {
    /// The `len` numbers of a brick that does not need a mask.
    ///
    /// # Errors
    /// [`crate::Error::Format`] when the bytes are damaged or need a mask.
    pub fn unpack<T: LittleEndian>(&self, len: usize) -> Result<Vec<T>> {
        let mut values = Vec::new();
        Unpacker::new()?.unpack(self.encoding, &self.bytes, len, None, &mut values)?;
        Ok(values)
    }
}

/// A mask, ready to be written.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedMask {
    /// Its bits as a brick of bytes.
    pub brick: PackedBrick,
    /// CRC-32 of the bits themselves, by which sparse bricks know their mask.
    pub bits_crc32: u32,
}

impl PackedMask {
    /// The mask of a brick of `voxels` voxels that is packed already.
    ///
    /// # Errors
    /// [`crate::Error::Format`] when the bytes are damaged.
    pub fn of_brick(brick: PackedBrick, voxels: usize) -> Result<(Self, Vec<u8>)> {
        let bits: Vec<u8> = brick.unpack(voxels.div_ceil(8))?;
        Ok((Self { brick, bits_crc32: crc32fast::hash(&bits) }, bits))
    }
}

/// A brick of a layer, and of a layer of distances its mask too.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedLayerBrick<T> {
    /// The layer's.
    pub brick: PackedBrick,
    /// The mask's.
    pub mask: Option<PackedMask>,
    /// Every second voxel along each axis, or a single number where all are the same.
    pub coarse: Vec<T>,
}

/// Packs all bricks of a layer of a block of `dims` voxels, in the order of its grid: `encode` of `values`, x fastest. A
/// volume's block that begins at multiples of [`crate::brick::BRICK_EDGE`] has the same bricks as the volume. `masks` are those
/// of the block's distances, as [`PackedMask::bits_crc32`], or none.
///
/// # Errors
/// [`crate::Error::Io`] when zstd fails.
///
/// # Panics
/// When there are fewer values than voxels.
pub fn pack_bricks<S: LittleEndian, T: Scalar>(
    layer: &Layer,
    dims: [usize; 3],
    values: &[S],
    encode: impl Fn(S) -> T + Copy + Sync,
    masks: &[u32],
) -> Result<Vec<PackedLayerBrick<T>>> {
    let packer = LayerPacker { layer, grid: BrickGrid::new(dims), values, encode, masks };
    packer.pack(0..packer.grid.len(), &Workbenches::default())
}

/// Packs the bricks of a layer on every thread.
pub(crate) struct LayerPacker<'a, S, E> {
    pub layer: &'a Layer,
    pub grid: BrickGrid,
    /// All voxels of the grid.
    pub values: &'a [S],
    pub encode: E,
    /// Of every brick of the grid, or none.
    pub masks: &'a [u32],
}

impl<S: LittleEndian, E: Sync> LayerPacker<'_, S, E> {
    pub fn pack<T: Scalar>(
        &self,
        bricks: Range<usize>,
        workbenches: &Workbenches<T>,
    ) -> Result<Vec<PackedLayerBrick<T>>>
    where
        E: Fn(S) -> T + Copy,
    {
        let packed = |brick: usize| -> Result<_> {
            workbenches.0.lend(Workbench::new, |workbench| {
                workbench.gather(&self.grid, brick, self.values, self.encode);
                workbench.pack(self.layer, self.grid.dims_of(brick), self.masks.get(brick).copied())
            })?
        };
        // Bricks differ too much in work for more than one to be taken at a time.
        bricks.into_par_iter().with_max_len(1).map(packed).collect()
    }
}

/// What threads need to pack bricks.
#[derive(Default)]
pub struct Workbenches<T>(Reused<Workbench<T>>);

impl<T: Scalar> Workbenches<T> {
    /// Packs a brick of `dims` voxels of a layer: `encode` of all its values, x fastest.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when zstd fails.
    pub fn pack<S: LittleEndian>(
        &self,
        layer: &Layer,
        dims: [usize; 3],
        values: &[S],
        encode: impl Fn(S) -> T,
        mask: Option<u32>,
    ) -> Result<PackedLayerBrick<T>> {
        self.0.lend(Workbench::new, |workbench| {
            workbench.stored.clear();
            workbench.stored.extend(values.iter().map(|&value| encode(value)));
            workbench.pack(layer, dims, mask)
        })?
    }

    /// Adds what a brick of `dims` voxels that is packed already leaves to the coarser level. `mask` is needed by a sparse one.
    ///
    /// # Errors
    /// [`crate::Error::Format`] when the brick is damaged.
    pub fn unpack(
        &self,
        layer: &Layer,
        dims: [usize; 3],
        brick: PackedBrick,
        mask: Option<(PackedMask, Vec<u8>)>,
    ) -> Result<PackedLayerBrick<T>> {
        self.0.lend(Workbench::new, |workbench| {
            let sparse = mask.as_ref().zip(layer.fill()).map(|((_, mask), fill)| Sparse { mask, fill });
            let Workbench { unpacker, stored, .. } = workbench;
            let voxels = if brick.encoding == Encoding::Constant { 1 } else { dims.iter().product() };
            unpacker.unpack(brick.encoding, &brick.bytes, voxels, sparse, stored)?;
            let mask = mask.filter(|_| layer.kind == LayerKind::Distance).map(|(mask, _)| mask);
            Ok(PackedLayerBrick { brick, mask, coarse: every_second(stored, dims) })
        })?
    }
}

/// What one thread needs to pack bricks.
struct Workbench<T> {
    packer: Packer,
    unpacker: Unpacker,
    /// The brick's numbers, or a single one where they are all the same.
    stored: Vec<T>,
}

impl<T: Scalar> Workbench<T> {
    fn new() -> Result<Self> {
        Ok(Self { packer: Packer::new()?, unpacker: Unpacker::new()?, stored: Vec::new() })
    }

    fn gather<S: LittleEndian>(&mut self, grid: &BrickGrid, brick: usize, values: &[S], encode: impl Fn(S) -> T) {
        self.stored.clear();
        let first = grid.rows(brick).next().map(|row| values[row.start]);
        if let Some(first) = first.filter(|&first| grid.rows(brick).all(|row| all_same(&values[row], first))) {
            self.stored.push(encode(first));
            return;
        }
        for row in grid.rows(brick) {
            self.stored.extend(values[row].iter().map(|&value| encode(value)));
        }
    }

    fn pack(&mut self, layer: &Layer, dims: [usize; 3], mask: Option<u32>) -> Result<PackedLayerBrick<T>> {
        let Self { packer, stored, .. } = self;
        if stored.first().is_some_and(|&first| all_same(stored, first)) {
            stored.truncate(1);
        }
        let mut mask_crc32 = mask;
        let mut packed_mask = None;
        if layer.kind == LayerKind::Distance {
            let bits = boundary_mask(stored, dims.iter().product());
            let (encoding, bytes) = packer.pack(&bits, None)?;
            let brick = PackedBrick { crc32: crc32fast::hash(&bytes), encoding, bytes, range: None };
            let bits_crc32 = crc32fast::hash(&bits);
            mask_crc32 = Some(bits_crc32);
            packed_mask = Some(PackedMask { brick, bits_crc32 });
        }
        // Layers are sparse where they have numbers exactly where the distance has: not where voxels are masked.
        let fill = layer.fill().filter(|_| mask_crc32.is_some() && stored.len() > 1);
        let own = fill.map(|fill: T| (mask::of(stored, |value: T| !value.is_same(fill)), fill));
        let own = own.filter(|(mask, _)| mask_crc32 == Some(crc32fast::hash(mask)));
        let sparse = own.as_ref().map(|(mask, fill)| Sparse { mask, fill: *fill });
        let (encoding, bytes) = packer.pack(stored, sparse)?;
        let range = ValueRange::of(stored, &layer.quantization);
        let brick = PackedBrick { crc32: crc32fast::hash(&bytes), encoding, bytes, range };
        Ok(PackedLayerBrick { brick, mask: packed_mask, coarse: every_second(stored, dims) })
    }
}

/// Which of a brick's voxels have a boundary: all whose stored distance is none of the two lowest numbers.
pub(crate) fn boundary_mask<T: Scalar>(stored: &[T], voxels: usize) -> Vec<u8> {
    let is_hit = |value: T| value.to_f64() > T::LOWEST.to_f64() + 1.0;
    match stored {
        [one] => mask::of(&vec![is_hit(*one); voxels], |hit| hit),
        _ => mask::of(stored, is_hit),
    }
}

/// Every second number along each axis, the first among them; a single number stays one.
fn every_second<T: Copy>(values: &[T], [nx, ny, nz]: [usize; 3]) -> Vec<T> {
    if let [one] = values {
        return vec![*one];
    }
    let rows = (0..nz).step_by(2).flat_map(|k| (0..ny).step_by(2).map(move |j| (k * ny + j) * nx));
    rows.flat_map(|start| values[start..start + nx].iter().step_by(2).copied()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Error;

    #[test]
    fn every_second_voxel_is_kept() {
        let values: Vec<usize> = (0..5 * 3 * 2).collect();
        assert_eq!(every_second(&values, [5, 3, 2]), [0, 2, 4, 10, 12, 14]);
        assert_eq!(every_second(&[7], [5, 3, 2]), [7]);
    }

    #[test]
    fn a_lone_brick_needs_its_mask() {
        let error = PackedBrick { encoding: Encoding::SparseZstd, bytes: vec![], crc32: 0, range: None };
        assert!(matches!(error.unpack::<u16>(8), Err(Error::Format(_))));
    }
}
