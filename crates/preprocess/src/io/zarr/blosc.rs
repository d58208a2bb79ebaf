//! Blosc, version 1, as Zarr uses it: blocks of shuffled numbers under one of several codecs
//! (<https://github.com/Blosc/c-blosc/blob/main/README_CHUNK_FORMAT.rst>).
//!
//! It is ours because the C library would need a C++ compiler for Snappy, which nearly nobody uses, and is not told how
//! much may come out.

use flate2::{Decompress, FlushDecompress};

/// Bytes of the header.
const HEADER_BYTES: usize = 16;
/// Blocks are split into one stream for each byte of a number if that has at most so many bytes, and a stream at least so many.
const MAX_SPLITS: usize = 16;
const MIN_STREAM_BYTES: usize = 128;
/// Longest block that is read; the C library makes blocks of a few MiB at most, unless it is told otherwise.
const MAX_BLOCK_BYTES: usize = 256 << 20;
/// Distance from which on a match of BloscLZ has two bytes more.
const FAR_DISTANCE: usize = 8191;

/// What a chunk says of itself.
struct Header {
    flags: u8,
    type_size: usize,
    bytes: usize,
    block_bytes: usize,
}

impl Header {
    const SHUFFLED: u8 = 1;
    const COPIED: u8 = 2;
    const BIT_SHUFFLED: u8 = 4;
    const NOT_SPLIT: u8 = 16;

    fn read(packed: &[u8]) -> Option<Self> {
        let number = |at: usize| Some(u32::from_le_bytes(*packed.get(at..)?.first_chunk()?) as usize);
        let header = Self {
            flags: *packed.get(2)?,
            type_size: (*packed.get(3)?).into(),
            bytes: number(4)?,
            block_bytes: number(8)?,
        };
        (number(12)? == packed.len() && header.type_size > 0).then_some(header)
    }

    fn is(&self, flag: u8) -> bool {
        self.flags & flag != 0
    }
}

/// Unpacks a chunk of at most `limit` bytes.
///
/// # Errors
/// A message, when the chunk is damaged, larger, or compressed with Snappy.
pub fn unpack(packed: &[u8], limit: u64) -> Result<Vec<u8>, String> {
    let header = Header::read(packed).ok_or("expected a Blosc chunk, found no such header")?;
    if header.bytes as u64 > limit {
        return Err(format!("expected a chunk of at most {limit} bytes, found one of {}", header.bytes));
    }
    let damaged = || "expected a whole Blosc chunk, found damage".to_owned();
    if header.is(Header::COPIED) {
        let bytes = packed.get(HEADER_BYTES..HEADER_BYTES + header.bytes).ok_or_else(damaged)?;
        return Ok(bytes.to_vec());
    }
    if header.flags >> 5 == 2 {
        return Err("expected Blosc with LZ4, Zstandard, zlib or BloscLZ, found Snappy, which is not read".into());
    }
    if header.bytes == 0 {
        return Ok(Vec::new());
    }
    if header.block_bytes == 0 || header.block_bytes > header.bytes.min(MAX_BLOCK_BYTES) {
        return Err(damaged());
    }
    let starts = HEADER_BYTES + 4 * header.bytes.div_ceil(header.block_bytes);
    let starts = packed.get(HEADER_BYTES..starts).ok_or_else(damaged)?;
    let mut unpacked = Vec::new();
    let mut streams = vec![0; header.block_bytes];
    for start in starts.chunks_exact(4) {
        let start = start.first_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes)) as usize;
        let begin = unpacked.len();
        // Block by block: a header can claim more than there is.
        unpacked.resize(header.bytes.min(begin + header.block_bytes), 0);
        let block = &mut unpacked[begin..];
        let streams = &mut streams[..block.len()];
        unpack_block(&header, packed.get(start..).ok_or_else(damaged)?, streams).ok_or_else(damaged)?;
        if header.is(Header::SHUFFLED) && header.type_size > 1 {
            unshuffle(streams, header.type_size, block);
        } else if header.is(Header::BIT_SHUFFLED) && block.len() >= header.type_size {
            unshuffle_bits(streams, header.type_size, block);
        } else {
            block.copy_from_slice(streams);
        }
    }
    Ok(unpacked)
}

