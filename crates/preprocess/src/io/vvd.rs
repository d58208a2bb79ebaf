//! Reader of Voreen's `.vvd`, as far as it describes a raw file beside it with spacing and offset.

use std::io::{BufReader, Read};
use std::path::Path;

use quick_xml::Reader;
use quick_xml::events::Event;
use voxrole_pack::ScalarType;

use super::header::Fields;
use super::payload::{self, Encoding, Payload, Start};
use super::pick::Picks;
use super::placement::Placement;
use super::raw::{ByteOrder, StoredType};
use super::volume_file::VolumeFile;
use super::xml;
use crate::{Error, Result};

/// How much of a file is looked at.
const MAX_BYTES: u64 = 4 << 20;

/// Whether a file that begins with `start` is of this kind.
pub(super) fn is_header(start: &[u8]) -> bool {
    start.windows(11).any(|window| window == b"<VoreenData")
}

/// Reads one volume.
///
/// # Errors
/// As [`super::read_volume`].
pub(super) fn read(path: &Path) -> Result<VolumeFile> {
    let Description { raw, spacing, offset } = Description::read(path)?;
    let raw = raw.ok_or_else(|| Error::format(path, "expected an element `RawData`, found none"))?;
    let dims = raw.dims("x, y, z", triple(&raw)?)?;
    let geometry = Placement { origin: offset, ..Placement::axis_aligned(dims, spacing) }.geometry(path)?;
    let payload = Payload {
        path: raw.data_file("filename", raw.required("filename")?)?,
        start: Start::Offset(0),
        encoding: Encoding::Plain,
        decoded_skip: 0,
        dims,
        stored: StoredType { scalar_type: scalar_type(&raw)?, byte_order: ByteOrder::Little },
        picks: Picks::default(),
        hint: "check the attributes of `RawData`",
    };
    VolumeFile::new(path, geometry, payload, 1.0, 0.0)
}

/// What the file says of its one volume.
struct Description<'a> {
    raw: Option<Fields<'a>>,
    spacing: [f64; 3],
    offset: [f64; 3],
}

impl<'a> Description<'a> {
    fn read(path: &'a Path) -> Result<Self> {
        let (file, _) = payload::open(path)?;
        let mut reader = Reader::from_reader(BufReader::new(file.take(MAX_BYTES)));
        let mut description = Self { raw: None, spacing: [1.0; 3], offset: [0.0; 3] };
        let (mut item, mut buffer) = (String::new(), Vec::new());
        loop {
            buffer.clear();
            let decoder = reader.decoder();
            let event = reader.read_event_into(&mut buffer);
            match event.map_err(|error| Error::format(path, format!("expected XML, found: {error}")))? {
                Event::Eof => return Ok(description),
                Event::Start(element) | Event::Empty(element) => match element.name().as_ref() {
                    b"RawData" if description.raw.is_some() => {
                        return Err(Error::format(path, "expected one element `RawData`, found several"));
                    }
                    b"RawData" => description.raw = Some(xml::attributes(path, &element, decoder)?),
                    b"MetaItem" => {
                        let fields = xml::attributes(path, &element, decoder)?;
                        item = fields.get(&["name"]).unwrap_or_default().to_owned();
                        if item == "Transformation" {
                            return Err(fields.unexpected("name", "no transformation of the volume", &item));
                        }
                    }
                    b"value" if item == "Spacing" => {
                        description.spacing = triple(&xml::attributes(path, &element, decoder)?)?;
                    }
                    b"value" if item == "Offset" => {
                        description.offset = triple(&xml::attributes(path, &element, decoder)?)?;
                    }
                    _ => {}
                },
                _ => {}
            }
        }
    }
}

/// The attributes `x`, `y` and `z`.
fn triple<T: std::str::FromStr>(fields: &Fields<'_>) -> Result<[T; 3]> {
    let number = |name: &str| {
        let number = fields.number(name)?;
        number.ok_or_else(|| fields.fail(format!("expected an attribute `{name}`, found none")))
    };
    Ok([number("x")?, number("y")?, number("z")?])
}

fn scalar_type(raw: &Fields<'_>) -> Result<ScalarType> {
    Ok(match raw.required("format")? {
        "uint8" => ScalarType::U8,
        "int8" => ScalarType::I8,
        "uint16" => ScalarType::U16,
        "int16" => ScalarType::I16,
        "uint32" => ScalarType::U32,
        "int32" => ScalarType::I32,
        "float" => ScalarType::F32,
        "double" => ScalarType::F64,
        other => {
            let expected = "uint8, int8, uint16, int16, uint32, int32, float or double";
            return Err(raw.unexpected("format", expected, other));
        }
    })
}
