//! A bit for each voxel of a brick: whether it has a boundary.
//!
//! Voxel `i`, x fastest, is bit `i % 8` of byte `i / 8`, counted from the lowest; bits behind the last voxel are 0.

/// The mask of the numbers that `is_set`.
#[must_use]
pub fn of<T: Copy>(values: &[T], is_set: impl Fn(T) -> bool) -> Vec<u8> {
    let byte =
        |values: &[T]| values.iter().enumerate().fold(0, |byte, (bit, &value)| byte | u8::from(is_set(value)) << bit);
    values.chunks(8).map(byte).collect()
}

/// How many bits are set.
#[must_use]
pub fn count(mask: &[u8]) -> usize {
    mask.iter().map(|byte| byte.count_ones() as usize).sum()
}

/// Visits the places of the bits that are set, in rising order.
pub fn for_each_one(mask: &[u8], mut visit: impl FnMut(usize)) {
    for (index, bytes) in mask.chunks(8).enumerate() {
        let mut word = [0; 8];
        word[..bytes.len()].copy_from_slice(bytes);
        let mut rest = u64::from_le_bytes(word);
        while rest != 0 {
            visit(64 * index + rest.trailing_zeros() as usize);
            rest &= rest - 1;
        }
    }
}

/// Whether no bit behind the last of `len` voxels is set, in a mask that has as many bytes as they need.
#[must_use]
pub fn is_sound(mask: &[u8], len: usize) -> bool {
    mask.len() == len.div_ceil(8) && (len.is_multiple_of(8) || mask.last().is_none_or(|last| last >> (len % 8) == 0))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn ones_are_where_they_were_set(flags in prop::collection::vec(any::<bool>(), 0..200)) {
            let mask = of(&flags, |flag| flag);
            let places: Vec<usize> = (0..flags.len()).filter(|&place| flags[place]).collect();
            prop_assert_eq!(count(&mask), places.len());
            prop_assert!(is_sound(&mask, flags.len()));
            let mut found = Vec::new();
            for_each_one(&mask, |place| found.push(place));
            prop_assert_eq!(found, places);
        }
    }

    #[test]
    fn bits_behind_the_last_voxel_are_unsound() {
        assert!(is_sound(&[0xff, 0x03], 10));
        assert!(!is_sound(&[0xff, 0x04], 10));
        assert!(!is_sound(&[0xff], 10));
    }
}
