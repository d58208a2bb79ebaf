//! The first 64 bytes: what the file is, how long, and where its tables lie.

use crate::{Error, Result};

/// Bytes of the prologue.
pub const PROLOGUE_BYTES: usize = 64;
/// The first eight bytes; like PNG's, they catch transfers that change line ends or drop the eighth bit.
pub const MAGIC: [u8; 8] = *b"\x89VXR\r\n\x1a\n";
/// The version of the format that this crate writes, and the only one there is.
pub const FORMAT_VERSION: u32 = 1;

/// Whether a checksum is the one that is stored. A fuzzer could not guess it, so there all are.
pub(crate) fn checksum_fits(stored: u32, computed: u32) -> bool {
    stored == computed || cfg!(fuzzing)
}

/// Where a table lies, and its checksum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TableExtent {
    /// Distance from the start of the file.
    pub offset: u64,
    /// Length in bytes.
    pub bytes: u32,
    /// CRC-32 (IEEE) of those bytes.
    pub crc32: u32,
}

/// The prologue's content.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Prologue {
    /// Length of the whole file.
    pub file_bytes: u64,
    /// The header.
    pub header: TableExtent,
    /// The directory.
    pub directory: TableExtent,
}

impl Prologue {
    /// The bytes, ending in their own checksum.
    #[must_use]
    pub fn to_bytes(&self) -> [u8; PROLOGUE_BYTES] {
        let mut bytes = [0; PROLOGUE_BYTES];
        let mut at = 0;
        let mut put = |field: &[u8]| {
            bytes[at..at + field.len()].copy_from_slice(field);
            at += field.len();
        };
        put(&MAGIC);
        put(&FORMAT_VERSION.to_le_bytes());
        put(&[0; 4]);
        put(&self.file_bytes.to_le_bytes());
        for table in [self.header, self.directory] {
            put(&table.offset.to_le_bytes());
            put(&table.bytes.to_le_bytes());
            put(&table.crc32.to_le_bytes());
        }
        let crc = crc32fast::hash(&bytes[..PROLOGUE_BYTES - 4]);
        bytes[PROLOGUE_BYTES - 4..].copy_from_slice(&crc.to_le_bytes());
        bytes
    }

    /// Reads and checks a prologue.
    ///
    /// # Errors
    /// [`Error::Format`] for another kind of file, another version or a wrong checksum.
    pub fn from_bytes(bytes: &[u8; PROLOGUE_BYTES]) -> Result<Self> {
        let u32_at = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        let u64_at = |at: usize| u64::from(u32_at(at)) | u64::from(u32_at(at + 4)) << 32;
        if bytes[..8] != MAGIC {
            return Err(Error::Format(
                "not a packed file of voxel roles: its first bytes differ (make one with `voxrole prepare`)".into(),
            ));
        }
        let version = u32_at(8);
        if version != FORMAT_VERSION {
            return Err(Error::Format(format!(
                "format version {version}, while this program reads version {FORMAT_VERSION}: get a newer program"
            )));
        }
        let (stored, computed) = (u32_at(PROLOGUE_BYTES - 4), crc32fast::hash(&bytes[..PROLOGUE_BYTES - 4]));
        if !checksum_fits(stored, computed) {
            return Err(Error::Format(format!(
                "the first {PROLOGUE_BYTES} bytes are damaged: checksum {stored:08x} is stored, {computed:08x} computed"
            )));
        }
        if u32_at(12) != 0 || u32_at(56) != 0 {
            return Err(Error::Format("bytes 12 to 15 and 56 to 59 must be 0".into()));
        }
        let table = |at: usize| TableExtent { offset: u64_at(at), bytes: u32_at(at + 8), crc32: u32_at(at + 12) };
        Ok(Self { file_bytes: u64_at(16), header: table(24), directory: table(40) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_flipped_bit_is_noticed() {
        let prologue = Prologue {
            file_bytes: 1 << 40,
            header: TableExtent { offset: 1, bytes: 2, crc32: 3 },
            directory: TableExtent { offset: 4, bytes: 5, crc32: 6 },
        };
        let bytes = prologue.to_bytes();
        assert_eq!(Prologue::from_bytes(&bytes).expect("reads"), prologue);
        for bit in 0..PROLOGUE_BYTES * 8 {
            let mut damaged = bytes;
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert!(Prologue::from_bytes(&damaged).is_err(), "bit {bit}");
        }
    }
}
