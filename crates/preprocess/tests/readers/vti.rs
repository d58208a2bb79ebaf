//! VTI in every form that VTK writes, and forms that must be refused.

use std::io::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use proptest::prelude::*;
use voxrole_pack::{ScalarType, Scalars};
use voxrole_preprocess::Grid;
use voxrole_preprocess::io::{ByteOrder, ReadOptions, StoredType, open_volume, read_volume};

use crate::samples::{DIMS, Files, bytes, numbers, stored_types, zlib};

const U16: StoredType = StoredType { scalar_type: ScalarType::U16, byte_order: ByteOrder::Little };
/// Bytes of a compressed block: no multiple of a number's size.
const BLOCK_BYTES: usize = 13;

/// Where the numbers stand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    Ascii,
    Inline,
    AppendedBase64,
    AppendedRaw,
}

pub const FORMS: [Form; 4] = [Form::Ascii, Form::Inline, Form::AppendedBase64, Form::AppendedRaw];

/// A file of the sample's numbers.
#[derive(Clone)]
pub struct Vti {
    pub stored: StoredType,
    pub form: Form,
    pub compressor: &'static str,
    pub wide_header: bool,
    pub image: &'static str,
    pub extent: &'static str,
    /// Instead of the sample's.
    pub data: Option<Vec<u8>>,
    pub array: String,
}

impl Vti {
    pub fn new(stored: StoredType, form: Form) -> Self {
        let name = match stored.scalar_type {
            ScalarType::U8 => "UInt8",
            ScalarType::I8 => "Int8",
            ScalarType::U16 => "UInt16",
            ScalarType::I16 => "Int16",
            ScalarType::U32 => "UInt32",
            ScalarType::I32 => "Int32",
            ScalarType::F32 => "Float32",
            ScalarType::F64 => "Float64",
        };
        Self {
            stored,
            form,
            compressor: "",
            wide_header: false,
            image: "WholeExtent=\"0 2 0 3 0 4\" Origin=\"0 0 0\" Spacing=\"1 2 3\"",
            extent: "0 2 0 3 0 4",
            data: None,
            array: format!("type=\"{name}\" Name=\"density\""),
        }
    }

    fn header(&self, numbers: &[u64]) -> Vec<u8> {
        let big = self.stored.byte_order == ByteOrder::Big;
        let one = |&number: &u64| {
            let mut bytes =
                if self.wide_header { number.to_le_bytes().to_vec() } else { (number as u32).to_le_bytes().to_vec() };
            if big {
                bytes.reverse();
            }
            bytes
        };
        numbers.iter().flat_map(one).collect()
    }

    /// Header and data as they are stored.
    fn parts(&self) -> [Vec<u8>; 2] {
        let data =
            self.data.clone().unwrap_or_else(|| bytes(&numbers(self.stored.scalar_type), self.stored.byte_order));
        let pack = |block: &[u8]| match self.compressor {
            "vtkLZ4DataCompressor" => lz4_flex::block::compress(block),
            _ => zlib(block),
        };
        if self.compressor.is_empty() {
            return [self.header(&[data.len() as u64]), data];
        }
        let blocks: Vec<Vec<u8>> = data.chunks(BLOCK_BYTES).map(pack).collect();
        let mut header = vec![blocks.len() as u64, BLOCK_BYTES as u64, (data.len() % BLOCK_BYTES) as u64];
        header.extend(blocks.iter().map(|block| block.len() as u64));
        [self.header(&header), blocks.concat()]
    }

    fn text(&self) -> String {
        let numbers = numbers(self.stored.scalar_type);
        let word = |index: usize| match &numbers {
            Scalars::F32(values) => values[index].to_string(),
            Scalars::F64(values) => format!("{:e}", values[index]),
            _ => numbers.get(index).to_string(),
        };
        (0..numbers.len()).map(|index| format!("{} {}", word(index), if index % 7 == 0 { "\n" } else { "" })).collect()
    }

