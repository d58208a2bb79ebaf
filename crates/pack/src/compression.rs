//! One brick's or section's bytes, packed and unpacked.

use serde::{Deserialize, Serialize};
use zstd::bulk::{Compressor, Decompressor};
use zstd::zstd_safe::{compress_bound, find_frame_compressed_size, get_error_name};

use crate::mask;
use crate::scalar::LittleEndian;
use crate::{Error, Result};

/// How a brick's bytes are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Encoding {
    /// One number that stands for every voxel.
    Constant,
    /// Little-endian numbers as they are.
    Raw,
    /// Byte planes (all first bytes, then all second bytes, …), each in a zstd frame of its own: their bytes are not alike.
    Zstd,
    /// The same of each number's difference from the one before it; the first's is from 0.
    DeltaZstd,
    /// The same of the numbers at the voxels of the brick's mask alone; the others hold the layer's number for none.
    SparseZstd,
}

impl Encoding {
    /// Every encoding, in the order of its code in a packed file.
    pub const ALL: [Self; 5] = [Self::Constant, Self::Raw, Self::Zstd, Self::DeltaZstd, Self::SparseZstd];
}

/// Level 1: on layers of differences higher levels gain about 1 % (`docs/benchmarks.md`, file sizes).
const ZSTD_LEVEL: i32 = 1;

/// What a zstd frame begins with; frames to be skipped begin otherwise.
const MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// Where numbers are left out, and what then stands there.
#[derive(Clone, Copy, Debug)]
pub struct Sparse<'m, T> {
    /// A bit for each number: whether it is stored.
    pub mask: &'m [u8],
    /// What the others are.
    pub fill: T,
}

/// Packs numbers, and keeps its memory from one brick to the next.
pub struct Packer {
    compressor: Compressor<'static>,
    planes: Vec<u8>,
    frame: Vec<u8>,
}

impl Packer {
    /// Prepares for packing.
    pub fn new() -> Result<Self> {
        let compressor = Compressor::new(ZSTD_LEVEL).map_err(Error::io("setting up zstd"))?;
        Ok(Self { compressor, planes: Vec::new(), frame: Vec::new() })
    }

    /// Packs numbers by whichever encoding is smallest; those outside of the mask must be its fill.
    pub fn pack<T: LittleEndian>(
        &mut self,
        values: &[T],
        sparse: Option<Sparse<'_, T>>,
    ) -> Result<(Encoding, Vec<u8>)> {
        let mut bytes = Vec::new();
        if values.first().is_none_or(|&first| all_same(values, first)) {
            T::append_le(&values[..values.len().min(1)], &mut bytes);
            return Ok((Encoding::Constant, bytes));
        }
        let encoding = match sparse {
            Some(Sparse { mask, .. }) => {
                let kept = mask::gather(mask, values);
                shuffle(&kept, &mut self.planes);
                Encoding::SparseZstd
            }
            None => {
                shuffle(values, &mut self.planes);
                if T::HAS_DIFFERENCES { Encoding::DeltaZstd } else { Encoding::Zstd }
            }
        };
        for plane in self.planes.chunks_exact(self.planes.len() / T::SIZE) {
            self.frame.clear();
            self.frame.reserve(compress_bound(plane.len()));
            self.compressor
                .compress_to_buffer(plane, &mut self.frame)
                .map_err(Error::io("compressing a brick with zstd"))?;
            bytes.extend_from_slice(&self.frame);
        }
        if bytes.len() < size_of_val(values) {
            return Ok((encoding, bytes));
        }
        bytes.clear();
        T::append_le(values, &mut bytes);
        Ok((Encoding::Raw, bytes))
    }
}

/// Whether all numbers are `first`, byte by byte, so that NaN payloads and −0 survive.
pub fn all_same<T: LittleEndian>(values: &[T], first: T) -> bool {
    // Whole runs without a branch are compared many at once.
    values.chunks(64).all(|run| run.iter().fold(true, |same, value| same & value.is_same(first)))
}

/// Unpacks numbers, and keeps its memory from one brick to the next.
pub struct Unpacker {
    decompressor: Decompressor<'static>,
    planes: Vec<u8>,
}

impl Unpacker {
    /// Prepares for unpacking.
    ///
    /// # Errors
    /// [`Error::Io`] when zstd has no memory.
    pub fn new() -> Result<Self> {
        let decompressor = Decompressor::new().map_err(Error::io("setting up zstd"))?;
        Ok(Self { decompressor, planes: Vec::new() })
    }

