//! Zarr stores of all types of number, and stores that must be refused.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use tempfile::TempDir;
use voxrole_pack::{ScalarType, Scalars};
use voxrole_preprocess::io::{ByteOrder, ReadOptions, open_volume, read_volume};
use voxrole_preprocess::source::Source;

use crate::samples::{bytes, gzip, numbers};

/// A store of the sample's numbers in chunks of whole rows, two slices each.
fn store(scalar_type: ScalarType, codecs: &str, change: impl Fn(&[u8]) -> Vec<u8>) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let name = match scalar_type {
        ScalarType::U8 => "uint8",
        ScalarType::I8 => "int8",
        ScalarType::U16 => "uint16",
        ScalarType::I16 => "int16",
        ScalarType::U32 => "uint32",
        ScalarType::I32 => "int32",
        ScalarType::F32 => "float32",
        ScalarType::F64 => "float64",
    };
    let metadata = format!(
        r#"{{"zarr_format": 3, "node_type": "array", "shape": [5, 4, 3], "data_type": "{name}", "fill_value": 0,
            "chunk_grid": {{"name": "regular", "configuration": {{"chunk_shape": [2, 4, 3]}}}},
            "chunk_key_encoding": {{"name": "default", "configuration": {{"separator": "/"}}}},
            "codecs": [{codecs}], "attributes": {{}}}}"#
    );
    fs::write(folder.path().join("zarr.json"), metadata).expect("written");
    let slice = 12 * scalar_type.size_in_bytes();
    let mut data = bytes(&numbers(scalar_type), ByteOrder::Little);
    data.resize(6 * slice, 0);
    for (index, chunk) in data.chunks(2 * slice).enumerate() {
        let chunk_folder = folder.path().join(format!("c/{index}/0"));
        fs::create_dir_all(&chunk_folder).expect("made");
        fs::write(chunk_folder.join("0"), change(chunk)).expect("written");
    }
    folder
}

const BYTES: &str = r#"{"name": "bytes", "configuration": {"endian": "little"}}"#;
const GZIP: &str =
    r#"{"name": "bytes", "configuration": {"endian": "little"}}, {"name": "gzip", "configuration": {"level": 5}}"#;

/// Shards of chunks with one axis too few.
const FLAT_SHARDS: &str = r#"{"name": "sharding_indexed", "configuration": {"chunk_shape": [1, 4],
    "codecs": [{"name": "bytes", "configuration": {"endian": "little"}}],
    "index_codecs": [{"name": "bytes", "configuration": {"endian": "little"}}]}}"#;

fn message(folder: &Path) -> String {
    read_volume(folder, &ReadOptions::default()).expect_err("refused").to_string()
}

#[test]
fn all_types_are_read() {
    for scalar_type in ScalarType::ALL {
        for folder in [store(scalar_type, BYTES, <[u8]>::to_vec), store(scalar_type, GZIP, gzip)] {
            let grid = read_volume(folder.path(), &ReadOptions::default()).unwrap_or_else(|error| panic!("{error}"));
            assert_eq!(grid.scalars, numbers(scalar_type));
            assert_eq!(grid.geometry.dims, [3, 4, 5]);
        }
    }
}

#[test]
fn a_stopped_run_keeps_nothing_about_files_that_may_have_changed() {
    let folder = store(ScalarType::U8, BYTES, <[u8]>::to_vec);
    let temporary = tempfile::tempdir().expect("a folder");
    let volume = open_volume(folder.path(), &ReadOptions::default()).and_then(|volume| volume.stored(temporary.path()));
    assert_eq!(Source::from(&volume.expect("is read")).identity(), None);
}

#[test]
fn what_zarrs_writes_in_shards_is_read() {
    use zarrs::array::{ArrayBuilder, data_type};
    let folder = tempfile::tempdir().expect("a folder");
    let files = Arc::new(zarrs::storage::store::MemoryStore::new());
    let array = ArrayBuilder::new(vec![10, 20, 30], vec![8, 16, 16], data_type::float32(), 0.5_f32)
        .subchunk_shape(vec![2, 4, 8])
        .build(files.clone(), "/")
        .expect("an array");
    let values: Vec<f32> = (0..8 * 20 * 30).map(|n| n as f32 / 7.0).collect();
    array.store_array_subset(&[0..8, 0..20, 0..30], values.as_slice()).expect("stored");
    array.store_metadata().expect("stored");
    use zarrs::storage::{ListableStorageTraits, ReadableStorageTraits};
    for key in files.list().expect("keys") {
        let path = folder.path().join(key.as_str());
        fs::create_dir_all(path.parent().expect("a folder")).expect("made");
        fs::write(path, files.get(&key).expect("read").expect("there")).expect("written");
    }
    let grid = read_volume(folder.path(), &ReadOptions::default()).unwrap_or_else(|error| panic!("{error}"));
    let expected = values.into_iter().chain(vec![0.5; 2 * 20 * 30]).collect();
    assert_eq!((grid.geometry.dims, grid.scalars), ([30, 20, 10], Scalars::F32(expected)));
}

