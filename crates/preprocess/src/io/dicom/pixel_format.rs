//! How the pixels of a DICOM file are stored.

use super::attribute as at;
use super::data_set::{DataSet, Result};
use super::parser::Pixels;
use super::transfer_syntax::{Codec, TransferSyntax, refusal};
use voxrole_pack::ScalarType;

/// Size and number format of a frame.
#[derive(Clone, Debug)]
pub(super) struct PixelFormat {
    pub columns: u16,
    pub rows: u16,
    pub codec: Codec,
    /// Bytes of a number: 1, 2 or 4.
    pub bytes: usize,
    big_endian: bool,
    /// Bits that belong to the number, and where the lowest of them is; those around them may be anything.
    bits: u32,
    shift: u32,
    signed: bool,
    /// Smallest and largest number that stand where nothing was measured.
    pub padding: Option<[i64; 2]>,
}

/// Compressed pixels take up at least this share of what they unpack to; less is damage or an attack.
const LEAST_COMPRESSED_SHARE: u64 = 2000;

impl PixelFormat {
    pub fn new(attributes: &DataSet, transfer_syntax: &str) -> Result<Self> {
        let syntax = TransferSyntax::new(transfer_syntax);
        if let Codec::Unread(name) = syntax.codec {
            return Err(refusal(transfer_syntax, name));
        }
        let photometric = attributes.text(at::PHOTOMETRIC).unwrap_or_else(|| "MONOCHROME2".into());
        let samples = attributes.short(at::SAMPLES_PER_PIXEL)?.unwrap_or(1);
        // MONOCHROME1 only asks for a negative to be shown: the numbers mean the same.
        if samples != 1 || !["MONOCHROME1", "MONOCHROME2"].contains(&photometric.as_str()) {
            return Err(format!(
                "expected grey images of one number per pixel, found {samples} ({photometric}): convert colours first"
            ));
        }
        if !attributes.items(at::MODALITY_LUT).is_empty() {
            let message = "expected numbers with a slope and an intercept, found a table of values";
            return Err(format!("{message} ({}): apply it first", at::MODALITY_LUT.name));
        }
        let allocated = attributes.required_short(at::BITS_ALLOCATED)?;
        if ![8, 16, 32].contains(&allocated) {
            return Err(format!("BitsAllocated: expected 8, 16 or 32, found {allocated}"));
        }
        let bits = attributes.short(at::BITS_STORED)?.unwrap_or(allocated);
        let high = attributes.short(at::HIGH_BIT)?.unwrap_or(bits.saturating_sub(1));
        if bits == 0 || bits > high.saturating_add(1) || high >= allocated {
            return Err(format!(
                "BitsStored, HighBit: expected bits within the {allocated} allocated ones, found {bits} up to bit {high}"
            ));
        }
        let mut format = Self {
            columns: attributes.required_short(at::COLUMNS)?,
            rows: attributes.required_short(at::ROWS)?,
            codec: syntax.codec,
            bytes: usize::from(allocated / 8),
            big_endian: syntax.big_endian,
            bits: u32::from(bits),
            shift: u32::from(high + 1 - bits),
            signed: match attributes.short(at::PIXEL_REPRESENTATION)?.unwrap_or(0) {
                0 => false,
                1 => true,
                other => return Err(format!("PixelRepresentation: expected 0 or 1, found {other}")),
            },
            padding: None,
        };
        if format.columns == 0 || format.rows == 0 {
            return Err(format!("expected an image, found {} x {} pixels", format.columns, format.rows));
        }
        if let Some(first) = attributes.short(at::PADDING)? {
            let last = attributes.short(at::PADDING_LIMIT)?.unwrap_or(first);
            let number = |word: u16| if format.signed { i64::from(word.cast_signed()) } else { i64::from(word) };
            format.padding = Some([number(first).min(number(last)), number(first).max(number(last))]);
        }
        Ok(format)
    }

    /// Pixels of a frame.
    pub fn pixels(&self) -> usize {
        usize::from(self.columns) * usize::from(self.rows)
    }

    /// Bytes of a frame, unpacked.
    pub fn frame_bytes(&self) -> usize {
        self.pixels() * self.bytes
    }

    /// The type that holds a number as it is stored.
    pub fn scalar_type(&self) -> ScalarType {
        match (self.bytes, self.signed) {
            (1, false) => ScalarType::U8,
            (1, true) => ScalarType::I8,
            (2, false) => ScalarType::U16,
            (2, true) => ScalarType::I16,
            (_, false) => ScalarType::U32,
            (_, true) => ScalarType::I32,
        }
    }

