//! Gaussian noise by counting, so that a voxel's noise depends on the seed and the voxel alone.

use std::f64::consts::TAU;

/// The step of splitmix64's counter, 2⁶⁴ divided by the golden ratio.
const GOLDEN_GAMMA: u64 = 0x9E37_79B9_7F4A_7C15;

/// The `counter`-th output of splitmix64 started at `seed`.
///
/// Steele, Lea, Flood: Fast splittable pseudorandom number generators, OOPSLA 2014.
fn splitmix64(seed: u64, counter: u64) -> u64 {
    let mut bits = seed.wrapping_add(counter.wrapping_add(1).wrapping_mul(GOLDEN_GAMMA));
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    bits ^ (bits >> 31)
}

/// A number in (0, 1] from the top 53 bits.
fn unit_interval(bits: u64) -> f64 {
    ((bits >> 11) + 1) as f64 / (1_u64 << 53) as f64
}

/// A normally distributed number of mean 0 and deviation 1 for voxel `index`.
///
/// Box and Muller's transform of two outputs of splitmix64. The same for any order of calls, and on every platform,
/// because the logarithm and the cosine come from a portable library.
pub(super) fn standard_normal(seed: u64, index: u64) -> f64 {
    // Seeds 0, 1, 2, … are spread first, so that neighbouring seeds do not give shifted copies of one stream.
    let stream = splitmix64(seed, 0);
    let radius = (-2.0 * libm::log(unit_interval(splitmix64(stream, 2 * index)))).sqrt();
    radius * libm::cos(TAU * unit_interval(splitmix64(stream, 2 * index + 1)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splitmix64_gives_its_published_sequence() {
        // First outputs for seed 1234567, as printed for the reference implementation.
        let expected = [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423];
        assert_eq!([0, 1, 2].map(|counter| splitmix64(1_234_567, counter)), expected);
    }

    #[test]
    fn moments_are_those_of_the_normal_distribution() {
        let count = 200_000_u64;
        let [mut first, mut second, mut fourth, mut lagged] = [0.0_f64; 4];
        let mut previous = 0.0;
        for index in 0..count {
            let sample = standard_normal(7, index);
            first += sample;
            second += sample * sample;
            fourth += sample.powi(4);
            lagged += sample * previous;
            previous = sample;
        }
        let n = count as f64;
        // Four standard errors each: 1/√n, √(2/n), √(96/n), 1/√n.
        assert!((first / n).abs() < 4.0 / n.sqrt(), "mean {}", first / n);
        assert!((second / n - 1.0).abs() < 4.0 * (2.0 / n).sqrt(), "variance {}", second / n);
        assert!((fourth / n - 3.0).abs() < 4.0 * (96.0 / n).sqrt(), "fourth moment {}", fourth / n);
        assert!((lagged / n).abs() < 4.0 / n.sqrt(), "correlation of neighbours {}", lagged / n);
    }

    #[test]
    fn seeds_differ() {
        assert!((0..100).all(|index| standard_normal(1, index) != standard_normal(2, index)));
        assert!((0..100).all(|index| standard_normal(1, index) != standard_normal(2, index + 1)));
    }
}