    pub fn file(&self) -> Vec<u8> {
        let [header, data] = self.parts();
        // VTK encodes the header of compressed blocks by itself.
        let base64 = if self.compressor.is_empty() {
            STANDARD.encode([header.clone(), data.clone()].concat())
        } else {
            STANDARD.encode(&header) + &STANDARD.encode(&data)
        };
        // Something else lies before the array in the appended section.
        let (format, inside, appended) = match self.form {
            Form::Ascii => ("ascii", self.text(), None),
            Form::Inline => ("binary", format!("\n  {base64}\n"), None),
            Form::AppendedBase64 => {
                ("appended\" offset=\"8", String::new(), Some(("base64", format!("AAAAAAAA{base64}").into_bytes())))
            }
            Form::AppendedRaw => {
                ("appended\" offset=\"5", String::new(), Some(("raw", [b"</x>&".as_slice(), &header, &data].concat())))
            }
        };
        let byte_order = if self.stored.byte_order == ByteOrder::Big { "BigEndian" } else { "LittleEndian" };
        let header_type = if self.wide_header { "UInt64" } else { "UInt32" };
        let compressor =
            if self.compressor.is_empty() { String::new() } else { format!(" compressor=\"{}\"", self.compressor) };
        let mut file = format!(
            "<?xml version=\"1.0\"?>\n<!-- a comment -->\n<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"{byte_order}\" \
             header_type=\"{header_type}\"{compressor}>\n<ImageData {}>\n<FieldData><DataArray type=\"String\" Name=\"note\" \
             format=\"ascii\">72 105 0</DataArray></FieldData>\n<Piece Extent=\"{}\">\n<PointData Scalars=\"density\">\n\
             <DataArray {} format=\"{format}\" RangeMin=\"0\">{inside}<InformationKey name=\"L2_NORM_RANGE\" length=\"2\">\
             <Value index=\"0\">0</Value></InformationKey></DataArray>\n</PointData>\n<CellData/>\n</Piece>\n</ImageData>\n",
            self.image, self.extent, self.array
        )
        .into_bytes();
        if let Some((encoding, appended)) = appended {
            write!(file, "<AppendedData encoding=\"{encoding}\">\n   _").expect("into memory");
            file.extend(appended);
            file.extend(b"\n</AppendedData>\n");
        }
        file.extend(b"</VTKFile>\n");
        file
    }

    fn read(&self, options: &ReadOptions) -> voxrole_preprocess::Result<Grid> {
        read_volume(&Files::new([("a.vti", self.file())]).path(), options)
    }
}

#[test]
fn every_form_gives_the_same_numbers() {
    for stored in stored_types() {
        for form in FORMS {
            for compressor in ["", "vtkZLibDataCompressor", "vtkLZ4DataCompressor"] {
                for wide_header in [false, true] {
                    let vti = Vti { compressor, wide_header, ..Vti::new(stored, form) };
                    let case = format!("{stored} {form:?} {compressor} {wide_header}");
                    let grid = vti.read(&ReadOptions::default()).unwrap_or_else(|error| panic!("{case}: {error}"));
                    assert_eq!(grid.scalars, numbers(stored.scalar_type), "{case}");
                    assert_eq!((grid.geometry.dims, grid.geometry.spacing), (DIMS, [1.0, 2.0, 3.0]), "{case}");
                }
            }
        }
    }
}

#[test]
fn plain_numbers_stay_where_they_are() {
    let vti = Vti::new(U16, Form::AppendedRaw);
    let file = vti.file();
    let start = file.windows(5).position(|window| window == b"</x>&").expect("there") + 5 + 4;
    let files = Files::new([("a.vti", file)]);
    let nowhere = files.path().join("no/such/folder");
    let volume = open_volume(&files.path(), &ReadOptions::default()).expect("a good file");
    let volume = volume.stored(&nowhere).expect("nothing is unpacked");
    let region = voxrole_preprocess::region::Region { start: [1, 1, 1], end: [3, 2, 2] };
    assert_eq!(volume.voxels.read(&region).expect("a region"), Scalars::U16(vec![16000, 17000]), "from byte {start}");
}

#[test]
fn the_origin_is_that_of_the_first_voxel() {
    let image = "WholeExtent=\"-1 1 10 13 0 4\" Origin=\"100 0 0\" Spacing=\"1 2 3\" Direction=\"0 -1 0 1 0 0 0 0 1\"";
    let vti = Vti { image, extent: "-1 1 10 13 0 4", ..Vti::new(U16, Form::Ascii) };
    let geometry = vti.read(&ReadOptions::default()).expect("a turned grid").geometry;
    // Along x of the grid is y of the world, along y is −x: 100 − 2·10, −1.
    assert_eq!(geometry.origin, [80.0, -1.0, 0.0]);
    assert_eq!(geometry.direction, [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]);
}

