//! Rows cut into pieces of a length that the compiler knows.

use std::ops::Range;

/// Samples of a piece: eight vectors of AVX2.
pub const WINDOW: usize = 64;

/// Pieces of [`WINDOW`] samples that cover `0..len`, the last one overlapping the one before, so that loops over them leave no
/// rest; a row shorter than that is one piece.
///
/// Whoever works on them asks first whether a piece has [`WINDOW`] samples, and spells its end out then.
#[inline(always)]
pub fn windows(len: usize) -> impl Iterator<Item = Range<usize>> {
    let last = len.saturating_sub(WINDOW);
    (0..len).step_by(WINDOW).map(move |start| {
        let start = start.min(last);
        start..(start + WINDOW).min(len)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sample_is_in_a_window_of_full_length() {
        for len in [1, 63, 64, 65, 128, 200] {
            let windows: Vec<_> = windows(len).collect();
            assert!((0..len).all(|sample| windows.iter().any(|window| window.contains(&sample))));
            assert!(windows.iter().all(|window| window.len() == WINDOW.min(len) && window.end <= len), "{windows:?}");
        }
        assert_eq!(windows(0).count(), 0);
    }
}
