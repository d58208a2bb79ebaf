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
    words(mask).map(|word| word.count_ones() as usize).sum()
}

/// The numbers whose bits are set.
#[must_use]
pub fn gather<T: Copy>(mask: &[u8], values: &[T]) -> Vec<T> {
    let mut numbers = Vec::with_capacity(count(mask));
    for (values, word) in values.chunks(RUN).zip(words(mask)) {
        if word == u64::MAX {
            numbers.extend_from_slice(values);
        } else {
            numbers.extend(places(word).map(|place| values[place]));
        }
    }
    numbers
}

/// Puts as many numbers as bits are set where they are set; the inverse of [`gather`].
pub fn scatter<T: Copy>(mask: &[u8], mut numbers: &[T], values: &mut [T]) {
    for (values, word) in values.chunks_mut(RUN).zip(words(mask)) {
        let (here, rest) = numbers.split_at(word.count_ones() as usize);
        numbers = rest;
        if word == u64::MAX {
            values.copy_from_slice(here);
        } else {
            places(word).zip(here).for_each(|(place, &number)| values[place] = number);
        }
    }
}

/// Voxels of a word.
const RUN: usize = u64::BITS as usize;

fn words(mask: &[u8]) -> impl Iterator<Item = u64> {
    mask.chunks(size_of::<u64>()).map(|bytes| {
        let mut word = [0; size_of::<u64>()];
        word[..bytes.len()].copy_from_slice(bytes);
        u64::from_le_bytes(word)
    })
}

/// The places of the bits that are set, in rising order.
fn places(mut word: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let place = (word != 0).then(|| word.trailing_zeros() as usize);
        word &= word.wrapping_sub(1);
        place
    })
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
            let all: Vec<usize> = (0..flags.len()).collect();
            prop_assert_eq!(&gather(&mask, &all), &places);
            let mut found = vec![usize::MAX; flags.len()];
            scatter(&mask, &places, &mut found);
            let expected: Vec<usize> = all.iter().map(|&place| if flags[place] { place } else { usize::MAX }).collect();
            prop_assert_eq!(found, expected);
        }
    }

    #[test]
    fn bits_behind_the_last_voxel_are_unsound() {
        assert!(is_sound(&[0xff, 0x03], 10));
        assert!(!is_sound(&[0xff, 0x04], 10));
        assert!(!is_sound(&[0xff], 10));
    }
}
