//! Noise by counting, so that a voxel's noise depends on the seed and the voxel alone.

use std::f64::consts::TAU;

/// How noise changes a value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum NoiseKind {
    /// A normally distributed number is added.
    #[default]
    Gaussian,
    /// The magnitude of a complex number whose two parts carry Gaussian noise of the same deviation, as of magnetic
    /// resonance: `√((v + n₁)² + n₂²)`, never negative, with a mean above `v` where the signal is weak.
    ///
    /// Source: Gudbjartsson and Patz, The Rician distribution of noisy MRI data, Magn. Reson. Med. 34(6), 1995.
    Rician,
}

impl NoiseKind {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Gaussian, Self::Rician];

    /// The name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Gaussian => "gaussian",
            Self::Rician => "rician",
        }
    }

    /// The kind that [`Self::name`] gives `name`.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// `value` with noise of deviation `sigma`, for voxel `index`: the same number for the same seed and voxel, independent of
    /// every other's.
    #[must_use]
    pub fn apply(self, value: f64, sigma: f64, seed: u64, index: u64) -> f64 {
        match self {
            Self::Gaussian => value + sigma * standard_normal(seed, index),
            Self::Rician => {
                let [real, imaginary] = standard_normals(seed, index).map(|normal| sigma * normal);
                ((value + real) * (value + real) + imaginary * imaginary).sqrt()
            }
        }
    }
}

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
    let (radius, angle) = polar(seed, index);
    radius * libm::cos(angle)
}

/// Two independent normally distributed numbers for voxel `index`; the first is [`standard_normal`].
fn standard_normals(seed: u64, index: u64) -> [f64; 2] {
    let (radius, angle) = polar(seed, index);
    [radius * libm::cos(angle), radius * libm::sin(angle)]
}

/// The point of the plane that Box and Muller's transform makes of two outputs of splitmix64.
fn polar(seed: u64, index: u64) -> (f64, f64) {
    // Seeds 0, 1, 2, … are spread first, so that neighbouring seeds do not give shifted copies of one stream.
    let stream = splitmix64(seed, 0);
    let radius = (-2.0 * libm::log(unit_interval(splitmix64(stream, 2 * index)))).sqrt();
    (radius, TAU * unit_interval(splitmix64(stream, 2 * index + 1)))
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

    #[test]
    fn rician_moments_are_those_of_the_distribution() {
        let (count, sigma) = (200_000_u64, 0.2);
        let moments = |value: f64| {
            let samples = (0..count).map(|index| NoiseKind::Rician.apply(value, sigma, 5, index));
            let (first, second) = samples.fold((0.0, 0.0), |(first, second), x| (first + x, second + x * x));
            let (mean, square) = (first / count as f64, second / count as f64);
            (mean, square - mean * mean)
        };
        // Four standard errors of mean and variance.
        let standard_error = 4.0 * sigma / (count as f64).sqrt();
        // Without signal the Rayleigh distribution: mean σ√(π/2), variance (2 − π/2)σ².
        let (mean, variance) = moments(0.0);
        assert!((mean - sigma * std::f64::consts::FRAC_PI_2.sqrt()).abs() < standard_error, "{mean}");
        assert!((variance / ((2.0 - std::f64::consts::FRAC_PI_2) * sigma * sigma) - 1.0).abs() < 0.02, "{variance}");
        // With a strong one nearly normal: mean v + σ²/2v, variance σ² − σ⁴/2v².
        let (mean, variance) = moments(4.0);
        assert!((mean - 4.0 - sigma * sigma / 8.0).abs() < standard_error, "{mean}");
        assert!((variance / (sigma * sigma) - 1.0 + sigma * sigma / 32.0).abs() < 0.015, "{variance}");
        // Signal as strong as the noise: mean σ·1.548572 (from the Laguerre polynomial), second moment v² + 2σ².
        let (mean, variance) = moments(sigma);
        assert!((mean / sigma - 1.548_572).abs() < standard_error / sigma, "{mean}");
        assert!(((variance + mean * mean) / (3.0 * sigma * sigma) - 1.0).abs() < 0.01, "{variance}");
    }

    #[test]
    fn both_parts_of_rician_noise_are_normal_and_independent() {
        let count = 200_000_u64;
        let [mut mean, mut square, mut product] = [0.0_f64; 3];
        for index in 0..count {
            let [real, imaginary] = standard_normals(11, index);
            assert_eq!(real, standard_normal(11, index));
            mean += imaginary;
            square += imaginary * imaginary;
            product += real * imaginary;
        }
        let n = count as f64;
        assert!((mean / n).abs() < 4.0 / n.sqrt() && (product / n).abs() < 4.0 / n.sqrt(), "{mean} {product}");
        assert!((square / n - 1.0).abs() < 4.0 * (2.0 / n).sqrt(), "{square}");
    }

    #[test]
    fn the_bits_are_the_same_on_every_platform() {
        let bits = [0, 1, 1 << 40].map(|index| NoiseKind::Rician.apply(0.25, 0.1, 42, index).to_bits());
        assert_eq!(bits, [4_600_745_356_751_207_424, 4_600_207_997_663_620_393, 4_598_623_389_036_751_871]);
    }
}
