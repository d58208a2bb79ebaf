//! The bytes of one frame, unpacked.

use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;

use super::image::Image;
use super::parser::Pixels;
use super::transfer_syntax::Codec;
use super::{jpeg, rle};
use crate::io::payload;
use crate::{Error, Result};

/// The numbers of a frame, as [`super::pixel_format::PixelFormat::numbers`] takes them.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] when the pixels are damaged.
pub(super) fn unpacked(image: &Image, frame: usize) -> Result<Vec<u8>> {
    let format = &image.format;
    match &image.pixels {
        Pixels::Native(range) => {
            let start = range.start + (frame * format.frame_bytes()) as u64;
            let range = start..start + format.frame_bytes() as u64;
            read(image, std::slice::from_ref(&range))
        }
        Pixels::Pieces { pieces, frame_offsets } => {
            let packed = read(image, pieces_of(frame, image.frames.len(), pieces, frame_offsets).ok_or_else(|| {
                let message = format!(
                    "expected a piece of compressed pixels for each of {} frames, or a table that says which belong to which, \
                     found {} pieces without",
                    image.frames.len(),
                    pieces.len()
                );
                Error::format(&image.path, message)
            })?)?;
            let numbers = if format.codec == Codec::Rle {
                rle::unpack(&packed, format.pixels(), format.bytes)
            } else {
                jpeg::unpack(&packed, format.columns, format.rows, format.bytes)
            };
            numbers.map_err(|message| Error::format(&image.path, format!("frame {}: {message}", frame + 1)))
        }
        Pixels::Floats => {
            Err(Error::format(&image.path, "expected whole numbers as pixels, found floating-point ones"))
        }
    }
}

/// Which of the pieces make a frame: offsets count from the first piece's header, of eight bytes.
fn pieces_of<'a>(frame: usize, frames: usize, pieces: &'a [Range<u64>], offsets: &[u32]) -> Option<&'a [Range<u64>]> {
    if frames == 1 {
        return Some(pieces);
    }
    if pieces.len() == frames {
        return pieces.get(frame..=frame);
    }
    let first = pieces.first()?.start;
    let index = |offset: &u32| pieces.iter().position(|piece| piece.start - first == u64::from(*offset));
    let start = offsets.get(frame).filter(|_| offsets.len() == frames).and_then(index)?;
    let end = offsets.get(frame + 1).map_or(Some(pieces.len()), index)?;
    pieces.get(start..end)
}

fn read(image: &Image, ranges: &[Range<u64>]) -> Result<Vec<u8>> {
    let (mut file, length) = payload::open(&image.path)?;
    if ranges.last().is_some_and(|range| range.end > length) {
        return Err(Error::format(
            &image.path,
            format!("expected the file as it was before, found {length} bytes left"),
        ));
    }
    let mut bytes = Vec::new();
    for range in ranges {
        let start = bytes.len();
        bytes.resize(start + (range.end - range.start) as usize, 0);
        file.seek(SeekFrom::Start(range.start))
            .and_then(|_| file.read_exact(&mut bytes[start..]))
            .map_err(Error::io(&image.path))?;
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_belong_to_frames() {
        let pieces = [8..10, 18..30, 38..40];
        assert_eq!(pieces_of(0, 1, &pieces, &[]), Some(&pieces[..]));
        assert_eq!(pieces_of(2, 3, &pieces, &[]), Some(&pieces[2..]));
        assert_eq!(pieces_of(0, 2, &pieces, &[0, 30]), Some(&pieces[..2]));
        assert_eq!(pieces_of(1, 2, &pieces, &[0, 30]), Some(&pieces[2..]));
        for bad in [&[][..], &[0], &[0, 31], &[30, 0]] {
            assert_eq!(pieces_of(0, 2, &pieces, bad), None, "{bad:?}");
        }
    }
}
