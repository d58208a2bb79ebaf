//! Whatever is done to a good file, reading it ends with a volume or an error, never with a panic.

use std::fs;
use std::path::Path;

use proptest::prelude::*;
use proptest::sample::Index;
use voxrole_pack::ScalarType;
use voxrole_preprocess::io::{ByteOrder, RawLayout, ReadOptions, StoredType, read_volume};

use crate::dicom_samples::{
    BIG_ENDIAN, COLUMNS, EXPLICIT, IMPLICIT, JPEG_LOSSLESS, RLE, Value, file, jpeg, rle, slice, with,
};
use crate::samples::{DIMS, Files, Nifti, bytes, gzip, meta_header, nrrd_header, numbers, zlib};
use crate::vti::{FORMS, Vti};

const I16: StoredType = StoredType { scalar_type: ScalarType::I16, byte_order: ByteOrder::Big };
/// Numbers that readers have stumbled over.
const HOSTILE: [&str; 14] = [
    "-1",
    "0",
    "-0",
    "2147483648",
    "4294967296",
    "9223372036854775807",
    "-9223372036854775808",
    "99999999999999999999",
    "nan",
    "inf",
    "1e308",
    "1e-308",
    "",
    "none",
];

/// One change to a file's bytes.
#[derive(Clone, Debug)]
enum Damage {
    Set(Index, u8),
    FlipBit(Index, u8),
    Truncate(Index),
    Remove(Index, u8),
    Repeat(Index, u8),
    /// Replaces the first run of digits from here on.
    Number(Index, &'static str),
}

fn damage() -> impl Strategy<Value = Damage> {
    let index = any::<Index>;
    prop_oneof![
        (index(), any::<u8>()).prop_map(|(at, byte)| Damage::Set(at, byte)),
        (index(), 0_u8..8).prop_map(|(at, bit)| Damage::FlipBit(at, bit)),
        index().prop_map(Damage::Truncate),
        (index(), any::<u8>()).prop_map(|(at, count)| Damage::Remove(at, count)),
        (index(), any::<u8>()).prop_map(|(at, count)| Damage::Repeat(at, count)),
        (index(), prop::sample::select(&HOSTILE[..])).prop_map(|(at, number)| Damage::Number(at, number)),
    ]
}

impl Damage {
    fn apply(&self, bytes: &mut Vec<u8>) {
        if bytes.is_empty() {
            return;
        }
        let len = bytes.len();
        let range = |at: &Index, count: u8| at.index(len)..(at.index(len) + usize::from(count)).min(len);
        match self {
            Self::Set(at, byte) => bytes[at.index(len)] = *byte,
            Self::FlipBit(at, bit) => bytes[at.index(len)] ^= 1 << bit,
            Self::Truncate(at) => bytes.truncate(at.index(len)),
            Self::Remove(at, count) => drop(bytes.drain(range(at, *count))),
            Self::Repeat(at, count) => {
                let repeated = bytes[range(at, *count)].to_vec();
                bytes.splice(at.index(len)..at.index(len), repeated);
            }
            Self::Number(at, number) => {
                let is_part = |byte: &u8| byte.is_ascii_digit() || b"-.".contains(byte);
                if let Some(start) = (at.index(len)..len).find(|&at| is_part(&bytes[at])) {
                    let end = (start..len).find(|&at| !is_part(&bytes[at])).unwrap_or(len);
                    bytes.splice(start..end, number.bytes());
                }
            }
        }
    }
}

/// Good DICOM slices of every transfer syntax.
fn good_slices() -> Vec<Files> {
    let packed = |pixels: Vec<u8>| with(slice(0, 0.0), [(0x7fe0_0010, Value::Pieces(vec![0; 4], vec![pixels]))]);
    let numbers: Vec<u16> = (0..12).map(|number| number * 300).collect();
    let item = with(slice(0, 0.0), [(0x0020_9113, Value::Items(vec![slice(1, 1.0), slice(2, 2.0)]))]);
    [
        (EXPLICIT, slice(0, 0.0)),
        (IMPLICIT, with(slice(0, 0.0), [(0x5200_9230, Value::Items(vec![item]))])),
        (BIG_ENDIAN, slice(0, 0.0)),
        (RLE, packed(rle(&numbers))),
        (JPEG_LOSSLESS, packed(jpeg(&numbers, COLUMNS, 12))),
    ]
    .into_iter()
    .map(|(syntax, elements)| Files::new([("a.dcm", file(syntax, &elements))]))
    .collect()
}

/// Good files with their data files; damage goes to the first.
fn good_files() -> Vec<Files> {
    let data = bytes(&numbers(ScalarType::I16), ByteOrder::Big);
    let space = "space: RAS\nspace directions: (0,2,0) (-3,0,0) (0,0,4)\nspace origin: (1,2,3)\nspace units: \"mm\" \"mm\" \"mm\"";
    let nrrd = |lines: &str| nrrd_header(I16, lines).into_bytes();
    let meta = |lines: &str| meta_header(I16, lines).into_bytes();
    let nifti = Nifti {
        codes: [1, 1],
        quatern: [0.5, 0.5, 0.5, 1.0, 2.0, 3.0],
        srow: [0.0, -3.0, 0.0, 10.0, 2.0, 0.0, 0.0, 20.0, 0.0, 0.0, 4.0, 30.0],
        ..Nifti::new(I16)
    };
    let by_quaternion = Nifti { codes: [1, 0], ..nifti.clone() };
    let pair = Nifti { magic: *b"ni1\0", vox_offset: 0.0, ..nifti.clone() };
    let matrix = "TransformMatrix = 0 1 0 -1 0 0 0 0 1\nOffset = 1 2 3\nElementSpacing = 1 2 3\n";
    let vti = FORMS.into_iter().flat_map(|form| {
        ["", "vtkZLibDataCompressor", "vtkLZ4DataCompressor"]
            .map(|compressor| Files::new([("a.vti", Vti { compressor, ..Vti::new(I16, form) }.file())]))
    });
    let mut files = vec![
        Files::new([("a.nrrd", [nrrd(&format!("encoding: raw\n{space}")), data.clone()].concat())]),
        Files::new([("a.nrrd", [nrrd(&format!("encoding: gzip\n{space}")), gzip(&data)].concat())]),
        Files::new([
            ("a.nhdr", nrrd("encoding: raw\nspacings: 1 2 3\nline skip: 1\nbyte skip: 2\ndata file: data.bin")),
            ("data.bin", [b"a\nbc".as_slice(), &data].concat()),
        ]),
        Files::new([("a.mha", [meta(&format!("{matrix}ElementDataFile = LOCAL\n")), data.clone()].concat())]),
        Files::new([
            ("a.mhd", meta(&format!("{matrix}CompressedData = True\nHeaderSize = 0\nElementDataFile = a.zraw\n"))),
            ("a.zraw", zlib(&data)),
        ]),
        Files::new([("a.nii", nifti.file())]),
        Files::new([("a.nii", by_quaternion.file())]),
        Files::new([("a.nii.gz", gzip(&nifti.file()))]),
        Files::new([("a.hdr", pair.header()), ("a.img", data.clone())]),
        Files::new([("a.npy", [NPY, &data].concat())]),
        Files::new([("a.vvd", VVD.into()), ("a.raw", data)]),
    ];
    files.extend(vti);
    files
}

/// Damages the file `damaged` in many ways and opens `opened`, which is that file or the folder that it is in.
fn never_panics(damaged: &Path, opened: &Path, options: &ReadOptions, cases: u32) {
    let good = fs::read(damaged).expect("just written");
    read_volume(opened, options).unwrap_or_else(|error| panic!("before any damage: {error}"));
    proptest!(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(cases) },
        |(damages in prop::collection::vec(damage(), 1..4))| {
            let mut bytes = good.clone();
            damages.iter().for_each(|damage| damage.apply(&mut bytes));
            fs::write(damaged, &bytes).expect("written");
            if let Err(error) = read_volume(opened, options) {
                prop_assert!(!error.to_string().is_empty());
            }
    });
    fs::write(damaged, &good).expect("written");
}

