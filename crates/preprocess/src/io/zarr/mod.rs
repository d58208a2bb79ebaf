//! Reader of Zarr 2 and 3 and of OME-Zarr 0.4 and 0.5 in folders (<https://zarr-specs.readthedocs.io>).

mod blosc;
mod chunk_files;
mod chunks;
mod codecs;
mod multiscales;

use std::fs;
use std::path::{Component, Path, PathBuf};

use chunk_files::ChunkFiles;
use chunks::Chunks;
use multiscales::{Lattice, Multiscale};
use serde_json::{Map, Value};
use voxrole_pack::ScalarType;
use zarrs::array::{Array, ArrayMetadata, ArrayShardedExt};
use zarrs::plugin::ExtensionName;

use super::placement::Placement;
use super::read_options::ReadOptions;
use super::volume_file::{Numbers, VolumeFile};
use crate::{Error, Result};

/// Longest metadata that are read.
const MAX_METADATA_BYTES: u64 = 16 << 20;
/// Most axes of an array.
const MAX_AXES: usize = 16;
/// Largest chunk that is read although the array itself is smaller.
const MAX_CHUNK_BYTES: u64 = 256 << 20;
/// Volumes above this length must have one in so many of their chunks.
const SPARSE_BYTES: u64 = 1 << 30;
const MAX_SPARSENESS: u64 = 1000;

/// Whether `path` is a folder with the metadata of a Zarr array or group.
pub(super) fn is_store(path: &Path) -> bool {
    ["zarr.json", ".zarray", ".zgroup"].iter().any(|name| path.join(name).is_file())
}

/// Reads an array, or the full resolution of an OME-Zarr image.
///
/// # Errors
/// As [`super::open_volume`].
pub(super) fn read(path: &Path, options: &ReadOptions) -> Result<VolumeFile> {
    let fail = |message: String| Error::format(path, message);
    let Node { is_array, attributes } = Node::read(path)?;
    if is_array {
        return Store::open(path, "")?.volume(options, None);
    }
    if let Some(image) = Multiscale::of_group(&attributes).map_err(fail)? {
        let array = image.full_resolution().map_err(fail)?;
        return Store::open(path, array)?.volume(options, Some(&image));
    }
    let names = children(path).join(", ");
    Err(fail(format!("expected a Zarr array or an OME-Zarr image, found a group with {names}: give one of those")))
}

/// What the metadata at the root of a store say.
struct Node {
    is_array: bool,
    attributes: Map<String, Value>,
}

impl Node {
    fn read(path: &Path) -> Result<Self> {
        if let Some(mut metadata) = json(&path.join("zarr.json"))? {
            let is_array = metadata.get("node_type").and_then(Value::as_str) == Some("array");
            let attributes = match metadata.remove("attributes") {
                Some(Value::Object(attributes)) => attributes,
                _ => Map::new(),
            };
            return Ok(Self { is_array, attributes });
        }
        let is_array = path.join(".zarray").is_file();
        Ok(Self { is_array, attributes: json(&path.join(".zattrs"))?.unwrap_or_default() })
    }
}

/// The object in a JSON file; `None` where there is no file.
fn json(path: &Path) -> Result<Option<Map<String, Value>>> {
    if !path.is_file() {
        return Ok(None);
    }
    let length = path.metadata().map_err(Error::io(path))?.len();
    if length > MAX_METADATA_BYTES {
        let message = format!("expected metadata of at most {MAX_METADATA_BYTES} bytes, found {length}");
        return Err(Error::format(path, message));
    }
    let text = fs::read(path).map_err(Error::io(path))?;
    let object = serde_json::from_slice(&text);
    object.map(Some).map_err(|error| Error::format(path, format!("expected a JSON object, found: {error}")))
}

/// Names of the arrays and groups in a folder, a few of them.
fn children(path: &Path) -> Vec<String> {
    let entries = fs::read_dir(path).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries
        .filter(|entry| is_store(&entry.path()))
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .take(20)
        .collect();
    names.sort();
    if names.is_empty() { vec!["nothing in it".into()] } else { names }
}

/// An array, opened.
struct Store<'a> {
    path: &'a Path,
    /// The file of the array's metadata.
    metadata: PathBuf,
    array: Array<ChunkFiles>,
    scalar_type: ScalarType,
}

