//! The attributes of a DICOM file: <https://dicom.nema.org/medical/dicom/current/output/chtml/part05/chapter_7.html>.
//!
//! They are read here and not by the crates of dicom-rs (0.10). `dicom-object` takes and clears as much
//! memory as a length claims before it looks for the bytes: a file of 258 bytes made it use 4 GiB. The lazy reader of
//! `dicom-parser` under it does not; by its code it takes a file that ends within a sequence for a whole one, reads the items of a
//! sequence of unknown kind as if they carried kinds, and brings the crate `encoding`, which nobody looks after any more
//! (RUSTSEC-2021-0153). Here a value is either one of those that say what the volume is, which are short, or it is passed
//! over; pixels stay in the file.

use std::collections::BTreeMap;

use super::attribute::Attribute;

/// Attributes and their values, those of a file or of one item of a sequence.
#[derive(Clone, Debug, Default)]
pub(super) struct DataSet {
    pub big_endian: bool,
    pub elements: BTreeMap<u32, Value>,
}

/// A value as it is stored.
#[derive(Clone, Debug)]
pub(super) enum Value {
    Bytes(Vec<u8>),
    Items(Vec<DataSet>),
}

/// What is wrong with a value; the file is named by whoever asked for it.
pub(super) type Result<T> = std::result::Result<T, String>;

impl DataSet {
    fn bytes(&self, attribute: Attribute) -> Option<&[u8]> {
        match self.elements.get(&attribute.tag)? {
            Value::Bytes(bytes) => Some(bytes),
            Value::Items(_) => None,
        }
    }

    /// The items of a sequence; none where it is missing.
    pub fn items(&self, attribute: Attribute) -> &[DataSet] {
        match self.elements.get(&attribute.tag) {
            Some(Value::Items(items)) => items,
            _ => &[],
        }
    }

    /// Text without the blanks and zeros that fill it up; `None` where the attribute is missing or empty.
    pub fn text(&self, attribute: Attribute) -> Option<String> {
        let text = String::from_utf8_lossy(self.bytes(attribute)?).into_owned();
        let text = text.trim_matches([' ', '\0', '\t', '\r', '\n']);
        (!text.is_empty()).then(|| text.replace(char::is_control, " "))
    }

    /// Numbers that are written as text; `None` where the attribute is missing or empty.
    pub fn decimals<const N: usize>(&self, attribute: Attribute) -> Result<Option<[f64; N]>> {
        let Some(text) = self.text(attribute) else { return Ok(None) };
        let numbers: Option<Vec<f64>> = text.split('\\').map(|word| word.trim().parse().ok()).collect();
        let finite = numbers.filter(|numbers| numbers.iter().all(|number| number.is_finite()));
        let array = finite.and_then(|numbers| <[f64; N]>::try_from(numbers).ok());
        array.map(Some).ok_or_else(|| {
            let count = if N == 1 { "a number".into() } else { format!("{N} numbers") };
            format!("{}: expected {count}, found {}", attribute.name, super::super::header::shown(&text))
        })
    }

    /// A number that is written as text.
    pub fn decimal(&self, attribute: Attribute) -> Result<Option<f64>> {
        Ok(self.decimals::<1>(attribute)?.map(|[number]| number))
    }

    /// A number of two bytes.
    pub fn short(&self, attribute: Attribute) -> Result<Option<u16>> {
        match self.bytes(attribute) {
            None | Some([]) => Ok(None),
            Some(&[a, b]) if self.big_endian => Ok(Some(u16::from_be_bytes([a, b]))),
            Some(&[a, b]) => Ok(Some(u16::from_le_bytes([a, b]))),
            Some(other) => Err(format!("{}: expected one number of 2 bytes, found {}", attribute.name, other.len())),
        }
    }

    /// As [`Self::short`], for an attribute that there must be.
    pub fn required_short(&self, attribute: Attribute) -> Result<u16> {
        self.short(attribute)?.ok_or_else(|| format!("expected the attribute {}, found none", attribute.name))
    }
}

#[cfg(test)]
mod tests {
    use super::super::attribute::{PIXEL_SPACING, ROWS, SERIES_DESCRIPTION, SLOPE};
    use super::*;

    fn with(attribute: Attribute, bytes: &[u8]) -> DataSet {
        DataSet { elements: [(attribute.tag, Value::Bytes(bytes.to_vec()))].into(), big_endian: false }
    }

    #[test]
    fn values_lose_their_padding() {
        assert_eq!(with(SERIES_DESCRIPTION, b"AX T1 \0").text(SERIES_DESCRIPTION), Some("AX T1".into()));
        assert_eq!(with(SERIES_DESCRIPTION, b"  ").text(SERIES_DESCRIPTION), None);
        assert_eq!(with(PIXEL_SPACING, b"0.5\\ 1e0 ").decimals(PIXEL_SPACING), Ok(Some([0.5, 1.0])));
        assert_eq!(with(ROWS, &[1, 2]).short(ROWS), Ok(Some(513)));
        assert_eq!(DataSet::default().decimal(SLOPE), Ok(None));
    }

    #[test]
    fn bad_values_are_named() {
        for text in [b"0.5".as_slice(), b"0.5\\x", b"0.5\\nan", b"1\\2\\3", b"0,5\\0,5"] {
            let message = with(PIXEL_SPACING, text).decimals::<2>(PIXEL_SPACING).expect_err("bad");
            assert!(message.contains("PixelSpacing: expected 2 numbers"), "{message}");
        }
        assert!(with(ROWS, &[1, 2, 3, 4]).short(ROWS).is_err());
        assert!(DataSet::default().required_short(ROWS).expect_err("missing").contains("Rows"));
    }
}
