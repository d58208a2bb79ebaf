//! The numbers of a volume: the one place that turns bytes into [`Scalars`].
//!
//! No length that a header claims is believed before it is met: plain data are measured against the file before any
//! memory is taken, compressed data grow the array only as they come out of the stream, and stop at the expected length.

use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use flate2::bufread::MultiGzDecoder;
use flate2::{Decompress, FlushDecompress, Status};
use voxrole_pack::scalar::Scalar;
use voxrole_pack::{ScalarType, Scalars};

use super::pick::Picks;
use super::raw::{ByteOrder, StoredType};
use super::slabs::no_room;
use super::stored_voxels::StoredVoxels;
use crate::{Error, Result};

/// How a gzip file begins: its mark, and deflate as the method.
pub(super) const GZIP_MAGIC: [u8; 3] = [0x1f, 0x8b, 8];
/// Bytes that are decoded at a time: a multiple of every number's size.
const CHUNK_BYTES: usize = 1 << 20;

/// Where the stored bytes begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Start {
    /// So many bytes into the file, with which they end.
    Offset(u64),
    /// So many bytes into the file, where other things may follow; for plain data only.
    Section(u64),
    /// So that they end with the file; for plain data only.
    FileEnd,
}

/// How the stored bytes are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    /// Not at all.
    Plain,
    /// gzip, of one or more members.
    Gzip,
    /// zlib; with its length, where the header gives it.
    Zlib(Option<u64>),
}

/// Where a volume's numbers lie, and how.
#[derive(Clone, Debug)]
pub(super) struct Payload {
    /// The file that holds the numbers.
    pub path: PathBuf,
    pub start: Start,
    pub encoding: Encoding,
    /// Bytes to drop behind the decompression; 0 for plain data.
    pub decoded_skip: u64,
    /// As [`voxrole_pack::GridGeometry::validate`] lets through.
    pub dims: [u32; 3],
    pub stored: StoredType,
    /// Which of the file's numbers are the volume's.
    pub picks: Picks,
    /// What to check when the length does not fit.
    pub hint: &'static str,
}

/// Opens a plain file, and gives its length.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] for a folder, pipe or device, which could block or never end.
pub(super) fn open(path: &Path) -> Result<(File, u64)> {
    let metadata = fs::metadata(path).map_err(Error::io(path))?;
    if metadata.is_dir() {
        return Err(Error::format(path, "expected a volume file, found a folder"));
    }
    if !metadata.is_file() {
        return Err(Error::format(path, "expected a volume file, found a pipe or device"));
    }
    Ok((File::open(path).map_err(Error::io(path))?, metadata.len()))
}

impl Payload {
    /// Length of all numbers of the file, unpacked. Requires dimensions that the geometry's check lets through.
    pub fn expected_bytes(&self) -> u64 {
        self.volume_bytes().saturating_mul(self.picks.volumes())
    }

    /// Length of the volume's own numbers.
    fn volume_bytes(&self) -> u64 {
        let size = self.stored.scalar_type.size_in_bytes() as u64;
        self.dims.iter().fold(size, |product, &dim| product.saturating_mul(u64::from(dim)))
    }

    /// The file's numbers from the first of the volume to behind the last.
    fn range(&self) -> Range<u64> {
        self.picks.range(self.expected_bytes() / self.stored.scalar_type.size_in_bytes() as u64)
    }

    /// Reads all numbers.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] when there are fewer or more bytes than the grid needs, or damaged ones;
    /// [`Error::OutOfMemory`].
    pub fn read(&self) -> Result<Scalars> {
        self.decode(|decoding| decoding.scalars())
    }

    /// Makes the numbers accessible region by region; compressed and scattered ones are put into a temporary file in `folder`.
    ///
    /// # Errors
    /// As [`Self::read`], but for memory; [`Error::Io`] when `folder` cannot be written to.
    pub fn stored(self, folder: &Path) -> Result<StoredVoxels> {
        let size = self.stored.scalar_type.size_in_bytes() as u64;
        let Range { start, end } = self.range();
        let (file, offset) = if self.encoding == Encoding::Plain && (end - start) * size == self.volume_bytes() {
            let (file, length) = open(&self.path)?;
            (file, self.offset(length)? + start * size)
        } else {
            let mut file = tempfile::tempfile_in(folder).map_err(Error::io(folder))?;
            self.decode(|decoding| decoding.copy_to(&mut file, folder))?;
            (file, 0)
        };
        Ok(StoredVoxels {
            file,
            paths: vec![self.path],
            are_all_paths: true,
            offset,
            dims: self.dims.map(|dim| dim as usize),
            stored: self.stored,
        })
    }

