//! Reader of MetaImage (`.mhd` with a data file, `.mha` with the data inside):
//! <https://docs.itk.org/en/latest/learn/metaio.html>.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use voxrole_pack::ScalarType;

use super::header::{Fields, HeaderLines, shown};
use super::payload::{Encoding, Payload, Start};
use super::pick::{self, AxisRole, Picks};
use super::placement::{FileFrame, Placement};
use super::raw::{ByteOrder, StoredType};
use super::read_options::ReadOptions;
use super::volume_file::VolumeFile;
use crate::Result;

/// Names of the field that ends a header, and of those that may begin one.
const DATA_FILE: &str = "ElementDataFile";
const FIRST_KEYS: [&str; 5] = ["ObjectType", "NDims", "Comment", "ID", "Name"];

/// Whether a file that begins with `start` can be a MetaImage file: its first field is one that ITK writes first.
pub(super) fn is_header(start: &[u8]) -> bool {
    let first = start.split(|&byte| byte == b'=' || byte == b':').next().unwrap_or_default().trim_ascii();
    FIRST_KEYS.iter().any(|key| first.eq_ignore_ascii_case(key.as_bytes()))
}

/// Reads one volume.
///
/// # Errors
/// As [`super::read_volume`].
pub(super) fn read(path: &Path, options: &ReadOptions) -> Result<VolumeFile> {
    let (fields, header_bytes) = parse(path)?;
    let (placement, picks) = placement(&fields, options)?;
    let geometry = placement.geometry(path)?;
    let (detached, start) = data_start(&fields, header_bytes)?;
    let payload = Payload {
        path: detached.unwrap_or_else(|| path.to_owned()),
        start,
        encoding: encoding(&fields)?,
        decoded_skip: 0,
        dims: geometry.dims,
        stored: stored_type(&fields)?,
        picks,
        hint: "check `DimSize`, `ElementType` and `HeaderSize` of the header",
    };
    if payload.start == Start::FileEnd && payload.encoding != Encoding::Plain {
        return Err(fields.unexpected("HeaderSize", "a count from 0 up, since the data are compressed", "-1"));
    }
    VolumeFile::new(path, geometry, payload, 1.0, 0.0)
}

/// The fields up to `ElementDataFile`, which is the last, and the length of their lines.
fn parse(path: &Path) -> Result<(Fields<'_>, u64)> {
    let mut lines = HeaderLines::open(path)?;
    let mut fields = Fields::new(path);
    while let Some(line) = lines.next_line()? {
        if line.trim().is_empty() {
            continue;
        }
        let Some((name, value)) = line.split_once(['=', ':']) else {
            return Err(fields.fail(format!("header: expected `Field = value`, found {}", shown(&line))));
        };
        let name = name.trim();
        if name.eq_ignore_ascii_case("Comment") {
            continue;
        }
        fields.insert(name, value)?;
        if name.eq_ignore_ascii_case(DATA_FILE) {
            return Ok((fields, lines.offset()));
        }
    }
    Err(fields.fail(format!("expected a field `{DATA_FILE}` at the header's end, found the file's end")))
}

/// Where the voxels lie, and which of the numbers are chosen: of several channels, and of several points of time, which are a
/// fourth axis.
fn placement(fields: &Fields<'_>, options: &ReadOptions) -> Result<(Placement, Picks)> {
    for (name, expected) in [("ObjectType", "Image"), ("BinaryData", "True")] {
        if let Some(found) = fields.get(&[name]).filter(|found| !found.eq_ignore_ascii_case(expected)) {
            return Err(fields.unexpected(name, expected, found));
        }
    }
    let axes: usize = match fields.get(&["NDims"]) {
        Some("3") => 3,
        Some("4") => 4,
        found => return Err(fields.unexpected("NDims", "3, or 4 with time", found.unwrap_or("no such field"))),
    };
    let sizes = along_axes::<u64>(fields, &["DimSize"], axes)?
        .ok_or_else(|| fields.unexpected("DimSize", &format!("{axes} numbers"), "no such field"))?;
    let dims = fields.dims("DimSize", [sizes[0], sizes[1], sizes[2]])?;
    let mut roles = vec![(fields.number("ElementNumberOfChannels")?.unwrap_or(1), AxisRole::Component)];
    roles.extend(sizes.iter().map(|&size| (size, AxisRole::Space)));
    if axes == 4 {
        roles[4].1 = AxisRole::Time;
    }
    let picks = pick::choose(&roles, options).map_err(|message| fields.fail(message))?;
    let three = |numbers: Vec<f64>| [numbers[0], numbers[1], numbers[2]];
    // ElementSize is the extent over which a voxel was measured, the distance of voxels only where nothing else is.
    let spacing = along_axes(fields, &["ElementSpacing", "ElementSize"], axes)?.map_or([1.0; 3], three);
    let mut placement = Placement::axis_aligned(dims, spacing);
    if let Some(origin) = along_axes(fields, &["Offset", "Position", "Origin"], axes)? {
        placement.origin = three(origin);
    }
    // Axis by axis: the first numbers are the first index axis' direction in the world.
    if let Some(matrix) = along_axes(fields, &["TransformMatrix", "Rotation", "Orientation"], axes * axes)? {
        placement.direction = [0, 1, 2].map(|axis| three(matrix[axis * axes..][..3].to_vec()));
    }
    // Writers name an orientation when they hold the world for the patient's; its frame is then ITK's.
    if fields.get(&["AnatomicalOrientation"]).is_some_and(is_known_orientation) {
        placement.frame = FileFrame::LeftPosteriorSuperior;
    }
    placement.unit = fields.get(&["DistanceUnits"]).filter(|unit| *unit != "?").unwrap_or_default().to_owned();
    Ok((placement, picks))
}

