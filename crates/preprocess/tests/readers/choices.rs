//! Files that hold several scalar volumes, and `.npy`.

use voxrole_pack::{ScalarType, Scalars};
use voxrole_preprocess::io::{ByteOrder, ReadOptions, StoredType, open_volume, read_volume};
use voxrole_preprocess::source::Source;

use crate::samples::{Files, Nifti, bytes, gzip, meta_header, nrrd_header, numbers, stored_types, zlib};

const U8: StoredType = StoredType { scalar_type: ScalarType::U8, byte_order: ByteOrder::Little };

fn component(component: usize) -> ReadOptions {
    ReadOptions { component: Some(component), ..ReadOptions::default() }
}

fn time(time: usize) -> ReadOptions {
    ReadOptions { time: Some(time), ..ReadOptions::default() }
}

#[track_caller]
fn refused(files: &Files, options: &ReadOptions, expected: &[&str]) {
    let message = read_volume(&files.path(), options).expect_err(expected[0]).to_string();
    for part in expected.iter().chain(&["expected", "found"]) {
        assert!(message.contains(part), "{part:?} is not in: {message}");
    }
}

/// Reads at once and through a file; both must give `expected`.
#[track_caller]
fn check(files: &Files, options: &ReadOptions, expected: &[u8]) {
    let open = || open_volume(&files.path(), options).unwrap_or_else(|error| panic!("{error}"));
    let dims = open().dims();
    assert_eq!(dims, [3, 4, 5]);
    assert_eq!(open().load().expect("numbers").scalars, Scalars::U8(expected.to_vec()));
    let folder = tempfile::tempdir().expect("a folder");
    let stored = open().stored(folder.path()).expect("numbers");
    let region = voxrole_preprocess::region::Region::whole(dims);
    assert_eq!(stored.voxels.read(&region).expect("numbers"), Scalars::U8(expected.to_vec()));
}

/// 120 numbers; those of the two volumes side by side, and one behind the other.
fn data() -> Vec<u8> {
    (0..120).collect()
}

fn interleaved(index: u8) -> Vec<u8> {
    (0..60).map(|voxel| 2 * voxel + index).collect()
}

fn behind(index: u8) -> Vec<u8> {
    (60 * index..60 * index + 60).collect()
}

#[test]
fn volumes_side_by_side() {
    let nrrd = nrrd_header(U8, "kinds: vector domain domain domain\nencoding: raw")
        .replace("dimension: 3\nsizes: 3 4 5", "dimension: 4\nsizes: 2 3 4 5");
    let packed = nrrd.replace("raw", "gzip");
    let meta = meta_header(U8, "ElementNumberOfChannels = 2\nElementDataFile = LOCAL\n");
    let zipped = meta_header(U8, "ElementNumberOfChannels = 2\nCompressedData = True\nElementDataFile = a.zraw\n");
    let npy = npy("|u1", "False", "(5, 4, 3, 2)");
    for files in [
        Files::new([("a.nrrd", [nrrd.as_bytes(), &data()].concat())]),
        Files::new([("a.nrrd", [packed.as_bytes(), &gzip(&data())].concat())]),
        Files::new([("a.mha", [meta.as_bytes(), &data()].concat())]),
        Files::new([("a.mhd", zipped.into_bytes()), ("a.zraw", zlib(&data()))]),
        Files::new([("a.npy", [npy, data()].concat())]),
    ] {
        for index in [0, 1] {
            check(&files, &component(index), &interleaved(index as u8));
        }
        refused(&files, &ReadOptions::default(), &["--component N", "from 0 to 1"]);
        refused(&files, &component(2), &["--component", "from 0 to 1"]);
    }
}