    /// Lets `consume` have the stream of numbers, and makes sure that it ends with them.
    fn decode<T>(&self, consume: impl FnOnce(&mut Decoding<'_>) -> Result<T>) -> Result<T> {
        let (mut file, length) = open(&self.path)?;
        let offset = self.offset(length)?;
        file.seek(SeekFrom::Start(offset)).map_err(Error::io(&self.path))?;
        match self.encoding {
            Encoding::Plain => {
                let first = self.range().start * self.stored.scalar_type.size_in_bytes() as u64;
                file.seek(SeekFrom::Start(offset + first)).map_err(Error::io(&self.path))?;
                consume(&mut Decoding::new(self, &mut file, true))
            }
            Encoding::Gzip => {
                let mut stream = MultiGzDecoder::new(BufReader::new(file));
                self.unpack(&mut stream, consume)
            }
            Encoding::Zlib(packed) => {
                let available = length - offset;
                if let Some(packed) = packed.filter(|&packed| packed != available) {
                    return Err(self
                        .fail(format!("expected {packed} compressed bytes from byte {offset} on, found {available}")));
                }
                let mut stream = ZlibStream::new(BufReader::new(file));
                let numbers = self.unpack(&mut stream, consume)?;
                if !stream.input.fill_buf().map_err(Error::io(&self.path))?.is_empty() {
                    let message = format!(
                        "expected {} compressed bytes from byte {offset} on, found {available}",
                        stream.inflate.total_in()
                    );
                    return Err(self.fail(message));
                }
                Ok(numbers)
            }
        }
    }

    /// The first stored byte's position; for plain data only if the file has the length that it must have.
    fn offset(&self, length: u64) -> Result<u64> {
        let expected = self.expected_bytes();
        let offset = match self.start {
            Start::Offset(offset) | Start::Section(offset) => offset,
            Start::FileEnd => length.saturating_sub(expected),
        };
        let available = length.checked_sub(offset).ok_or_else(|| {
            self.fail(format!("expected voxels from byte {offset} on, found a file of {length} bytes; {}", self.hint))
        })?;
        let fits = match self.start {
            Start::Section(_) => available >= expected,
            _ => available == expected,
        };
        if self.encoding == Encoding::Plain && !fits {
            return Err(self.fail(format!(
                "{}, found {available} from byte {offset} on; {}",
                self.expectation(),
                self.hint
            )));
        }
        Ok(offset)
    }

    fn unpack<T>(&self, stream: &mut dyn Read, consume: impl FnOnce(&mut Decoding<'_>) -> Result<T>) -> Result<T> {
        let mut decoding = Decoding::new(self, stream, false);
        decoding.skip()?;
        let Range { start, end } = self.range();
        let size = self.stored.scalar_type.size_in_bytes() as u64;
        decoding.pass(start * size)?;
        let numbers = consume(&mut decoding)?;
        decoding.pass(self.expected_bytes() - end * size)?;
        decoding.expect_end()?;
        Ok(numbers)
    }

    fn expectation(&self) -> String {
        let [x, y, z] = self.dims;
        let volumes = match self.picks.volumes() {
            1 => String::new(),
            several => format!("{several} times "),
        };
        format!("expected {} bytes ({volumes}{x} x {y} x {z} of {})", self.expected_bytes(), self.stored)
    }

    fn fail(&self, message: String) -> Error {
        Error::format(&self.path, message)
    }
}

/// Appends the numbers that `bytes` hold, which are reversed where their order is not the little-endian one.
pub(super) fn append_numbers<T: Scalar>(bytes: &mut [u8], byte_order: ByteOrder, numbers: &mut Vec<T>) {
    if byte_order == ByteOrder::Big {
        bytes.chunks_exact_mut(T::SIZE).for_each(<[u8]>::reverse);
    }
    numbers.extend(bytes.chunks_exact(T::SIZE).map(T::from_le));
}

/// A stream of numbers being read.
struct Decoding<'a> {
    payload: &'a Payload,
    stream: &'a mut dyn Read,
    /// Whether the stream is known to hold all expected bytes.
    measured: bool,
    /// Bytes of voxels read so far.
    found: u64,
}

impl<'a> Decoding<'a> {
    fn new(payload: &'a Payload, stream: &'a mut dyn Read, measured: bool) -> Self {
        Self { payload, stream, measured, found: 0 }
    }

