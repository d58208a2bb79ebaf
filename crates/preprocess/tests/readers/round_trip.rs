//! What was written is what is read: every type, both byte orders, every way to store the numbers.

use voxrole_pack::{GridGeometry, ScalarType, WorldFrame};
use voxrole_preprocess::io::{ByteOrder, RawLayout, ReadOptions, StoredType, nrrd_writer, read_volume};

use crate::samples::{DIMS, Files, Nifti, bytes, gzip, meta_header, nrrd_header, numbers, stored_types, zlib};

fn check(files: &Files, options: &ReadOptions, stored: StoredType, case: &str) {
    let grid = read_volume(&files.path(), options).unwrap_or_else(|error| panic!("{case} {stored}: {error}"));
    assert_eq!(grid.scalars, numbers(stored.scalar_type), "{case} {stored}");
    assert_eq!(grid.geometry.dims, DIMS, "{case} {stored}");
    assert_eq!((grid.slope, grid.intercept), (1.0, 0.0), "{case} {stored}");
    assert_eq!(grid.name, files.path().file_name().expect("a file").to_string_lossy(), "{case} {stored}");
}

fn sample(stored: StoredType) -> Vec<u8> {
    bytes(&numbers(stored.scalar_type), stored.byte_order)
}

#[test]
fn raw() {
    for stored in stored_types() {
        let data = sample(stored);
        let skipped = [b"header".as_slice(), &data].concat();
        let layout = |skip_bytes| RawLayout { dims: DIMS, scalar: Some(stored), spacing: [1.0, 2.0, 3.0], skip_bytes };
        check(&Files::new([("a.raw", data.clone())]), &layout(0).into(), stored, "plain");
        check(&Files::new([("a.raw", skipped.clone())]), &layout(6).into(), stored, "skipped");
        check(&Files::new([("a.raw.gz", gzip(&data))]), &layout(0).into(), stored, "gzip");
        check(&Files::new([("a.raw.gz", gzip(&skipped))]), &layout(6).into(), stored, "gzip skipped");
    }
}

#[test]
fn raw_numbers_may_begin_like_a_gzip_file() {
    let mut data = vec![9; 60];
    data[..3].copy_from_slice(&[0x1f, 0x8b, 8]);
    let scalar = StoredType { scalar_type: ScalarType::U8, byte_order: ByteOrder::Little };
    let layout = RawLayout { dims: DIMS, scalar: Some(scalar), spacing: [1.0; 3], skip_bytes: 0 };
    let grid = read_volume(&Files::new([("a.raw", data)]).path(), &layout.into()).expect("the length fits");
    assert_eq!(grid.scalars.get(1), 139.0);
}

#[test]
fn nrrd() {
    for stored in stored_types() {
        let data = sample(stored);
        let attached = |lines: &str, data: &[u8]| [nrrd_header(stored, lines).as_bytes(), data].concat();
        let detached = |lines: &str| nrrd_header(stored, &format!("{lines}\ndata file: data.bin")).into_bytes();
        let behind = |prefix: &[u8]| [prefix, &data].concat();
        let cases: [(&str, Files); 9] = [
            ("attached raw", Files::new([("a.nrrd", attached("encoding: raw", &data))])),
            ("attached gzip", Files::new([("a.nrrd", attached("encoding: gzip", &gzip(&data)))])),
            ("attached gz", Files::new([("a.nrrd", attached("encoding: GZ", &gzip(&data)))])),
            ("detached", Files::new([("a.nhdr", detached("encoding: raw")), ("data.bin", data.clone())])),
            ("detached gz", Files::new([("a.nhdr", detached("encoding: gz")), ("data.bin", gzip(&data))])),
            (
                "line and byte skip",
                Files::new([
                    ("a.nhdr", detached("encoding: raw\nline skip: 2\nbyte skip: 3")),
                    ("data.bin", behind(b"one\ntwo\nabc")),
                ]),
            ),
            (
                "byte skip -1",
                Files::new([("a.nhdr", detached("encoding: raw\nbyteskip: -1")), ("data.bin", behind(b"anything"))]),
            ),
            (
                "byte skip in the unpacked stream",
                Files::new([
                    ("a.nhdr", detached("encoding: gzip\nbyte skip: 5")),
                    ("data.bin", gzip(&behind(b"12345"))),
                ]),
            ),
            ("attached skip", Files::new([("a.nrrd", attached("encoding: raw\nbyte skip: 2", &behind(b"ab")))])),
        ];
        for (case, files) in &cases {
            check(files, &ReadOptions::default(), stored, case);
        }
    }
}

