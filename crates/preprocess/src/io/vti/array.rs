//! The numbers of an array in VTK's XML: written out, or in base64, or appended, in compressed blocks or not.
//!
//! Stored bytes begin with a header of whole numbers: the length of what follows or, compressed, the count of blocks, the
//! length of a block and of the last one if that is shorter (else 0), and the compressed length of each
//! (<https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html>).

use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use voxrole_pack::ScalarType;

use super::super::payload::{self, ZlibStream};
use super::super::raw::ByteOrder;
use super::super::slabs::Slabs;
use super::base64_stream::Base64Stream;
use super::numbers::{NumberType, Numbers};
use crate::{Error, Result};

/// Bytes that are taken at a time.
const CHUNK_BYTES: usize = 1 << 18;
/// The most that LZ4 makes of a byte.
const MAX_LZ4_RATIO: u64 = 255;

/// Where an array is, and in which form: bytes into the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Decimal numbers, up to the next markup.
    Text(u64),
    /// Base64, likewise.
    Base64(u64),
    /// As in memory.
    Raw(u64),
}

/// The whole numbers of the header in front of stored bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeaderType {
    U32,
    U64,
}

impl HeaderType {
    pub fn size(self) -> usize {
        match self {
            Self::U32 => 4,
            Self::U64 => 8,
        }
    }
}

/// How blocks are compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compressor {
    Zlib,
    Lz4,
}

/// An array whose numbers are asked for.
#[derive(Debug)]
pub struct StoredArray {
    pub files: [PathBuf; 1],
    pub place: Place,
    pub header_type: HeaderType,
    pub compressor: Option<Compressor>,
    pub byte_order: ByteOrder,
    pub number_type: NumberType,
    /// Numbers of each voxel, and which of them is meant.
    pub components: usize,
    pub component: usize,
    /// Length of all numbers in bytes, as they would be in memory.
    pub bytes: u64,
}

impl Slabs for StoredArray {
    fn scalar_type(&self) -> ScalarType {
        self.number_type.scalar_type()
    }

    fn files(&self) -> &[PathBuf] {
        &self.files
    }

    fn decode(&self, sink: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let mut numbers = Numbers::new(self, sink);
        match self.place {
            Place::Text(offset) => self.decode_text(offset, &mut numbers)?,
            Place::Base64(offset) => self.decode_bytes(&mut Base64Stream::new(self.open(offset)?), &mut numbers)?,
            Place::Raw(offset) => self.decode_bytes(&mut self.open(offset)?, &mut numbers)?,
        }
        numbers.finish()
    }
}

impl StoredArray {
    pub fn path(&self) -> &Path {
        &self.files[0]
    }

    pub fn fail(&self, message: impl Into<String>) -> Error {
        Error::format(self.path(), message)
    }

    /// Where uncompressed bytes begin that lie in the file as in memory; `None` for others.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] when their header gives another length than the grid needs.
    pub fn plain_offset(&self) -> Result<Option<u64>> {
        let Place::Raw(offset) = self.place else { return Ok(None) };
        if self.compressor.is_some() || self.components != 1 || self.number_type.is_narrowed() {
            return Ok(None);
        }
        self.check_length(&mut self.open(offset)?)?;
        Ok(Some(offset + self.header_type.size() as u64))
    }

    fn open(&self, offset: u64) -> Result<BufReader<File>> {
        let (mut file, length) = payload::open(self.path())?;
        if offset > length {
            return Err(self.fail(format!("expected an array at byte {offset}, found a file of {length} bytes")));
        }
        file.seek(SeekFrom::Start(offset)).map_err(Error::io(self.path()))?;
        Ok(BufReader::with_capacity(CHUNK_BYTES, file))
    }

    fn decode_text(&self, offset: u64, numbers: &mut Numbers<'_>) -> Result<()> {
        let mut text = self.open(offset)?;
        loop {
            let bytes = text.fill_buf().map_err(Error::io(self.path()))?;
            let end = bytes.iter().position(|&byte| byte == b'<');
            let (length, is_end) = (bytes.len(), bytes.is_empty() || end.is_some());
            numbers.push_text(&bytes[..end.unwrap_or(length)])?;
            text.consume(length);
            if is_end {
                return numbers.push_text(b" ");
            }
        }
    }