#[test]
fn bad_metadata_are_refused() {
    for (old, new, expected) in [
        ("[5, 4, 3]", "[5, 4]", "found"),
        ("[5, 4, 3]", "[5, 4, 0]", "hold no voxel"),
        ("[5, 4, 3]", "[2147483648, 2147483648, 2147483648]", "what a machine can address"),
        ("[5, 4, 3]", "[2147483648, 4, 3]", "chunks beside its metadata"),
        ("[5, 4, 3]", "[5, 4, 3, 2]", "found"),
        ("[5, 4, 3]", "[5, 4, -3]", "found"),
        ("[2, 4, 3]", "[2, 4, 0]", "found"),
        ("[2, 4, 3]", "[1048576, 1048576, 1]", "chunks of at most"),
        ("[2, 4, 3]", "[18446744073709551615, 4, 3]", "what a machine can address"),
        ("uint16", "uint64", "uint64"),
        ("uint16", "complex64", "complex64"),
        ("uint16", "string", "found"),
        ("regular", "other", "found"),
        ("\"gzip\"", "\"zfp\"", "zfp"),
        ("\"zarr_format\": 3", "\"zarr_format\": 9", "found"),
        ("\"node_type\": \"array\"", "\"node_type\": \"group\"", "OME-Zarr image"),
        ("{\"zarr", "{\"zarr_forma\u{0}\"", "JSON"),
        (GZIP, FLAT_SHARDS, "chunk_shape of 3 axes"),
        ("\"attributes\"", "\"dimension_names\": [\"x\", \"y\", \"z\"], \"attributes\"", "z, y and x in this order"),
    ] {
        let folder = store(ScalarType::U16, GZIP, gzip);
        let path = folder.path().join("zarr.json");
        let good = fs::read_to_string(&path).expect("text");
        assert!(good.contains(old), "{old}");
        fs::write(&path, good.replace(old, new)).expect("written");
        let message = message(folder.path());
        for part in [expected, "expected", "found"] {
            assert!(message.contains(part), "{part:?} is not in: {message}");
        }
        assert!(message.len() < 1000, "too long to read: {message}");
    }
}

#[test]
fn bad_chunks_are_refused() {
    let cut = |chunk: &[u8]| gzip(chunk)[..20].to_vec();
    let bomb = |_: &[u8]| gzip(&vec![0; 10_000_000]);
    let zstd = r#"{"name": "bytes", "configuration": {"endian": "little"}}, {"name": "zstd", "configuration": {"level": 1, "checksum": false}}"#;
    // A frame that says that it holds 2⁶³ bytes.
    let frame = |_: &[u8]| {
        [0xfd2f_b528_u32.to_le_bytes().as_slice(), &[0xe0], &(1_u64 << 63).to_le_bytes(), &[1, 0, 0]].concat()
    };
    let blosc = r#"{"name": "bytes", "configuration": {"endian": "little"}},
        {"name": "blosc", "configuration": {"typesize": 2, "cname": "lz4", "clevel": 5, "shuffle": "shuffle", "blocksize": 0}}"#;
    let claim = |_: &[u8]| {
        let mut chunk = vec![2, 1, 0x21, 2];
        chunk.extend([u32::MAX, u32::MAX, 20, 0].into_iter().flat_map(u32::to_le_bytes));
        chunk
    };
    for (codecs, change, expected) in [
        (BYTES, &(|chunk: &[u8]| chunk[..7].to_vec()) as &dyn Fn(&[u8]) -> Vec<u8>, "48"),
        (BYTES, &|chunk: &[u8]| [chunk, chunk].concat(), "48"),
        (GZIP, &cut, "compressed chunk"),
        (GZIP, &bomb, "at most 48 bytes"),
        (GZIP, &|chunk: &[u8]| gzip(&chunk[..7]), "48"),
        (zstd, &frame, "chunk"),
        (blosc, &claim, "at most 48 bytes"),
        (blosc, &|_| vec![1; 15], "Blosc"),
    ] {
        let folder = store(ScalarType::U16, codecs, change);
        let message = message(folder.path());
        for part in [expected, "zarr.json", "expected", "found"] {
            assert!(message.contains(part), "{part:?} is not in: {message}");
        }
    }
    let empty = store(ScalarType::U16, BYTES, <[u8]>::to_vec);
    fs::remove_dir_all(empty.path().join("c")).expect("removed");
    assert!(message(empty.path()).contains("at least 1 of the array"), "{}", message(empty.path()));
}

#[test]
fn images_outside_their_store_are_refused() {
    let inside = store(ScalarType::U16, BYTES, <[u8]>::to_vec);
    let folder = tempfile::tempdir().expect("a folder");
    let image = |path: &str| {
        let axes = r#"[{"name": "z"}, {"name": "y"}, {"name": "x"}]"#;
        let metadata = format!(
            r#"{{"zarr_format": 3, "node_type": "group", "attributes": {{"ome": {{"version": "0.5", "multiscales":
                [{{"axes": {axes}, "datasets": [{{"path": {path:?}}}]}}]}}}}}}"#
        );
        fs::write(folder.path().join("zarr.json"), metadata).expect("written");
        message(folder.path())
    };
    let name = inside.path().file_name().expect("a name").to_string_lossy().into_owned();
    for path in [format!("../{name}"), inside.path().to_string_lossy().into_owned(), "..".into(), "missing".into()] {
        let message = image(&path);
        assert!(message.contains("expected") && message.contains("found"), "{message}");
    }
    let zip = folder.path().join("a.zarr.zip");
    fs::write(&zip, b"PK\x03\x04 and more").expect("written");
    assert!(message(&zip).contains("unpack it first"), "{}", message(&zip));
}