#[test]
fn volumes_one_behind_the_other() {
    let nrrd = nrrd_header(U8, "kinds: domain domain domain time\nencoding: raw")
        .replace("dimension: 3\nsizes: 3 4 5", "dimension: 4\nsizes: 3 4 5 2");
    let meta = meta_header(U8, "ElementSpacing = 1 2 3 1\nOffset = 1 2 3 4\nElementDataFile = LOCAL\n")
        .replace("NDims = 3\nDimSize = 3 4 5", "NDims = 4\nDimSize = 3 4 5 2");
    let nifti = Nifti { dim: [4, 3, 4, 5, 2, 1, 1, 1], ..Nifti::new(U8) };
    let nifti = [nifti.header(), data()].concat();
    for files in [
        Files::new([("a.nrrd", [nrrd.as_bytes(), &data()].concat())]),
        Files::new([("a.mha", [meta.as_bytes(), &data()].concat())]),
        Files::new([("a.nii", nifti.clone())]),
        Files::new([("a.nii.gz", gzip(&nifti))]),
        Files::new([("a.npy", [npy("|u1", "False", "(2, 5, 4, 3)"), data()].concat())]),
        Files::new([("a.npy", [npy("|b1", "True", "(3, 4, 5, 2)"), data()].concat())]),
    ] {
        let mut identities = Vec::new();
        for index in [0, 1] {
            check(&files, &time(index), &behind(index as u8));
            let folder = tempfile::tempdir().expect("a folder");
            let volume = open_volume(&files.path(), &time(index)).and_then(|volume| volume.stored(folder.path()));
            identities.push(Source::from(&volume.expect("is read")).identity().expect("files tell their times"));
        }
        assert!(identities[0] != identities[1], "a stopped run must not go on with the other");
        refused(&files, &ReadOptions::default(), &["--time N", "from 0 to 1"]);
        refused(&files, &time(2), &["--time", "from 0 to 1"]);
    }
    let vectors = Nifti { dim: [5, 3, 4, 5, 1, 2, 1, 1], ..Nifti::new(U8) };
    check(&Files::new([("a.nii", [vectors.header(), data()].concat())]), &component(1), &behind(1));
    let colours = Nifti { datatype: Some(128), bitpix: Some(24), ..Nifti::new(U8) };
    let colours = [colours.header(), (0..180).collect()].concat();
    let green: Vec<u8> = (0..60).map(|voxel| 3 * voxel + 1).collect();
    check(&Files::new([("a.nii", colours)]), &component(1), &green);
}

#[test]
fn time_as_an_axis_of_nrrd_s_space() {
    let space = "space: left-posterior-superior-time\nspace directions: (1,0,0,0) (0,2,0,0) (0,0,3,0) (0,0,0,4)\n\
                 space units: \"mm\" \"mm\" \"mm\" \"s\"\nencoding: raw";
    let nrrd = nrrd_header(U8, space).replace("dimension: 3\nsizes: 3 4 5", "dimension: 4\nsizes: 3 4 5 2");
    let files = Files::new([("a.nrrd", [nrrd.as_bytes(), &data()].concat())]);
    check(&files, &time(1), &behind(1));
    let geometry = read_volume(&files.path(), &time(1)).expect("is read").geometry;
    assert_eq!((geometry.spacing, geometry.unit.as_str()), ([1.0, 2.0, 3.0], "mm"));
}

#[test]
fn too_short_files_of_several_volumes() {
    let npy = [npy("|u1", "False", "(2, 5, 4, 3)"), data()[1..].to_vec()].concat();
    refused(&Files::new([("a.npy", npy)]), &time(0), &["expected 120 bytes (2 times 3 x 4 x 5 of u8)", "found 119"]);
    let nifti = Nifti { dim: [4, 3, 4, 5, 2, 1, 1, 1], ..Nifti::new(U8) };
    let nifti = [nifti.header(), data()[1..].to_vec()].concat();
    refused(&Files::new([("a.nii.gz", gzip(&nifti))]), &time(0), &["expected 120 bytes", "found 119"]);
    let huge = Nifti { dim: [5, 32767, 32767, 32767, 32767, 32767, 1, 1], ..Nifti::new(U8) };
    let both = ReadOptions { component: Some(0), time: Some(0), ..ReadOptions::default() };
    refused(&Files::new([("a.nii", huge.file())]), &both, &["more than a machine can address"]);
}

#[test]
fn options_without_effect_are_refused() {
    let files = Files::new([("a.nrrd", [nrrd_header(U8, "encoding: raw").as_bytes(), &data()[..60]].concat())]);
    assert!(read_volume(&files.path(), &ReadOptions::default()).is_ok());
    refused(&files, &component(0), &["--component 0", "leave the option out"]);
    refused(&files, &time(0), &["--time 0", "leave the option out"]);
    refused(&files, &ReadOptions { series: Some("1".into()), ..ReadOptions::default() }, &["--series"]);
    refused(&files, &ReadOptions { resample: true, ..ReadOptions::default() }, &["--resample"]);
    refused(&files, &ReadOptions { array: Some("a".into()), ..ReadOptions::default() }, &["--array"]);
}

