//! Reader of NIfTI-1: `.nii`, `.nii.gz`, and `.hdr` with `.img`: <https://nifti.nimh.nih.gov/pub/dist/src/niftilib/nifti1.h>.
//!
//! The header is read here and not by the crate `nifti`: it is twenty numbers at fixed offsets, and the crate would bring
//! eleven others to build, and read the voxels without the checks of [`super::payload`].

use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use flate2::bufread::MultiGzDecoder;
use voxrole_pack::ScalarType;

use super::payload::{self, Encoding, Payload, Start};
use super::pick::{self, AxisRole, Picks};
use super::placement::{FileFrame, Placement};
use super::raw::{ByteOrder, StoredType};
use super::read_options::ReadOptions;
use super::volume_file::VolumeFile;
use crate::{Error, Result};

/// Bytes of the header, which are also its first number.
const HEADER_BYTES: usize = 348;
/// Where the data of a single file begin at the earliest: behind the header and four bytes about extensions.
const FIRST_DATA_BYTE: u64 = 352;
/// The same first number of NIfTI-2.
const NIFTI_2_HEADER_BYTES: i32 = 540;

/// Whether a file that begins with `start` is NIfTI, of whichever version and byte order, or its forerunner Analyze.
pub(super) fn is_header(start: &[u8]) -> bool {
    let size = start.first_chunk::<4>();
    let is = |expected: i32| size.is_some_and(|size| [expected.to_le_bytes(), expected.to_be_bytes()].contains(size));
    is(HEADER_BYTES as i32) || is(NIFTI_2_HEADER_BYTES) || has_magic(start)
}

fn has_magic(start: &[u8]) -> bool {
    matches!(start.get(344..348), Some(b"n+1\0" | b"ni1\0"))
}

/// Reads one volume; `packed` if the file is gzipped. The fourth axis is time, the fifth that of components.
///
/// # Errors
/// As [`super::read_volume`].
pub(super) fn read(path: &Path, packed: bool, options: &ReadOptions) -> Result<VolumeFile> {
    let header = Header::read(path, packed)?;
    let geometry = header.placement()?.geometry(path)?;
    let (slope, intercept) = header.mapping()?;
    let stored = header.stored_type()?;
    let offset = header.data_offset()?;
    let image = if header.is_single_file() { None } else { Some(header.image_file()?) };
    let (data, packed) = image.as_ref().map_or((path, packed), |(image, packed)| (image.as_path(), *packed));
    let (encoding, start, decoded_skip) =
        if packed { (Encoding::Gzip, 0, offset) } else { (Encoding::Plain, offset, 0) };
    let hint = "check `dim`, `datatype` and `vox_offset` of the header";
    let payload = Payload {
        path: data.to_owned(),
        start: Start::Offset(start),
        encoding,
        decoded_skip,
        dims: geometry.dims,
        stored,
        picks: header.picks(options)?,
        hint,
    };
    VolumeFile::new(path, geometry, payload, slope, intercept)
}

/// The header's bytes and what is needed to understand them.
struct Header<'a> {
    path: &'a Path,
    bytes: [u8; HEADER_BYTES],
    byte_order: ByteOrder,
}

