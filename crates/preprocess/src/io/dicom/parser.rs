//! Reads the attributes of a DICOM file and finds its pixels.

use std::fs::File;
use std::io::{BufReader, Read};
use std::ops::Range;
use std::path::Path;

use super::attribute::{FLOAT_PIXEL_DATA, ITEM, ITEM_END, PIXEL_DATA, SEQUENCE_END, TRANSFER_SYNTAX, is_read};
use super::data_set::{DataSet, Value};
use super::transfer_syntax::{Codec, TransferSyntax};
use crate::io::payload;
use crate::{Error, Result};

/// Where a file says that it is DICOM, behind bytes that may be anything.
const MAGIC_OFFSET: usize = 128;
const MAGIC: &[u8; 4] = b"DICM";
/// The length of a value that says itself where it ends.
const UNDEFINED: u32 = u32::MAX;
/// Longest value that is kept: those of interest are a few numbers or words.
const MAX_VALUE_BYTES: u32 = 1 << 16;
/// How deep sequences may be nested. Enhanced images nest three deep.
const MAX_DEPTH: usize = 32;
/// Most items of a sequence that is kept, and pieces of compressed pixels: more than any scanner makes frames.
const MAX_ITEMS: usize = 1 << 20;
/// Two letters, two zero bytes and a length of four bytes begin values of these kinds; all others have a length of two bytes.
const LONG_KINDS: [&[u8; 2]; 13] =
    [b"OB", b"OD", b"OF", b"OL", b"OV", b"OW", b"SQ", b"SV", b"UC", b"UN", b"UR", b"UT", b"UV"];

/// What a DICOM file says, and where its pixels are.
#[derive(Debug)]
pub(super) struct Parsed {
    pub transfer_syntax: String,
    pub attributes: DataSet,
    pub pixels: Option<Pixels>,
}

/// Where pixels are in their file.
#[derive(Clone, Debug)]
pub(super) enum Pixels {
    /// In one run of bytes.
    Native(Range<u64>),
    /// In pieces, of which each frame has one or more, with the places of the frames among them where they are given.
    Pieces { pieces: Vec<Range<u64>>, frame_offsets: Vec<u32> },
    /// As floating-point numbers.
    Floats,
}

/// Whether a file that begins with `start` is DICOM.
pub(in crate::io) fn is_dicom(start: &[u8]) -> bool {
    start.get(MAGIC_OFFSET..MAGIC_OFFSET + MAGIC.len()) == Some(MAGIC)
}

/// Reads the attributes of `path`; `None` where it is no DICOM file.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] when the file is damaged.
pub(super) fn parse(path: &Path) -> Result<Option<Parsed>> {
    let (file, length) = payload::open(path)?;
    let mut parser = Parser { path, reader: BufReader::new(file), position: 0, length };
    let mut start = [0; MAGIC_OFFSET + MAGIC.len()];
    if length < start.len() as u64 {
        return Ok(None);
    }
    parser.read(&mut start)?;
    if !is_dicom(&start) {
        return Ok(None);
    }
    let mut meta = DataSet::default();
    while parser.peek_group()? == Some(2) {
        let header = parser.header(TransferSyntax::FILE_META)?;
        parser.element(&header, TransferSyntax::FILE_META, &mut meta, 0)?;
    }
    // Only files from before the attribute was demanded lack it.
    let uid = meta.text(TRANSFER_SYNTAX).unwrap_or_else(|| "1.2.840.10008.1.2".into());
    let syntax = TransferSyntax::new(&uid);
    if let Codec::Unread(name @ ("deflated" | "unknown")) = syntax.codec {
        return Err(Error::format(path, super::transfer_syntax::refusal(&uid, name)));
    }
    let mut attributes = DataSet { big_endian: syntax.big_endian, ..DataSet::default() };
    let mut pixels = None;
    while parser.position < length {
        let header = parser.header(syntax)?;
        if header.tag == PIXEL_DATA.tag {
            pixels = Some(parser.pixels(&header, syntax)?);
            break;
        }
        if FLOAT_PIXEL_DATA.contains(&header.tag) {
            pixels = Some(Pixels::Floats);
            break;
        }
        parser.element(&header, syntax, &mut attributes, 0)?;
    }
    Ok(Some(Parsed { transfer_syntax: uid, attributes, pixels }))
}

