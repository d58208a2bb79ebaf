//! Reader of NRRD, attached (`.nrrd`) and detached (`.nhdr`): <https://teem.sourceforge.net/nrrd/format.html>.

use std::io::{BufRead, BufReader, Seek, SeekFrom};
use std::path::Path;

use voxrole_pack::ScalarType;

use super::header::{Fields, HeaderLines, shown};
use super::nrrd_axes;
use super::payload::{self, Encoding, Payload, Start};
use super::raw::{ByteOrder, StoredType};
use super::read_options::ReadOptions;
use super::volume_file::VolumeFile;
use crate::{Error, Result};

/// Reads a volume's header.
///
/// # Errors
/// As [`super::read_volume`].
pub(super) fn read(path: &Path, options: &ReadOptions) -> Result<VolumeFile> {
    let mut lines = HeaderLines::open(path)?;
    let (fields, ended_by_blank_line) = parse(path, &mut lines)?;
    let (placement, picks) = nrrd_axes::placement(&fields, options)?;
    let geometry = placement.geometry(path)?;
    // First, since numbers as text have no byte order.
    let encoding = encoding(&fields)?;
    let stored = stored_type(&fields)?;
    let detached = match fields.get(&["data file"]) {
        Some(name) => Some(fields.data_file("data file", single_file(&fields, name)?)?),
        None if ended_by_blank_line => None,
        None => {
            return Err(
                fields.fail("expected a blank line before the data or a field `data file`, found the file's end")
            );
        }
    };
    let (data, base) = detached.as_deref().map_or((path, lines.offset()), |data| (data, 0));
    let payload = Payload {
        path: data.to_owned(),
        start: Start::Offset(base),
        encoding,
        decoded_skip: 0,
        dims: geometry.dims,
        stored,
        picks,
        hint: "check `sizes`, `type` and the skips of the header",
    };
    VolumeFile::new(path, geometry, skipping(&fields, payload, base)?, 1.0, 0.0)
}

/// The header's fields, and whether a blank line ended them.
fn parse<'a>(path: &'a Path, lines: &mut HeaderLines<'_>) -> Result<(Fields<'a>, bool)> {
    let magic = lines.next_line()?.unwrap_or_default();
    if !matches!(magic.trim_end().strip_prefix("NRRD000"), Some("1" | "2" | "3" | "4" | "5")) {
        return Err(Error::format(path, format!("expected NRRD0001 to NRRD0005, found {}", shown(&magic))));
    }
    let mut fields = Fields::new(path);
    while let Some(line) = lines.next_line()? {
        if line.is_empty() {
            return Ok((fields, true));
        }
        if line.starts_with('#') {
            continue;
        }
        match line.split_once(':') {
            // A key/value pair: of meaning to others only.
            Some((_, value)) if value.starts_with('=') => {}
            Some((name, value)) => {
                fields.insert(name, value)?;
                if fields.get(&["data file"]).is_some_and(is_list) {
                    // Names of files follow.
                    return Ok((fields, false));
                }
            }
            None => return Err(fields.fail(format!("header: expected `field: value`, found {}", shown(&line)))),
        }
    }
    Ok((fields, false))
}

fn stored_type(fields: &Fields<'_>) -> Result<StoredType> {
    let name = fields.required("type")?;
    let scalar_type = match name.to_lowercase().as_str() {
        "signed char" | "int8" | "int8_t" => ScalarType::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => ScalarType::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => ScalarType::I16,
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => ScalarType::U16,
        "int" | "signed int" | "int32" | "int32_t" => ScalarType::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => ScalarType::U32,
        "float" => ScalarType::F32,
        "double" => ScalarType::F64,
        _ => {
            let expected = "int8, uint8, int16, uint16, int32, uint32, float or double (convert others first)";
            return Err(fields.unexpected("type", expected, name));
        }
    };
    let byte_order = match fields.get(&["endian"]) {
        Some(order) if order.eq_ignore_ascii_case("little") => ByteOrder::Little,
        Some(order) if order.eq_ignore_ascii_case("big") => ByteOrder::Big,
        None if scalar_type.size_in_bytes() == 1 => ByteOrder::Little,
        other => return Err(fields.unexpected("endian", "little or big", other.unwrap_or("no such field"))),
    };
    Ok(StoredType { scalar_type, byte_order })
}

fn encoding(fields: &Fields<'_>) -> Result<Encoding> {
    match fields.required("encoding")?.to_lowercase().as_str() {
        "raw" => Ok(Encoding::Plain),
        "gzip" | "gz" => Ok(Encoding::Gzip),
        other => {
            let expected = "raw or gzip (`unu save -f nrrd -e gzip` converts text, hex and bzip2)";
            Err(fields.unexpected("encoding", expected, other))
        }
    }
}

/// Whether `data file` says that the names of files follow.
fn is_list(data_file: &str) -> bool {
    data_file.split_whitespace().next() == Some("LIST")
}

/// The one data file that `value` names.
fn single_file<'v>(fields: &Fields<'_>, value: &'v str) -> Result<&'v str> {
    let mut words = value.split_whitespace();
    let first = words.next().unwrap_or_default();
    let is_pattern = first.contains('%') && words.next().is_some_and(|word| word.parse::<i64>().is_ok());
    if is_list(value) || is_pattern || value.is_empty() {
        let expected = "the name of one file (join the slices first, for example with `unu join`)";
        return Err(fields.unexpected("data file", expected, value));
    }
    Ok(value)
}

/// `payload` behind `line skip` and `byte skip`. Bytes are counted in the unpacked stream, lines in the file, as teem
/// does it.
fn skipping(fields: &Fields<'_>, payload: Payload, base: u64) -> Result<Payload> {
    let lines: u64 = fields.number("line skip")?.unwrap_or(0);
    let bytes: i64 = fields.number("byte skip")?.unwrap_or(0);
    let packed = payload.encoding != Encoding::Plain;
    if bytes == -1 && !packed {
        return Ok(Payload { start: Start::FileEnd, ..payload });
    }
    let bytes = u64::try_from(bytes).map_err(|_| {
        fields.unexpected("byte skip", "a count from 0 up, or -1 with encoding raw", &bytes.to_string())
    })?;
    let offset = behind_lines(&payload.path, base, lines)?;
    if packed {
        return Ok(Payload { start: Start::Offset(offset), decoded_skip: bytes, ..payload });
    }
    Ok(Payload { start: Start::Offset(offset.saturating_add(bytes)), ..payload })
}

/// Position behind `count` lines from byte `base` on.
fn behind_lines(path: &Path, base: u64, count: u64) -> Result<u64> {
    let (mut file, _) = payload::open(path)?;
    file.seek(SeekFrom::Start(base)).map_err(Error::io(path))?;
    let mut reader = BufReader::new(file);
    let mut offset = base;
    for line in 0..count {
        match reader.skip_until(b'\n').map_err(Error::io(path))? {
            0 => {
                return Err(Error::format(
                    path,
                    format!("line skip: expected {count} lines before the data, found {line}"),
                ));
            }
            bytes => offset += bytes as u64,
        }
    }
    Ok(offset)
}
