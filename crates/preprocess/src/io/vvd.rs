//! Reader of Voreen's `.vvd`, as far as it describes a raw file beside it with spacing and offset.

use std::io::Read;
use std::path::Path;

use voxrole_pack::ScalarType;

use super::header::shown;
use super::payload::{self, Encoding, Payload, Start};
use super::pick::Picks;
use super::placement::Placement;
use super::raw::{ByteOrder, StoredType};
use super::volume_file::VolumeFile;
use crate::{Error, Result};

/// How much of a file is looked at: behind the description lies a preview picture.
const MAX_BYTES: u64 = 1 << 20;

/// Whether a file that begins with `start` is of this kind.
pub(super) fn is_header(start: &[u8]) -> bool {
    start.windows(11).any(|window| window == b"<VoreenData")
}

/// Reads one volume.
///
/// # Errors
/// As [`super::read_volume`].
pub(super) fn read(path: &Path) -> Result<VolumeFile> {
    let (file, _) = payload::open(path)?;
    let mut bytes = Vec::new();
    file.take(MAX_BYTES).read_to_end(&mut bytes).map_err(Error::io(path))?;
    let text = String::from_utf8_lossy(&bytes);
    let fail = |message: String| Error::format(path, message);
    let raw = Element::find(&text, "RawData").map_err(fail)?;
    let dims: [u32; 3] = raw.triple().map_err(fail)?;
    let mut placement = Placement::axis_aligned(dims, [1.0; 3]);
    for (name, target) in [("Spacing", &mut placement.spacing), ("Offset", &mut placement.origin)] {
        if let Some((_, after)) = text.split_once(&format!("<MetaItem name=\"{name}\"")) {
            *target = Element::find(after, "value").and_then(|value| value.triple()).map_err(fail)?;
        }
    }
    if text.contains("<MetaItem name=\"Transformation\"") {
        return Err(fail("expected no Transformation, found one, which is not read: convert the volume first".into()));
    }
    let data = path.parent().unwrap_or(Path::new("")).join(raw.attribute("filename").map_err(fail)?);
    if let Err(error) = data.metadata() {
        return Err(fail(format!("expected the data in {}, found: {error}", shown(&data.to_string_lossy()))));
    }
    let payload = Payload {
        path: data,
        start: Start::Offset(0),
        encoding: Encoding::Plain,
        decoded_skip: 0,
        dims,
        stored: StoredType {
            scalar_type: scalar_type(raw.attribute("format").map_err(fail)?).map_err(fail)?,
            byte_order: ByteOrder::Little,
        },
        picks: Picks::default(),
        hint: "check the attributes of `RawData`",
    };
    VolumeFile::new(path, placement.geometry(path)?, payload, 1.0, 0.0)
}

fn scalar_type(name: &str) -> std::result::Result<ScalarType, String> {
    Ok(match name {
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
            return Err(format!("format: expected {expected}, found {}", shown(other)));
        }
    })
}

/// The inside of one tag.
struct Element<'a> {
    name: &'a str,
    attributes: &'a str,
}

impl<'a> Element<'a> {
    /// The first element `name` of `text`.
    fn find(text: &'a str, name: &'a str) -> std::result::Result<Self, String> {
        let inside = text.split_once(&format!("<{name} ")).and_then(|(_, after)| after.split_once('>'));
        let (attributes, _) = inside.ok_or_else(|| format!("expected an element `{name}`, found none"))?;
        Ok(Self { name, attributes })
    }

    fn attribute(&self, attribute: &str) -> std::result::Result<&'a str, String> {
        let quoted = format!("{attribute}=\"");
        let mut found = self.attributes.match_indices(&quoted);
        // Not the end of a longer name.
        let start = found.find(|(at, _)| self.attributes[..*at].ends_with(char::is_whitespace) || *at == 0);
        let value = start.and_then(|(at, _)| self.attributes[at + quoted.len()..].split_once('"'));
        value.map(|(value, _)| value).ok_or_else(|| format!("expected `{attribute}` of `{}`, found none", self.name))
    }

    /// The attributes `x`, `y` and `z`.
    fn triple<T: std::str::FromStr + Copy>(&self) -> std::result::Result<[T; 3], String> {
        let number = |name: &str| {
            let text = self.attribute(name)?;
            text.parse().map_err(|_| format!("{name} of `{}`: expected a number, found {}", self.name, shown(text)))
        };
        Ok([number("x")?, number("y")?, number("z")?])
    }
}