    /// Unpacks exactly `len` numbers into `values`, which are replaced. Memory for `len` numbers is all that is asked for.
    ///
    /// # Errors
    /// [`Error::Format`] when `stored` is damaged, holds more or fewer, or lacks the mask that it needs.
    pub fn unpack<T: LittleEndian>(
        &mut self,
        encoding: Encoding,
        stored: &[u8],
        len: usize,
        sparse: Option<Sparse<'_, T>>,
        values: &mut Vec<T>,
    ) -> Result<()> {
        values.clear();
        match encoding {
            Encoding::Constant => {
                expect(encoding, stored.len(), T::SIZE)?;
                values.resize(len, T::from_le(stored));
            }
            Encoding::Raw => {
                expect(encoding, stored.len(), len * T::SIZE)?;
                values.extend(stored.chunks_exact(T::SIZE).map(T::from_le));
            }
            Encoding::Zstd => {
                self.decompress(encoding, stored, T::SIZE, len)?;
                join_planes(&self.planes, len, values);
            }
            Encoding::DeltaZstd => {
                self.decompress(encoding, stored, T::SIZE, len)?;
                join_differences(&self.planes, len, values);
            }
            Encoding::SparseZstd => {
                let Some(Sparse { mask, fill }) = sparse.filter(|sparse| mask::is_sound(sparse.mask, len)) else {
                    return Err(Error::Format("sparse data where there is no mask".into()));
                };
                let kept = mask::count(mask);
                self.decompress(encoding, stored, T::SIZE, kept)?;
                let mut numbers = Vec::with_capacity(kept);
                join_differences(&self.planes, kept, &mut numbers);
                values.resize(len, fill);
                mask::scatter(mask, &numbers, values);
            }
        }
        Ok(())
    }

    /// Unpacks as many planes of `len` bytes.
    fn decompress(&mut self, encoding: Encoding, mut stored: &[u8], planes: usize, len: usize) -> Result<()> {
        let damaged = |error: &str| Error::Format(format!("zstd data is damaged: {error}"));
        self.planes.resize(planes * len, 0);
        for index in 0..planes {
            if !stored.starts_with(&MAGIC) {
                return Err(damaged("a frame does not begin as frames do"));
            }
            let frame = find_frame_compressed_size(stored).map_err(|code| damaged(get_error_name(code)))?;
            let (frame, rest) = stored.split_at(frame);
            stored = rest;
            let plane = &mut self.planes[index * len..(index + 1) * len];
            let found =
                self.decompressor.decompress_to_buffer(frame, plane).map_err(|error| damaged(&error.to_string()))?;
            expect(encoding, found, len)?;
        }
        if stored.is_empty() { Ok(()) } else { Err(damaged("it goes on behind its last frame")) }
    }
}

fn expect(encoding: Encoding, found: usize, expected: usize) -> Result<()> {
    if found == expected {
        Ok(())
    } else {
        Err(Error::Format(format!("{encoding:?} data unpacks to {found} bytes where {expected} are expected")))
    }
}

/// Byte planes of the numbers, or of their differences where the type has them.
fn shuffle<T: LittleEndian>(values: &[T], planes: &mut Vec<u8>) {
    planes.clear();
    planes.resize(size_of_val(values), 0);
    if values.is_empty() {
        return;
    }
    for (index, plane) in planes.chunks_exact_mut(values.len()).enumerate() {
        if T::HAS_DIFFERENCES {
            plane[0] = values[0].difference(T::default()).byte(index);
            plane[1..].iter_mut().zip(values.windows(2)).for_each(|(byte, pair)| {
                *byte = pair[1].difference(pair[0]).byte(index);
            });
        } else {
            plane.iter_mut().zip(values).for_each(|(byte, value)| *byte = value.byte(index));
        }
    }
}

/// Appends `count` numbers, from their differences where the type has them. The sums, for which each number waits, come last.
fn join_differences<T: LittleEndian>(planes: &[u8], count: usize, values: &mut Vec<T>) {
    let start = values.len();
    join_planes(planes, count, values);
    if T::HAS_DIFFERENCES {
        let mut previous = T::default();
        for value in &mut values[start..] {
            previous = value.following(previous);
            *value = previous;
        }
    }
}

