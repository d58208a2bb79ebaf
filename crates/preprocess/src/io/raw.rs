//! Headerless volumes: the caller says how the numbers lie.

use std::fmt;
use std::io::Read;
use std::path::Path;
use std::str::FromStr;

use voxrole_pack::{GridGeometry, ScalarType};

use super::payload::{self, Encoding, Payload, Start};
use super::pick::Picks;
use super::raw_guess;
use super::volume_file::VolumeFile;
use crate::{Error, Result};

/// Order of a number's bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ByteOrder {
    /// Least significant byte first.
    #[default]
    Little,
    /// Most significant byte first.
    Big,
}

/// How one number is stored in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StoredType {
    /// The number's type.
    pub scalar_type: ScalarType,
    /// The order of its bytes; of no meaning for one byte.
    pub byte_order: ByteOrder,
}

impl FromStr for StoredType {
    type Err = Error;

    /// `u8`, `i8`, `u16`, `i16`, `u32`, `i32`, `f32` or `f64`, followed by `le`, `be` or nothing, which is `le`.
    fn from_str(text: &str) -> Result<Self> {
        let (name, byte_order) = match (text.strip_suffix("le"), text.strip_suffix("be")) {
            (Some(name), _) => (name, ByteOrder::Little),
            (_, Some(name)) => (name, ByteOrder::Big),
            _ => (text, ByteOrder::Little),
        };
        let scalar_type = ScalarType::from_name(name).ok_or_else(|| {
            let names = ScalarType::ALL.map(ScalarType::name).join(", ");
            Error::Parameter(format!(
                "unknown type of number {text:?}: expected one of {names}, with `be` behind it for big-endian numbers"
            ))
        })?;
        Ok(Self { scalar_type, byte_order })
    }
}

impl fmt::Display for StoredType {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let suffix = match (self.scalar_type.size_in_bytes(), self.byte_order) {
            (1, _) => "",
            (_, ByteOrder::Little) => "le",
            (_, ByteOrder::Big) => "be",
        };
        write!(formatter, "{}{suffix}", self.scalar_type.name())
    }
}

/// What a headerless file does not say itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RawLayout {
    /// Number of voxels along x, y, z; x is fastest in the file.
    pub dims: [u32; 3],
    /// How one number is stored; `None` for the only type that the file's size allows.
    pub scalar: Option<StoredType>,
    /// Distance between neighbouring voxels along each axis.
    pub spacing: [f64; 3],
    /// Bytes before the first number: of the unpacked content, where the file is gzipped.
    pub skip_bytes: u64,
}

impl RawLayout {
    /// The options that say so, as they are typed.
    pub(super) fn typed(&self) -> String {
        let Self { dims: [nx, ny, nz], scalar, spacing: [dx, dy, dz], skip_bytes } = self;
        let dtype = scalar.map_or_else(String::new, |scalar| format!(" --dtype {scalar}"));
        let skip = if *skip_bytes == 0 { String::new() } else { format!(" --skip-bytes {skip_bytes}") };
        format!("--dims {nx},{ny},{nz}{dtype} --spacing {dx},{dy},{dz}{skip}")
    }
}

const HINT: &str = "check --dims, --dtype and --skip-bytes";

/// Finds the numbers of a headerless file, gzipped or not.
///
/// # Errors
/// As [`super::read_volume`].
pub(super) fn read(path: &Path, layout: &RawLayout) -> Result<VolumeFile> {
    let RawLayout { dims, scalar, spacing, skip_bytes } = *layout;
    let geometry = GridGeometry::axis_aligned(dims, spacing);
    geometry.validate().map_err(|error| {
        Error::Parameter(format!(
            "{}: expected a usable grid, found {error}; check --dims and --spacing",
            path.display()
        ))
    })?;
    let stored = scalar.map_or_else(|| raw_guess::stored_type(path, dims, skip_bytes), Ok)?;
    let mut payload = Payload {
        path: path.to_owned(),
        start: Start::Offset(skip_bytes),
        encoding: Encoding::Plain,
        decoded_skip: 0,
        dims,
        stored,
        picks: Picks::default(),
        hint: HINT,
    };
    // Plain numbers may happen to begin like a gzip file: a length that fits exactly says that they are plain.
    let fits = payload.expected_bytes().checked_add(skip_bytes);
    let (mut file, length) = payload::open(path)?;
    let mut magic = [0; payload::GZIP_MAGIC.len()];
    if fits != Some(length) && file.read_exact(&mut magic).is_ok() && magic == payload::GZIP_MAGIC {
        payload = Payload { start: Start::Offset(0), encoding: Encoding::Gzip, decoded_skip: skip_bytes, ..payload };
    }
    let volume = VolumeFile::new(path, geometry, payload, 1.0, 0.0)?;
    Ok(if scalar.is_none() { volume.with_notes(vec![format!("read as --dtype {stored}")]) } else { volume })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn types_are_read_and_written_alike() {
        for scalar_type in ScalarType::ALL {
            for byte_order in [ByteOrder::Little, ByteOrder::Big] {
                let stored = StoredType { scalar_type, byte_order };
                let parsed: StoredType = stored.to_string().parse().expect("its own name");
                assert_eq!(parsed.scalar_type, scalar_type);
                assert!(scalar_type.size_in_bytes() == 1 || parsed == stored, "{stored}");
            }
        }
        let plain: StoredType = "u16".parse().expect("little-endian by default");
        assert_eq!(plain, "u16le".parse().expect("the same, spelt out"));
    }

    #[test]
    fn unknown_types_are_refused() {
        for text in ["", "be", "u64", "U16", "u16 be", "f16le", "u16bele"] {
            let message = text.parse::<StoredType>().expect_err(text).to_string();
            assert!(message.contains("expected one of u8, i8, u16"), "{message}");
        }
    }
}