/// Unpacks a block's streams, each behind its length; `None` when they are damaged.
fn unpack_block(header: &Header, mut packed: &[u8], block: &mut [u8]) -> Option<()> {
    let is_whole = block.len() == header.block_bytes;
    let is_split = is_whole
        && !header.is(Header::NOT_SPLIT)
        && header.type_size <= MAX_SPLITS
        && block.len() / header.type_size >= MIN_STREAM_BYTES;
    let stream_bytes = if is_split { block.len() / header.type_size } else { block.len() };
    for stream in block.chunks_mut(stream_bytes) {
        let length = u32::from_le_bytes(*packed.first_chunk()?) as usize;
        let source = packed.get(4..)?.get(..length)?;
        packed = &packed[4 + length..];
        if length == stream.len() {
            stream.copy_from_slice(source);
            continue;
        }
        let found = match header.flags >> 5 {
            0 => unpack_blosclz(source, stream)?,
            1 => lz4_flex::block::decompress_into(source, stream).ok()?,
            3 => {
                let mut inflate = Decompress::new(true);
                inflate.decompress(source, stream, FlushDecompress::Finish).ok()?;
                inflate.total_out() as usize
            }
            4 => zstd::bulk::decompress_to_buffer(source, stream).ok()?,
            _ => return None,
        };
        if found != stream.len() {
            return None;
        }
    }
    Some(())
}

/// BloscLZ: runs of up to 32 bytes as they are, and matches of earlier bytes. The count of bytes unpacked; `None` for
/// damage.
fn unpack_blosclz(source: &[u8], target: &mut [u8]) -> Option<usize> {
    let mut input = source.iter().copied();
    let mut written = 0;
    let mut control = usize::from(input.next()? & 31);
    loop {
        if control < 32 {
            for _ in 0..=control {
                *target.get_mut(written)? = input.next()?;
                written += 1;
            }
        } else {
            let mut length = (control >> 5) + 2;
            let mut distance = (control & 31) << 8;
            if control >> 5 == 7 {
                loop {
                    let more = usize::from(input.next()?);
                    length += more;
                    if more < 255 || length > target.len() {
                        break;
                    }
                }
            }
            let low = usize::from(input.next()?);
            distance += low;
            if low == 255 && distance == FAR_DISTANCE {
                distance += usize::from(input.next()?) << 8;
                distance += usize::from(input.next()?);
            }
            let from = written.checked_sub(distance + 1)?;
            if length > target.len() - written {
                return None;
            }
            // Byte by byte: a match may overlap what it makes.
            for offset in 0..length {
                target[written + offset] = target[from + offset];
            }
            written += length;
        }
        match input.next() {
            Some(next) => control = usize::from(next),
            None => return Some(written),
        }
    }
}

/// From all first bytes, all second bytes and so on to whole numbers; bytes that are left over stay.
fn unshuffle(streams: &[u8], type_size: usize, block: &mut [u8]) {
    let count = streams.len() / type_size;
    for byte in 0..type_size {
        let stream = &streams[byte * count..][..count];
        for (number, &value) in block.chunks_exact_mut(type_size).zip(stream) {
            number[byte] = value;
        }
    }
    let rest = count * type_size;
    block[rest..].copy_from_slice(&streams[rest..]);
}

/// The same for bits, of counts of numbers that are multiples of eight; others are as they are.
fn unshuffle_bits(streams: &[u8], type_size: usize, block: &mut [u8]) {
    let count = streams.len() / type_size;
    if !count.is_multiple_of(8) {
        block.copy_from_slice(streams);
        return;
    }
    for byte in 0..type_size {
        let planes = &streams[byte * count..][..count];
        for group in 0..count / 8 {
            let bits: [u8; 8] = std::array::from_fn(|bit| planes[bit * (count / 8) + group]);
            for number in 0..8 {
                let value = (0..8).fold(0, |value, bit| value | (bits[bit] >> number & 1) << bit);
                block[(8 * group + number) * type_size + byte] = value;
            }
        }
    }
    let rest = count * type_size;
    block[rest..].copy_from_slice(&streams[rest..]);
}