impl<'a> Header<'a> {
    fn read(path: &'a Path, packed: bool) -> Result<Self> {
        let (file, _) = payload::open(path)?;
        let file = BufReader::new(file);
        let mut stream: Box<dyn Read> = if packed { Box::new(MultiGzDecoder::new(file)) } else { Box::new(file) };
        let mut found = Vec::new();
        let outcome = Read::by_ref(&mut stream).take(HEADER_BYTES as u64).read_to_end(&mut found);
        let Ok(bytes) = <[u8; HEADER_BYTES]>::try_from(found.as_slice()) else {
            let reason = outcome.err().map(|error| format!(" ({error})")).unwrap_or_default();
            let message = format!("expected a NIfTI header of {HEADER_BYTES} bytes, found {}{reason}", found.len());
            return Err(Error::format(path, message));
        };
        let size = [bytes[0], bytes[1], bytes[2], bytes[3]];
        let byte_order = match (i32::from_le_bytes(size), i32::from_be_bytes(size)) {
            (348, _) => ByteOrder::Little,
            (_, 348) => ByteOrder::Big,
            (NIFTI_2_HEADER_BYTES, _) | (_, NIFTI_2_HEADER_BYTES) => {
                return Err(Error::format(
                    path,
                    "expected NIfTI-1, found NIfTI-2, which is not read yet: convert it to NIfTI-1",
                ));
            }
            (little, big) => {
                let message =
                    format!("sizeof_hdr: expected {HEADER_BYTES} in either byte order, found {little} or {big}");
                return Err(Error::format(path, message));
            }
        };
        if !has_magic(&bytes) {
            let message = format!(
                "magic: expected \"n+1\" or \"ni1\", found {:?}: an Analyze file says too little of its placement, convert it \
                 to NIfTI-1 first",
                String::from_utf8_lossy(&bytes[344..348])
            );
            return Err(Error::format(path, message));
        }
        Ok(Self { path, bytes, byte_order })
    }

    fn fail(&self, message: impl Into<String>) -> Error {
        Error::format(self.path, message)
    }

    fn field<const N: usize>(&self, offset: usize) -> [u8; N] {
        let mut field = [0; N];
        field.copy_from_slice(&self.bytes[offset..offset + N]);
        if self.byte_order == ByteOrder::Big {
            field.reverse();
        }
        field
    }

    fn i16_at(&self, offset: usize) -> i16 {
        i16::from_le_bytes(self.field(offset))
    }

    fn f64_at(&self, offset: usize) -> f64 {
        f64::from(f32::from_le_bytes(self.field(offset)))
    }

    fn is_single_file(&self) -> bool {
        self.bytes[344..348] == *b"n+1\0"
    }

    /// `dim`: the number of axes, then their lengths; those beyond the last are 1.
    fn sizes(&self) -> Result<[u16; 7]> {
        let count = self.i16_at(40);
        if !(3..=7).contains(&count) {
            return Err(self.fail(format!("dim[0]: expected 3 to 7 axes, found {count}")));
        }
        let mut sizes = [1; 7];
        for axis in 1..=usize::from(count.unsigned_abs()) {
            let length = self.i16_at(40 + 2 * axis);
            if length < 1 || (axis > 5 && length != 1) {
                let expected = if axis > 5 { "1" } else { "at least 1" };
                return Err(self.fail(format!("dim[{axis}]: expected {expected}, found {length}")));
            }
            sizes[axis - 1] = length.unsigned_abs();
        }
        Ok(sizes)
    }

    fn dims(&self) -> Result<[u32; 3]> {
        let [x, y, z, ..] = self.sizes()?;
        Ok([x, y, z].map(u32::from))
    }

    /// Which of the numbers `options` choose: of several components, which lie apart but for those of colours, and of several
    /// points of time.
    fn picks(&self, options: &ReadOptions) -> Result<Picks> {
        let sizes = self.sizes()?.map(u64::from);
        let mut axes = vec![(self.colours(), AxisRole::Component)];
        axes.extend(sizes[..3].iter().map(|&size| (size, AxisRole::Space)));
        axes.extend([(sizes[3], AxisRole::Time), (sizes[4], AxisRole::Component)]);
        pick::choose(&axes, options).map_err(|message| self.fail(format!("dim: {message}")))
    }

    /// Numbers of a colour; 1 where there is none.
    fn colours(&self) -> u64 {
        match self.i16_at(70) {
            128 => 3,
            2304 => 4,
            _ => 1,
        }
    }

    fn stored_type(&self) -> Result<StoredType> {
        let code = self.i16_at(70);
        let scalar_type = match code {
            2 | 128 | 2304 => ScalarType::U8,
            4 => ScalarType::I16,
            8 => ScalarType::I32,
            16 => ScalarType::F32,
            64 => ScalarType::F64,
            256 => ScalarType::I8,
            512 => ScalarType::U16,
            768 => ScalarType::U32,
            _ => {
                let message = format!(
                    "datatype: expected 2 (u8), 4 (i16), 8 (i32), 16 (f32), 64 (f64), 256 (i8), 512 (u16) or 768 (u32), \
                     found {code}{}",
                    unread_type(code)
                );
                return Err(self.fail(message));
            }
        };
        let bits = 8 * scalar_type.size_in_bytes();
        let (expected, found) = (bits * self.colours() as usize, self.i16_at(72));
        if usize::try_from(found) != Ok(expected) {
            return Err(self.fail(format!("bitpix: expected {expected} for datatype {code}, found {found}")));
        }
        Ok(StoredType { scalar_type, byte_order: self.byte_order })
    }

