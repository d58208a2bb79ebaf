//! Small DICOM files.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

pub const IMPLICIT: &str = "1.2.840.10008.1.2";
pub const EXPLICIT: &str = "1.2.840.10008.1.2.1";
pub const BIG_ENDIAN: &str = "1.2.840.10008.1.2.2";
pub const RLE: &str = "1.2.840.10008.1.2.5";
pub const JPEG_LOSSLESS: &str = "1.2.840.10008.1.2.4.70";

/// A value by its kind.
#[derive(Clone)]
pub enum Value {
    Text(&'static [u8; 2], String),
    Short(u16),
    Items(Vec<Elements>),
    Pixels(Vec<u8>),
    /// Compressed, with a table of offsets.
    Pieces(Vec<u8>, Vec<Vec<u8>>),
}

/// Values by tag.
pub type Elements = BTreeMap<u32, Value>;

pub fn text(words: impl ToString) -> Value {
    Value::Text(b"DS", words.to_string())
}

/// Numbers as DICOM writes them.
pub fn decimals(numbers: &[f64]) -> Value {
    text(numbers.iter().map(f64::to_string).collect::<Vec<_>>().join("\\"))
}

/// Size of every sample slice.
pub const COLUMNS: usize = 4;
pub const ROWS: usize = 3;

/// Number `pixel` of sample slice `k`.
pub fn number(k: usize, pixel: usize) -> u16 {
    (100 * k + 7 * pixel) as u16
}

/// A slice of twelve bits in sixteen at height `z`, with the numbers of sample slice `k`.
pub fn slice(k: usize, z: f64) -> Elements {
    let pixels = (0..COLUMNS * ROWS).flat_map(|pixel| number(k, pixel).to_le_bytes()).collect();
    Elements::from([
        (0x0008_0060, Value::Text(b"CS", "CT".into())),
        (0x0008_103e, Value::Text(b"LO", "sample".into())),
        (0x0009_1001, Value::Items(vec![Elements::from([(0x0020_0032, text("1\\2\\3"))])])),
        (0x0020_000e, Value::Text(b"UI", "1.2.3".into())),
        (0x0020_0011, Value::Text(b"IS", "7".into())),
        (0x0020_0032, decimals(&[-10.0, 20.0, z])),
        (0x0020_0037, text("1\\0\\0\\0\\1\\0")),
        (0x0028_0002, Value::Short(1)),
        (0x0028_0004, Value::Text(b"CS", "MONOCHROME2".into())),
        (0x0028_0010, Value::Short(ROWS as u16)),
        (0x0028_0011, Value::Short(COLUMNS as u16)),
        (0x0028_0030, text("0.75\\0.5")),
        (0x0028_0100, Value::Short(16)),
        (0x0028_0101, Value::Short(12)),
        (0x0028_0102, Value::Short(11)),
        (0x0028_0103, Value::Short(0)),
        (0x7fe0_0010, Value::Pixels(pixels)),
    ])
}

/// The same with other or further values.
pub fn with(mut elements: Elements, others: impl IntoIterator<Item = (u32, Value)>) -> Elements {
    elements.extend(others);
    elements
}

struct Writer {
    explicit: bool,
    big: bool,
    bytes: Vec<u8>,
}

impl Writer {
    fn short(&mut self, number: u16) {
        self.bytes.extend(if self.big { number.to_be_bytes() } else { number.to_le_bytes() });
    }

    fn long(&mut self, number: u32) {
        self.bytes.extend(if self.big { number.to_be_bytes() } else { number.to_le_bytes() });
    }

    fn tag(&mut self, tag: u32) {
        self.short((tag >> 16) as u16);
        self.short(tag as u16);
    }

    fn header(&mut self, tag: u32, kind: &[u8; 2], length: u32) {
        self.tag(tag);
        if !self.explicit {
            return self.long(length);
        }
        self.bytes.extend(kind);
        if [b"SQ", b"OW", b"OB", b"UN"].contains(&kind) {
            self.bytes.extend([0, 0]);
            self.long(length);
        } else {
            self.short(length as u16);
        }
    }

    fn elements(&mut self, elements: &Elements) {
        for (&tag, value) in elements {
            match value {
                Value::Text(kind, text) => {
                    let padding = if **kind == *b"UI" { '\0' } else { ' ' };
                    let text = if text.len() % 2 == 1 { format!("{text}{padding}") } else { text.clone() };
                    self.header(tag, kind, text.len() as u32);
                    self.bytes.extend(text.bytes());
                }
                Value::Short(number) => {
                    self.header(tag, b"US", 2);
                    self.short(*number);
                }
                Value::Items(items) => self.items(tag, items),
                Value::Pixels(pixels) => {
                    self.header(tag, b"OW", pixels.len() as u32);
                    let size = if self.big { 2 } else { 1 };
                    pixels.chunks(size).for_each(|number| self.bytes.extend(number.iter().rev()));
                }
                Value::Pieces(offsets, pieces) => {
                    self.header(tag, b"OB", u32::MAX);
                    for piece in std::iter::once(offsets).chain(pieces) {
                        self.tag(0xfffe_e000);
                        self.long(piece.len() as u32);
                        self.bytes.extend(piece);
                    }
                    self.tag(0xfffe_e0dd);
                    self.long(0);
                }
            }
        }
    }

