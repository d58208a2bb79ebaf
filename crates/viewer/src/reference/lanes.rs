//! Vectors of sixteen numbers, one for each of the rays or samples that are worked out side by side.
//!
//! Every lane is on its own and nothing is fused: the bits are the same on every processor, and whatever lies beside.

// No iterators and closures in vector code: what std calls might be compiled without the level's instructions.
#![allow(clippy::needless_range_loop, reason = "see above")]

use fearless_simd::{Select, Simd, SimdBase, SimdFloat, SimdInt, SimdInterleaved, SimdSplit, f32x4, f32x16};
use glam::Vec3;

/// How many lie side by side.
pub(super) const LANES: usize = 16;

/// Vectors in space.
pub(super) type Directions<S> = [f32x16<S>; 3];

/// The same number in every lane.
#[inline(always)]
pub(super) fn splat<S: Simd>(simd: S, number: f32) -> f32x16<S> {
    f32x16::splat(simd, number)
}

/// The same vector in every lane.
#[inline(always)]
pub(super) fn splat_vector<S: Simd>(simd: S, vector: Vec3) -> Directions<S> {
    [splat(simd, vector.x), splat(simd, vector.y), splat(simd, vector.z)]
}

/// Products of vectors in space.
#[inline(always)]
pub(super) fn dot<S: Simd>(a: &Directions<S>, b: &Directions<S>) -> f32x16<S> {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Lengths of 1 for vectors in space, or 0 for those whose squared length is not above `least`.
#[inline(always)]
pub(super) fn unit_or_zero<S: Simd>(simd: S, vectors: &Directions<S>, least: f32) -> Directions<S> {
    let squared = dot(vectors, vectors);
    let share = squared.simd_gt(least).select(1.0 / squared.sqrt(), splat(simd, 0.0));
    [vectors[0] * share, vectors[1] * share, vectors[2] * share]
}

/// Writes vectors as the columns of rows.
#[inline(always)]
pub(super) fn store_columns<S: Simd>(simd: S, columns: [f32x16<S>; 4], rows: &mut [[f32; 4]]) {
    let mut quads = [[f32x4::splat(simd, 0.0); 4]; 4];
    for column in 0..4 {
        let (low, high) = columns[column].split();
        let ((first, second), (third, fourth)) = (low.split(), high.split());
        for (quad, four) in [first, second, third, fourth].into_iter().enumerate() {
            quads[quad][column] = four;
        }
    }
    for quad in 0..4 {
        f32x4::store_four_interleaved(quads[quad], rows[4 * quad..4 * quad + 4].as_flattened_mut());
    }
}

/// e to the power of negative numbers or 0, right to 1.2e-7.
#[inline(always)]
pub(super) fn exp_of_negative<S: Simd>(simd: S, number: f32x16<S>) -> f32x16<S> {
    /// Added to a number it leaves no bits behind its point, and the nearest integer in its lowest ones.
    const ROUND: f32 = 12_582_912.0;
    let power = (number * std::f32::consts::LOG2_E).max(splat(simd, -126.0));
    let rounded = power + ROUND;
    let rest = power - (rounded - ROUND);
    // The Taylor series of 2^x, whose first term left out is below half a unit in the last place for |x| ≤ 1/2; in pairs,
    // which wait for each other less than a chain does.
    let [a, b, c, d, e, f, g, h] = SERIES;
    let square = rest * rest;
    let (high, low) = ((rest * a + b) * square + (rest * c + d), (rest * e + f) * square + (rest * g + h));
    let fraction = high * (square * square) + low;
    let exponent = rounded.to_bits() - (ROUND.to_bits() - 127);
    f32x16::from_bits(exponent << 23) * fraction
}

/// Numbers from 0 to 1 to positive powers, right to 3e-7.
#[inline(always)]
pub(super) fn power<S: Simd>(simd: S, number: f32x16<S>, exponent: f32x16<S>) -> f32x16<S> {
    // m · 2^e with m from √½ to √2; ln m = 2 artanh((m − 1)/(m + 1)).
    let bits = number.to_bits() + (1.0_f32.to_bits() - std::f32::consts::FRAC_1_SQRT_2.to_bits());
    let exponents = (bits >> 23).to_float::<f32x16<S>>() - 127.0;
    let mantissa = f32x16::from_bits((bits & 0x007f_ffff) + std::f32::consts::FRAC_1_SQRT_2.to_bits());
    let share = (mantissa - 1.0) / (mantissa + 1.0);
    let square = share * share;
    let series = ((square * (1.0 / 9.0) + 1.0 / 7.0) * square + 1.0 / 5.0) * square + 1.0 / 3.0;
    let logarithm = exponents * std::f32::consts::LN_2 + (2.0 * share + 2.0 * share * square * series);
    let found = exp_of_negative(simd, (exponent * logarithm).min(splat(simd, 0.0)));
    number.simd_gt(0.0).select(found, splat(simd, 0.0))
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
            let powers: [f32; LANES] =
                dispatch!(simd::level(), simd => exp_of_negative(simd, splat(simd, number)).into());
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
    fn powers_are_right() {
        for step in 0..=4096 {
            let number = step as f32 / 4096.0;
            for exponent in [1.0 / 64.0, 0.25, 0.7, 1.0, 3.0, 16.0] {
                let powers: [f32; LANES] =
                    dispatch!(simd::level(), simd => power(simd, splat(simd, number), splat(simd, exponent)).into());
                let off = (f64::from(powers[0]) - f64::from(number).powf(f64::from(exponent))).abs();
                assert!(off < 3e-7, "{number} ^ {exponent}: {off:e}");
            }
        }
    }

    #[test]
    fn columns_are_written_as_rows() {
        let columns: [[f32; LANES]; 4] =
            std::array::from_fn(|column| std::array::from_fn(|row| (4 * row + column) as f32));
        let mut rows = [[0.0; 4]; LANES];
        dispatch!(simd::level(), simd => {
            let [a, b, c, d] = &columns;
            let vectors = [a, b, c, d].map(|column| f32x16::from_slice(simd, column));
            store_columns(simd, vectors, &mut rows);
        });
        assert!(rows.as_flattened().iter().enumerate().all(|(index, number)| *number == index as f32));
    }

    #[test]
    fn vectors_get_length_1() {
        let vector = Vec3::new(0.3, -4.0, 0.02);
        let found = |vector: Vec3| -> [[f32; LANES]; 3] {
            dispatch!(simd::level(), simd => {
                unit_or_zero(simd, &splat_vector(simd, vector), 1e-8).map(Into::into)
            })
        };
        let unit = found(vector).map(|axis| axis[5]);
        assert!((Vec3::from_array(unit) - vector.normalize()).length() < 1e-6);
        assert_eq!(found(1e-5 * vector), [[0.0; LANES]; 3]);
    }
}
