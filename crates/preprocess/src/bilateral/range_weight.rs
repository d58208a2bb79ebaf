//! What a neighbour counts for: exp(−v) by its difference in value, v = (h(x) − h(y))²/2σr², times its spatial weight.

use std::fmt;

use serde::Serialize;

/// How range weights are computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum RangeWeights {
    /// By a polynomial; what the filter's result then deviates by, `Bilateral::deviation_bound` says.
    #[default]
    Fast,
    /// By the exponential, right to 1e-6 where v is below 7.
    Exact,
}

impl fmt::Display for RangeWeights {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Fast => "fast",
            Self::Exact => "exact",
        })
    }
}

/// The largest deviation, as a share of the field's range, up to which fast weights are used.
pub const LARGEST_DEVIATION: f64 = 1e-3;

/// What a result may be off by where moments replace the neighbours, as a share of the field's range. On top comes what
/// rounding does to their weights, 5e-6 of each; less than fast weights themselves are off by.
pub const TRUNCATION: f64 = 5e-5;

/// What fast weights differ from exp(−v) by: at most `RELATIVE_ERROR·exp(−v) + ABSOLUTE_ERROR`, for any v.
const RELATIVE_ERROR: f64 = 1.3e-4;
const ABSOLUTE_ERROR: f64 = 1e-6;

/// How far a result with fast weights is from one with exact weights at most, as a share of the field's range; rounding of
/// sums in f32 comes on top. `total` is the sum of all spatial weights, that of the voxel itself being 1.
///
/// With r the exact mean of the differences d in value, weighted by Wd·w, and weights W̃ = Wd·w̃ instead, the mean is off
/// by `Σ (W̃ − Wd·w)·(d − r) / Σ W̃`. Both d and r lie within the range R. `Σ Wd·w·|d − r| / Σ Wd·w` is a mean absolute
/// deviation, so at most R/2; and `Σ Wd·w` is at least 1, the voxel's own weight.
#[must_use]
pub fn deviation_bound(total: f64) -> f64 {
    let absolute = ABSOLUTE_ERROR * total;
    (RELATIVE_ERROR / 2.0 + absolute) / (1.0 - RELATIVE_ERROR - absolute)
}

/// `exp(−v) ≈ max(0, p(v))¹⁶` with a cubic p that falls all along, times the spatial weight, whose sixteenth root the
/// coefficients hold. Beyond v = 28.97 it is 0.
#[derive(Clone, Copy, Debug)]
pub struct FastWeight([f32; 4]);

impl FastWeight {
    /// Coefficients of p, from the linear program that leaves the most room below the errors above.
    const CUBIC: [f64; 4] = [0.999_992_228, -0.062_461_894_7, 1.923_192_43e-3, -3.309_331_32e-5];

    /// Of a neighbour of spatial weight exp(−`spatial`), with v = `falloff`·difference².
    #[must_use]
    pub fn new(spatial: f64, falloff: f64) -> Self {
        let root = libm::exp(-spatial / 16.0);
        let [constant, linear, quadratic, cubic] = Self::CUBIC;
        let scaled = [constant, linear * falloff, quadratic * falloff * falloff, cubic * falloff.powi(3)];
        Self(scaled.map(|coefficient| (root * coefficient) as f32))
    }

    /// The weight at a difference; 0 for differences of more than 1e18, of which the square may be infinite.
    #[must_use]
    #[inline(always)]
    pub fn at(&self, difference: f32) -> f32 {
        let [constant, linear, quadratic, cubic] = self.0;
        let squared = difference * difference;
        let root = constant + squared * (linear + squared * (quadratic + squared * cubic));
        // Unlike `f32::max`, a single instruction.
        let root = if root > 0.0 { root } else { 0.0 };
        let second = root * root;
        let fourth = second * second;
        let eighth = fourth * fourth;
        eighth * eighth
    }
}

/// `exp(−x)` for x ≥ 0 with a relative error below `(3 + x)·1e-7`; beyond x = 86, below 1e-37. Written so that it vectorises.
#[inline(always)]
pub fn exp_of_negative(x: f32) -> f32 {
    /// Adding 1.5·2²³ leaves a number's nearest integer in its low bits.
    const ROUND: f32 = 12_582_912.0;
    let exponent = (x * std::f32::consts::LOG2_E).min(124.0);
    let rounded = exponent + ROUND;
    let rest = (rounded - ROUND - exponent) * std::f32::consts::LN_2;
    // Taylor's series on ±ln2/2, where its next term is below 1.3e-7.
    let series = 1.0
        + rest * (1.0 + rest * (0.5 + rest * (1.0 / 6.0 + rest * (1.0 / 24.0 + rest * (1.0 / 120.0 + rest / 720.0)))));
    series * f32::from_bits(0x3f80_0000_u32.wrapping_sub(rounded.to_bits() << 23))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponential_is_accurate() {
        for i in 0..=85_000 {
            let x = i as f32 / 1000.0;
            let exact = (-f64::from(x)).exp();
            let error = (f64::from(exp_of_negative(x)) / exact - 1.0).abs();
            assert!(error < (3.0 + f64::from(x)) * 1e-7, "{x}: {error}");
        }
        assert!([86.0, 1e30, f32::INFINITY].map(exp_of_negative).iter().all(|&power| power < 1e-37));
    }

    #[test]
    fn fast_weights_keep_to_their_errors() {
        for (spatial, falloff) in [(0.0, 0.5), (1.5, 0.5), (13.5, 0.3), (37.5, 0.126)] {
            let weight = FastWeight::new(spatial, falloff);
            let mut before = f32::INFINITY;
            for step in 0..200_000 {
                let difference = step as f32 * 1e-4;
                let found = weight.at(difference);
                let exact = (-f64::from(difference).powi(2) * falloff).exp();
                let error = (f64::from(found) * spatial.exp() - exact).abs();
                assert!(error <= RELATIVE_ERROR * exact + ABSOLUTE_ERROR, "{difference}: {error}");
                assert!(found <= before * (1.0 + 1e-5), "{difference}: the weight grows");
                before = found;
            }
        }
    }

    #[test]
    fn far_differences_have_no_weight() {
        for falloff in [0.126, 0.5] {
            let weight = FastWeight::new(30.0, falloff);
            for difference in [30.0, 1e6, 1e18, 1e30, 1.7e38] {
                assert_eq!([difference, -difference].map(|difference| weight.at(difference)), [0.0; 2]);
            }
        }
    }

    #[test]
    fn the_bound_of_the_default_neighbourhood() {
        // σd = 1, radius 3.
        let line: f64 = (-3..=3).map(|steps: i32| (-0.5 * f64::from(steps * steps)).exp()).sum();
        let bound = deviation_bound(line.powi(3));
        assert!((8.0e-5..8.2e-5).contains(&bound), "{bound}");
    }
}
