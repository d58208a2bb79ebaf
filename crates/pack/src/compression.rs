//! One brick's or section's bytes, packed and unpacked.

use serde::{Deserialize, Serialize};
use zstd::bulk::Compressor;
use zstd::zstd_safe::compress_bound;

use crate::scalar::LittleEndian;
use crate::{Error, Result};

/// How a brick's bytes are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Encoding {
    /// One number that stands for every voxel.
    Constant,
    /// Little-endian numbers as they are.
    Raw,
    /// Byte planes (all first bytes, then all second bytes, …) in one zstd frame.
    ShuffledZstd,
}

/// Level 3 is zstd's own default: higher levels gain about 2 % on these layers at several times the time.
const ZSTD_LEVEL: i32 = 3;

/// Packs numbers, and keeps its memory from one brick to the next.
pub struct Packer {
    compressor: Compressor<'static>,
    planes: Vec<u8>,
    packed: Vec<u8>,
}

impl Packer {
    /// Prepares for packing.
    pub fn new() -> Result<Self> {
        let compressor = Compressor::new(ZSTD_LEVEL).map_err(Error::io("setting up zstd"))?;
        Ok(Self { compressor, planes: Vec::new(), packed: Vec::new() })
    }

    /// Packs numbers by whichever encoding is smallest.
    pub fn pack<T: LittleEndian>(&mut self, values: &[T]) -> Result<(Encoding, Vec<u8>)> {
        let mut bytes = Vec::new();
        if values.first().is_none_or(|&first| all_same(values, first)) {
            T::append_le(&values[..values.len().min(1)], &mut bytes);
            return Ok((Encoding::Constant, bytes));
        }
        shuffle(values, &mut self.planes);
        self.packed.clear();
        self.packed.reserve(compress_bound(self.planes.len()));
        let length = self
            .compressor
            .compress_to_buffer(&self.planes, &mut self.packed)
            .map_err(Error::io("compressing a brick with zstd"))?;
        if length < self.planes.len() {
            return Ok((Encoding::ShuffledZstd, self.packed[..length].to_vec()));
        }
        T::append_le(values, &mut bytes);
        Ok((Encoding::Raw, bytes))
    }
}

/// Whether all numbers are `first`, byte by byte, so that NaN payloads and −0 survive.
pub fn all_same<T: LittleEndian>(values: &[T], first: T) -> bool {
    // Whole runs without a branch are compared many at once.
    values.chunks(64).all(|run| run.iter().fold(true, |same, value| same & value.is_same(first)))
}

/// Unpacks exactly `len` numbers.
pub fn unpack<T: LittleEndian>(encoding: Encoding, stored: &[u8], len: usize) -> Result<Vec<T>> {
    let size = T::SIZE;
    let expect = |found: usize, expected: usize| {
        if found == expected {
            Ok(())
        } else {
            Err(Error::Format(format!("{encoding:?} data unpacks to {found} bytes where {expected} are expected")))
        }
    };
    match encoding {
        Encoding::Constant => {
            expect(stored.len(), size)?;
            Ok(vec![T::from_le(stored); len])
        }
        Encoding::Raw => {
            expect(stored.len(), len * size)?;
            Ok(stored.chunks_exact(size).map(T::from_le).collect())
        }
        Encoding::ShuffledZstd => {
            let bytes = zstd::bulk::decompress(stored, len * size)
                .map_err(|error| Error::Format(format!("zstd data is damaged: {error}")))?;
            expect(bytes.len(), len * size)?;
            Ok(unshuffle(&bytes, size).chunks_exact(size).map(T::from_le).collect())
        }
    }
}

fn shuffle<T: LittleEndian>(values: &[T], planes: &mut Vec<u8>) {
    planes.resize(size_of_val(values), 0);
    for (index, plane) in planes.chunks_exact_mut(values.len()).enumerate() {
        plane.iter_mut().zip(values).for_each(|(byte, value)| *byte = value.byte(index));
    }
}

fn unshuffle(planes: &[u8], size: usize) -> Vec<u8> {
    if size == 1 {
        return planes.to_vec();
    }
    let count = planes.len() / size;
    let mut bytes = vec![0; planes.len()];
    for (plane, values) in planes.chunks_exact(count.max(1)).enumerate() {
        values.iter().zip(bytes[plane..].iter_mut().step_by(size)).for_each(|(&value, byte)| *byte = value);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn pack<T: LittleEndian>(values: &[T]) -> Result<(Encoding, Vec<u8>)> {
        Packer::new()?.pack(values)
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
        assert_eq!(encoding, Encoding::ShuffledZstd);
        assert!(matches!(unpack::<u32>(encoding, &stored, 3999), Err(Error::Format(_))));
        assert!(matches!(unpack::<u32>(encoding, &stored, 4001), Err(Error::Format(_))));
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
            assert_eq!(packer.pack(&brick(seed)).expect("packs"), pack(&brick(seed)).expect("packs"));
        }
    }

    proptest! {
        #[test]
        fn every_bit_survives(values in prop::collection::vec(any::<u32>(), 1..300)) {
            let floats: Vec<f32> = values.iter().map(|&bits| f32::from_bits(bits)).collect();
            let (encoding, stored) = pack(&floats).expect("packs");
            let back = unpack::<f32>(encoding, &stored, floats.len()).expect("unpacks");
            prop_assert!(back.iter().zip(&floats).all(|(a, b)| a.to_bits() == b.to_bits()));
        }
    }
}