    fn skip(&mut self) -> Result<()> {
        let skip = self.payload.decoded_skip;
        let skipped = io::copy(&mut Read::by_ref(&mut self.stream).take(skip), &mut io::sink())
            .map_err(|error| self.broken(error))?;
        if skipped < skip {
            let message =
                format!("expected voxels from unpacked byte {skip} on, found {skipped} bytes; {}", self.payload.hint);
            return Err(self.payload.fail(message));
        }
        Ok(())
    }

    fn scalars(&mut self) -> Result<Scalars> {
        Ok(match self.payload.stored.scalar_type {
            ScalarType::U8 => Scalars::U8(self.numbers()?),
            ScalarType::I8 => Scalars::I8(self.numbers()?),
            ScalarType::U16 => Scalars::U16(self.numbers()?),
            ScalarType::I16 => Scalars::I16(self.numbers()?),
            ScalarType::U32 => Scalars::U32(self.numbers()?),
            ScalarType::I32 => Scalars::I32(self.numbers()?),
            ScalarType::F32 => Scalars::F32(self.numbers()?),
            ScalarType::F64 => Scalars::F64(self.numbers()?),
        })
    }

    fn numbers<T: Scalar>(&mut self) -> Result<Vec<T>> {
        let count = self.payload.volume_bytes() / T::SIZE as u64;
        let count = usize::try_from(count).map_err(|_| self.out_of_memory())?;
        let mut numbers = Vec::new();
        if self.measured {
            numbers.try_reserve_exact(count).map_err(|_| self.out_of_memory())?;
        }
        let byte_order = self.payload.stored.byte_order;
        self.each_chunk(|decoding, chunk| {
            let wanted = chunk.len() / T::SIZE;
            if numbers.capacity() - numbers.len() < wanted {
                // Twice as much as before, but never more than is expected.
                let growth = (count - numbers.len()).min(wanted.max(numbers.len()));
                numbers.try_reserve_exact(growth).map_err(|_| decoding.out_of_memory())?;
            }
            append_numbers(chunk, byte_order, &mut numbers);
            Ok(())
        })?;
        Ok(numbers)
    }

    /// Writes all numbers to a file in `folder`, as they are stored.
    fn copy_to(&mut self, file: &mut File, folder: &Path) -> Result<()> {
        let bytes = self.payload.volume_bytes();
        self.each_chunk(|_, chunk| file.write_all(chunk).map_err(|error| no_room(folder, bytes, error)))
    }

    /// Hands the volume's own numbers to `consume`, as they are stored.
    fn each_chunk(&mut self, mut consume: impl FnMut(&Self, &mut [u8]) -> Result<()>) -> Result<()> {
        let size = self.payload.stored.scalar_type.size_in_bytes();
        let Range { start: mut position, end } = self.payload.range();
        let longest = (CHUNK_BYTES / size) as u64;
        let mut buffer = vec![0; (end - position).min(longest) as usize * size];
        while position < end {
            let wanted = (end - position).min(longest);
            let chunk = &mut buffer[..wanted as usize * size];
            self.fill(chunk)?;
            let kept = self.payload.picks.keep(position, chunk, size);
            consume(self, &mut chunk[..kept])?;
            position += wanted;
        }
        Ok(())
    }

    /// Goes on behind `count` bytes of numbers that are not the volume's.
    fn pass(&mut self, count: u64) -> Result<()> {
        let mut missing = count;
        let mut buffer = vec![0; CHUNK_BYTES.min(usize::try_from(count).unwrap_or(CHUNK_BYTES))];
        while missing > 0 {
            let chunk = &mut buffer[..missing.min(CHUNK_BYTES as u64) as usize];
            self.fill(chunk)?;
            missing -= chunk.len() as u64;
        }
        Ok(())
    }