impl<'a> Store<'a> {
    /// Opens the array at `name` in the store.
    fn open(path: &'a Path, name: &str) -> Result<Self> {
        codecs::register();
        if !Path::new(name).components().all(|component| matches!(component, Component::Normal(_))) {
            return Err(Error::format(path, format!("expected an array in the store, found the path {name:?}")));
        }
        let folder = path.join(name);
        let metadata = ["zarr.json", ".zarray"].map(|file| folder.join(file)).into_iter().find(|file| file.is_file());
        let metadata = metadata.ok_or_else(|| {
            Error::format(path, format!("expected a Zarr array at {name:?}, found no zarr.json or .zarray there"))
        })?;
        let fail = |message: String| Error::format(&metadata, message);
        check_shapes(&metadata)?;
        let store = |max_bytes| std::sync::Arc::new(ChunkFiles::new(path, max_bytes));
        let array = Array::open(store(MAX_METADATA_BYTES), &format!("/{name}"))
            .map_err(|error| fail(format!("expected a Zarr array that can be read, found: {error}")))?;
        let scalar_type = scalar_type(&array).map_err(fail)?;
        let bytes =
            array.shape().iter().try_fold(scalar_type.size_in_bytes() as u64, |bytes, &size| bytes.checked_mul(size));
        let limit = bytes.unwrap_or(u64::MAX).max(MAX_CHUNK_BYTES);
        check_chunks(&array, scalar_type, limit).map_err(fail)?;
        // Compressed chunks may be somewhat longer than plain ones.
        let array = array.with_storage(store(limit.saturating_mul(2)));
        Ok(Self { path, metadata, array, scalar_type })
    }

    fn volume(self, options: &ReadOptions, image: Option<&Multiscale>) -> Result<VolumeFile> {
        let fail = |message: String| Error::format(&self.metadata, message);
        let names = image.map(Multiscale::axis_names).unwrap_or_else(|| self.dimension_names());
        let shape = self.array.shape();
        let (z, fixed) = chosen(&names, shape, options).map_err(fail)?;
        let lattice = match image {
            Some(image) => image.lattice([z + 2, z + 1, z]).map_err(fail)?,
            None => Lattice { spacing: [1.0; 3], origin: [0.0; 3], unit: String::new() },
        };
        let dim = |axis: usize| u32::try_from(shape[axis]);
        let (Ok(x), Ok(y), Ok(depth)) = (dim(z + 2), dim(z + 1), dim(z)) else {
            return Err(fail(format!("expected axes of at most 4294967295 voxels, found {shape:?}")));
        };
        let Lattice { spacing, origin, unit } = lattice;
        let placement = Placement { origin, unit, ..Placement::axis_aligned([x, y, depth], spacing) };
        let geometry = placement.geometry(self.path)?;
        let bytes = geometry.voxel_count() as u64 * self.scalar_type.size_in_bytes() as u64;
        check_stored(self.metadata.parent().unwrap_or(self.path), &self.array, bytes).map_err(fail)?;
        let chunks = Chunks { files: [self.metadata], array: self.array, scalar_type: self.scalar_type, fixed, z };
        VolumeFile::new(self.path, geometry, Numbers::Slabs(Box::new(chunks)), 1.0, 0.0)
    }

    /// Names of the axes; of three without names they are z, y and x.
    fn dimension_names(&self) -> Vec<&str> {
        match self.array.dimension_names() {
            Some(names) if names.iter().all(Option::is_some) => names.iter().flatten().map(String::as_str).collect(),
            _ if self.array.dimensionality() == 3 => vec!["z", "y", "x"],
            _ => vec!["?"; self.array.dimensionality()],
        }
    }
}

/// The axis of z, behind which y and x follow, and the index to read on each axis before it.
fn chosen(names: &[&str], shape: &[u64], options: &ReadOptions) -> std::result::Result<(usize, Vec<u64>), String> {
    if names.len() != shape.len() || shape.len() < 3 {
        return Err(format!(
            "expected axes z, y and x and at most t and c before them, found {names:?} of sizes {shape:?}"
        ));
    }
    let z = shape.len() - 3;
    let is_volume = names[z..].iter().map(|name| name.to_ascii_lowercase()).eq(["z", "y", "x"]);
    // Three axes of other names are taken in the order that all of Zarr has.
    let has_space = names.iter().any(|name| ["x", "y", "z"].iter().any(|space| name.eq_ignore_ascii_case(space)));
    if !is_volume && (z > 0 || has_space) {
        return Err(format!("expected the last axes to be z, y and x in this order, found {names:?}"));
    }
    let mut fixed = Vec::new();
    let (mut has_time, mut has_channel) = (false, false);
    for (name, &size) in names[..z].iter().zip(shape) {
        let size = usize::try_from(size).unwrap_or(usize::MAX);
        let index = match name.to_ascii_lowercase().as_str() {
            "t" | "time" if !has_time => {
                has_time = true;
                options.time_of(size)?
            }
            "c" | "channel" if !has_channel => {
                has_channel = true;
                options.component_of(size, "channels")?
            }
            _ if size == 1 => 0,
            _ => return Err(format!("expected axes t, c, z, y and x, found {name:?} of {size}")),
        };
        fixed.push(index as u64);
    }
    if !has_time {
        options.time_of(1)?;
    }
    if !has_channel {
        options.component_of(1, "channels")?;
    }
    Ok((z, fixed))
}