    /// `scl_slope` and `scl_inter`. A slope of 0 means that there is no mapping; NaN, which some writers put there, too.
    fn mapping(&self) -> Result<(f64, f64)> {
        let (slope, intercept) = (self.f64_at(112), self.f64_at(116));
        if slope == 0.0 || slope.is_nan() {
            return Ok((1.0, 0.0));
        }
        if !(slope.is_finite() && intercept.is_finite()) {
            let message = format!("scl_slope, scl_inter: expected finite numbers, found {slope} and {intercept}");
            return Err(self.fail(message));
        }
        Ok((slope, intercept))
    }

    /// `vox_offset`: where the data begin in their file.
    fn data_offset(&self) -> Result<u64> {
        let offset = self.f64_at(108);
        let least = if self.is_single_file() { FIRST_DATA_BYTE } else { 0 };
        if offset == 0.0 {
            return Ok(least);
        }
        if !(offset >= least as f64 && offset.fract() == 0.0 && offset < f64::from(u32::MAX)) {
            return Err(self.fail(format!("vox_offset: expected a whole number from {least} up, found {offset}")));
        }
        Ok(offset as u64)
    }

    /// The file beside a `.hdr`, and whether it is gzipped.
    fn image_file(&self) -> Result<(PathBuf, bool)> {
        let header = if self.path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("gz")) {
            self.path.with_extension("")
        } else {
            self.path.to_owned()
        };
        let candidates = [(header.with_extension("img"), false), (header.with_extension("img.gz"), true)];
        let found = candidates.iter().find(|(path, _)| path.exists());
        found.cloned().ok_or_else(|| {
            self.fail(format!("expected the voxels in {} or .img.gz, found neither file", candidates[0].0.display()))
        })
    }

    /// By `sform` if there is one, else by `qform`, else along the axes of an unknown world (the header's methods 3, 2
    /// and 1).
    fn placement(&self) -> Result<Placement> {
        let pixdim = [1, 2, 3].map(|axis| self.f64_at(76 + 4 * axis));
        let unit = match self.bytes[123] & 7 {
            1 => "m",
            2 => "mm",
            3 => "\u{b5}m",
            _ => "",
        };
        let placement = Placement { unit: unit.into(), ..Placement::axis_aligned(self.dims()?, pixdim) };
        let patient = FileFrame::RightAnteriorSuperior;
        if self.i16_at(254) > 0 {
            // Rows give world x, y, z; columns the step along each index axis, then the origin.
            let entry = |row: usize, column: usize| self.f64_at(280 + 16 * row + 4 * column);
            let column = |column: usize| [entry(0, column), entry(1, column), entry(2, column)];
            let steps = [column(0), column(1), column(2)];
            if let Some(bad) = steps.iter().flatten().find(|entry| !entry.is_finite()) {
                return Err(self.fail(format!("srow_x, srow_y, srow_z: expected finite numbers, found {bad}")));
            }
            return Ok(Placement { origin: column(3), frame: patient, ..placement }.with_steps(steps));
        }
        if self.i16_at(252) > 0 {
            let origin = [268, 272, 276].map(|offset| self.f64_at(offset));
            return Ok(Placement { direction: self.quaternion_axes()?, origin, frame: patient, ..placement });
        }
        Ok(placement)
    }

    /// World directions of the index axes from `quatern_b, c, d` and the sign of `pixdim[0]`.
    fn quaternion_axes(&self) -> Result<[[f64; 3]; 3]> {
        let [mut b, mut c, mut d] = [256, 260, 264].map(|offset| self.f64_at(offset));
        let square = b * b + c * c + d * d;
        // Beyond what the rounding of three f32 explains, it is no rotation.
        if square.is_nan() || square > 1.0 + 1e-3 {
            return Err(self.fail(format!("quatern_b, c, d: expected a length of at most 1, found {}", square.sqrt())));
        }
        let mut a = (1.0 - square).max(0.0).sqrt();
        // As in nifti1_io.c: half a turn, up to rounding.
        if 1.0 - square < 1e-7 {
            let length = square.sqrt();
            (a, b, c, d) = (0.0, b / length, c / length, d / length);
        }
        let handedness = if self.f64_at(76) < 0.0 { -1.0 } else { 1.0 };
        let x = [a * a + b * b - c * c - d * d, 2.0 * (b * c + a * d), 2.0 * (b * d - a * c)];
        let y = [2.0 * (b * c - a * d), a * a + c * c - b * b - d * d, 2.0 * (c * d + a * b)];
        let z = [2.0 * (b * d + a * c), 2.0 * (c * d - a * b), a * a + d * d - c * c - b * b];
        Ok([x, y, z.map(|component| handedness * component)])
    }
}