/// The first present one of `names` as `count` numbers.
fn along_axes<T: FromStr>(fields: &Fields<'_>, names: &[&str], count: usize) -> Result<Option<Vec<T>>> {
    let Some((name, text)) = names.iter().find_map(|name| Some((*name, fields.get(&[name])?))) else {
        return Ok(None);
    };
    let numbers = fields.numbers(name, text)?;
    if numbers.len() != count {
        return Err(fields.unexpected(name, &format!("{count} numbers"), text));
    }
    Ok(Some(numbers))
}

/// Three letters, one of each pair right-left, anterior-posterior, inferior-superior.
fn is_known_orientation(text: &str) -> bool {
    let pairs = ["RL", "AP", "IS"];
    let text = text.to_ascii_uppercase();
    text.len() == 3 && pairs.iter().all(|pair| text.chars().filter(|letter| pair.contains(*letter)).count() == 1)
}

fn stored_type(fields: &Fields<'_>) -> Result<StoredType> {
    let name = fields.required("ElementType")?;
    let scalar_type = match name.to_ascii_uppercase().as_str() {
        "MET_CHAR" => ScalarType::I8,
        "MET_UCHAR" => ScalarType::U8,
        "MET_SHORT" => ScalarType::I16,
        "MET_USHORT" => ScalarType::U16,
        // A MetaImage `long` has four bytes, whatever the machine's has.
        "MET_INT" | "MET_LONG" => ScalarType::I32,
        "MET_UINT" | "MET_ULONG" => ScalarType::U32,
        "MET_FLOAT" => ScalarType::F32,
        "MET_DOUBLE" => ScalarType::F64,
        _ => {
            let expected = "MET_CHAR, MET_UCHAR, MET_SHORT, MET_USHORT, MET_INT, MET_UINT, MET_FLOAT or MET_DOUBLE \
                            (convert others first)";
            return Err(fields.unexpected("ElementType", expected, name));
        }
    };
    let big_endian = flag(fields, &["BinaryDataByteOrderMSB", "ElementByteOrderMSB"])?;
    Ok(StoredType { scalar_type, byte_order: if big_endian { ByteOrder::Big } else { ByteOrder::Little } })
}

fn encoding(fields: &Fields<'_>) -> Result<Encoding> {
    if flag(fields, &["CompressedData"])? {
        return Ok(Encoding::Zlib(fields.number("CompressedDataSize")?));
    }
    Ok(Encoding::Plain)
}

/// `True` or `False`, which is also what a missing field means. MetaIO looks at the first letter only.
fn flag(fields: &Fields<'_>, names: &[&str]) -> Result<bool> {
    match fields.get(names).map(|value| (value, value.chars().next())) {
        None | Some((_, Some('F' | 'f' | '0'))) => Ok(false),
        Some((_, Some('T' | 't' | '1'))) => Ok(true),
        Some((value, _)) => Err(fields.unexpected(names[0], "True or False", value)),
    }
}

/// The data file, if it is another one, and where in it the data begin.
fn data_start(fields: &Fields<'_>, header_bytes: u64) -> Result<(Option<PathBuf>, Start)> {
    let name = fields.required(DATA_FILE)?;
    let header_size: i64 = fields.number("HeaderSize")?.unwrap_or(0);
    let local = name.eq_ignore_ascii_case("LOCAL");
    let start = match header_size {
        -1 => Start::FileEnd,
        0 if local => Start::Offset(header_bytes),
        // MetaIO would count from the file's start, its documentation from the header's end.
        1.. if local => {
            return Err(fields.unexpected(
                "HeaderSize",
                "0 or -1 with data in the same file",
                &header_size.to_string(),
            ));
        }
        _ => Start::Offset(
            u64::try_from(header_size)
                .map_err(|_| fields.unexpected("HeaderSize", "-1 or a count from 0 up", &header_size.to_string()))?,
        ),
    };
    if local {
        return Ok((None, start));
    }
    let first = name.split_whitespace().next().unwrap_or_default();
    if first.eq_ignore_ascii_case("LIST") || first.contains('%') || first.is_empty() {
        let expected = "LOCAL or the name of one file (join the slices first, for example with SimpleITK)";
        return Err(fields.unexpected(DATA_FILE, expected, name));
    }
    Ok((Some(fields.data_file(DATA_FILE, name)?), start))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_are_known_by_their_first_field() {
        assert!(is_header(b"ObjectType = Image\nNDims = 3\n"));
        assert!(is_header(b"NDims=3"));
        assert!(is_header(b"Comment: a scan\n"));
        for other in [b"".as_slice(), b"NRRD0004\ntype: short", b"\0\0\0\0", b"NDims"] {
            assert_eq!(is_header(other), other == b"NDims", "{other:?}");
        }
    }

    #[test]
    fn orientations_name_each_pair_once() {
        for known in ["RAI", "LPS", "ail"] {
            assert!(is_known_orientation(known), "{known}");
        }
        for unknown in ["???", "", "RAL", "RRA", "RAIS", "XYZ"] {
            assert!(!is_known_orientation(unknown), "{unknown}");
        }
    }
}
