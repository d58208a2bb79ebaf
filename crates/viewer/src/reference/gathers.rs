//! Numbers out of tables, sixteen at once.
//!
//! The one module of this crate with `unsafe` code: all indices are held against the table's end in one comparison. With one
//! comparison for each, pictures take 1.06 to 1.25 times as long where opacity is integrated (docs/benchmarks.md, “Pictures on
//! the CPU”).
//!
//! Indices go through memory, which [`black_box`] sees to: taking them out of a vector one by one would keep the units busy that
//! do arithmetic. It hides nothing from the checks, which have the same vector.
//!
//! Memory is asked for as soon as it is known where a sample lies, long before that is worked out: otherwise pictures by value
//! take 1.05 to 1.08 times as long.

// No iterators and closures in vector code: what std calls might be compiled without the level's instructions.
#![allow(clippy::needless_range_loop, reason = "see above")]
#![expect(unsafe_code, reason = "see above")]

use std::hint::black_box;

use fearless_simd::{Bytes, Simd, SimdBase, SimdCombine, SimdMask, f32x4, f32x16, u16x8, u32x4, u32x16};

use super::lanes::LANES;

/// Panics unless every index is below a length.
#[inline(always)]
fn check<S: Simd>(indices: u32x16<S>, length: usize) {
    let length = u32::try_from(length).unwrap_or(u32::MAX);
    assert!(indices.simd_lt(length).all_true(), "an index lies beyond its table's end");
}

/// The numbers of a table.
#[inline(always)]
pub(super) fn numbers<S: Simd, T: Copy + Into<u32>>(simd: S, table: &[T], indices: u32x16<S>) -> u32x16<S> {
    check(indices, table.len());
    let indices: [u32; LANES] = black_box(indices.into());
    let mut quads = [u32x4::splat(simd, 0); 4];
    for quad in 0..4 {
        let mut found = [0; 4];
        for lane in 0..4 {
            // SAFETY: `check` has held all indices against the table's length.
            found[lane] = unsafe { *table.get_unchecked(indices[4 * quad + lane] as usize) }.into();
        }
        quads[quad] = u32x4::from_slice(simd, &found);
    }
    quads[0].combine(quads[1]).combine(quads[2].combine(quads[3]))
}

/// Numbers of a table, and the ones behind them.
#[inline(always)]
pub(super) fn pairs<S: Simd>(simd: S, table: &[f32], indices: u32x16<S>) -> [f32x16<S>; 2] {
    check(indices, table.len().saturating_sub(1));
    let indices: [u32; LANES] = black_box(indices.into());
    let zero = f32x4::splat(simd, 0.0);
    let mut halves = [zero.combine(zero).combine(zero.combine(zero)); 2];
    for half in 0..2 {
        let mut quarters = [zero; 4];
        for quarter in 0..4 {
            let lane = 8 * half + 2 * quarter;
            let (first, second) = (indices[lane] as usize, indices[lane + 1] as usize);
            // SAFETY: `check` has held all indices against one less than the table's length.
            let (first, second) =
                unsafe { (table.get_unchecked(first..first + 2), table.get_unchecked(second..second + 2)) };
            quarters[quarter] = f32x4::from_slice(simd, &[first[0], first[1], second[0], second[1]]);
        }
        halves[half] = quarters[0].combine(quarters[1]).combine(quarters[2].combine(quarters[3]));
    }
    let (first, second) = halves[0].deinterleave(halves[1]);
    [first, second]
}

/// Rows of a table, as columns.
#[inline(always)]
pub(super) fn columns<S: Simd>(simd: S, table: &[[f32; 4]], rows: u32x16<S>) -> [f32x16<S>; 4] {
    check(rows, table.len());
    let rows: [u32; LANES] = black_box(rows.into());
    let mut quads = [f32x16::splat(simd, 0.0); 4];
    for quad in 0..4 {
        let mut lanes = [f32x4::splat(simd, 0.0); 4];
        for lane in 0..4 {
            // SAFETY: `check` has held all rows against the table's length.
            let row = unsafe { table.get_unchecked(rows[4 * quad + lane] as usize) };
            lanes[lane] = f32x4::from_slice(simd, row);
        }
        quads[quad] = lanes[0].combine(lanes[1]).combine(lanes[2].combine(lanes[3]));
    }
    transposed(quads)
}

/// Where sixteen rows of texels begin.
pub(super) struct Firsts {
    lanes: [usize; LANES],
    most: usize,
}