/// Appends `count` numbers, each put together from its bytes.
fn join_planes<T: LittleEndian>(planes: &[u8], count: usize, values: &mut Vec<T>) {
    let plane = |index: usize| &planes[index * count..(index + 1) * count];
    match T::SIZE {
        1 => values.extend(plane(0).iter().map(|&byte| T::from_le(&[byte]))),
        2 => values.extend(plane(0).iter().zip(plane(1)).map(|(&low, &high)| T::from_le(&[low, high]))),
        _ => values.extend((0..count).map(|at| {
            let mut bytes = [0; 8];
            (0..T::SIZE).for_each(|index| bytes[index] = planes[index * count + at]);
            T::from_le(&bytes[..T::SIZE])
        })),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn pack<T: LittleEndian>(values: &[T]) -> Result<(Encoding, Vec<u8>)> {
        Packer::new()?.pack(values, None)
    }

    fn unpack<T: LittleEndian>(encoding: Encoding, stored: &[u8], len: usize) -> Result<Vec<T>> {
        let mut values = Vec::new();
        Unpacker::new()?.unpack(encoding, stored, len, None, &mut values)?;
        Ok(values)
    }

    #[test]
    fn constant_needs_one_number() {
        let (encoding, stored) = pack(&[7_i16; 1000]).expect("packs");
        assert_eq!((encoding, stored.len()), (Encoding::Constant, 2));
        assert_eq!(unpack::<i16>(encoding, &stored, 1000).expect("unpacks"), vec![7; 1000]);
    }

    #[test]
    fn a_frame_that_unpacks_to_more_is_refused() {
        let (encoding, stored) = pack(&(0..4000).collect::<Vec<u32>>()).expect("packs");
        assert_eq!(encoding, Encoding::DeltaZstd);
        assert!(matches!(unpack::<u32>(encoding, &stored, 3999), Err(Error::Format(_))));
        assert!(matches!(unpack::<u32>(encoding, &stored, 4001), Err(Error::Format(_))));
    }

    #[test]
    fn frames_to_be_skipped_are_refused() {
        let bits = [0];
        let nothing = Some(Sparse { mask: &bits, fill: 0 });
        let frame = [0x50, 0x2a, 0x4d, 0x18, 0, 0, 0, 0];
        let (mut unpacker, mut back) = (Unpacker::new().expect("an unpacker"), Vec::<u8>::new());
        let outcome = unpacker.unpack(Encoding::SparseZstd, &frame, 8, nothing, &mut back);
        assert!(matches!(outcome, Err(Error::Format(_))), "{outcome:?}");
    }

    #[test]
    fn what_was_packed_before_does_not_matter() {
        let brick = |seed: u32| -> Vec<u16> {
            (0..32_768_u32)
                .map(|voxel| ((voxel * seed) >> 9) as u16 ^ (voxel.wrapping_mul(seed * 77_777) >> 29) as u16)
                .collect()
        };
        let mut packer = Packer::new().expect("a packer");
        for seed in [1, 2, 3, 50, 1, 999] {
            assert_eq!(packer.pack(&brick(seed), None).expect("packs"), pack(&brick(seed)).expect("packs"));
        }
    }

    #[test]
    fn sparse_data_need_their_mask() {
        let values: Vec<u16> = (0..999).map(|at| if at % 3 == 0 { 100 + at } else { 0 }).collect();
        let bits = mask::of(&values, |value| value != 0);
        let sparse = Some(Sparse { mask: &bits, fill: 0 });
        let (encoding, stored) = Packer::new().expect("a packer").pack(&values, sparse).expect("packs");
        assert_eq!(encoding, Encoding::SparseZstd);
        let (mut unpacker, mut back) = (Unpacker::new().expect("an unpacker"), Vec::new());
        unpacker.unpack(encoding, &stored, 999, sparse, &mut back).expect("unpacks");
        assert_eq!(back, values);
        let other = mask::of(&values, |value| value > 200);
        for wrong in [None, Some(Sparse { mask: &other, fill: 0 }), Some(Sparse { mask: &bits[1..], fill: 0 })] {
            assert!(matches!(unpacker.unpack(encoding, &stored, 999, wrong, &mut back), Err(Error::Format(_))));
        }
    }

    fn survives<T: LittleEndian>(values: &[T]) -> bool {
        let (encoding, stored) = pack(values).expect("packs");
        let back = unpack::<T>(encoding, &stored, values.len()).expect("unpacks");
        back.iter().zip(values).all(|(&a, &b)| a.is_same(b))
    }

    proptest! {
        #[test]
        fn every_bit_survives(values in prop::collection::vec(any::<u64>(), 1..300), shift in 0..64) {
            let values: Vec<u64> = values.iter().map(|value| value >> shift).collect();
            prop_assert!(survives(&values));
            prop_assert!(survives(&values.iter().map(|&bits| bits as i8).collect::<Vec<_>>()));
            prop_assert!(survives(&values.iter().map(|&bits| bits as u16).collect::<Vec<_>>()));
            prop_assert!(survives(&values.iter().map(|&bits| bits as i32).collect::<Vec<_>>()));
            prop_assert!(survives(&values.iter().map(|&bits| f32::from_bits(bits as u32)).collect::<Vec<_>>()));
            prop_assert!(survives(&values.iter().map(|&bits| f64::from_bits(bits)).collect::<Vec<_>>()));
        }
    }
}
