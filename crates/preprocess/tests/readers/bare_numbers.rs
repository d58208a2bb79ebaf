//! Files of nothing but numbers: headers that name them, and layouts that are proposed.

use std::fs;
use std::path::Path;

use voxrole_pack::{ScalarType, Scalars};
use voxrole_preprocess::io::{ByteOrder, RawLayout, ReadOptions, StoredType, open_volume, read_volume};

use crate::samples::{Files, Nifti, bytes, gzip, meta_header, nrrd_header, numbers};

const I16: StoredType = StoredType { scalar_type: ScalarType::I16, byte_order: ByteOrder::Big };

fn message(path: &Path) -> String {
    read_volume(path, &ReadOptions::default()).expect_err("no header").to_string()
}

#[test]
fn a_header_beside_the_numbers_is_found() {
    let data = bytes(&numbers(ScalarType::I16), ByteOrder::Big);
    let big = |data: &str| format!("encoding: raw\nspacings: 1 2 3\ndata file: {data}");
    let meta = |data: &str| meta_header(I16, &format!("ElementDataFile = {data}\n")).into_bytes();
    let pair = Nifti { magic: *b"ni1\0", vox_offset: 0.0, ..Nifti::new(I16) };
    let vvd = r#"<VoreenData version="1"><Volumes><Volume><RawData filename="a.raw" format="int16" x="3" y="4" z="5" />
        <MetaItem name="Spacing" type="Vec3MetaData"><value x="1" y="2" z="3" /></MetaItem></Volume></Volumes></VoreenData>"#;
    for (files, header) in [
        (Files::new([("a.raw", data.clone()), ("a.mhd", meta("a.raw"))]), "a.mhd"),
        (
            Files::new([("a.raw", data.clone()), ("other.nhdr", nrrd_header(I16, &big("a.raw")).into_bytes())]),
            "other.nhdr",
        ),
        (Files::new([("a.img", data.clone()), ("a.hdr", pair.header())]), "a.hdr"),
        (Files::new([("a.img.gz", gzip(&data)), ("a.hdr", pair.header())]), "a.hdr"),
        // Others are passed over, whatever is wrong with them.
        (Files::new([("a.raw", data.clone()), ("b.mhd", b"NDims = 9\n".to_vec()), ("c.mhd", meta("a.raw"))]), "c.mhd"),
    ] {
        let volume = open_volume(&files.path(), &ReadOptions::default()).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(volume.notes(), [format!("read by its header {header}")]);
        assert_eq!(volume.load().expect("numbers").scalars, numbers(ScalarType::I16), "{header}");
    }
    let little = bytes(&numbers(ScalarType::I16), ByteOrder::Little);
    let files = Files::new([("a.raw", little), ("a.vvd", vvd.into())]);
    for path in [files.path(), files.path().with_extension("vvd")] {
        let grid = read_volume(&path, &ReadOptions::default()).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!((grid.scalars, grid.geometry.spacing), (numbers(ScalarType::I16), [1.0, 2.0, 3.0]));
    }
    // A header of the same name that is broken is told of.
    let files = Files::new([("a.raw", data), ("a.mhd", b"NDims = 9\n".to_vec())]);
    assert!(message(&files.path()).contains("header beside it, found: "), "{}", message(&files.path()));
}

#[test]
fn descriptions_of_voreen_that_are_refused() {
    let good = r#"<VoreenData version="1"><RawData filename="a.raw" format="uint8" x="3" y="4" z="5" /></VoreenData>"#;
    for (old, new, expected) in [
        ("uint8", "Vector3(float)", "format: expected uint8"),
        ("RawData", "Other", "an element `RawData`"),
        ("a.raw", "none.raw", "none.raw"),
        (" z=\"5\"", "", "an attribute `z`"),
        ("y=\"4\"", "y=\"-4\"", "y: expected a whole number from 0 up"),
        ("z=\"5\"", "z=\"6\"", "expected 72 bytes"),
        ("</Vor", "<MetaItem name=\"Transformation\" /></Vor", "no transformation"),
    ] {
        let files = Files::new([("a.vvd", good.replace(old, new).into_bytes()), ("a.raw", vec![0; 60])]);
        assert!(message(&files.path()).contains(expected), "{}", message(&files.path()));
    }
}

