//! One brick's or section's bytes, packed and unpacked.

use serde::{Deserialize, Serialize};

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

/// Packs numbers by whichever encoding is smallest.
pub fn pack<T: LittleEndian>(values: &[T]) -> Result<(Encoding, Vec<u8>)> {
    let mut bytes = Vec::with_capacity(values.len() * T::SIZE);
    values.iter().for_each(|value| value.append_le(&mut bytes));
    let size = T::SIZE;
    // Compared as bytes, so that NaN payloads and −0 survive.
    if bytes.chunks_exact(size).all(|number| number == &bytes[..size]) {
        bytes.truncate(size);
        return Ok((Encoding::Constant, bytes));
    }
    let packed =
        zstd::bulk::compress(&shuffle(&bytes, size), ZSTD_LEVEL).map_err(Error::io("compressing a brick with zstd"))?;
    Ok(if packed.len() < bytes.len() { (Encoding::ShuffledZstd, packed) } else { (Encoding::Raw, bytes) })
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

fn shuffle(bytes: &[u8], size: usize) -> Vec<u8> {
    if size == 1 {
        return bytes.to_vec();
    }
    (0..size).flat_map(|plane| bytes.iter().skip(plane).step_by(size).copied()).collect()
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
