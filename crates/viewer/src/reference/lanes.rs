//! Vectors of eight numbers, one for each corner of a cell.
//!
//! Everything is summed in the same order for every width of vectors, and nothing is fused: the bits are the same on
//! every processor.

// No iterators and closures in vector code: what std calls might be compiled without the level's instructions.
#![allow(clippy::needless_range_loop, reason = "see above")]

use fearless_simd::{Simd, SimdBase, SimdCombine, SimdFloat, SimdSplit, f32x4, f32x8};

/// The sums of four vectors' numbers.
#[inline(always)]
pub(super) fn sums<S: Simd>(simd: S, vectors: [f32x8<S>; 4]) -> [f32; 4] {
    let mut halves = [f32x4::splat(simd, 0.0); 4];
    for vector in 0..4 {
        let (low, high) = vectors[vector].split();
        halves[vector] = low + high;
    }
    let [a, b, c, d] = transposed(halves);
    ((a + b) + (c + d)).into()
}

/// The columns of the eight rows of a table that are given by their numbers.
#[inline(always)]
pub(super) fn columns<S: Simd>(simd: S, table: &[[f32; 4]], rows: &[u32; 8]) -> [f32x8<S>; 4] {
    let zero = f32x4::splat(simd, 0.0);
    let [mut low, mut high] = [[zero; 4]; 2];
    for lane in 0..4 {
        low[lane] = f32x4::from_slice(simd, &table[rows[lane] as usize]);
        high[lane] = f32x4::from_slice(simd, &table[rows[lane + 4] as usize]);
    }
    let (low, high) = (transposed(low), transposed(high));
    [low[0].combine(high[0]), low[1].combine(high[1]), low[2].combine(high[2]), low[3].combine(high[3])]
}

#[inline(always)]
fn transposed<S: Simd>(rows: [f32x4<S>; 4]) -> [f32x4<S>; 4] {
    let (even_low, even_high) = rows[0].interleave(rows[2]);
    let (odd_low, odd_high) = rows[1].interleave(rows[3]);
    let (x, y) = even_low.interleave(odd_low);
    let (z, w) = even_high.interleave(odd_high);
    [x, y, z, w]
}

/// e to the power of negative numbers or 0, right to 1.2e-7.
#[inline(always)]
pub(super) fn exp_of_negative<S: Simd>(simd: S, number: f32x8<S>) -> f32x8<S> {
    /// Added to a number it leaves no bits behind its point, and the nearest integer in its lowest ones.
    const ROUND: f32 = 12_582_912.0;
    let power = (number * std::f32::consts::LOG2_E).max(f32x8::splat(simd, -126.0));
    let rounded = power + ROUND;
    let rest = power - (rounded - ROUND);
    // The Taylor series of 2^x, whose first term left out is below half a unit in the last place for |x| ≤ 1/2; in pairs,
    // which wait for each other less than a chain does.
    let [a, b, c, d, e, f, g, h] = SERIES;
    let square = rest * rest;
    let (high, low) = ((rest * a + b) * square + (rest * c + d), (rest * e + f) * square + (rest * g + h));
    let fraction = high * (square * square) + low;
    let exponent = rounded.to_bits() - (ROUND.to_bits() - 127);
    f32x8::from_bits(exponent << 23) * fraction
}

/// Powers of ln 2 over factorials, the highest first.
const SERIES: [f32; 8] = {
    let (mut series, mut power) = ([1.0; 8], 1.0);
    let mut exponent = 1;
    while exponent < 8 {
        power *= std::f64::consts::LN_2 / exponent as f64;
        series[7 - exponent] = power as f32;
        exponent += 1;
    }
    series
};

#[cfg(test)]
mod tests {
    use fearless_simd::dispatch;
    use voxrole_preprocess::simd;

    use super::*;

    #[test]
    fn powers_of_e_are_right() {
        let power = |number: f32| -> f32 {
            let powers: [f32; 8] =
                dispatch!(simd::level(), simd => exp_of_negative(simd, f32x8::splat(simd, number)).into());
            assert!(powers.iter().all(|power| *power == powers[0]));
            powers[0]
        };
        for step in 0..=87_000 {
            let number = -0.001 * step as f32;
            let off = (f64::from(power(number)) - f64::from(number).exp()).abs();
            assert!(off < 1.2e-7, "{number}: {off:e}");
        }
        assert_eq!(power(0.0), 1.0);
        assert!(power(-1e9) < 2e-38);
    }

    #[test]
    fn columns_and_sums_are_those_of_the_rows() {
        let table: Vec<[f32; 4]> =
            (0..20_u16).map(|row| [0, 1, 2, 3].map(|column| f32::from(4 * row + column))).collect();
        let rows = [3, 19, 0, 7, 7, 11, 2, 5];
        let (found, sums): ([[f32; 8]; 4], _) = dispatch!(simd::level(), simd => {
            let columns = columns(simd, &table, &rows);
            ([columns[0].into(), columns[1].into(), columns[2].into(), columns[3].into()], sums(simd, columns))
        });
        for (column, (found, sum)) in found.into_iter().zip(sums).enumerate() {
            assert_eq!(found, rows.map(|row| table[row as usize][column]));
            assert_eq!(sum, found.iter().sum::<f32>());
        }
    }
}