    /// Fills `chunk`, or says how far the data go.
    fn fill(&mut self, chunk: &mut [u8]) -> Result<()> {
        let mut filled = 0;
        while filled < chunk.len() {
            match self.stream.read(&mut chunk[filled..]) {
                Ok(0) => {
                    let Payload { hint, .. } = self.payload;
                    return Err(self.payload.fail(format!(
                        "{}, found {}; {hint}",
                        self.payload.expectation(),
                        self.found
                    )));
                }
                Ok(count) => {
                    filled += count;
                    self.found += count as u64;
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(self.broken(error)),
            }
        }
        Ok(())
    }

    /// Makes sure that the stream ends here; this is also what checks the stream's checksum.
    fn expect_end(&mut self) -> Result<()> {
        loop {
            match self.stream.read(&mut [0]) {
                Ok(0) => return Ok(()),
                Ok(_) => {
                    let message = format!(
                        "{}, found more in the compressed data; {}",
                        self.payload.expectation(),
                        self.payload.hint
                    );
                    return Err(self.payload.fail(message));
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(self.broken(error)),
            }
        }
    }

    /// What an error of the stream means.
    fn broken(&self, error: io::Error) -> Error {
        let (expectation, found) = (self.payload.expectation(), self.found);
        match error.kind() {
            io::ErrorKind::UnexpectedEof => self
                .payload
                .fail(format!("the compressed data are truncated: {expectation}, found {found} before their end")),
            io::ErrorKind::InvalidInput | io::ErrorKind::InvalidData => self
                .payload
                .fail(format!("the compressed data are damaged: {expectation}, found {found} before this: {error}")),
            _ => Error::Io { path: self.payload.path.to_owned(), source: error },
        }
    }

    fn out_of_memory(&self) -> Error {
        let what = format!("the voxels of {}", self.payload.path.display());
        Error::OutOfMemory { what, bytes: u128::from(self.payload.volume_bytes()) }
    }
}

/// A zlib stream that knows whether it has ended: flate2's own reader takes a truncated checksum for a good end.
pub(super) struct ZlibStream<R> {
    input: R,
    inflate: Decompress,
    ended: bool,
}

impl<R: BufRead> ZlibStream<R> {
    pub fn new(input: R) -> Self {
        Self { input, inflate: Decompress::new(true), ended: false }
    }
}

impl<R: BufRead> Read for ZlibStream<R> {
    fn read(&mut self, output: &mut [u8]) -> io::Result<usize> {
        while !self.ended {
            let input = self.input.fill_buf()?;
            let at_end = input.is_empty();
            let (consumed, produced) = (self.inflate.total_in(), self.inflate.total_out());
            let status = self.inflate.decompress(input, output, FlushDecompress::None);
            let consumed = self.inflate.total_in() - consumed;
            let produced = self.inflate.total_out() - produced;
            self.input.consume(consumed as usize);
            match status.map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))? {
                Status::StreamEnd => self.ended = true,
                Status::Ok | Status::BufError if at_end && produced == 0 => {
                    return Err(io::ErrorKind::UnexpectedEof.into());
                }
                Status::Ok | Status::BufError => {}
            }
            if produced > 0 {
                return Ok(produced as usize);
            }
        }
        Ok(0)
    }
}

#[cfg(test)]
mod tests {

    use flate2::Compression;
    use flate2::write::{GzEncoder, ZlibEncoder};

    use super::*;

    const U16_BE: StoredType = StoredType { scalar_type: ScalarType::U16, byte_order: ByteOrder::Big };

    fn read(bytes: &[u8], start: Start, encoding: Encoding, decoded_skip: u64) -> Result<Scalars> {
        let mut file = tempfile::NamedTempFile::new().expect("a temporary file");
        file.write_all(bytes).expect("written");
        let payload = Payload {
            path: file.path().to_owned(),
            start,
            encoding,
            decoded_skip,
            dims: [3, 1, 1],
            stored: U16_BE,
            picks: Picks::default(),
            hint: "check sizes",
        };
        payload.read()
    }

    fn zlib(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(bytes).expect("into memory");
        encoder.finish().expect("into memory")
    }

    fn gzip(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(bytes).expect("into memory");
        encoder.finish().expect("into memory")
    }

    const SIX: [u8; 6] = [0, 1, 1, 0, 255, 254];