/// What stands before a value.
struct Header {
    tag: u32,
    /// Whether the value is a sequence, as far as that is said.
    is_sequence: bool,
    /// Whether the kind of the value was not known to whoever wrote it: its items are then encoded without kinds.
    is_unknown: bool,
    length: u32,
}

struct Parser<'a> {
    path: &'a Path,
    reader: BufReader<File>,
    position: u64,
    length: u64,
}

impl Parser<'_> {
    fn fail(&self, message: impl std::fmt::Display) -> Error {
        Error::format(self.path, format!("damaged DICOM file at byte {}: {message}", self.position))
    }

    fn read(&mut self, bytes: &mut [u8]) -> Result<()> {
        self.expect(bytes.len() as u64)?;
        self.reader.read_exact(bytes).map_err(Error::io(self.path))?;
        self.position += bytes.len() as u64;
        Ok(())
    }

    /// Makes sure that the file has `count` further bytes.
    fn expect(&self, count: u64) -> Result<()> {
        let left = self.length - self.position;
        if count > left { Err(self.fail(format!("expected {count} further bytes, found {left}"))) } else { Ok(()) }
    }

    fn skip(&mut self, count: u64) -> Result<()> {
        self.expect(count)?;
        self.reader.seek_relative(count.cast_signed()).map_err(Error::io(self.path))?;
        self.position += count;
        Ok(())
    }

    fn short(&mut self, big_endian: bool) -> Result<u16> {
        let mut bytes = [0; 2];
        self.read(&mut bytes)?;
        Ok(if big_endian { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) })
    }

    fn long(&mut self, big_endian: bool) -> Result<u32> {
        let mut bytes = [0; 4];
        self.read(&mut bytes)?;
        Ok(if big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }

    /// The group of the next attribute, little-endian, without going on; `None` at the file's end.
    fn peek_group(&mut self) -> Result<Option<u16>> {
        if self.length - self.position < 2 {
            return Ok(None);
        }
        let group = self.short(false)?;
        self.reader.seek_relative(-2).map_err(Error::io(self.path))?;
        self.position -= 2;
        Ok(Some(group))
    }

    fn header(&mut self, syntax: TransferSyntax) -> Result<Header> {
        let group = self.short(syntax.big_endian)?;
        let element = self.short(syntax.big_endian)?;
        let tag = u32::from(group) << 16 | u32::from(element);
        let mut header = Header { tag, is_sequence: false, is_unknown: false, length: 0 };
        if group == 0xfffe || !syntax.explicit {
            header.length = self.long(syntax.big_endian)?;
            return Ok(header);
        }
        let mut kind = [0; 2];
        self.read(&mut kind)?;
        if !kind.iter().all(u8::is_ascii_uppercase) {
            let message = format!("expected two letters in front of the value of ({group:04x},{element:04x})");
            return Err(self.fail(format!("{message}, found {kind:?}")));
        }
        header.is_sequence = kind == *b"SQ";
        header.is_unknown = kind == *b"UN";
        header.length = if LONG_KINDS.contains(&&kind) {
            self.skip(2)?;
            self.long(syntax.big_endian)?
        } else {
            u32::from(self.short(syntax.big_endian)?)
        };
        Ok(header)
    }

    /// Reads the value behind `header` into `set` where it is of interest, and goes on behind it.
    fn element(&mut self, header: &Header, syntax: TransferSyntax, set: &mut DataSet, depth: usize) -> Result<()> {
        let wanted = is_read(header.tag);
        if header.length == UNDEFINED || (header.is_sequence && wanted) {
            // What somebody wrote who did not know its kind is as it came: without kinds.
            let syntax = if header.is_unknown { TransferSyntax { explicit: false, ..syntax } } else { syntax };
            let items = self.sequence(header.length, syntax, wanted, depth + 1)?;
            if wanted {
                set.elements.entry(header.tag).or_insert(Value::Items(items));
            }
            return Ok(());
        }
        if !wanted || header.length > MAX_VALUE_BYTES {
            return self.skip(u64::from(header.length));
        }
        self.expect(u64::from(header.length))?;
        if !syntax.explicit && self.begins_item(header.length, syntax)? {
            let items = self.sequence(header.length, syntax, true, depth + 1)?;
            set.elements.entry(header.tag).or_insert(Value::Items(items));
            return Ok(());
        }
        let mut bytes = vec![0; header.length as usize];
        self.read(&mut bytes)?;
        set.elements.entry(header.tag).or_insert(Value::Bytes(bytes));
        Ok(())
    }

    /// Whether a value of `length` bytes whose kind is not given is a sequence.
    fn begins_item(&mut self, length: u32, syntax: TransferSyntax) -> Result<bool> {
        if length < 8 {
            return Ok(false);
        }
        let (group, element) = (self.short(syntax.big_endian)?, self.short(syntax.big_endian)?);
        self.reader.seek_relative(-4).map_err(Error::io(self.path))?;
        self.position -= 4;
        Ok(u32::from(group) << 16 | u32::from(element) == ITEM)
    }

    /// The items of a sequence; `keep` or only go on behind them.
    fn sequence(&mut self, length: u32, syntax: TransferSyntax, keep: bool, depth: usize) -> Result<Vec<DataSet>> {
        if depth > MAX_DEPTH {
            return Err(self.fail(format!("expected sequences nested at most {MAX_DEPTH} deep, found more")));
        }
        let end = self.end(length)?;
        let mut items = Vec::new();
        while self.position < end {
            let header = self.header(syntax)?;
            match header.tag {
                SEQUENCE_END if length == UNDEFINED => return Ok(items),
                ITEM => {
                    let item = self.item(header.length, syntax, depth)?;
                    if keep && items.len() == MAX_ITEMS {
                        return Err(self.fail(format!("expected at most {MAX_ITEMS} items, found more")));
                    }
                    if keep {
                        items.push(item);
                    }
                }
                other => return Err(self.fail(format!("expected an item of a sequence, found {other:08x}"))),
            }
        }
        self.expect_at(end)?;
        Ok(items)
    }

    fn item(&mut self, length: u32, syntax: TransferSyntax, depth: usize) -> Result<DataSet> {
        let end = self.end(length)?;
        let mut item = DataSet { big_endian: syntax.big_endian, ..DataSet::default() };
        while self.position < end {
            let header = self.header(syntax)?;
            if header.tag == ITEM_END && length == UNDEFINED {
                return Ok(item);
            }
            self.element(&header, syntax, &mut item, depth)?;
        }
        self.expect_at(end)?;
        Ok(item)
    }

    /// Where what has `length` bytes ends, at the latest.
    fn end(&self, length: u32) -> Result<u64> {
        if length == UNDEFINED {
            return Ok(self.length);
        }
        self.expect(u64::from(length))?;
        Ok(self.position + u64::from(length))
    }

    fn expect_at(&self, end: u64) -> Result<()> {
        if self.position == end {
            return Ok(());
        }
        Err(self.fail(format!("expected the end of a sequence at byte {end}, found more of it")))
    }

    fn pixels(&mut self, header: &Header, syntax: TransferSyntax) -> Result<Pixels> {
        if header.length != UNDEFINED {
            self.expect(u64::from(header.length))?;
            return Ok(Pixels::Native(self.position..self.position + u64::from(header.length)));
        }
        let mut frame_offsets = Vec::new();
        let mut pieces: Option<Vec<Range<u64>>> = None;
        loop {
            let header = self.header(syntax)?;
            if header.tag == SEQUENCE_END {
                return Ok(Pixels::Pieces { pieces: pieces.unwrap_or_default(), frame_offsets });
            }
            if header.tag != ITEM || header.length == UNDEFINED {
                return Err(self.fail(format!("expected a piece of compressed pixels, found {:08x}", header.tag)));
            }
            self.expect(u64::from(header.length))?;
            let Some(pieces) = &mut pieces else {
                // The first is no piece, but says where in the others each frame begins.
                if header.length as usize > 4 * MAX_ITEMS {
                    return Err(self.fail(format!("expected at most {MAX_ITEMS} frames, found more")));
                }
                frame_offsets =
                    (0..header.length / 4).map(|_| self.long(syntax.big_endian)).collect::<Result<Vec<_>>>()?;
                self.skip(u64::from(header.length % 4))?;
                pieces = Some(Vec::new());
                continue;
            };
            if pieces.len() == MAX_ITEMS {
                return Err(self.fail(format!("expected at most {MAX_ITEMS} pieces of pixels, found more")));
            }
            pieces.push(self.position..self.position + u64::from(header.length));
            self.skip(u64::from(header.length))?;
        }
    }
}
