//! Basis weights of a spline's taps, all taps of an axis at once.

use fearless_simd::{Simd, SimdBase, f32x8};

use super::Degree;

/// Samples that a place depends on along an axis: six of a quintic spline, the middle four of a cubic one.
pub const TAPS: usize = 6;

/// Weights of an axis' taps for the value, the first and the second derivative per voxel; those of the last two lanes are 0.
pub type Weights<S> = [f32x8<S>; 3];

/// For value, first and second derivative the taps' coefficients of every power.
type Table = [[[f32; 8]; TAPS]; 3];

static CUBIC: Table = table(3);
static QUINTIC: Table = table(5);

/// The weights at a fraction of a cell.
///
/// Polynomials in the distance from the cell's middle, where they are well conditioned: right to a few units in the last
/// place of the largest weight.
#[inline(always)]
pub fn weights<S: Simd>(simd: S, degree: Degree, fraction: f32) -> Weights<S> {
    let x = fraction - 0.5;
    match degree {
        Degree::Cubic => {
            [horner::<4, S>(simd, &CUBIC[0], x), horner::<3, S>(simd, &CUBIC[1], x), horner::<2, S>(simd, &CUBIC[2], x)]
        }
        Degree::Quintic => [
            horner::<6, S>(simd, &QUINTIC[0], x),
            horner::<5, S>(simd, &QUINTIC[1], x),
            horner::<4, S>(simd, &QUINTIC[2], x),
        ],
    }
}

#[inline(always)]
fn horner<const TERMS: usize, S: Simd>(simd: S, coefficients: &[[f32; 8]; TAPS], x: f32) -> f32x8<S> {
    let mut sum = f32x8::from_slice(simd, &coefficients[TERMS - 1]);
    for power in (0..TERMS - 1).rev() {
        sum = sum * x + f32x8::from_slice(simd, &coefficients[power]);
    }
    sum
}

const fn table(degree: usize) -> Table {
    let mut polynomials = basis(degree);
    let mut table = [[[0.0; 8]; TAPS]; 3];
    let mut derivative = 0;
    while derivative < 3 {
        let mut tap = 0;
        while tap <= degree {
            let mut power = 0;
            while power < TAPS {
                // A cubic's four taps are the middle ones.
                table[derivative][power][tap + (5 - degree) / 2] = polynomials[tap][power] as f32;
                power += 1;
            }
            polynomials[tap] = differentiated(polynomials[tap]);
            tap += 1;
        }
        derivative += 1;
    }
    table
}

/// A polynomial by its coefficients, the constant first.
type Polynomial = [f64; TAPS];

/// The taps' polynomials, by the recursion over the degree of Cox and de Boor on equidistant knots.
const fn basis(degree: usize) -> [Polynomial; TAPS] {
    let mut lower = [[0.0; TAPS]; TAPS];
    lower[0][0] = 1.0;
    let mut n = 1;
    while n <= degree {
        let mut next = [[0.0; TAPS]; TAPS];
        let mut tap = 0;
        while tap <= n {
            // ((x + n − tap)·lower[tap − 1] + (1 + tap − x)·lower[tap]) / n, where x is the fraction.
            let (rising, falling) = ((n - tap) as f64 + 0.5, tap as f64 + 0.5);
            let mut power = 0;
            while power < TAPS {
                let mut sum = falling * lower[tap][power];
                if power > 0 {
                    sum -= lower[tap][power - 1];
                }
                if tap > 0 {
                    sum += rising * lower[tap - 1][power];
                    if power > 0 {
                        sum += lower[tap - 1][power - 1];
                    }
                }
                next[tap][power] = sum / n as f64;
                power += 1;
            }
            tap += 1;
        }
        lower = next;
        n += 1;
    }
    lower
}

const fn differentiated(polynomial: Polynomial) -> Polynomial {
    let mut derivative = [0.0; TAPS];
    let mut power = 1;
    while power < TAPS {
        derivative[power - 1] = power as f64 * polynomial[power];
        power += 1;
    }
    derivative
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd;

    fn weights(degree: Degree, fraction: f32) -> [[f32; 8]; 3] {
        fearless_simd::dispatch!(simd::level(), simd => {
            super::weights(simd, degree, fraction).map(|weights| weights.into())
        })
    }

    #[test]
    fn weights_at_samples_are_the_table_s() {
        for degree in [Degree::Cubic, Degree::Quintic] {
            for (derivative, found) in weights(degree, 0.0).into_iter().enumerate() {
                let sign = if derivative == 1 { -1.0 } else { 1.0 };
                let [own, next, after] = degree.at_samples()[derivative];
                let expected = [sign * after, sign * next, own, next, after, 0.0, 0.0, 0.0];
                assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 2e-7), "{degree:?} {found:?}");
            }
        }
    }

    #[test]
    fn weights_add_up_to_what_a_constant_has() {
        for degree in [Degree::Cubic, Degree::Quintic] {
            for fraction in [0.0, 0.2, 0.5, 0.9, 1.0] {
                let sums = weights(degree, fraction).map(|taps| taps.iter().map(|&w| f64::from(w)).sum::<f64>());
                for (sum, expected) in sums.into_iter().zip([1.0, 0.0, 0.0]) {
                    assert!((sum - expected).abs() < 3e-7, "{degree:?} at {fraction}: {sums:?}");
                }
            }
        }
    }
}