#[test]
fn numbers_of_cells_lie_half_a_voxel_further() {
    let image = "WholeExtent=\"0 3 0 4 0 5\" Origin=\"0 0 0\" Spacing=\"1 2 3\"";
    let vti = Vti { image, extent: "0 3 0 4 0 5", ..Vti::new(U16, Form::Inline) };
    let file = String::from_utf8(vti.file()).expect("text");
    let file = file.replace("<CellData/>", "").replace("PointData", "CellData");
    let grid = read_volume(&Files::new([("a.vti", file.into_bytes())]).path(), &ReadOptions::default()).expect("cells");
    assert_eq!((grid.geometry.dims, grid.geometry.origin), (DIMS, [0.5, 1.0, 1.5]));
    assert_eq!(grid.scalars, numbers(ScalarType::U16));
}

#[test]
fn a_component_is_chosen() {
    let plain = bytes(&numbers(ScalarType::U16), ByteOrder::Little);
    let pairs: Vec<u8> = plain.chunks(2).flat_map(|number| [number, &[1, 2]].concat()).collect();
    for compressor in ["", "vtkZLibDataCompressor"] {
        for form in [Form::Inline, Form::AppendedRaw] {
            let mut vti = Vti { compressor, data: Some(pairs.clone()), ..Vti::new(U16, form) };
            vti.array += " NumberOfComponents=\"2\"";
            let of = |component| vti.read(&ReadOptions { component, ..ReadOptions::default() });
            assert_eq!(of(Some(0)).expect("the first").scalars, numbers(ScalarType::U16));
            assert_eq!(of(Some(1)).expect("the second").scalars, Scalars::U16(vec![0x201; 60]));
            for (component, expected) in [(None, "--component"), (Some(2), "found 2 numbers per voxel")] {
                let message = of(component).expect_err(expected).to_string();
                assert!(message.contains(expected) && message.contains("a.vti"), "{message}");
            }
        }
    }
}

#[test]
fn one_of_several_arrays_is_chosen() {
    let two = |scalars: &str| {
        let file = String::from_utf8(Vti::new(U16, Form::Ascii).file()).expect("text");
        let other = "<DataArray type=\"UInt8\" Name=\"mask\" format=\"ascii\">1</DataArray>\n</PointData>";
        file.replace("</PointData>", &other.replace("1<", &format!("{}<", "1 ".repeat(60))))
            .replace(" Scalars=\"density\"", scalars)
    };
    let read = |scalars: &str, array: Option<&str>| {
        let options = ReadOptions { array: array.map(str::to_owned), ..ReadOptions::default() };
        read_volume(&Files::new([("a.vti", two(scalars).into_bytes())]).path(), &options)
    };
    let named = " Scalars=\"density\"";
    assert_eq!(read(named, None).expect("the scalars").scalars, numbers(ScalarType::U16));
    for scalars in [named, ""] {
        assert_eq!(read(scalars, Some("density")).expect("by name").scalars, numbers(ScalarType::U16));
        assert_eq!(read(scalars, Some("mask")).expect("by name").scalars, Scalars::U8(vec![1; 60]));
    }
    for (array, expected) in [(None, "choose with --array"), (Some("no"), "expected an array \"no\" for --array")] {
        let message = read("", array).expect_err(expected).to_string();
        assert!(message.contains(expected) && message.contains("\"density\", \"mask\""), "{message}");
    }
}

#[test]
fn wide_integers_are_read_if_they_fit() {
    let stored = StoredType { scalar_type: ScalarType::I32, byte_order: ByteOrder::Big };
    let values: Vec<i64> = (0..60).map(|n| n * -70_000_001 / 2).collect();
    let wide = |values: &[i64], name: &str| {
        let data = values.iter().flat_map(|value| value.to_be_bytes()).collect();
        let array = format!("type=\"{name}\" Name=\"density\"");
        Vti { data: Some(data), array, ..Vti::new(stored, Form::AppendedRaw) }.read(&ReadOptions::default())
    };
    let expected = values.iter().map(|&value| value as i32).collect();
    assert_eq!(wide(&values, "Int64").expect("all fit").scalars, Scalars::I32(expected));
    let mut large = values;
    large[59] = 1 << 31;
    for (name, found) in [("Int64", "2147483648"), ("UInt64", "18446744073")] {
        let message = wide(&large, name).expect_err(found).to_string();
        assert!(message.contains(found) && message.contains("fit into 32 bits"), "{message}");
    }
}