const NPY: &[u8] = b"\x93NUMPY\x01\0\x3b\0{'descr': '>i2', 'fortran_order': False, 'shape': (5,4,3)}\n";
const VVD: &[u8] = b"<VoreenData><RawData filename=\"a.raw\" format=\"int16\" x=\"3\" y=\"4\" z=\"5\" />\
<MetaItem name=\"Spacing\" type=\"Vec3MetaData\"><value x=\"1\" y=\"2\" z=\"3\" /></MetaItem></VoreenData>";

#[test]
fn damaged_files_never_panic() {
    for files in good_files().into_iter().chain(good_slices()) {
        never_panics(&files.path(), &files.path(), &ReadOptions::default(), 400);
    }
}

#[cfg(feature = "tiff")]
#[test]
fn damaged_tiff_never_panics() {
    use crate::tiff::{Tiff, imagej};
    let plain = ReadOptions::default();
    let stack = Tiff { description: imagej("cf=0\nc0=-32768.0\nc1=1.0\n"), ..Tiff::new(I16) };
    for tiff in [Tiff { pages: 1, ..stack.clone() }, Tiff { deflate: true, ..Tiff::new(I16) }, stack] {
        let files = Files::new([("a.tif", tiff.file())]);
        never_panics(&files.path(), &files.path(), &plain, 400);
    }
    for name in [
        "tifffile_bigtiff.tif",
        "tifffile_lzw.tif",
        "tifffile_packbits.tif",
        "tifffile_planar.tif",
        "tifffile_tiles.tif",
        "tifffile_inverted.tif",
        "tifffile_tczyx.ome.tif",
    ] {
        let files = Files::new([("a.tif", fs::read(crate::peers::path(name)).expect("kept"))]);
        let one = (name.contains("planar") || name.contains("tczyx")).then_some(1);
        let options = ReadOptions { component: one, time: one.filter(|_| name.contains("tczyx")), ..plain.clone() };
        never_panics(&files.path(), &files.path(), &options, 400);
    }
}

