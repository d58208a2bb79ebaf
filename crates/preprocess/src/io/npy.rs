//! Reader of NumPy's `.npy`, versions 1 to 3: <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>.
//!
//! The axis that is fastest in the file is x: an array in C order is `array[z][y][x]`, one in Fortran order `array[x][y][z]`.
//! With four axes the fastest may be that of components, `array[z][y][x][component]`, or the slowest that of time,
//! `array[time][z][y][x]`. The file says nothing of spacing, which is 1.

use std::io::Read;
use std::path::Path;

use voxrole_pack::ScalarType;

use super::header::shown;
use super::payload::{self, Encoding, Payload, Start};
use super::pick;
use super::placement::Placement;
use super::raw::{ByteOrder, StoredType};
use super::read_options::ReadOptions;
use super::volume_file::VolumeFile;
use crate::{Error, Result};

const MAGIC: &[u8] = b"\x93NUMPY";
/// Longest header that is read.
const MAX_HEADER_BYTES: u32 = 1 << 16;

/// Whether a file that begins with `start` is of this kind.
pub(super) fn is_header(start: &[u8]) -> bool {
    start.starts_with(MAGIC)
}

/// Reads one volume.
///
/// # Errors
/// As [`super::read_volume`].
pub(super) fn read(path: &Path, options: &ReadOptions) -> Result<VolumeFile> {
    let fail = |message: String| Error::format(path, message);
    let (header, start) = header(path)?;
    let stored = stored_type(&header).map_err(fail)?;
    let sizes = sizes(&header).map_err(fail)?;
    let axes = pick::roles(&sizes, options).map_err(fail)?;
    let spatial: Vec<u64> = axes.iter().filter(|axis| axis.1 == pick::AxisRole::Space).map(|axis| axis.0).collect();
    let mut dims = [0; 3];
    for (dim, size) in dims.iter_mut().zip(&spatial) {
        *dim = u32::try_from(*size)
            .map_err(|_| fail(format!("shape: expected axes of at most 4294967295 voxels, found {size}")))?;
    }
    let geometry = Placement::axis_aligned(dims, [1.0; 3]).geometry(path)?;
    let payload = Payload {
        path: path.to_owned(),
        start: Start::Offset(start),
        encoding: Encoding::Plain,
        decoded_skip: 0,
        dims,
        stored,
        picks: pick::choose(&axes, options).map_err(fail)?,
        hint: "check `shape` and `descr` of the header",
    };
    Ok(VolumeFile::new(path, geometry, payload, 1.0, 0.0)?.with_notes(options.note_on_spacing()))
}

/// The header's text, and where the numbers begin.
fn header(path: &Path) -> Result<(String, u64)> {
    let (mut file, file_bytes) = payload::open(path)?;
    let mut read = |bytes: &mut [u8]| {
        file.read_exact(bytes)
            .map_err(|_| Error::format(path, format!("expected an .npy header, found a file of {file_bytes} bytes")))
    };
    let mut start = [0; 8];
    read(&mut start)?;
    let mut length = [0; 4];
    match start[6] {
        1 => read(&mut length[..2])?,
        2 | 3 => read(&mut length)?,
        version => return Err(Error::format(path, format!("expected .npy version 1 to 3, found {version}"))),
    }
    let length_bytes = if start[6] == 1 { 2 } else { 4 };
    let length = u32::from_le_bytes(length);
    if length > MAX_HEADER_BYTES {
        let message = format!("expected an .npy header of at most {MAX_HEADER_BYTES} bytes, found {length}");
        return Err(Error::format(path, message));
    }
    let mut text = vec![0; length as usize];
    read(&mut text)?;
    Ok((String::from_utf8_lossy(&text).into_owned(), 8 + length_bytes + u64::from(length)))
}

/// What stands behind `'name':` in the header.
fn value<'a>(header: &'a str, name: &str) -> std::result::Result<&'a str, String> {
    let quoted = [format!("'{name}'"), format!("\"{name}\"")];
    let after = quoted.iter().find_map(|name| header.split_once(name.as_str()));
    after
        .and_then(|(_, after)| after.trim_start().strip_prefix(':'))
        .map(str::trim_start)
        .ok_or_else(|| format!("expected `{name}` in the .npy header, found {}", shown(header.trim_end())))
}

/// Numbers along each axis, fastest first. Axes of one are left out until three remain, slowest first.
fn sizes(header: &str) -> std::result::Result<Vec<u64>, String> {
    let text = value(header, "shape")?;
    let inside = text.strip_prefix('(').and_then(|text| text.split_once(')')).map(|(inside, _)| inside);
    let numbers = inside.and_then(|inside| {
        let words = inside.split(',').map(str::trim).filter(|word| !word.is_empty());
        words.map(|word| word.parse::<u64>().ok().filter(|&size| size > 0)).collect::<Option<Vec<_>>>()
    });
    let mut sizes =
        numbers.ok_or_else(|| format!("shape: expected counts from 1 up, found {}", shown(text.trim_end())))?;
    match value(header, "fortran_order")? {
        text if text.starts_with("False") => sizes.reverse(),
        text if text.starts_with("True") => {}
        other => return Err(format!("fortran_order: expected True or False, found {}", shown(other.trim_end()))),
    }
    while sizes.len() > 3 {
        let Some(single) = sizes.iter().rposition(|&size| size == 1) else { break };
        sizes.remove(single);
    }
    Ok(sizes)
}

fn stored_type(header: &str) -> std::result::Result<StoredType, String> {
    let text = value(header, "descr")?;
    let name = text.strip_prefix(['\'', '"']).and_then(|text| text.split_once(['\'', '"'])).map(|(name, _)| name);
    let unread = || {
        let found = shown(name.unwrap_or(text.trim_end()));
        format!(
            "descr: expected numbers b1, u1, i1, u2, i2, u4, i4, f4 or f8, found {found}: convert them first, for example with \
             `array.astype('f4')`"
        )
    };
    let (order, kind) = name.and_then(|name| name.split_at_checked(1)).ok_or_else(unread)?;
    let scalar_type = match kind {
        "b1" | "u1" => ScalarType::U8,
        "i1" => ScalarType::I8,
        "u2" => ScalarType::U16,
        "i2" => ScalarType::I16,
        "u4" => ScalarType::U32,
        "i4" => ScalarType::I32,
        "f4" => ScalarType::F32,
        "f8" => ScalarType::F64,
        _ => return Err(unread()),
    };
    let byte_order = match order {
        "<" => ByteOrder::Little,
        ">" => ByteOrder::Big,
        "|" if scalar_type.size_in_bytes() == 1 => ByteOrder::Little,
        _ => return Err(unread()),
    };
    Ok(StoredType { scalar_type, byte_order })
}
