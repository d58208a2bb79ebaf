//! Writer of numpy's `.npy`: <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>, version 1.0.

use std::io::{self, Write};

use voxrole_pack::ScalarType;

use super::write_numbers;
use crate::field_volume::FieldVolume;

/// The header's length is a multiple of this.
const ALIGNMENT: usize = 64;

/// Writes a field as an array of shape (z, y, x), of normals (z, y, x, 3), in C order. Spacing, origin and direction find no
/// place.
///
/// # Errors
/// Whatever `out` says.
pub fn write(out: &mut impl Write, volume: &FieldVolume) -> io::Result<()> {
    let [x, y, z] = volume.geometry().dims_usize();
    let shape = [z, y, x, volume.components()];
    let axes = if volume.components() == 1 { 3 } else { 4 };
    out.write_all(&header(type_name(volume.scalar_type()), false, &shape[..axes]))?;
    write_numbers(out, volume)
}

/// What stands before the numbers. `fortran_order`: whether the first axis is the fastest.
#[must_use]
pub fn header(descr: &str, fortran_order: bool, shape: &[usize]) -> Vec<u8> {
    let order = if fortran_order { "True" } else { "False" };
    let lengths = shape.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
    // A tuple of one has a comma.
    let lengths = if shape.len() == 1 { lengths + "," } else { lengths };
    let text = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': ({lengths}), }}");
    // Ten bytes stand before the text, one line end behind it.
    let length = (10 + text.len() + 1).next_multiple_of(ALIGNMENT) - 10;
    let mut header = b"\x93NUMPY\x01\x00".to_vec();
    header.extend_from_slice(&(length as u16).to_le_bytes());
    header.extend_from_slice(format!("{text:<width$}\n", width = length - 1).as_bytes());
    header
}

fn type_name(scalar_type: ScalarType) -> &'static str {
    match scalar_type {
        ScalarType::U8 => "|u1",
        ScalarType::I8 => "|i1",
        ScalarType::U16 => "<u2",
        ScalarType::I16 => "<i2",
        ScalarType::U32 => "<u4",
        ScalarType::I32 => "<i4",
        ScalarType::F32 => "<f4",
        ScalarType::F64 => "<f8",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_are_those_of_numpy() {
        // numpy.save of numpy.zeros((2, 3, 4), '<u2'), and of numpy.zeros(5, order='F') as u64.
        let expected = b"\x93NUMPY\x01\0\x76\0{'descr': '<u2', 'fortran_order': False, 'shape': (2, 3, 4), }";
        let found = header("<u2", false, &[2, 3, 4]);
        assert_eq!((&found[..expected.len()], found.len()), (expected.as_slice(), 128));
        assert!(found[expected.len()..127].iter().all(|&byte| byte == b' ') && found.ends_with(b"\n"));
        let one = header("<u8", true, &[5]);
        assert!(String::from_utf8_lossy(&one).contains("'fortran_order': True, 'shape': (5,), }"));
    }
}
