//! JPEG frames, lossless of 8 to 16 bits or lossy of 8: ITU-T T.81. The decoder is that of the crate `jpeg-decoder`; what it
//! takes for granted is checked here.

use jpeg_decoder::Decoder;

/// Marks of frames: Huffman-coded and baseline, extended, progressive or lossless.
const LOSSLESS: u8 = 0xc3;
const READ_FRAMES: [u8; 4] = [0xc0, 0xc1, 0xc2, LOSSLESS];
/// Marks of other frames; 0xc4, 0xc8 and 0xcc between them are tables.
const OTHER_FRAMES: [u8; 9] = [0xc5, 0xc6, 0xc7, 0xc9, 0xca, 0xcb, 0xcd, 0xce, 0xcf];
const SCAN: u8 = 0xda;

/// Unpacks a frame of `columns` × `rows` numbers of `size` bytes into little-endian ones.
///
/// # Errors
/// A message when `packed` is damaged, or another kind of image than the file says.
pub(super) fn unpack(packed: &[u8], columns: u16, rows: u16, size: usize) -> Result<Vec<u8>, String> {
    let precision = precision(packed, columns, rows)?;
    let bytes_each = if precision == 8 { 1 } else { 2 };
    if bytes_each > size {
        return Err(format!("JPEG: expected numbers of {size} bytes, found {precision} bits"));
    }
    let pixels = usize::from(columns) * usize::from(rows);
    let bytes = Decoder::new(packed).decode().map_err(|error| format!("JPEG: {error}"))?;
    if bytes.len() != pixels * bytes_each {
        return Err(format!("JPEG: expected {} bytes of pixels, found {}", pixels * bytes_each, bytes.len()));
    }
    let mut frame = vec![0; pixels * size];
    for (number, bytes) in frame.chunks_exact_mut(size).zip(bytes.chunks_exact(bytes_each)) {
        match bytes {
            [a, b] => number[..2].copy_from_slice(&u16::from_ne_bytes([*a, *b]).to_le_bytes()),
            _ => number[0] = bytes[0],
        }
    }
    Ok(frame)
}

/// The bits of a number, after making sure that the first scan is one that the decoder gets right: of one grey image, as large
/// as it should be, and, where it is lossless, of all bits.
fn precision(packed: &[u8], columns: u16, rows: u16) -> Result<u8, String> {
    let mut frame = None;
    let mut at = 2;
    while let Some([0xff, mark, a, b]) = packed.get(at..).and_then(<[u8]>::first_chunk).copied() {
        let length = usize::from(u16::from_be_bytes([a, b]));
        let segment = packed.get(at + 4..at + 2 + length).ok_or("JPEG: expected the end of a segment, found none")?;
        match (mark, segment) {
            (mark, [precision, r1, r0, c1, c0, components, ..]) if READ_FRAMES.contains(&mark) => {
                let found = [u16::from_be_bytes([*c1, *c0]), u16::from_be_bytes([*r1, *r0])];
                let bits = if mark == LOSSLESS { 8..=16 } else { 8..=8 };
                if found != [columns, rows] || *components != 1 || !bits.contains(precision) {
                    let [width, height] = found;
                    return Err(format!(
                        "JPEG: expected {columns} x {rows} grey pixels of 8 bits, or of up to 16 where it is lossless, found \
                         {width} x {height} of {components} x {precision} bits"
                    ));
                }
                frame = Some((mark, *precision));
            }
            (SCAN, segment) => {
                let (mark, precision) = frame.ok_or("JPEG: expected a frame before the first scan, found none")?;
                let dropped = segment.last().map_or(0, |last| last & 15);
                if mark == LOSSLESS && dropped != 0 {
                    return Err(format!("JPEG: expected all bits, found {dropped} left out"));
                }
                return Ok(precision);
            }
            (other, _) if OTHER_FRAMES.contains(&other) => {
                return Err(format!(
                    "JPEG: expected Huffman-coded frames, found another kind ({other:02x}), which is not read"
                ));
            }
            _ => {}
        }
        at += 2 + length;
    }
    Err("JPEG: expected a scan, found none".into())
}