    /// Smallest and largest number that the bits can hold.
    pub fn range(&self) -> [i64; 2] {
        if self.signed { [-(1 << (self.bits - 1)), (1 << (self.bits - 1)) - 1] } else { [0, (1 << self.bits) - 1] }
    }

    /// The numbers of a frame that is no longer compressed.
    pub fn numbers<'a>(&self, bytes: &'a [u8]) -> impl Iterator<Item = i64> + use<'a> {
        let Self { big_endian, bits, shift, signed, .. } = *self;
        let mask = u32::MAX >> (32 - bits);
        // Everything that is compressed comes out little-endian.
        let big_endian = big_endian && self.codec == Codec::Native;
        bytes.chunks_exact(self.bytes).map(move |bytes| {
            let add = |number, byte: &u8| number << 8 | u32::from(*byte);
            let number = if big_endian { bytes.iter().fold(0, add) } else { bytes.iter().rev().fold(0, add) };
            let number = number >> shift & mask;
            if signed { i64::from((number << (32 - bits)).cast_signed() >> (32 - bits)) } else { i64::from(number) }
        })
    }

    /// Whether `number` stands where nothing was measured.
    pub fn is_padding(&self, number: i64) -> bool {
        self.padding.is_some_and(|[first, last]| (first..=last).contains(&number))
    }

    /// Makes sure that `pixels` can hold `frames` frames.
    pub fn check_length(&self, pixels: &Pixels, frames: usize) -> Result<()> {
        let expected = (self.frame_bytes() as u64).saturating_mul(frames as u64);
        let frame_size = format!("{} x {} pixels of {} bytes", self.columns, self.rows, self.bytes);
        match pixels {
            Pixels::Floats => Err("expected whole numbers as pixels, found floating-point ones, which are not read: \
                                   convert the files first, for example with dcm2niix"
                .into()),
            Pixels::Native(range) => {
                let found = range.end - range.start;
                // The length is even, whatever the pixels' count.
                if (self.codec == Codec::Native && found == expected) || found == expected + expected % 2 {
                    return Ok(());
                }
                Err(format!("expected {expected} bytes of pixels ({frames} x {frame_size}), found {found}"))
            }
            Pixels::Pieces { pieces, .. } => {
                if self.codec == Codec::Native {
                    return Err("expected pixels in one piece, as the transfer syntax says, found several".into());
                }
                let found: u64 = pieces.iter().map(|piece| piece.end - piece.start).sum();
                if pieces.is_empty() || found.saturating_mul(LEAST_COMPRESSED_SHARE) < expected {
                    return Err(format!(
                        "expected compressed pixels that unpack to {expected} bytes ({frames} x {frame_size}), found {found} \
                         bytes, which are too few"
                    ));
                }
                Ok(())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn format(bytes: usize, bits: u32, shift: u32, signed: bool) -> PixelFormat {
        PixelFormat {
            columns: 3,
            rows: 1,
            codec: Codec::Native,
            bytes,
            big_endian: false,
            bits,
            shift,
            signed,
            padding: None,
        }
    }

    #[test]
    fn numbers_are_cut_out_of_their_bits() {
        let found = |format: &PixelFormat, bytes: &[u8]| format.numbers(bytes).collect::<Vec<_>>();
        // The upper four bits belong to something else.
        assert_eq!(found(&format(2, 12, 0, false), &[0xff, 0xff, 0x01, 0xf0, 0, 0x10]), [4095, 1, 0]);
        assert_eq!(found(&format(2, 12, 0, true), &[0xff, 0x0f, 0x00, 0x08, 0xff, 0x07]), [-1, -2048, 2047]);
        assert_eq!(found(&format(2, 12, 4, true), &[0x1f, 0x00, 0xf0, 0xff]), [1, -1]);
        assert_eq!(found(&format(1, 8, 0, true), &[0x80, 0x7f]), [-128, 127]);
        assert_eq!(found(&format(4, 32, 0, true), &[0, 0, 0, 0x80]), [i64::from(i32::MIN)]);
        assert_eq!(found(&format(4, 32, 0, false), &[0xff; 4]), [i64::from(u32::MAX)]);
        let big = PixelFormat { big_endian: true, ..format(2, 16, 0, false) };
        assert_eq!(found(&big, &[1, 2]), [258]);
    }

    #[test]
    fn ranges_are_those_of_the_bits() {
        assert_eq!(format(2, 12, 0, false).range(), [0, 4095]);
        assert_eq!(format(2, 12, 0, true).range(), [-2048, 2047]);
        assert_eq!(format(4, 32, 0, false).range(), [0, i64::from(u32::MAX)]);
        assert_eq!(format(4, 32, 0, true).range(), [i64::from(i32::MIN), i64::from(i32::MAX)]);
    }
}
