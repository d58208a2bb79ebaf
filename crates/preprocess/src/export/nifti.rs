//! Writer of NIfTI-1 in one file: <https://nifti.nimh.nih.gov/pub/dist/src/niftilib/nifti1.h>.

use std::io::{self, Write};

use glam::{DMat3, DQuat};
use voxrole_pack::{GridGeometry, ScalarType, WorldFrame};

use super::{component, write_numbers};
use crate::field_volume::FieldVolume;

/// Bytes of the header, which are also its first number.
const HEADER_BYTES: usize = 348;
/// Where the numbers begin: behind the header and four bytes that say that there are no extensions.
const FIRST_DATA_BYTE: usize = 352;
/// Longest axis: lengths are i16.
const LONGEST_AXIS: u32 = i16::MAX as u32;
/// `intent_code` of a vector at each voxel.
const INTENT_VECTOR: i16 = 1007;
/// `sform_code` and `qform_code`: in the scanner's coordinates; in those of something else.
const SCANNER: i16 = 1;
const ALIGNED: i16 = 2;

/// Writes a field. The world of NIfTI is right-anterior-superior; an unspecified one is taken for left-posterior-superior, as
/// ITK does. Values keep their stored numbers where f32 holds slope and intercept. Components of normals are along the
/// axes of NIfTI's world, and lie one volume behind the other.
///
/// # Errors
/// [`io::ErrorKind::InvalidInput`] for more than 32767 voxels along an axis; else whatever `out` says.
pub fn write(out: &mut impl Write, volume: FieldVolume) -> io::Result<()> {
    let mapping = volume.mapping();
    let is_exact = mapping.iter().all(|number| f64::from(*number as f32) == *number);
    let (volume, mapping) = if is_exact { (volume.into_stored(), mapping) } else { (volume, [1.0, 0.0]) };
    out.write_all(&header(&volume, mapping)?)?;
    if volume.components() == 1 {
        return write_numbers(out, &volume);
    }
    let mut bytes = Vec::new();
    for axis in 0..3 {
        for chunk in volume.chunks() {
            bytes.clear();
            volume.append_le(chunk, &mut bytes);
            let mut along = component(&bytes, axis);
            if axis < 2 {
                // The sign of a little-endian float.
                along.iter_mut().skip(3).step_by(4).for_each(|byte| *byte ^= 0x80);
            }
            out.write_all(&along)?;
        }
    }
    Ok(())
}

/// The code of a unit of length; `None` for one that NIfTI has no code for.
pub(super) fn unit_code(unit: &str) -> Option<u8> {
    match unit {
        "" => Some(0),
        "m" => Some(1),
        "mm" => Some(2),
        "\u{b5}m" => Some(3),
        _ => None,
    }
}

struct Header([u8; FIRST_DATA_BYTE]);

impl Header {
    fn put(&mut self, offset: usize, bytes: &[u8]) {
        self.0[offset..offset + bytes.len()].copy_from_slice(bytes);
    }

    fn put_i16s(&mut self, offset: usize, numbers: &[i16]) {
        numbers.iter().enumerate().for_each(|(index, number)| self.put(offset + 2 * index, &number.to_le_bytes()));
    }

    fn put_f32s(&mut self, offset: usize, numbers: &[f64]) {
        numbers.iter().enumerate().for_each(|(index, &number)| {
            self.put(offset + 4 * index, &(number as f32).to_le_bytes());
        });
    }
}

fn header(volume: &FieldVolume, [slope, intercept]: [f64; 2]) -> io::Result<[u8; FIRST_DATA_BYTE]> {
    let geometry = volume.geometry();
    if let Some(dim) = geometry.dims.iter().find(|dim| **dim > LONGEST_AXIS) {
        let message = format!("NIfTI-1 holds at most {LONGEST_AXIS} voxels along an axis, not {dim}: use NRRD");
        return Err(io::Error::new(io::ErrorKind::InvalidInput, message));
    }
    let [nx, ny, nz] = geometry.dims.map(|dim| dim as i16);
    let is_vector = volume.components() > 1;
    let (datatype, scalar_type) = (type_code(volume.scalar_type()), volume.scalar_type());
    let mut header = Header([0; FIRST_DATA_BYTE]);
    header.put(0, &(HEADER_BYTES as i32).to_le_bytes());
    header.put(38, b"r");
    header.put_i16s(40, &[if is_vector { 5 } else { 3 }, nx, ny, nz, 1, volume.components() as i16, 1, 1]);
    header.put_i16s(68, &[if is_vector { INTENT_VECTOR } else { 0 }, datatype]);
    header.put_i16s(72, &[8 * scalar_type.size_in_bytes() as i16]);
    header.put_f32s(108, &[FIRST_DATA_BYTE as f64, slope, intercept]);
    header.put(123, &[unit_code(&geometry.unit).unwrap_or(0)]);
    let description = volume.field().description().as_bytes();
    header.put(148, &description[..description.len().min(79)]);
    put_placement(&mut header, geometry);
    header.put(328, &volume.field().name().as_bytes()[..volume.field().name().len().min(15)]);
    header.put(344, b"n+1\0");
    Ok(header.0)
}

/// The same placement as a matrix (`sform`) and as a rotation (`qform`), which is mirrored along z where the grid is mirrored.
fn put_placement(header: &mut Header, geometry: &GridGeometry) {
    let ras_from_lps = DMat3::from_diagonal([-1.0, -1.0, 1.0].into());
    let axes = ras_from_lps * geometry.world_from_axes();
    let handedness = if axes.determinant() < 0.0 { -1.0 } else { 1.0 };
    let [sx, sy, sz] = geometry.spacing;
    header.put_f32s(76, &[handedness, sx, sy, sz, 1.0, 1.0, 1.0, 1.0]);
    let code = match geometry.frame {
        WorldFrame::LeftPosteriorSuperior => SCANNER,
        WorldFrame::Unspecified => ALIGNED,
    };
    header.put_i16s(252, &[code, code]);
    let turn = DQuat::from_mat3(&(axes * DMat3::from_diagonal([1.0, 1.0, handedness].into())));
    // The standard stores no real part, which therefore must not be negative.
    let turn = if turn.w < 0.0 { -turn } else { turn };
    header.put_f32s(256, &[turn.x, turn.y, turn.z]);
    let origin = ras_from_lps * glam::DVec3::from_array(geometry.origin);
    header.put_f32s(268, &origin.to_array());
    let steps = axes * DMat3::from_diagonal(geometry.spacing.into());
    for row in 0..3 {
        // `+ 0.0` makes 0 of −0.
        let row_of_matrix = [steps.x_axis[row], steps.y_axis[row], steps.z_axis[row], origin[row]].map(|n| n + 0.0);
        header.put_f32s(280 + 16 * row, &row_of_matrix);
    }
}

fn type_code(scalar_type: ScalarType) -> i16 {
    match scalar_type {
        ScalarType::U8 => 2,
        ScalarType::I16 => 4,
        ScalarType::I32 => 8,
        ScalarType::F32 => 16,
        ScalarType::F64 => 64,
        ScalarType::I8 => 256,
        ScalarType::U16 => 512,
        ScalarType::U32 => 768,
    }
}