    #[test]
    fn every_encoding_gives_the_same_numbers() {
        let expected = Scalars::U16(vec![1, 256, 65534]);
        let with_prefix = [b"abc".as_slice(), &SIX].concat();
        let members = [gzip(&SIX[..3]), gzip(&SIX[3..])].concat();
        for (bytes, start, encoding, skip) in [
            (SIX.to_vec(), Start::Offset(0), Encoding::Plain, 0),
            (with_prefix.clone(), Start::Offset(3), Encoding::Plain, 0),
            (with_prefix.clone(), Start::FileEnd, Encoding::Plain, 0),
            ([&with_prefix, b"def".as_slice()].concat(), Start::Section(3), Encoding::Plain, 0),
            (gzip(&with_prefix), Start::Offset(0), Encoding::Gzip, 3),
            (members, Start::Offset(0), Encoding::Gzip, 0),
            (zlib(&SIX), Start::Offset(0), Encoding::Zlib(None), 0),
            (zlib(&SIX), Start::Offset(0), Encoding::Zlib(Some(zlib(&SIX).len() as u64)), 0),
        ] {
            assert_eq!(read(&bytes, start, encoding, skip).expect("good data"), expected, "{start:?} {encoding:?}");
        }
    }

    #[test]
    fn every_truncation_is_noticed() {
        for (bytes, encoding) in
            [(SIX.to_vec(), Encoding::Plain), (gzip(&SIX), Encoding::Gzip), (zlib(&SIX), Encoding::Zlib(None))]
        {
            for length in 0..bytes.len() {
                let message = read(&bytes[..length], Start::Offset(0), encoding, 0).expect_err("truncated").to_string();
                assert!(
                    message.contains("expected 6 bytes (3 x 1 x 1 of u16be)") && message.contains("found"),
                    "{message}"
                );
            }
        }
    }

    #[test]
    fn every_trailing_byte_is_noticed() {
        for (bytes, encoding) in [
            ([SIX.as_slice(), &[0]].concat(), Encoding::Plain),
            (gzip(&[SIX.as_slice(), &[0]].concat()), Encoding::Gzip),
            ([gzip(&SIX), vec![7]].concat(), Encoding::Gzip),
            (zlib(&[SIX.as_slice(), &[0]].concat()), Encoding::Zlib(None)),
            ([zlib(&SIX), vec![0]].concat(), Encoding::Zlib(None)),
        ] {
            let message = read(&bytes, Start::Offset(0), encoding, 0).expect_err("too long").to_string();
            assert!(message.contains("expected") && message.contains("found"), "{message}");
        }
    }

    #[test]
    fn flipped_bits_never_give_other_numbers() {
        let expected = Scalars::U16(vec![1, 256, 65534]);
        for (bytes, encoding) in [(gzip(&SIX), Encoding::Gzip), (zlib(&SIX), Encoding::Zlib(None))] {
            let mut unnoticed = 0;
            // Behind gzip's ten bytes of header: of those, time and system may be anything.
            let start = if encoding == Encoding::Gzip { 10 } else { 0 };
            for byte in start..bytes.len() {
                for bit in 0..8 {
                    let mut flipped = bytes.clone();
                    flipped[byte] ^= 1 << bit;
                    if let Ok(numbers) = read(&flipped, Start::Offset(0), encoding, 0) {
                        assert_eq!(numbers, expected, "{encoding:?} byte {byte} bit {bit}");
                        unnoticed += 1;
                    }
                }
            }
            // The bits that fill deflate's last byte have no meaning.
            assert!(unnoticed < 8, "{encoding:?}: {unnoticed} flipped bits went unnoticed");
        }
    }

    #[test]
    fn a_long_array_takes_no_more_memory_than_it_needs() {
        let stored = StoredType { scalar_type: ScalarType::U8, byte_order: ByteOrder::Little };
        let bytes = vec![7; 5 * CHUNK_BYTES + 3];
        let dims = [bytes.len() as u32, 1, 1];
        let payload = Payload {
            path: PathBuf::from("none"),
            start: Start::Offset(0),
            encoding: Encoding::Gzip,
            decoded_skip: 0,
            dims,
            stored,
            picks: Picks::default(),
            hint: "",
        };
        let numbers: Vec<u8> = Decoding::new(&payload, &mut bytes.as_slice(), false).numbers().expect("all there");
        assert_eq!(numbers, bytes);
        assert_eq!(numbers.capacity(), bytes.len());
    }
}
