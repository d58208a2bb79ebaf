//! Run-length encoded frames: <https://dicom.nema.org/medical/dicom/current/output/chtml/part05/chapter_G.html>.
//!
//! Unpacked here and not by `dicom-pixeldata`, which panics on runs that end too early.

/// Bytes in front of the planes: their count and where up to 15 of them begin.
const HEADER_BYTES: usize = 64;

/// Unpacks a frame of `pixels` numbers of `size` bytes into little-endian ones.
///
/// # Errors
/// A message when `packed` is damaged.
pub(super) fn unpack(packed: &[u8], pixels: usize, size: usize) -> Result<Vec<u8>, String> {
    let number =
        |index: usize| packed.get(4 * index..).and_then(<[u8]>::first_chunk).map(|bytes| u32::from_le_bytes(*bytes));
    let planes = number(0).filter(|_| packed.len() >= HEADER_BYTES).unwrap_or(0);
    if planes as usize != size {
        return Err(format!("expected {size} planes of run-length encoded bytes, found {planes}"));
    }
    let mut frame = vec![0; pixels * size];
    for plane in 0..size {
        let start = number(1 + plane).unwrap_or(0) as usize;
        let end = if plane + 1 < size { number(2 + plane).unwrap_or(0) as usize } else { packed.len() };
        let runs = packed.get(start..end).filter(|_| start >= HEADER_BYTES).ok_or_else(|| {
            format!("expected a plane within {} run-length encoded bytes, found {start} to {end}", packed.len())
        })?;
        // The plane of the most significant bytes is the first.
        let target = frame[size - 1 - plane..].iter_mut().step_by(size);
        let found = expand(runs, target);
        if found < pixels {
            return Err(format!("expected {pixels} bytes in each run-length encoded plane, found {found}"));
        }
    }
    Ok(frame)
}

/// Fills `target` from runs as far as they go; returns how many bytes were filled.
fn expand<'a>(runs: &[u8], mut target: impl Iterator<Item = &'a mut u8>) -> usize {
    let mut found = 0;
    let mut rest = runs;
    while let [control, after @ ..] = rest {
        let control = usize::from(*control);
        let (literal, repeats) = match control {
            0..128 => (&after[..after.len().min(control + 1)], 1),
            128 => (&after[..0], 1),
            _ => (&after[..after.len().min(1)], 257 - control),
        };
        rest = &after[literal.len()..];
        for byte in literal.iter().flat_map(|byte| std::iter::repeat_n(byte, repeats)) {
            match target.next() {
                Some(place) => *place = *byte,
                None => return found,
            }
            found += 1;
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packed(planes: &[&[u8]]) -> Vec<u8> {
        let mut header = vec![0; HEADER_BYTES];
        header[0] = planes.len() as u8;
        let mut offset = HEADER_BYTES as u32;
        for (index, plane) in planes.iter().enumerate() {
            header[4 * (index + 1)..4 * (index + 2)].copy_from_slice(&offset.to_le_bytes());
            offset += plane.len() as u32;
        }
        [header, planes.concat()].concat()
    }

    #[test]
    fn literals_repeats_and_planes() {
        // High bytes 1 1 1 2, low bytes 7 8 9 10; a run of "nothing" between.
        let bytes = packed(&[&[254, 1, 128, 0, 2], &[3, 7, 8, 9, 10]]);
        assert_eq!(unpack(&bytes, 4, 2), Ok(vec![7, 1, 8, 1, 9, 1, 10, 2]));
        assert_eq!(unpack(&packed(&[&[253, 5]]), 4, 1), Ok(vec![5; 4]));
        // What goes beyond the frame fills the length up.
        assert_eq!(unpack(&packed(&[&[129, 5, 0]]), 4, 1), Ok(vec![5; 4]));
    }

    #[test]
    fn damage_is_an_error() {
        let good = packed(&[&[254, 1, 0, 2], &[3, 7, 8, 9, 10]]);
        assert!(unpack(&good, 4, 2).is_ok());
        for length in 0..good.len() {
            assert!(unpack(&good[..length], 4, 2).is_err(), "{length}");
        }
        for byte in 0..good.len() {
            for bit in 0..8 {
                let mut damaged = good.clone();
                damaged[byte] ^= 1 << bit;
                // Never a panic.
                let _ = unpack(&damaged, 4, 2);
            }
        }
    }
}
