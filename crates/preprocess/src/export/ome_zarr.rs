//! Writer of OME-Zarr 0.5: a folder with one Zarr 3 array for each level, in chunks of 64³ voxels packed by zstd, of which
//! up to 4³ share a file (a shard). Chunks without any boundary are not written.

use std::io;
use std::path::Path;
use std::sync::Arc;

use voxrole_pack::{GridGeometry, Reader, ScalarType, with_scalars};
use zarrs::array::builder::ArrayBuilderFillValue;
use zarrs::array::codec::ZstdCodec;
use zarrs::array::{Array, ArrayBuilder, ArrayMetadataOptions, DataType, data_type};
use zarrs::filesystem::FilesystemStore;
use zarrs::group::GroupBuilder;

use super::ome_metadata::{attributes, axis_names};
use super::{ExportFormat, check_replaceable_folder, component, losses};
use crate::atomic_folder::AtomicFolder;
use crate::field_volume::FieldVolume;
use crate::fields::Field;
use crate::{Error, Result};

/// Longest edge of a chunk in voxels.
const CHUNK_EDGE: u64 = 64;
/// Longest edge of a shard in chunks.
const SHARD_CHUNKS: u64 = 4;
/// zstd's level: higher ones take several times as long and save a few percent.
const ZSTD_LEVEL: i32 = 3;

/// Writes all levels of a field from `finest` on, one after the other; returns what the format does not hold.
///
/// # Errors
/// As [`super::Export::write`]; [`Error::Io`] too when there is a folder of that name that does not look as if it was
/// written here, or a file.
pub(super) fn write(reader: &Reader, field: Field, finest: usize, path: &Path) -> Result<Vec<String>> {
    check_replaceable_folder(path).map_err(Error::io(path))?;
    reader.geometry(finest)?;
    let levels = finest..reader.levels();
    let geometries: Vec<GridGeometry> =
        levels.clone().map(|level| reader.geometry(level)).collect::<voxrole_pack::Result<_>>()?;
    let folder = AtomicFolder::create(path).map_err(Error::io(path))?;
    let failed = |error: Box<dyn std::error::Error + Send + Sync>| Error::io(path)(io::Error::other(error));
    let store = Arc::new(FilesystemStore::new(folder.path()).map_err(|error| failed(error.into()))?);
    let mut lost = Vec::new();
    for (index, level) in levels.enumerate() {
        let volume = FieldVolume::read(reader, field, level)?;
        if index == 0 {
            lost = losses(ExportFormat::OmeZarr, &volume);
            let mut group = GroupBuilder::new();
            group.attributes(attributes(reader.header(), &volume, &geometries));
            let group = group.build(Arc::clone(&store), "/").map_err(|error| failed(error.into()))?;
            group.store_metadata().map_err(|error| failed(error.into()))?;
        }
        write_level(&store, index, &volume).map_err(failed)?;
    }
    folder.commit().map_err(Error::io(path))?;
    Ok(lost)
}

type Failure = Box<dyn std::error::Error + Send + Sync>;

fn write_level(store: &Arc<FilesystemStore>, path: usize, volume: &FieldVolume) -> std::result::Result<(), Failure> {
    let [nx, ny, nz] = volume.geometry().dims.map(u64::from);
    // Of one component: channels come one after the other.
    let dims = [nz, ny, nx];
    let chunk = dims.map(|dim| dim.min(CHUNK_EDGE));
    let shard = [0, 1, 2].map(|axis| shard_chunks(dims[axis].div_ceil(chunk[axis])) * chunk[axis]);
    let components = volume.components() as u64;
    let with_channels = |of_channels: u64, [z, y, x]: [u64; 3]| -> Vec<u64> {
        if components == 1 { vec![z, y, x] } else { vec![of_channels, z, y, x] }
    };
    let array = ArrayBuilder::new(
        with_channels(components, dims),
        with_channels(1, shard),
        data_type_of(volume.scalar_type()),
        fill_value(volume),
    )
    .subchunk_shape(with_channels(1, chunk))
    .bytes_to_bytes_codecs(vec![Arc::new(ZstdCodec::new(ZSTD_LEVEL, false))])
    .dimension_names(Some(axis_names(volume.components()).iter().copied()))
    .build(Arc::clone(store), &format!("/{path}"))?;
    array.store_metadata_opt(&ArrayMetadataOptions::default().with_include_zarrs_metadata(false))?;
    let shards = [0, 1, 2].map(|axis| dims[axis].div_ceil(shard[axis]));
    for z in 0..shards[0] {
        for y in 0..shards[1] {
            for x in 0..shards[2] {
                let first = [z * shard[0], y * shard[1], x * shard[2]];
                for channel in 0..components {
                    let bytes = shard_bytes(volume, first, shard, channel as usize);
                    store_shard(&array, &with_channels(channel, [z, y, x]), volume.scalar_type(), &bytes)?;
                }
            }
        }
    }
    Ok(())
}