#[cfg(feature = "zarr")]
#[test]
fn damaged_zarr_never_panics() {
    let plain = ReadOptions::default();
    let chosen = ReadOptions { component: Some(1), time: Some(1), ..ReadOptions::default() };
    for (store, options, files) in [
        ("ome_0.4.zarr", &chosen, &[".zattrs", "0/.zarray"][..]),
        ("ome_0.5.zarr", &chosen, &["zarr.json", "0/zarr.json", "0/c/1/1/0/0/0"]),
        ("v2_zlib", &plain, &[".zarray", "0.0.0"]),
        ("v3_gzip", &plain, &["zarr.json", "c/0/0/0"]),
        ("v3_zstd", &plain, &["c/0/0/0"]),
        ("v3_blosc_blosclz_shuffle", &plain, &["zarr.json", "c/0/0/0"]),
        ("v3_blosc_lz4_bitshuffle", &plain, &["c/0/0/0"]),
        ("v3_blosc_zstd_noshuffle", &plain, &["c/0/0/0"]),
        ("v3_blosc_zlib_shuffle", &plain, &["c/0/0/0"]),
    ] {
        let folder = tempfile::tempdir().expect("a folder");
        copy(&crate::peers::path("zarr").join(store), folder.path());
        for file in files {
            never_panics(&folder.path().join(file), folder.path(), options, 200);
        }
    }
}

/// Copies a folder.
#[cfg(feature = "zarr")]
fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("made");
    for entry in fs::read_dir(from).expect("a folder").flatten() {
        let target = to.join(entry.file_name());
        match entry.path().is_dir() {
            true => copy(&entry.path(), &target),
            false => fs::write(target, fs::read(entry.path()).expect("read")).expect("written"),
        }
    }
}

#[test]
fn any_raw_layout_never_panics() {
    let data = bytes(&numbers(ScalarType::I16), ByteOrder::Big);
    for file in [Files::new([("a.raw", data.clone())]), Files::new([("a.raw.gz", gzip(&data))])] {
        let path = file.path();
        let layout = RawLayout { dims: DIMS, scalar: Some(I16), spacing: [1.0; 3], skip_bytes: 0 };
        read_volume(&path, &layout.into()).unwrap_or_else(|error| panic!("the right layout: {error}"));
        let dim = prop_oneof![0_u32..6, any::<u32>()];
        proptest!(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(400) },
            |(dims in [dim.clone(), dim.clone(), dim.clone()], spacing in any::<[f64; 3]>(), any_spacing: bool, skip: u64, any_skip: bool)| {
                let spacing = if any_spacing { spacing } else { [1.0; 3] };
                let skip_bytes = if any_skip { skip } else { 0 };
                let _ = read_volume(&path, &RawLayout { dims, scalar: Some(I16), spacing, skip_bytes }.into());
        });
    }
}