/// What a type that is not read is called.
fn unread_type(code: i16) -> &'static str {
    match code {
        1 => " (single bits)",
        32 | 1792 | 2048 => " (complex numbers)",
        1024 | 1280 => " (64-bit integers)",
        1536 => " (128-bit floats)",
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(fields: &[(usize, &[u8])]) -> Header<'static> {
        let mut bytes = [0; HEADER_BYTES];
        for (offset, field) in fields {
            bytes[*offset..offset + field.len()].copy_from_slice(field);
        }
        Header { path: Path::new("a.nii"), bytes, byte_order: ByteOrder::Little }
    }

    #[test]
    fn quaternions_turn_as_the_standard_says() {
        // A quarter turn about z: a = d = √½, so that x → y and y → −x.
        let half = 0.5_f32.sqrt();
        let quarter = header(&[(264, &half.to_le_bytes()), (76, &(-1.0_f32).to_le_bytes())]);
        let expected = [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]];
        for (axis, expected) in quarter.quaternion_axes().expect("a rotation").iter().zip(expected) {
            for (found, expected) in axis.iter().zip(expected) {
                assert!((found - expected).abs() < 1e-7, "{axis:?}");
            }
        }
        // Half a turn about x: b = 1.
        let half_turn = header(&[(256, &1.0_f32.to_le_bytes())]);
        assert_eq!(
            half_turn.quaternion_axes().expect("a rotation"),
            [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]
        );
        for bad in [2.0_f32, f32::NAN, f32::INFINITY] {
            assert!(header(&[(256, &bad.to_le_bytes())]).quaternion_axes().is_err(), "{bad}");
        }
    }

    #[test]
    fn no_slope_means_no_mapping() {
        for slope in [0.0_f32, -0.0, f32::NAN] {
            let header = header(&[(112, &slope.to_le_bytes()), (116, &5.0_f32.to_le_bytes())]);
            assert_eq!(header.mapping().expect("no mapping"), (1.0, 0.0));
        }
        let header =
            |slope: f32, intercept: f32| header(&[(112, &slope.to_le_bytes()), (116, &intercept.to_le_bytes())]);
        assert_eq!(header(2.0, -1.0).mapping().expect("finite"), (2.0, -1.0));
        assert!(header(f32::INFINITY, 0.0).mapping().is_err());
        assert!(header(1.0, f32::NAN).mapping().is_err());
    }

    #[test]
    fn offsets_are_whole_and_behind_the_header() {
        let header = |offset: f32| header(&[(108, &offset.to_le_bytes()), (344, b"n+1\0")]);
        assert_eq!(header(0.0).data_offset().expect("the default"), 352);
        assert_eq!(header(1000.0).data_offset().expect("behind extensions"), 1000);
        for bad in [-1.0, 348.0, 352.5, f32::NAN, f32::INFINITY, 1e30] {
            let message = header(bad).data_offset().expect_err("no place").to_string();
            assert!(message.contains("a.nii") && message.contains("expected a whole number"), "{message}");
        }
    }
}