    /// A sequence with lengths, or, of several items, with marks at their ends.
    fn items(&mut self, tag: u32, items: &[Elements]) {
        if let [item] = items {
            let mut inner = Self { bytes: Vec::new(), ..*self };
            inner.elements(item);
            self.header(tag, b"SQ", inner.bytes.len() as u32 + 8);
            self.tag(0xfffe_e000);
            self.long(inner.bytes.len() as u32);
            return self.bytes.extend(inner.bytes);
        }
        self.header(tag, b"SQ", u32::MAX);
        for item in items {
            self.tag(0xfffe_e000);
            self.long(u32::MAX);
            self.elements(item);
            self.tag(0xfffe_e00d);
            self.long(0);
        }
        self.tag(0xfffe_e0dd);
        self.long(0);
    }
}

/// A whole file in a transfer syntax.
pub fn file(syntax: &str, elements: &Elements) -> Vec<u8> {
    let meta = Elements::from([(0x0002_0010, Value::Text(b"UI", syntax.into()))]);
    let mut writer = Writer { explicit: true, big: false, bytes: [vec![0; 128], b"DICM".to_vec()].concat() };
    writer.elements(&meta);
    writer.explicit = syntax != IMPLICIT;
    writer.big = syntax == BIG_ENDIAN;
    writer.elements(elements);
    writer.bytes
}

/// A folder of files by name.
pub struct Folder(TempDir);

impl Folder {
    pub fn new<'a>(files: impl IntoIterator<Item = (&'a str, Vec<u8>)>) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        for (name, bytes) in files {
            fs::write(folder.path().join(name), bytes).expect("written");
        }
        Self(folder)
    }

    /// One file for each slice, named so that their order is not that of the names.
    pub fn of_slices(slices: impl IntoIterator<Item = Elements>) -> Self {
        let folder = Self::new([]);
        for (k, slice) in slices.into_iter().enumerate() {
            let name = format!("I{}", (k * 7 + 3) % 10 * 10 + k);
            fs::write(folder.path().join(name), file(EXPLICIT, &slice)).expect("written");
        }
        folder
    }

    pub fn path(&self) -> &Path {
        self.0.path()
    }

    pub fn file(&self, name: &str) -> PathBuf {
        self.path().join(name)
    }
}

/// Run-length encoded: each byte for itself, high bytes first.
pub fn rle(numbers: &[u16]) -> Vec<u8> {
    let plane = |byte: usize| numbers.iter().flat_map(move |number| [0, number.to_be_bytes()[byte]]);
    let mut bytes: Vec<u8> = [2_u32, 64, 64 + 2 * numbers.len() as u32].iter().flat_map(|n| n.to_le_bytes()).collect();
    bytes.resize(64, 0);
    bytes.extend(plane(0).chain(plane(1)));
    bytes
}

/// Lossless JPEG of `bits` bits, each number predicted by the one to its left. The code of a difference's bit count is that
/// count in five bits.
pub fn jpeg(numbers: &[u16], columns: usize, bits: u8) -> Vec<u8> {
    let rows = numbers.len() / columns;
    let mut bytes = vec![0xff, 0xd8, 0xff, 0xc3, 0, 11, bits, 0, rows as u8, 0, columns as u8, 1, 1, 0x11, 0];
    // 17 codes of five bits.
    bytes.extend([0xff, 0xc4, 0, 2 + 17 + 17, 0, 0, 0, 0, 0, 17]);
    bytes.extend([0; 11]);
    bytes.extend(0..17_u8);
    bytes.extend([0xff, 0xda, 0, 8, 1, 1, 0, 1, 0, 0]);
    let mut string = String::new();
    for (index, &number) in numbers.iter().enumerate() {
        let prediction = match (index % columns, index / columns) {
            (0, 0) => 1 << (bits - 1),
            (0, _) => i32::from(numbers[index - columns]),
            _ => i32::from(numbers[index - 1]),
        };
        // Differences are counted modulo 2¹⁶.
        let difference = i32::from((i32::from(number) - prediction) as i16);
        let count = 32 - difference.unsigned_abs().leading_zeros();
        string += &format!("{count:05b}");
        let rest = if difference < 0 { difference + (1 << count) - 1 } else { difference };
        if (1..16).contains(&count) {
            string += &format!("{rest:0width$b}", width = count as usize);
        }
    }
    while !string.len().is_multiple_of(8) {
        string.push('1');
    }
    for byte in string.as_bytes().chunks(8) {
        let byte = byte.iter().fold(0, |byte, bit| byte << 1 | (bit - b'0'));
        bytes.push(byte);
        if byte == 0xff {
            bytes.push(0);
        }
    }
    bytes.extend([0xff, 0xd9]);
    if bytes.len() % 2 == 1 {
        bytes.push(0);
    }
    bytes
}