impl Firsts {
    /// At voxels in a volume of so many along x and y.
    #[inline(always)]
    pub(super) fn new<S: Simd>(voxels: [u32x16<S>; 3], [width, height]: [usize; 2]) -> Self {
        let [x, y, z] = voxels;
        let (x, y, z): ([u32; LANES], [u32; LANES], [u32; LANES]) = (x.into(), y.into(), z.into());
        let (x, y, z) = black_box((x, y, z));
        let (mut lanes, mut most) = ([0; LANES], 0);
        for lane in 0..LANES {
            lanes[lane] = (z[lane] as usize * height + y[lane] as usize) * width + x[lane] as usize;
            most = most.max(lanes[lane]);
        }
        Self { lanes, most }
    }
}

/// Asks for the memory in which the first numbers lie, where that can be done; whether there are any does not matter.
#[inline(always)]
pub(super) fn ask_for<T>(numbers: &[T], firsts: &Firsts) {
    #[cfg(target_arch = "x86_64")]
    for lane in 0..LANES {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let first = numbers.as_ptr().wrapping_add(firsts.lanes[lane]);
        // SAFETY: all processors of this architecture have the instruction, and it reads nothing, wherever the pointer points to.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(first.cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (numbers, firsts);
}

/// Pairs of texels that begin so far behind given ones, as words: value and distance of the first, its gradient magnitude and
/// normal, and those of the second; that is the first again where there is but one along a row.
#[inline(always)]
pub(super) fn texel_pairs<S: Simd>(
    simd: S,
    texels: &[[u16; 4]],
    firsts: &Firsts,
    offset: usize,
    is_one: bool,
) -> [u32x16<S>; 4] {
    let count = 2 - usize::from(is_one);
    assert!(
        firsts.most < texels.len() && offset < texels.len() && offset + count <= texels.len() - firsts.most,
        "a texel lies beyond the volume's end"
    );
    let mut quads = [u32x16::splat(simd, 0); 4];
    for quad in 0..4 {
        let mut lanes = [u32x4::splat(simd, 0); 4];
        for lane in 0..4 {
            let first = firsts.lanes[4 * quad + lane] + offset;
            // SAFETY: no lane is larger than `most`, `count` texels behind which have been held against the volume's end.
            let found = unsafe { texels.get_unchecked(first..first + count) };
            lanes[lane] = if is_one {
                u16x8::from_slice(simd, [found[0]; 2].as_flattened()).bitcast()
            } else {
                u16x8::from_slice(simd, found.as_flattened()).bitcast()
            };
        }
        quads[quad] = lanes[0].combine(lanes[1]).combine(lanes[2].combine(lanes[3]));
    }
    transposed(quads)
}

/// Numbers that lie so far behind given ones, and above them the ones behind those.
#[inline(always)]
pub(super) fn halves<S: Simd>(simd: S, numbers: &[u16], firsts: &Firsts, offset: usize) -> u32x16<S> {
    assert!(
        firsts.most < numbers.len() && offset < numbers.len() && offset + 2 <= numbers.len() - firsts.most,
        "a number lies beyond the volume's end"
    );
    let mut quads = [u32x4::splat(simd, 0); 4];
    for quad in 0..4 {
        let mut found = [0; 4];
        for lane in 0..4 {
            let first = firsts.lanes[4 * quad + lane] + offset;
            // SAFETY: no lane is larger than `most`, two numbers behind which have been held against the end.
            let pair = unsafe { numbers.get_unchecked(first..first + 2) };
            found[lane] = u32::from(pair[0]) | u32::from(pair[1]) << 16;
        }
        quads[quad] = u32x4::from_slice(simd, &found);
    }
    quads[0].combine(quads[1]).combine(quads[2].combine(quads[3]))
}

/// Of sixteen rows, four in each vector, the columns.
#[inline(always)]
fn transposed<S: Simd, V: SimdBase<S>>(quads: [V; 4]) -> [V; 4] {
    let (even_low, odd_low) = quads[0].deinterleave(quads[1]);
    let (even_high, odd_high) = quads[2].deinterleave(quads[3]);
    let (first, third) = even_low.deinterleave(even_high);
    let (second, fourth) = odd_low.deinterleave(odd_high);
    [first, second, third, fourth]
}

#[cfg(test)]
mod tests {
    use fearless_simd::dispatch;
    use voxrole_preprocess::simd;

    use super::*;

    const INDICES: [u32; LANES] = [3, 19, 0, 7, 7, 11, 2, 5, 18, 1, 4, 6, 9, 8, 10, 12];

    /// Runs under Miri too: `cargo +nightly miri test -p voxrole-viewer --no-default-features --lib -- gathers`.
    #[test]
    fn what_is_found_is_what_the_table_holds() {
        let bytes: Vec<u8> = (0..20).map(|index| 255 - index).collect();
        let floats: Vec<f32> = (0..21_u16).map(|index| f32::from(index) + 0.5).collect();
        let rows: Vec<[f32; 4]> =
            (0..20_u16).map(|row| [0, 1, 2, 3].map(|column| f32::from(4 * row + column))).collect();
        let texels: Vec<[u16; 4]> = (0..39).map(|row| [0, 1, 2, 3].map(|column| 1000 * row + column)).collect();
        dispatch!(simd::level(), simd => {
            let indices = u32x16::from_slice(simd, &INDICES);
            let found: [u32; LANES] = numbers(simd, &bytes, indices).into();
            assert_eq!(found, INDICES.map(|index| u32::from(bytes[index as usize])));
            let [first, second]: [[f32; LANES]; 2] = pairs(simd, &floats, indices).map(Into::into);
            assert_eq!(first, INDICES.map(|index| floats[index as usize]));
            assert_eq!(second, INDICES.map(|index| floats[index as usize + 1]));
            for (column, found) in columns(simd, &rows, indices).into_iter().enumerate() {
                let found: [f32; LANES] = found.into();
                assert_eq!(found, INDICES.map(|row| rows[row as usize][column]));
            }
            let halves_of: Vec<u16> = (0..40).map(|number| 1000 + 7 * number).collect();
            // Two to a row and to a column.
            let firsts = Firsts::new([indices & 1, indices >> 1 & 1, indices >> 2], [2, 2]);
            for (is_one, next) in [(false, 1), (true, 0)] {
                let words: [[u32; LANES]; 4] = texel_pairs(simd, &texels, &firsts, 18, is_one).map(Into::into);
                for lane in 0..LANES {
                    let word = |[low, high]: [u16; 2]| u32::from(low) | u32::from(high) << 16;
                    let [a, b, c, d] = texels[INDICES[lane] as usize + 18];
                    assert_eq!([words[0][lane], words[1][lane]], [word([a, b]), word([c, d])]);
                    let [a, b, c, d] = texels[INDICES[lane] as usize + 18 + next];
                    assert_eq!([words[2][lane], words[3][lane]], [word([a, b]), word([c, d])]);
                }
            }
            let found: [u32; LANES] = halves(simd, &halves_of, &firsts, 19).into();
            for lane in 0..LANES {
                let first = INDICES[lane] as usize + 19;
                assert_eq!(found[lane], u32::from(halves_of[first]) | u32::from(halves_of[first + 1]) << 16);
            }
        });
    }

    #[test]
    fn no_index_beyond_the_end_is_followed() {
        fn is_refused(of: impl Fn([u32; LANES]) + std::panic::RefUnwindSafe) {
            for (lane, index) in (0..LANES).flat_map(|lane| [4, 1 << 31, u32::MAX].map(|index| (lane, index))) {
                let mut indices = [0; LANES];
                indices[lane] = index;
                assert!(std::panic::catch_unwind(|| of(indices)).is_err(), "{index} in lane {lane}");
            }
        }
        is_refused(|indices| {
            dispatch!(simd::level(), simd => { numbers(simd, &[0_u32; 4], u32x16::from_slice(simd, &indices)); });
        });
        is_refused(|indices| {
            dispatch!(simd::level(), simd => { pairs(simd, &[0.0; 5], u32x16::from_slice(simd, &indices)); });
        });
        is_refused(|indices| {
            dispatch!(simd::level(), simd => { pairs(simd, &[], u32x16::from_slice(simd, &indices)); });
        });
        is_refused(|indices| {
            dispatch!(simd::level(), simd => { columns(simd, &[[0.0; 4]; 4], u32x16::from_slice(simd, &indices)); });
        });
        for (length, offset, is_one) in
            [(6, 1, false), (5, 1, true), (4, 0, true), (0, 0, true), (9, usize::MAX, true), (9, usize::MAX - 1, false)]
        {
            is_refused(move |indices| {
                dispatch!(simd::level(), simd => {
                    let zero = u32x16::splat(simd, 0);
                    let firsts = Firsts::new([u32x16::from_slice(simd, &indices), zero, zero], [1, 1]);
                    texel_pairs(simd, &vec![[0; 4]; length], &firsts, offset, is_one);
                });
            });
        }
        for (length, offset) in [(6, 1), (5, 0), (0, 0), (9, usize::MAX), (9, usize::MAX - 1)] {
            is_refused(move |indices| {
                dispatch!(simd::level(), simd => {
                    let zero = u32x16::splat(simd, 0);
                    let firsts = Firsts::new([u32x16::from_slice(simd, &indices), zero, zero], [1, 1]);
                    halves(simd, &vec![0; length], &firsts, offset);
                });
            });
        }
    }

    #[test]
    #[cfg_attr(miri, ignore = "there are no caches")]
    fn memory_can_be_asked_for_wherever_it_is() {
        let firsts = Firsts { lanes: [usize::MAX; LANES], most: usize::MAX };
        ask_for::<[u16; 4]>(&[], &firsts);
        ask_for(&[1_u16; 40], &firsts);
    }
}
