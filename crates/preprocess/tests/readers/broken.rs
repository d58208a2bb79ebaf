//! Files that must be refused, each with a message that names the file, what was expected and what was found.

use voxrole_pack::ScalarType;
use voxrole_preprocess::io::{ByteOrder, RawLayout, ReadOptions, StoredType, read_volume};

use crate::samples::{DIMS, Files, Nifti, bytes, gzip, meta_header, nrrd_header, numbers, zlib};

const U16: StoredType = StoredType { scalar_type: ScalarType::U16, byte_order: ByteOrder::Little };

/// 120 bytes of numbers.
fn data() -> Vec<u8> {
    bytes(&numbers(ScalarType::U16), ByteOrder::Little)
}

#[track_caller]
fn refused_with(files: &Files, options: &ReadOptions, expected: &[&str]) {
    let message = read_volume(&files.path(), options).expect_err(expected[0]).to_string();
    for part in expected.iter().chain(&["expected", "found"]) {
        assert!(message.contains(part), "{part:?} is not in: {message}");
    }
    assert!(message.len() < 700, "too long to read: {message}");
}

/// Each row: what replaces what in a good attached header, what replaces the data, and parts of the message.
type HeaderCase<'a> = (&'a str, &'a str, &'a [&'a str]);

#[track_caller]
fn nrrd(cases: &[HeaderCase<'_>]) {
    let good = nrrd_header(U16, "encoding: raw\nspacings: 1 2 3");
    for (old, new, expected) in cases {
        assert!(good.contains(old), "{old}");
        let file = [good.replace(old, new).as_bytes(), &data()].concat();
        refused_with(&Files::new([("a.nrrd", file)]), &ReadOptions::default(), &[&["a.nrrd"], *expected].concat());
    }
}

#[track_caller]
fn metaimage(cases: &[HeaderCase<'_>]) {
    let good = meta_header(U16, "ElementSpacing = 1 2 3\nHeaderSize = 0\nElementDataFile = LOCAL\n");
    for (old, new, expected) in cases {
        assert!(good.contains(old), "{old}");
        let file = [good.replace(old, new).as_bytes(), &data()].concat();
        refused_with(&Files::new([("a.mha", file)]), &ReadOptions::default(), &[&["a.mha"], *expected].concat());
    }
}

#[track_caller]
fn nifti(header: Nifti, expected: &[&str]) {
    refused_with(&Files::new([("a.nii", header.file())]), &ReadOptions::default(), &[&["a.nii"], expected].concat());
    refused_with(
        &Files::new([("a.nii.gz", gzip(&header.file()))]),
        &ReadOptions::default(),
        &[&["a.nii.gz"], expected].concat(),
    );
}

fn good_nifti() -> Nifti {
    Nifti::new(U16)
}

fn layout(dims: [u32; 3], spacing: [f64; 3], skip_bytes: u64) -> RawLayout {
    RawLayout { dims, scalar: Some(U16), spacing, skip_bytes }
}

#[test]
fn raw_files_that_do_not_fit_their_layout() {
    let raw = Files::new([("a.raw", data())]);
    let packed = Files::new([("a.raw.gz", gzip(&data()))]);
    for (dims, spacing, skip, expected) in [
        ([3, 4, 6], [1.0; 3], 0, ["expected 144 bytes (3 x 4 x 6 of u16le)", "found 120"]),
        ([3, 4, 4], [1.0; 3], 0, ["expected 96 bytes", "found"]),
        ([3, 4, 5], [1.0; 3], 1, ["expected 120 bytes", "found 119"]),
        ([1 << 31, 1 << 20, 1], [1.0; 3], 0, ["expected 4503599627370496 bytes", "found 120"]),
    ] {
        let layout = layout(dims, spacing, skip);
        refused_with(&raw, &layout.into(), &["a.raw", expected[0], expected[1], "--dims, --dtype and --skip-bytes"]);
        refused_with(&packed, &layout.into(), &["a.raw.gz", expected[0]]);
    }
    for (dims, spacing, skip, expected) in [
        (DIMS, [1.0; 3], 1000, "1000"),
        (DIMS, [1.0; 3], u64::MAX, "18446744073709551615"),
        ([u32::MAX; 3], [1.0; 3], 0, "more than a machine can address"),
        ([3, 0, 5], [1.0; 3], 0, "hold no voxel"),
        (DIMS, [1.0, -1.0, 1.0], 0, "-1 is not a positive length"),
        (DIMS, [1.0, f64::NAN, 1.0], 0, "NaN is not a positive length"),
    ] {
        for files in [&raw, &packed] {
            refused_with(files, &layout(dims, spacing, skip).into(), &["a.raw", expected]);
        }
    }
}

#[test]
fn files_of_other_kinds() {
    let padded = |bytes: &[u8]| [bytes, &[0; 400]].concat();
    let dicom = [vec![0; 128], padded(b"DICM\x02\0")].concat();
    for (name, bytes, expected) in [
        ("empty.raw", Vec::new(), "empty"),
        ("a.raw", vec![1; 1000], "--dims X,Y,Z --dtype u16be --spacing SX,SY,SZ --skip-bytes N"),
        ("a.raw.gz", gzip(&data()), "content is not NIfTI"),
        ("cut.gz", gzip(&data())[..12].to_vec(), "cannot be unpacked"),
        ("a.dcm", dicom, "DICOM"),
        ("a.vti", padded(b"<?xml version=\"1.0\"?><VTKFile type=\"ImageData\">"), "XML"),
        ("a.vtk", padded(b"# vtk DataFile Version 3.0\n"), ".vti"),
        ("a.tif", padded(b"MM\0*"), "TIFF"),
        ("a.mhd", b"Something = else\n".to_vec(), "no known kind"),
        ("a.vxr", padded(b"\x89VXR\r\n\x1a\n"), "already packed"),
    ] {
        refused_with(&Files::new([(name, bytes)]), &ReadOptions::default(), &[name, expected]);
    }
    let folder = tempfile::tempdir().expect("a folder");
    let message = read_volume(folder.path(), &ReadOptions::default()).expect_err("a folder").to_string();
    assert!(message.contains("or of DICOM images, found no DICOM image in 0 files"), "{message}");
    let missing = folder.path().join("missing.nrrd");
    assert!(read_volume(&missing, &ReadOptions::default()).expect_err("missing").to_string().contains("missing.nrrd"));
}

#[test]
fn nrrd_headers() {
    nrrd(&[
        ("NRRD0004", "NRRD0009", &["NRRD0001 to NRRD0005", "NRRD0009"]),
        ("sizes: 3 4 5", "sizes: 3 4 6", &["expected 144 bytes (3 x 4 x 6 of u16le)", "found 120"]),
        ("sizes: 3 4 5", "sizes: 3 4 4", &["expected 96 bytes", "found 120"]),
        ("sizes: 3 4 5", "sizes: 2147483648 2147483648 2147483648", &["more than a machine can address"]),
        ("sizes: 3 4 5", "sizes: 2147483648 1 1", &["expected 4294967296 bytes", "found 120"]),
        ("sizes: 3 4 5", "sizes: 4294967296 1 1", &["axes of 1 to 4294967295", "4294967296"]),
        ("sizes: 3 4 5", "sizes: 99999999999999999999 1 1", &["a whole number from 0 up", "99999999999999999999"]),
        ("sizes: 3 4 5", "sizes: 3 -4 5", &["sizes", "-4"]),
        ("sizes: 3 4 5", "sizes: 3 0 5", &["sizes", "\"0\""]),
        ("sizes: 3 4 5", "sizes: 3 4", &["3 entries", "2 entries"]),
        ("sizes: 3 4 5\n", "", &["`sizes`"]),
        ("dimension: 3", "dimension: 2147483648", &["from 1 to 16"]),
        ("dimension: 3", "dimension: 4", &["sizes: expected 4 entries", "3 entries"]),
        ("spacings: 1 2 3", "spacings: 1 -2 3", &["-2 is not a positive length"]),
        ("spacings: 1 2 3", "spacings: 1 0 3", &["0 is not a positive length"]),
        ("spacings: 1 2 3", "spacings: 1 nan 3", &["spacings", "nan"]),
        ("spacings: 1 2 3", "spacings: 1 inf 3", &["inf is not a positive length"]),
        ("type: ushort", "type: longlong", &["type", "longlong"]),
        ("type: ushort", "type: block", &["type", "block"]),
        ("type: ushort\n", "", &["`type`"]),
        ("endian: little", "endian: middle", &["little or big", "middle"]),
        ("endian: little\n", "", &["endian: expected little or big"]),
        ("encoding: raw", "encoding: ascii", &["raw or gzip", "ascii"]),
        ("encoding: raw", "encoding: bzip2", &["raw or gzip", "bzip2"]),
        ("encoding: raw", "encoding: gzip", &["damaged", "expected 120 bytes"]),
        ("encoding: raw", "encoding: raw\nbyte skip: -2", &["byte skip", "-2"]),
        ("encoding: raw", "encoding: gzip\nbyte skip: -1", &["byte skip", "-1"]),
        ("encoding: raw", "encoding: raw\nbyte skip: 9223372036854775807", &["byte 92233720368547"]),
        ("encoding: raw", "encoding: raw\nline skip: 18446744073709551615", &["18446744073709551615 lines"]),
        ("encoding: raw", "encoding: raw\nencoding: raw", &["once", "twice"]),
        ("encoding: raw", "no field at all", &["field: value", "no field at all"]),
        ("encoding: raw", "encoding: raw\ndata file: LIST", &["one file", "LIST"]),
        ("encoding: raw", "encoding: raw\ndata file: LIST\na.raw\nb.raw", &["one file", "unu join"]),
        ("encoding: raw", "encoding: raw\ndata file: slice%03d.raw 1 5 1", &["one file", "slice%03d.raw"]),
        ("encoding: raw", "data file: LISTA.raw\nencoding: raw", &["LISTA.raw", "`data file` names that file"]),
        ("encoding: raw", "encoding: raw\ndata file: nowhere.raw", &["nowhere.raw", "`data file` names that file"]),
    ]);
}

#[test]
fn nrrd_with_other_counts_of_axes() {
    for (axes, expected) in [
        ("dimension: 4\nsizes: 3 4 5 2", "found four (3 x 4 x 5 x 2"),
        ("dimension: 4\nsizes: 3 4 5 2\nkinds: vector domain domain domain", "3 numbers per voxel"),
        ("dimension: 2\nsizes: 12 5", "three axes of a volume"),
    ] {
        let header = nrrd_header(U16, "encoding: raw").replace("dimension: 3\nsizes: 3 4 5", axes);
        let file = [header.as_bytes(), &data()].concat();
        refused_with(&Files::new([("a.nrrd", file)]), &ReadOptions::default(), &["a.nrrd", expected]);
    }
}

#[test]
fn nrrd_placements() {
    let directions = |space: &str, vectors: &str| format!("encoding: raw\n{space}\nspace directions: {vectors}");
    let lps = "space: left-posterior-superior";
    for (space, vectors, expected) in [
        (lps, "(1,0,0) (0.1,2,0) (0,0,3)", "not at right angles"),
        (lps, "(1,0,0) (0,2,0) (0,0,0)", "0 is not a positive length"),
        (lps, "(1,0,0) (0,nan,0) (0,0,3)", "finite numbers"),
        (lps, "(1,0,0) (0,1e300,0) (0,0,3)", "inf is not a positive length"),
        (lps, "(1,0) (0,1) (0,0)", "a vector (x,y,z)"),
        (lps, "(1,0,0) (0,2,0)", "3 entries"),
        (lps, "none (0,2,0) (0,0,3)", "three axes of space"),
        ("space: scanner-xyz-time", "(1,0,0) (0,2,0) (0,0,3)", "(x,y,z,0) or (0,0,0,t)"),
        ("space: plane", "(1,0,0) (0,2,0) (0,0,3)", "a space of three dimensions"),
        ("space dimension: 5", "(1,0,0) (0,2,0) (0,0,3)", "space dimension: expected 3"),
        ("content: none", "(1,0,0) (0,2,0) (0,0,3)", "no `space`"),
        ("space: RAS\nspace origin: (0,inf,0)", "(1,0,0) (0,2,0) (0,0,3)", "is not finite"),
        ("space: RAS\nspace origin: 0 0 0", "(1,0,0) (0,2,0) (0,0,3)", "space origin: expected (x,y,z)"),
        ("space: RAS\nspace units: \"mm\" \"mm\" \"s\"", "(1,0,0) (0,2,0) (0,0,3)", "the same unit"),
    ] {
        let header = nrrd_header(U16, &directions(space, vectors));
        let file = [header.as_bytes(), &data()].concat();
        refused_with(&Files::new([("a.nrrd", file)]), &ReadOptions::default(), &["a.nrrd", expected]);
    }
}

#[test]
fn nrrd_data() {
    let gzip_header = nrrd_header(U16, "encoding: gzip").into_bytes();
    let packed = gzip(&data());
    let with = |packed: &[u8]| Files::new([("a.nrrd", [&*gzip_header, packed].concat())]);
    let mut flipped = packed.clone();
    flipped[packed.len() / 2] ^= 0x10;
    refused_with(
        &with(&packed[..packed.len() / 2]),
        &ReadOptions::default(),
        &["a.nrrd", "truncated", "expected 120 bytes"],
    );
    refused_with(
        &with(&packed[..packed.len() - 1]),
        &ReadOptions::default(),
        &["a.nrrd", "truncated", "found 120 before their end"],
    );
    refused_with(&with(&flipped), &ReadOptions::default(), &["a.nrrd", "expected 120 bytes"]);
    refused_with(&with(&gzip(&data()[1..])), &ReadOptions::default(), &["a.nrrd", "expected 120 bytes", "found 119"]);
    refused_with(
        &with(&gzip(&[data(), vec![0]].concat())),
        &ReadOptions::default(),
        &["a.nrrd", "expected 120 bytes", "found more"],
    );
    // Ten million zeros behind a promise of 120 bytes: refused after 121 of them.
    refused_with(&with(&gzip(&vec![0; 10_000_000])), &ReadOptions::default(), &["a.nrrd", "found more"]);

    let detached = nrrd_header(U16, "encoding: raw\ndata file: data.bin").into_bytes();
    let short = Files::new([("a.nhdr", detached.clone()), ("data.bin", data()[..7].to_vec())]);
    refused_with(&short, &ReadOptions::default(), &["data.bin", "expected 120 bytes", "found 7"]);
    let no_end = nrrd_header(U16, "encoding: raw");
    refused_with(
        &Files::new([("a.nrrd", no_end.trim_end().into())]),
        &ReadOptions::default(),
        &["a.nrrd", "a blank line"],
    );
    let endless = [b"NRRD0004\ncontent: ".as_slice(), &vec![b'x'; 2 << 20]].concat();
    refused_with(&Files::new([("a.nrrd", endless)]), &ReadOptions::default(), &["a.nrrd", "at most 1048576 bytes"]);
}

#[test]
fn metaimage_headers() {
    metaimage(&[
        ("DimSize = 3 4 5", "DimSize = 3 4 6", &["expected 144 bytes", "found 120"]),
        ("DimSize = 3 4 5", "DimSize = 2147483648 2147483648 2147483648", &["more than a machine can address"]),
        ("DimSize = 3 4 5", "DimSize = 3 4", &["3 numbers", "3 4"]),
        ("DimSize = 3 4 5", "DimSize = 3 4 -5", &["a whole number from 0 up", "-5"]),
        ("DimSize = 3 4 5\n", "", &["DimSize"]),
        ("NDims = 3", "NDims = 5", &["NDims: expected 3", "\"5\""]),
        ("NDims = 3", "NDims = 4", &["DimSize: expected 4 numbers"]),
        ("NDims = 3\n", "", &["NDims: expected 3", "no such field"]),
        ("ObjectType = Image", "ObjectType = Tube", &["Image", "Tube"]),
        ("ElementType = MET_USHORT", "ElementType = MET_LONG_LONG", &["ElementType", "MET_LONG_LONG"]),
        ("ElementType = MET_USHORT\n", "", &["`ElementType`"]),
        ("ElementSpacing = 1 2 3", "ElementSpacing = 1 -2 3", &["-2 is not a positive length"]),
        ("ElementSpacing = 1 2 3", "ElementSpacing = 1 nan 3", &["NaN is not a positive length"]),
        ("ElementSpacing = 1 2 3", "TransformMatrix = 1 0 0 0.2 1 0 0 0 1", &["not at right angles"]),
        ("ElementSpacing = 1 2 3", "TransformMatrix = 0 0 0 0 0 0 0 0 0", &["not at right angles"]),
        (
            "ElementSpacing = 1 2 3",
            "ElementNumberOfChannels = 3",
            &["found 3 numbers per voxel (3 x 3 x 4 x 5)", "--component N"],
        ),
        ("ElementSpacing = 1 2 3", "BinaryData = False", &["BinaryData: expected True"]),
        ("ElementSpacing = 1 2 3", "CompressedData = maybe", &["True or False", "maybe"]),
        ("ElementSpacing = 1 2 3", "CompressedData = True", &["damaged", "expected 120 bytes"]),
        (
            "ElementSpacing = 1 2 3",
            "CompressedData = True\nCompressedDataSize = 7",
            &["expected 7 compressed bytes", "found 120"],
        ),
        ("ElementSpacing = 1 2 3", "Offset = 1 2 inf", &["is not finite"]),
        ("HeaderSize = 0", "HeaderSize = -2", &["HeaderSize", "-2"]),
        ("HeaderSize = 0", "HeaderSize = 12", &["HeaderSize", "12"]),
        ("HeaderSize = 0", "HeaderSize = -1\nCompressedData = True", &["HeaderSize", "compressed"]),
        ("ElementDataFile = LOCAL", "ElementDataFile = LIST", &["one file", "LIST"]),
        ("ElementDataFile = LOCAL", "ElementDataFile = %03d.raw 1 5 1", &["one file", "%03d.raw"]),
        ("ElementDataFile = LOCAL", "ElementDataFile = nowhere.raw", &["nowhere.raw", "names that file"]),
        ("ElementDataFile = LOCAL\n", "Comment = none\n", &["expected"]),
    ]);
}

#[test]
fn metaimage_data() {
    let header = meta_header(U16, "CompressedData = True\nElementDataFile = a.zraw\n").into_bytes();
    let packed = zlib(&data());
    let with = |packed: &[u8]| Files::new([("a.mhd", header.clone()), ("a.zraw", packed.to_vec())]);
    refused_with(
        &with(&packed[..packed.len() / 2]),
        &ReadOptions::default(),
        &["a.zraw", "truncated", "expected 120 bytes"],
    );
    refused_with(
        &with(&packed[..packed.len() - 1]),
        &ReadOptions::default(),
        &["a.zraw", "truncated", "found 120 before their end"],
    );
    refused_with(&with(&zlib(&data()[..50])), &ReadOptions::default(), &["a.zraw", "expected 120 bytes", "found 50"]);
    refused_with(&with(&zlib(&[0; 121])), &ReadOptions::default(), &["a.zraw", "expected 120 bytes", "found more"]);
    refused_with(&with(&[packed.clone(), vec![0]].concat()), &ReadOptions::default(), &["a.zraw", "compressed bytes"]);
    let mut flipped = packed.clone();
    let last = packed.len() - 1;
    flipped[last] ^= 1;
    refused_with(&with(&flipped), &ReadOptions::default(), &["a.zraw", "damaged"]);
}

#[test]
fn nifti_headers() {
    let good = good_nifti();
    let dim = |index: usize, value: i16| {
        let mut dim = good.dim;
        dim[index] = value;
        Nifti { dim, ..good.clone() }
    };
    nifti(Nifti { sizeof_hdr: 540, ..good.clone() }, &["NIfTI-2"]);
    nifti(Nifti { sizeof_hdr: 1000, ..good.clone() }, &["sizeof_hdr: expected 348", "1000"]);
    nifti(Nifti { magic: *b"abc\0", ..good.clone() }, &["magic", "abc"]);
    nifti(dim(0, 2), &["dim[0]: expected 3 to 7 axes, found 2"]);
    nifti(dim(0, -3), &["dim[0]", "-3"]);
    nifti(dim(2, 0), &["dim[2]: expected at least 1, found 0"]);
    nifti(dim(2, -4), &["dim[2]: expected at least 1, found -4"]);
    nifti(
        Nifti { dim: [4, 3, 4, 5, 2, 1, 1, 1], ..good.clone() },
        &["found 2 points of time (3 x 4 x 5 x 2)", "--time N"],
    );
    nifti(Nifti { dim: [5, 3, 4, 5, 1, 3, 1, 1], ..good.clone() }, &["found 3 numbers per voxel", "--component N"]);
    nifti(dim(3, 32767), &["expected 786408 bytes (3 x 4 x 32767 of u16le)"]);
    nifti(dim(3, 4), &["expected 96 bytes"]);
    nifti(Nifti { datatype: Some(128), ..good.clone() }, &["bitpix: expected 24", "found 16"]);
    nifti(Nifti { datatype: Some(1024), ..good.clone() }, &["datatype", "1024 (64-bit integers)"]);
    nifti(Nifti { datatype: Some(-7), ..good.clone() }, &["datatype", "-7"]);
    nifti(Nifti { bitpix: Some(8), ..good.clone() }, &["bitpix: expected 16", "found 8"]);
    nifti(Nifti { vox_offset: 100.0, ..good.clone() }, &["vox_offset", "found 100"]);
    nifti(Nifti { vox_offset: f32::NAN, ..good.clone() }, &["vox_offset", "found NaN"]);
    nifti(Nifti { vox_offset: 1e9, ..good.clone() }, &["1000000000"]);
    nifti(Nifti { scl: [f32::INFINITY, 0.0], ..good.clone() }, &["scl_slope", "inf"]);
    nifti(
        Nifti { pixdim: [1.0, 1.0, -2.0, 1.0, 0.0, 0.0, 0.0, 0.0], ..good.clone() },
        &["-2 is not a positive length"],
    );
    nifti(Nifti { codes: [0, 1], ..good.clone() }, &["0 is not a positive length"]);
    let sheared = [1.0, 0.3, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    nifti(Nifti { codes: [0, 1], srow: sheared, ..good.clone() }, &["not at right angles"]);
    nifti(Nifti { codes: [0, 1], srow: [f32::NAN; 12], ..good.clone() }, &["srow_x", "NaN"]);
    nifti(Nifti { codes: [1, 0], quatern: [9.0; 6], ..good.clone() }, &["quatern_b"]);
    nifti(Nifti { codes: [1, 0], quatern: [0.0, 0.0, 0.0, f32::NAN, 0.0, 0.0], ..good.clone() }, &["is not finite"]);
}

#[test]
fn nifti_data() {
    let file = good_nifti().file();
    let packed = gzip(&file);
    for (name, bytes, expected) in [
        ("a.nii", file[..300].to_vec(), "348 bytes, found 300"),
        ("a.nii", file[..400].to_vec(), "expected 120 bytes (3 x 4 x 5 of u16le), found 48"),
        ("a.nii", [&*file, &[0]].concat(), "expected 120 bytes (3 x 4 x 5 of u16le), found 121"),
        ("a.nii.gz", packed[..packed.len() - 4].to_vec(), "truncated"),
        ("a.nii.gz", gzip(&file[..400]), "found 48"),
        ("a.nii.gz", gzip(&[&*file, &[0]].concat()), "found more"),
    ] {
        refused_with(&Files::new([(name, bytes)]), &ReadOptions::default(), &[name, expected]);
    }
    let pair = Nifti { magic: *b"ni1\0", vox_offset: 0.0, ..good_nifti() }.header();
    refused_with(
        &Files::new([("a.hdr", pair.clone())]),
        &ReadOptions::default(),
        &["a.hdr", "a.img", "found neither file"],
    );
    refused_with(
        &Files::new([("a.hdr", pair), ("a.img", vec![0; 9])]),
        &ReadOptions::default(),
        &["a.img", "expected 120 bytes", "found 9"],
    );
}