/// Each row: what replaces what in a good file, and parts of the message.
type Case<'a> = (&'a str, &'a str, &'a [&'a str]);

#[track_caller]
fn refused(vti: &Vti, cases: &[Case<'_>]) {
    let good = vti.file();
    for (old, new, expected) in cases {
        let at = good.windows(old.len()).position(|window| window == old.as_bytes()).expect(old);
        let file = [&good[..at], new.as_bytes(), &good[at + old.len()..]].concat();
        let message = read_volume(&Files::new([("a.vti", file)]).path(), &ReadOptions::default());
        let message = message.expect_err(new).to_string();
        for part in expected.iter().chain(&["a.vti", "expected", "found"]) {
            assert!(message.contains(part), "{part:?} is not in: {message}");
        }
        assert!(message.len() < 700, "too long to read: {message}");
    }
}

#[test]
fn bad_markup_is_refused() {
    let array =
        "<DataArray type=\"UInt8\" Name=\"other\" format=\"ascii\"/><DataArray type=\"UInt16\" Name=\"density\"";
    let entities =
        "<!DOCTYPE x [<!ENTITY a \"aaaaaaaaaa\"><!ENTITY b \"&a;&a;&a;&a;&a;&a;&a;&a;\">]><!-- a comment -->";
    refused(
        &Vti::new(U16, Form::AppendedRaw),
        &[
            ("ImageData\"", "RectilinearGrid\"", &["ImageData", "RectilinearGrid"]),
            ("UInt32", "Float32", &["header_type", "UInt32 or UInt64"]),
            ("LittleEndian", "Middle", &["byte_order", "Middle"]),
            ("header_type", "compressor=\"vtkLZMADataCompressor\" header_type", &["vtkZLibDataCompressor", "LZMA"]),
            ("0 2 0 3 0 4", "0 2 0 3", &["WholeExtent", "6 numbers"]),
            ("0 2 0 3 0 4", "0 2 0 3 0 -1", &["WholeExtent", "first and last point"]),
            ("0 2 0 3 0 4", "0 2 0 3 0 5", &["Extent", "whole extent"]),
            ("0 2 0 3 0 4", "-9223372036854775808 9223372036854775807 0 3 0 4", &["WholeExtent"]),
            ("Spacing=\"1 2 3\"", "Spacing=\"1 -2 3\"", &["-2 is not a positive length"]),
            ("Spacing=\"1 2 3\"", "Spacing=\"1 2 3\" Direction=\"1 0 0 0 1 0 0 0 2\"", &["not at right angles"]),
            ("Spacing=\"1 2 3\"", "Spacing=\"1 2 3\" Spacing=\"1 2 3\"", &["attributes"]),
            ("Spacing=\"1 2 3\"", "Spacing=\"&lol;\"", &["attributes", "lol"]),
            ("<!-- a comment -->", entities, &["document type declaration"]),
            ("Scalars=\"density\"", "Scalars=\"speed\"", &["speed", "density"]),
            (
                " Scalars=\"density\">\n<DataArray type=\"UInt16\" Name=\"density\"",
                &format!(">{array}"),
                &["other", "density"],
            ),
            ("type=\"UInt16\"", "type=\"String\"", &["type", "String"]),
            ("type=\"UInt16\"", "type=\"UInt16\" NumberOfComponents=\"0\"", &["NumberOfComponents"]),
            ("type=\"UInt16\"", "type=\"UInt16\" NumberOfComponents=\"9\"", &["9 numbers per voxel", "--component"]),
            ("type=\"UInt16\"", "type=\"UInt32\"", &["array of 240 bytes", "a length of 120"]),
            ("offset=\"5\"", "offset=\"18446744073709551615\"", &["offset"]),
            ("offset=\"5\"", "offset=\"9999\"", &["at byte", "found a file of"]),
            ("offset=\"5\"", "offset=\"4\"", &["array of 120 bytes"]),
            ("offset=\"5\"", "", &["offset"]),
            ("format=\"appended\"", "format=\"punched\"", &["format", "punched"]),
            ("encoding=\"raw\"", "encoding=\"hex\"", &["raw or base64", "hex"]),
            ("\n   _", "\n   +", &["underscore"]),
            ("</PointData>", "</Points>", &["VTK's XML"]),
            ("</Piece>", "</Piece><Piece Extent=\"0 1 0 1 0 1\"/>", &["one piece"]),
        ],
    );
    let spacious =
        Vti { image: "WholeExtent=\"0 2000000000 0 2000000000 0 2000000000\"", ..Vti::new(U16, Form::Ascii) };
    refused(
        &Vti { extent: "0 2000000000 0 2000000000 0 2000000000", ..spacious },
        &[("density", "density", &["machine"])],
    );
    let endless = [b"<VTKFile type=\"".as_slice(), &vec![b'x'; 3 << 20]].concat();
    let message = read_volume(&Files::new([("a.vti", endless)]).path(), &ReadOptions::default()).expect_err("endless");
    assert!(message.to_string().contains("1048576 bytes of markup"), "{message}");
}

#[test]
fn lengths_that_lie_are_refused() {
    let claims = |extent: &'static str, image: &'static str, form, compressor| {
        let vti = Vti { image, extent, compressor, ..Vti::new(U16, form) };
        vti.read(&ReadOptions::default()).expect_err(extent).to_string()
    };
    let (extent, image) = ("0 65535 0 65535 0 65535", "WholeExtent=\"0 65535 0 65535 0 65535\"");
    for form in FORMS {
        for compressor in ["", "vtkZLibDataCompressor", "vtkLZ4DataCompressor"] {
            let message = claims(extent, image, form, compressor);
            assert!(message.contains("expected") && message.contains("found"), "{message}");
        }
    }
    // Zeros that unpack to more than the block says.
    let bomb = zlib(&vec![0; 10_000_000]);
    let header = [1_u32, 120, 0, bomb.len() as u32].into_iter().flat_map(u32::to_le_bytes).collect::<Vec<_>>();
    let vti = Vti { compressor: "vtkZLibDataCompressor", ..Vti::new(U16, Form::AppendedRaw) };
    let good = vti.file();
    let start = good.windows(5).position(|window| window == b"</x>&").expect("there") + 5;
    let file = [&good[..start], &header, &bomb].concat();
    let message = read_volume(&Files::new([("a.vti", file)]).path(), &ReadOptions::default()).expect_err("a bomb");
    assert!(message.to_string().contains("block of 120 bytes, found more"), "{message}");
}

#[test]
fn cut_files_are_refused() {
    for form in FORMS {
        for compressor in ["", "vtkZLibDataCompressor", "vtkLZ4DataCompressor"] {
            let vti = Vti { compressor, ..Vti::new(U16, form) };
            let good = vti.file();
            // Whatever is behind the numbers may be missing.
            let tail = "\n</AppendedData>\n</VTKFile>\n".len();
            let end = if matches!(form, Form::Ascii | Form::Inline) { good.len() - 2 } else { good.len() - tail - 2 };
            for length in (0..end).step_by(11).chain([end]) {
                let files = Files::new([("a.vti", good[..length].to_vec())]);
                assert!(read_volume(&files.path(), &ReadOptions::default()).is_err(), "{form:?} {compressor} {length}");
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(300) })]
    #[test]
    fn changed_compressed_numbers_are_noticed_or_harmless(at in any::<prop::sample::Index>(), bit in 0..8_u8) {
        let vti = Vti { compressor: "vtkZLibDataCompressor", ..Vti::new(U16, Form::AppendedRaw) };
        let mut file = vti.file();
        let start = file.windows(5).position(|window| window == b"</x>&").expect("there") + 5;
        let length = file.len() - start;
        file[start + at.index(length)] ^= 1 << bit;
        if let Ok(grid) = read_volume(&Files::new([("a.vti", file)]).path(), &ReadOptions::default()) {
            prop_assert_eq!(grid.scalars, numbers(ScalarType::U16));
        }
    }
}