/// The type of the array's numbers.
fn scalar_type(array: &Array<ChunkFiles>) -> std::result::Result<ScalarType, String> {
    let name = array.data_type().name_v3().unwrap_or_default();
    Ok(match name.as_ref() {
        "uint8" => ScalarType::U8,
        "int8" => ScalarType::I8,
        "uint16" => ScalarType::U16,
        "int16" => ScalarType::I16,
        "uint32" => ScalarType::U32,
        "int32" => ScalarType::I32,
        "float32" => ScalarType::F32,
        "float64" => ScalarType::F64,
        _ => {
            return Err(format!(
                "expected integers of 8, 16 or 32 bits or floats of 32 or 64, found {name}: convert the array first"
            ));
        }
    })
}

/// Checks counts of axes and sizes before they are multiplied anywhere.
fn check_shapes(path: &Path) -> Result<()> {
    fn check(value: &Value, depth: usize) -> std::result::Result<(), String> {
        match value {
            Value::Object(object) if depth < 16 => {
                for (name, value) in object {
                    if ["shape", "chunks", "chunk_shape"].contains(&name.as_str()) {
                        check_shape(name, value)?;
                    }
                    check(value, depth + 1)?;
                }
                Ok(())
            }
            Value::Array(values) if depth < 16 => values.iter().try_for_each(|value| check(value, depth + 1)),
            _ => Ok(()),
        }
    }
    let metadata = json(path)?.unwrap_or_default();
    for (name, value) in metadata.into_iter().filter(|(name, _)| name != "attributes") {
        let field = Value::Object(Map::from_iter([(name, value)]));
        check(&field, 0).map_err(|message| Error::format(path, message))?;
    }
    Ok(())
}

fn check_shape(name: &str, value: &Value) -> std::result::Result<(), String> {
    let Some(sizes) = value.as_array() else { return Ok(()) };
    let product =
        sizes.iter().filter_map(Value::as_u64).try_fold(1_u64, |product, size| product.checked_mul(size.max(1)));
    if sizes.len() > MAX_AXES || product.is_none_or(|product| product > i64::MAX as u64 / 16) {
        return Err(format!("{name}: expected at most {MAX_AXES} axes and what a machine can address, found {value}"));
    }
    Ok(())
}

/// Makes sure that chunks have one size, and a size that there is memory for.
fn check_chunks(array: &Array<ChunkFiles>, scalar_type: ScalarType, limit: u64) -> std::result::Result<(), String> {
    if let ArrayMetadata::V3(metadata) = array.metadata()
        && metadata.chunk_grid.name() != "regular"
    {
        return Err(format!("chunk_grid: expected chunks of one size, found {}", metadata.chunk_grid.name()));
    }
    let shape = array
        .chunk_shape(&vec![0; array.dimensionality()])
        .map_err(|error| format!("expected chunks, found: {error}"))?;
    // zarrs takes any count of axes for what a shard is made of.
    if let Some(inner) = array.effective_subchunk_shape()
        && inner.len() != shape.len()
    {
        return Err(format!("sharding_indexed: expected a chunk_shape of {} axes, found {}", shape.len(), inner.len()));
    }
    let size = scalar_type.size_in_bytes() as u64;
    let bytes = shape.iter().try_fold(size, |bytes, size| bytes.checked_mul(size.get()));
    match bytes {
        Some(bytes) if bytes <= limit => Ok(()),
        _ => Err(format!("expected chunks of at most {limit} bytes, found {shape:?} numbers of {size} bytes")),
    }
}

/// Makes sure that a large volume is not nearly all fill value, which costs a hostile file nothing.
fn check_stored(folder: &Path, array: &Array<ChunkFiles>, bytes: u64) -> std::result::Result<(), String> {
    let chunks = array.chunk_grid_shape().iter().fold(1, |chunks: u64, &count| chunks.saturating_mul(count));
    let needed = if bytes > SPARSE_BYTES { chunks.div_ceil(MAX_SPARSENESS) } else { 1 };
    let found = stored_chunks(folder, MAX_AXES, needed);
    if found < needed {
        return Err(format!(
            "expected at least {needed} of the array's {chunks} chunks beside its metadata, found {found}"
        ));
    }
    Ok(())
}

/// Count of files but metadata in an array's folder, counted up to `enough`.
fn stored_chunks(folder: &Path, depth: usize, enough: u64) -> u64 {
    let mut count = 0;
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let is_metadata = name.as_encoded_bytes().starts_with(b".") || name == "zarr.json";
        let is_folder = entry.file_type().is_ok_and(|kind| kind.is_dir());
        count += match is_folder {
            true if depth > 0 => stored_chunks(&entry.path(), depth - 1, enough - count),
            true => 0,
            false => u64::from(!is_metadata),
        };
        if count >= enough {
            break;
        }
    }
    count
}