#[test]
fn nrrd_with_windows_line_ends_and_no_last_line_end() {
    let stored = StoredType { scalar_type: ScalarType::I16, byte_order: ByteOrder::Big };
    let header = nrrd_header(stored, "encoding: raw").replace('\n', "\r\n");
    let files = Files::new([("a.nrrd", [header.as_bytes(), &sample(stored)].concat())]);
    check(&files, &ReadOptions::default(), stored, "attached, windows");
    let header = nrrd_header(stored, "encoding: raw\ndata file: ./data.bin");
    let files = Files::new([("a.nhdr", header.trim_end().into()), ("data.bin", sample(stored))]);
    check(&files, &ReadOptions::default(), stored, "detached, no line end");
}

#[test]
fn metaimage() {
    for stored in stored_types() {
        let data = sample(stored);
        let packed = zlib(&data);
        let header =
            |lines: &str, file: &str| meta_header(stored, &format!("{lines}ElementDataFile = {file}\n")).into_bytes();
        let size = format!("CompressedData = True\nCompressedDataSize = {}\n", packed.len());
        let local = |lines: &str, data: &[u8]| [header(lines, "LOCAL"), data.to_vec()].concat();
        let cases: [(&str, Files); 7] = [
            ("mha", Files::new([("a.mha", local("", &data))])),
            ("mha zlib", Files::new([("a.mha", local("CompressedData = True\n", &packed))])),
            ("mha zlib with size", Files::new([("a.MHA", local(&size, &packed))])),
            ("mhd", Files::new([("a.mhd", header("", "a.raw")), ("a.raw", data.clone())])),
            ("mhd zlib", Files::new([("a.mhd", header(&size, "a.zraw")), ("a.zraw", packed.clone())])),
            (
                "HeaderSize",
                Files::new([("a.mhd", header("HeaderSize = 3\n", "a.raw")), ("a.raw", [b"abc", &*data].concat())]),
            ),
            (
                "HeaderSize -1",
                Files::new([("a.mhd", header("HeaderSize = -1\n", "a.raw")), ("a.raw", [b"abcd", &*data].concat())]),
            ),
        ];
        for (case, files) in &cases {
            check(files, &ReadOptions::default(), stored, case);
        }
    }
}

#[test]
fn nifti() {
    for stored in stored_types() {
        let nifti = Nifti::new(stored);
        let extended = Nifti { vox_offset: 368.0, ..nifti.clone() };
        let extended = [extended.header(), vec![1; 16], sample(stored)].concat();
        let pair = Nifti { magic: *b"ni1\0", vox_offset: 0.0, ..nifti.clone() }.header();
        let cases: [(&str, Files); 7] = [
            ("nii", Files::new([("a.nii", nifti.file())])),
            ("nii.gz", Files::new([("a.nii.gz", gzip(&nifti.file()))])),
            ("extension", Files::new([("a.nii", extended.clone())])),
            ("extension gz", Files::new([("a.nii.gz", gzip(&extended))])),
            ("pair", Files::new([("a.hdr", pair.clone()), ("a.img", sample(stored))])),
            ("pair, image packed", Files::new([("a.hdr", pair.clone()), ("a.img.gz", gzip(&sample(stored)))])),
            ("pair, both packed", Files::new([("a.hdr.gz", gzip(&pair)), ("a.img.gz", gzip(&sample(stored)))])),
        ];
        for (case, files) in &cases {
            check(files, &ReadOptions::default(), stored, case);
        }
    }
}

#[test]
fn written_nrrd_is_read_back_whole() {
    let third = 1.0 / 3.0;
    let geometries = [
        GridGeometry::axis_aligned(DIMS, [0.1, 1e-3, 123.456]),
        GridGeometry {
            origin: [-99.609_374_999_999_99, 1e-300, third],
            direction: [[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]],
            unit: "a \"strange\\ µ".into(),
            frame: WorldFrame::LeftPosteriorSuperior,
            ..GridGeometry::axis_aligned(DIMS, [0.78125, third, 6.5])
        },
    ];
    for geometry in geometries {
        for scalar_type in ScalarType::ALL {
            let mut out = Vec::new();
            nrrd_writer::write_scalars(&mut out, &geometry, &numbers(scalar_type), "a sample").expect("into memory");
            let grid = read_volume(&Files::new([("a.nrrd", out)]).path(), &ReadOptions::default()).expect("own file");
            assert_eq!((grid.geometry, grid.scalars), (geometry.clone(), numbers(scalar_type)));
        }
    }
}