/// Chunks of a shard along an axis of that many: as few as make no more shards, so that little of the last one is empty.
fn shard_chunks(chunks: u64) -> u64 {
    chunks.div_ceil(chunks.div_ceil(SHARD_CHUNKS))
}

fn store_shard(
    array: &Array<FilesystemStore>,
    index: &[u64],
    scalar_type: ScalarType,
    bytes: &[u8],
) -> std::result::Result<(), Failure> {
    let numbers = voxrole_pack::Scalars::from_le_bytes(scalar_type, bytes);
    with_scalars!(numbers, values => array.store_chunk(index, values))?;
    Ok(())
}

/// One component of a shard's numbers, little-endian; beyond the volume's faces there is what stands for no value.
fn shard_bytes(volume: &FieldVolume, first: [u64; 3], shard: [u64; 3], channel: usize) -> Vec<u8> {
    let [nx, ny, nz] = volume.geometry().dims_usize();
    let [z0, y0, x0] = first.map(|index| index as usize);
    let [depth, height, width] = shard.map(|length| length as usize);
    let number_bytes = volume.scalar_type().size_in_bytes();
    let fill: &[u8] = if volume.is_nan_without_boundary() { &f32::NAN.to_le_bytes() } else { &[0; 8][..number_bytes] };
    let mut bytes = Vec::with_capacity(depth * height * width * number_bytes);
    let mut row = Vec::new();
    for z in z0..z0 + depth {
        for y in y0..y0 + height {
            let end = bytes.len() + width * number_bytes;
            if z < nz && y < ny {
                let start = (z * ny + y) * nx;
                let voxels = start + x0..start + (x0 + width).min(nx);
                if volume.components() == 1 {
                    volume.append_le(voxels, &mut bytes);
                } else {
                    row.clear();
                    volume.append_le(voxels, &mut row);
                    bytes.extend_from_slice(&component(&row, channel));
                }
            }
            let missing = (end - bytes.len()) / number_bytes;
            bytes.extend(std::iter::repeat_n(fill, missing).flatten());
        }
    }
    bytes
}

fn fill_value(volume: &FieldVolume) -> ArrayBuilderFillValue {
    match volume.scalar_type() {
        ScalarType::F32 if volume.is_nan_without_boundary() => f32::NAN.into(),
        ScalarType::F32 => 0.0_f32.into(),
        ScalarType::F64 => 0.0_f64.into(),
        _ => 0_u8.into(),
    }
}

fn data_type_of(scalar_type: ScalarType) -> DataType {
    match scalar_type {
        ScalarType::U8 => data_type::uint8(),
        ScalarType::I8 => data_type::int8(),
        ScalarType::U16 => data_type::uint16(),
        ScalarType::I16 => data_type::int16(),
        ScalarType::U32 => data_type::uint32(),
        ScalarType::I32 => data_type::int32(),
        ScalarType::F32 => data_type::float32(),
        ScalarType::F64 => data_type::float64(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_are_evenly_filled() {
        assert_eq!([1, 2, 4, 5, 6, 8, 9].map(shard_chunks), [1, 2, 4, 3, 3, 4, 3]);
    }
}