    fn decode_bytes(&self, stream: &mut dyn Read, numbers: &mut Numbers<'_>) -> Result<()> {
        match self.compressor {
            None => {
                self.check_length(stream)?;
                self.copy(stream, self.bytes, numbers)
            }
            Some(compressor) => {
                let blocks = Blocks::read(self, stream)?;
                let mut packed = Vec::new();
                for (index, &packed_bytes) in blocks.packed.iter().enumerate() {
                    packed.clear();
                    let found = (&mut *stream)
                        .take(packed_bytes)
                        .read_to_end(&mut packed)
                        .map_err(|error| self.broken(error))?;
                    if (found as u64) < packed_bytes {
                        return Err(self.broken(ErrorKind::UnexpectedEof.into()));
                    }
                    self.unpack(compressor, &packed, blocks.block_bytes(index), numbers)?;
                }
                Ok(())
            }
        }
    }

    /// Unpacks a block of `length` bytes.
    fn unpack(&self, compressor: Compressor, packed: &[u8], length: u64, numbers: &mut Numbers<'_>) -> Result<()> {
        match compressor {
            Compressor::Zlib => {
                let mut stream = ZlibStream::new(packed);
                self.copy(&mut stream, length, numbers)?;
                match stream.read(&mut [0]) {
                    Ok(0) => Ok(()),
                    Ok(_) => Err(self.fail(format!("expected a block of {length} bytes, found more in it"))),
                    Err(error) => Err(self.broken(error)),
                }
            }
            Compressor::Lz4 => {
                if length > MAX_LZ4_RATIO * packed.len() as u64 {
                    let found = packed.len();
                    return Err(self.fail(format!("expected a block of {length} bytes, found {found} compressed ones")));
                }
                let block = lz4_flex::block::decompress(packed, length as usize)
                    .map_err(|error| self.fail(format!("expected a block of {length} bytes, found damage: {error}")))?;
                if block.len() as u64 != length {
                    return Err(self.fail(format!("expected a block of {length} bytes, found {}", block.len())));
                }
                numbers.push(&block)
            }
        }
    }

    /// Hands on exactly `length` bytes.
    fn copy(&self, stream: &mut dyn Read, length: u64, numbers: &mut Numbers<'_>) -> Result<()> {
        let mut buffer = vec![0; length.min(CHUNK_BYTES as u64) as usize];
        let mut left = length;
        while left > 0 {
            let wanted = left.min(CHUNK_BYTES as u64) as usize;
            stream.read_exact(&mut buffer[..wanted]).map_err(|error| self.broken(error))?;
            numbers.push(&buffer[..wanted])?;
            left -= wanted as u64;
        }
        Ok(())
    }

    fn check_length(&self, stream: &mut dyn Read) -> Result<()> {
        let (expected, found) = (self.bytes, self.header_number(stream)?);
        if expected != found {
            return Err(
                self.fail(format!("expected an array of {expected} bytes, found a length of {found} before it"))
            );
        }
        Ok(())
    }

    fn header_number(&self, stream: &mut dyn Read) -> Result<u64> {
        let mut bytes = [0; 8];
        let size = self.header_type.size();
        stream.read_exact(&mut bytes[..size]).map_err(|error| self.broken(error))?;
        if self.byte_order == ByteOrder::Big {
            bytes[..size].reverse();
        }
        Ok(u64::from_le_bytes(bytes))
    }

    /// What an error of a stream means.
    fn broken(&self, error: std::io::Error) -> Error {
        let expected = self.bytes;
        match error.kind() {
            ErrorKind::UnexpectedEof => {
                self.fail(format!("expected an array of {expected} bytes, found its end before: the file is cut short"))
            }
            ErrorKind::InvalidData | ErrorKind::InvalidInput => {
                self.fail(format!("expected an array of {expected} bytes, found damage: {error}"))
            }
            _ => Error::io(self.path())(error),
        }
    }
}

/// The header of compressed blocks.
struct Blocks {
    length: u64,
    last_length: u64,
    /// Compressed length of each block.
    packed: Vec<u64>,
}

impl Blocks {
    fn read(array: &StoredArray, stream: &mut dyn Read) -> Result<Self> {
        let count = array.header_number(stream)?;
        let (length, partial) = (array.header_number(stream)?, array.header_number(stream)?);
        let last_length = if partial == 0 { length } else { partial };
        let total = count.checked_sub(1).map_or(Some(0), |whole| whole.checked_mul(length)?.checked_add(last_length));
        if total != Some(array.bytes) || (count > 1 && length == 0) || last_length > length {
            let message = format!(
                "expected compressed blocks of {} bytes in all, found {count} of {length} bytes, the last of {last_length}",
                array.bytes
            );
            return Err(array.fail(message));
        }
        // Not reserved beforehand: the file may end long before.
        let packed = (0..count).map(|_| array.header_number(stream)).collect::<Result<Vec<_>>>()?;
        Ok(Self { length, last_length, packed })
    }

    fn block_bytes(&self, index: usize) -> u64 {
        if index + 1 == self.packed.len() { self.last_length } else { self.length }
    }
}