#[test]
fn spacing_is_told_where_a_file_says_nothing() {
    let files = Files::new([("a.npy", [npy("|u1", "False", "(5, 4, 3)"), data()[..60].to_vec()].concat())]);
    let volume = open_volume(&files.path(), &ReadOptions::default()).expect("a volume");
    assert!(volume.notes()[0].contains("--spacing X,Y,Z"), "{:?}", volume.notes());
    let spaced = |spacing| ReadOptions { spacing: Some(spacing), ..ReadOptions::default() };
    let volume = open_volume(&files.path(), &spaced([0.5, 1.0, 2.0])).expect("a volume");
    assert_eq!(volume.notes(), ["voxels are taken to be 0.5,1,2 apart in place of 1,1,1"]);
    assert_eq!(volume.load().expect("numbers").geometry.spacing, [0.5, 1.0, 2.0]);
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let message = read_volume(&files.path(), &spaced([1.0, bad, 1.0])).expect_err("no length").to_string();
        assert!(message.contains("a.npy: --spacing"), "{message}");
    }
}

/// A header of `.npy`, filled up as NumPy does.
fn npy(descr: &str, fortran: &str, shape: &str) -> Vec<u8> {
    npy_of_version(1, &format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': {shape}, }}"))
}

fn npy_of_version(version: u8, text: &str) -> Vec<u8> {
    let length_bytes = if version == 1 { 2 } else { 4 };
    let mut text = text.to_owned();
    while !(8 + length_bytes + text.len() + 1).is_multiple_of(64) {
        text.push(' ');
    }
    text.push('\n');
    let length = &(text.len() as u32).to_le_bytes()[..length_bytes];
    [b"\x93NUMPY", &[version, 0][..], length, text.as_bytes()].concat()
}

#[test]
fn npy_of_every_type_version_and_order() {
    for stored in stored_types() {
        let letter = match stored.scalar_type {
            ScalarType::U8 | ScalarType::U16 | ScalarType::U32 => 'u',
            ScalarType::I8 | ScalarType::I16 | ScalarType::I32 => 'i',
            ScalarType::F32 | ScalarType::F64 => 'f',
        };
        let order = if stored.byte_order == ByteOrder::Big { '>' } else { '<' };
        let descr = format!("{order}{letter}{}", stored.scalar_type.size_in_bytes());
        let numbers = numbers(stored.scalar_type);
        let data = bytes(&numbers, stored.byte_order);
        for (version, fortran, shape) in [
            (1, "False", "(5, 4, 3)"),
            (2, "True", "(3, 4, 5)"),
            (3, "False", "(1, 5, 4, 3, 1)"),
            (1, "True", "(3,4,5)"),
        ] {
            let text = format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': {shape}, }}");
            let files = Files::new([("a.npy", [npy_of_version(version, &text), data.clone()].concat())]);
            let grid = read_volume(&files.path(), &ReadOptions::default()).unwrap_or_else(|error| panic!("{error}"));
            assert_eq!((grid.geometry.dims, &grid.scalars), ([3, 4, 5], &numbers), "{text}");
        }
    }
}

#[test]
fn npy_that_is_refused() {
    let file = |header: Vec<u8>| Files::new([("a.npy", [header, vec![0; 60]].concat())]);
    for (header, expected) in [
        (npy("<i8", "False", "(5, 4, 3)"), "astype"),
        (npy("=u1", "False", "(5, 4, 3)"), "descr"),
        (npy("|u1", "Maybe", "(5, 4, 3)"), "fortran_order"),
        (npy("|u1", "False", "(5, 12)"), "found 2 (12 x 5"),
        (npy("|u1", "False", "(5, 4, 0)"), "shape"),
        (npy("|u1", "False", "(5, 4, -3)"), "shape"),
        (npy("|u1", "False", "(5, 4, 3"), "shape"),
        (npy("|u1", "False", "(5, 4, 99999999999)"), "4294967295"),
        (npy("|u1", "False", "(5, 4, 4)"), "expected 80 bytes"),
        (npy("|u1", "False", "(2, 2, 5, 3, 2)"), "--component N along the first and --time N along the last"),
        (npy("|u1", "False", "(2, 2, 2, 2, 2, 2)"), "found 6"),
        (npy_of_version(1, "{'descr': [('a', '<u1')], 'fortran_order': False, 'shape': (5, 4, 3), }"), "descr"),
        (npy_of_version(1, "{'fortran_order': False, 'shape': (5, 4, 3), }"), "`descr`"),
        (npy_of_version(4, "{}"), "version 1 to 3, found 4"),
        (b"\x93NUMPY\x01".to_vec(), "found"),
    ] {
        refused(&file(header), &ReadOptions::default(), &["a.npy", expected]);
    }
}
