//! One page's directory of a TIFF or BigTIFF file.

/// Tag of the page's place in the file.
const STRIP_OFFSETS: u16 = 273;

/// A tag and its value.
pub(super) struct Entry {
    tag: u16,
    type_code: u16,
    count: u64,
    value: Vec<u8>,
}

impl Entry {
    pub fn short(tag: u16, value: u16) -> Self {
        Self { tag, type_code: 3, count: 1, value: value.to_le_bytes().to_vec() }
    }

    pub fn long(tag: u16, value: u32) -> Self {
        Self { tag, type_code: 4, count: 1, value: value.to_le_bytes().to_vec() }
    }

    /// A place or length in the file: 64 bits in BigTIFF.
    pub fn offset(tag: u16, value: u64, is_big: bool) -> Self {
        if is_big {
            Self { tag, type_code: 16, count: 1, value: value.to_le_bytes().to_vec() }
        } else {
            Self::long(tag, value as u32)
        }
    }

    pub fn rational(tag: u16, [numerator, denominator]: [u32; 2]) -> Self {
        let value = [numerator.to_le_bytes(), denominator.to_le_bytes()].concat();
        Self { tag, type_code: 5, count: 1, value }
    }

    /// ASCII, with the zero that ends it.
    pub fn text(tag: u16, text: &str) -> Self {
        let value = [text.as_bytes(), b"\0"].concat();
        Self { tag, type_code: 2, count: value.len() as u64, value }
    }
}

/// Entries in the order of their tags, with longer values behind them.
pub(super) struct Directory {
    is_big: bool,
    entries: Vec<Entry>,
}

impl Directory {
    pub fn new(is_big: bool, entries: Vec<Entry>) -> Self {
        Self { is_big, entries }
    }

    /// Bytes of a value that stands in its entry.
    fn inline_bytes(&self) -> usize {
        if self.is_big { 8 } else { 4 }
    }

    /// Bytes before the longer values.
    fn table_len(&self) -> u64 {
        let entries = self.entries.len() as u64;
        if self.is_big { 8 + 20 * entries + 8 } else { 2 + 12 * entries + 4 }
    }

    /// All bytes: an even number.
    pub fn len(&self) -> u64 {
        let longer = self.entries.iter().map(|entry| entry.value.len()).filter(|&len| len > self.inline_bytes());
        self.table_len() + longer.map(|len| len.next_multiple_of(2) as u64).sum::<u64>()
    }

    /// The directory as it stands at `offset`, of a page at `strip`, before the one at `next`.
    pub fn bytes(&self, offset: u64, strip: u64, next: u64) -> Vec<u8> {
        let width = self.inline_bytes();
        let mut table = Vec::new();
        let mut longer: Vec<u8> = Vec::new();
        let count = self.entries.len() as u64;
        table.extend_from_slice(&count.to_le_bytes()[..if self.is_big { 8 } else { 2 }]);
        for entry in &self.entries {
            table.extend_from_slice(&entry.tag.to_le_bytes());
            table.extend_from_slice(&entry.type_code.to_le_bytes());
            table.extend_from_slice(&entry.count.to_le_bytes()[..width]);
            let mut value = if entry.tag == STRIP_OFFSETS { strip.to_le_bytes().to_vec() } else { entry.value.clone() };
            if entry.tag != STRIP_OFFSETS && value.len() > width {
                let place = offset + self.table_len() + longer.len() as u64;
                value.resize(value.len().next_multiple_of(2), 0);
                longer.append(&mut value);
                value = place.to_le_bytes().to_vec();
            }
            value.resize(width, 0);
            table.extend_from_slice(&value);
        }
        table.extend_from_slice(&next.to_le_bytes()[..width]);
        table.append(&mut longer);
        table
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn directory(is_big: bool) -> Directory {
        let entries = vec![
            Entry::long(256, 7),
            Entry::text(270, "ab"),
            Entry::offset(273, 0, is_big),
            Entry::rational(282, [1, 2]),
        ];
        Directory::new(is_big, entries)
    }

    #[test]
    fn a_directory_is_written_to_the_byte() {
        let directory = directory(false);
        let expected = [
            [4, 0].as_slice(),
            &[0, 1, 4, 0, 1, 0, 0, 0, 7, 0, 0, 0],
            &[14, 1, 2, 0, 3, 0, 0, 0, b'a', b'b', 0, 0],
            &[17, 1, 4, 0, 1, 0, 0, 0, 0, 2, 0, 0],
            // Behind the table, which lies at 100 and is 54 bytes long.
            &[26, 1, 5, 0, 1, 0, 0, 0, 154, 0, 0, 0],
            &[0, 3, 0, 0],
            &[1, 0, 0, 0, 2, 0, 0, 0],
        ];
        assert_eq!(directory.bytes(100, 512, 768), expected.concat());
        assert_eq!(directory.len(), 62);
    }

    #[test]
    fn a_big_directory_has_room_for_a_ratio() {
        let directory = directory(true);
        let bytes = directory.bytes(16, 1 << 33, 0);
        assert_eq!((bytes.len() as u64, directory.len()), (8 + 4 * 20 + 8, 96));
        assert_eq!(bytes[8 + 40..8 + 60], [17, 1, 16, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2, 0, 0, 0]);
        assert_eq!(bytes[8 + 60..8 + 80], [26, 1, 5, 0, 1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0]);
    }
}