/// A ball with a gradient, x fastest.
fn ball(dims: [usize; 3]) -> Vec<f64> {
    let [nx, ny, nz] = dims;
    let mut values = Vec::new();
    for k in 0..nz {
        for j in 0..ny {
            for i in 0..nx {
                let off = [(i, nx), (j, ny), (k, nz)].map(|(index, size)| 2.0 * index as f64 / size as f64 - 1.0);
                let radius = off.iter().map(|off| off * off).sum::<f64>().sqrt();
                values.push(if radius < 0.7 { 900.0 - 300.0 * radius } else { 20.0 * off[0] - 30.0 });
            }
        }
    }
    values
}

#[test]
fn the_smoothest_layout_is_proposed_first() {
    let dims = [48, 40, 56];
    let values = ball(dims);
    let encoded = |stored: &str| -> Vec<u8> {
        let stored: StoredType = stored.parse().expect("a type");
        let scalars = match stored.scalar_type {
            ScalarType::U8 => Scalars::U8(values.iter().map(|value| (value / 4.0 + 20.0) as u8).collect()),
            ScalarType::U16 => Scalars::U16(values.iter().map(|value| (value + 100.0) as u16).collect()),
            ScalarType::I16 => Scalars::I16(values.iter().map(|&value| value as i16).collect()),
            _ => Scalars::F32(values.iter().map(|&value| value as f32).collect()),
        };
        bytes(&scalars, stored.byte_order)
    };
    for stored in ["u8", "u16le", "u16be", "i16le", "i16be", "f32le", "f32be"] {
        let expected = format!("likeliest by its size and smoothness: --dims 48,40,56 --dtype {stored}");
        for files in
            [Files::new([("scan.raw", encoded(stored))]), Files::new([("scan.raw.gz", gzip(&encoded(stored)))])]
        {
            let found = message(&files.path());
            assert!(found.contains(&expected), "{stored}: {found}");
        }
        // With the dimensions only the type is open.
        let files = Files::new([("scan.raw", encoded(stored))]);
        let layout = RawLayout { dims: dims.map(|dim| dim as u32), scalar: None, spacing: [1.0; 3], skip_bytes: 0 };
        match read_volume(&files.path(), &layout.into()) {
            Ok(grid) => assert_eq!((grid.scalars.scalar_type(), stored), (ScalarType::U8, "u8")),
            Err(error) => {
                let expected = format!("likeliest first: --dtype {stored}");
                assert!(error.to_string().contains(&expected), "{stored}: {error}");
            }
        }
        let wrong = RawLayout { dims: [48, 40, 55], ..layout };
        let error = read_volume(&files.path(), &wrong.into()).expect_err("does not fit").to_string();
        assert!(error.contains("1, 2, 4 or 8 bytes for each of 48 x 40 x 55"), "{error}");
    }
}

#[test]
fn names_are_believed_before_smoothness() {
    let data =
        bytes(&Scalars::U16(ball([48, 40, 56]).iter().map(|value| (value + 100.0) as u16).collect()), ByteOrder::Big);
    let files = Files::new([("head_40x48x56_u16.raw", [vec![0; 100], data].concat())]);
    let found = message(&files.path());
    assert!(
        found.contains("smoothness: --dims 40,48,56 --dtype u16be --skip-bytes 100, or --dims 40,48,56 --dtype u16le"),
        "{found}"
    );
    // Nothing is proposed where nothing fits.
    let files = Files::new([("odd.raw", vec![7; 9973])]);
    assert!(!message(&files.path()).contains("likeliest"));
    fs::write(files.path(), [0; 3]).expect("written");
    assert!(!message(&files.path()).contains("likeliest"));
}
