//! exp(−(x − y)²/2) as a short sum of products of a function of x and one of y, for x and y in an interval.

/// The most terms that are used; more lose digits of f32.
pub const MOST_TERMS: usize = 48;

/// Mehler's formula (DLMF 18.18.28), cut after some terms and without the factor that x alone determines:
/// `exp(−(x − y)²/2) = c(x) · Σ h_k(x) · exp(−(1−ρ)·y²/2)·h_k(y)`, `c(x) = √(1−ρ²)·exp(−(1−ρ)·x²/2)`, where `h_0 = 1` and
/// `√(k+1)·h_{k+1}(x) = √(1−ρ²)·x·h_k(x) − ρ·√k·h_{k−1}(x)` are scaled Hermite polynomials. Of x = y the terms are
/// squares that add up to 1, so rounding does not grow, and by the Cauchy–Schwarz inequality what the sum lacks anywhere is
/// at most what it lacks for some x = y.
#[derive(Clone, Debug)]
pub struct Expansion {
    /// What y² is multiplied by in the functions of y.
    pub falloff: f32,
    /// `h_{k+1}(x) = forward·x·h_k(x) − backward·h_{k−1}(x)` for each k.
    pub recurrence: Vec<Recurrence>,
}

/// A step from one Hermite polynomial to the next, and back.
#[derive(Clone, Copy, Debug)]
pub struct Recurrence {
    /// See [`Expansion::recurrence`].
    pub forward: f32,
    /// See [`Expansion::recurrence`].
    pub backward: f32,
    /// `x·h_k(x) = higher·h_{k+1}(x) + lower·h_{k−1}(x)`.
    pub higher: f32,
    /// See [`Self::higher`].
    pub lower: f32,
}

impl Expansion {
    /// The expansion for x and y in ±`extent` that is off by at most `error`, or none if that takes too many terms.
    #[must_use]
    pub fn new(extent: f64, error: f64) -> Option<Self> {
        // Within a term or two of the best ratio for any extent.
        let ratio = extent / (extent + 9.0);
        let terms = terms_needed(extent, ratio, error / PROBES_MISS)?;
        let narrowing = (1.0 - ratio * ratio).sqrt();
        let step = |k: usize| {
            let (this, next) = ((k as f64).sqrt(), (k as f64 + 1.0).sqrt());
            Recurrence {
                forward: (narrowing / next) as f32,
                backward: (ratio * this / next) as f32,
                higher: (next / narrowing) as f32,
                lower: (ratio * this / narrowing) as f32,
            }
        };
        Some(Self { falloff: (0.5 * (1.0 - ratio)) as f32, recurrence: (0..terms).map(step).collect() })
    }

    /// How many products are added.
    #[must_use]
    pub fn terms(&self) -> usize {
        self.recurrence.len()
    }
}

/// Where in the interval it is checked what the sum lacks; denser towards its end.
const PROBES: [f64; 8] = [1.0, 0.974_928, 0.900_969, 0.781_831, 0.623_49, 0.433_884, 0.222_521, 0.0];

/// The sum may lack so much more in between.
const PROBES_MISS: f64 = 1.4;

/// Terms after which the sum for x = y lacks at most `error` at all probes.
fn terms_needed(extent: f64, ratio: f64, error: f64) -> Option<usize> {
    let narrowing = (1.0 - ratio * ratio).sqrt();
    let places = PROBES.map(|probe| probe * extent);
    let factors = places.map(|place| narrowing * libm::exp(-(1.0 - ratio) * place * place));
    let (mut before, mut this) = ([0.0; PROBES.len()], [1.0; PROBES.len()]);
    let mut lacking = [1.0; PROBES.len()];
    for k in 0..MOST_TERMS {
        let [forward, backward] = [narrowing, ratio * (k as f64).sqrt()].map(|step| step / (k as f64 + 1.0).sqrt());
        for probe in 0..PROBES.len() {
            lacking[probe] -= factors[probe] * this[probe] * this[probe];
            let next = forward * places[probe] * this[probe] - backward * before[probe];
            before[probe] = this[probe];
            this[probe] = next;
        }
        if lacking.iter().all(|&lacking| lacking <= error) {
            return Some(k + 1);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The expansion's sum, times the factor of x.
    fn sum(expansion: &Expansion, x: f64, y: f64) -> f64 {
        let ratio = 1.0 - 2.0 * f64::from(expansion.falloff);
        let factor = (1.0 - ratio * ratio).sqrt() * (-(1.0 - ratio) * (x * x + y * y) / 2.0).exp();
        let [mut before, mut this] = [[0.0; 2], [1.0; 2]];
        let mut sum = 0.0;
        for step in &expansion.recurrence {
            sum += factor * this[0] * this[1];
            let [forward, backward] = [step.forward, step.backward].map(f64::from);
            let next = [0, 1].map(|of| forward * [x, y][of] * this[of] - backward * before[of]);
            [before, this] = [this, next];
        }
        sum
    }

    #[test]
    fn expansions_keep_to_their_error() {
        for error in [1e-4, 3e-6, 1e-7] {
            for extent in (0..100).map(|step| 0.0013 * f64::from(step * step)) {
                let Some(expansion) = Expansion::new(extent, error) else { continue };
                for x in 0..=40 {
                    for y in -40..=40 {
                        let [x, y] = [x, y].map(|index| f64::from(index) / 40.0 * extent);
                        let exact = (-0.5 * (x - y) * (x - y)).exp();
                        let found = (sum(&expansion, x, y) - exact).abs();
                        // Coefficients are rounded to f32.
                        assert!(found <= error + 5e-6 * exact + 1e-7, "{extent}: {found}, not {error}");
                    }
                }
            }
        }
    }

    #[test]
    fn few_terms_are_enough() {
        let terms = |extent| Expansion::new(extent, 5e-6).map(|expansion| expansion.terms());
        assert_eq!([0.0, 0.25, 1.25, 2.5, 5.0, 20.0].map(terms), [Some(1), Some(4), Some(8), Some(14), Some(25), None]);
    }

    #[test]
    fn steps_lead_back() {
        let expansion = Expansion::new(2.0, 1e-6).expect("few terms");
        let x = 0.7;
        let [mut before, mut this] = [0.0, 1.0];
        for step in &expansion.recurrence {
            let next = step.forward * x * this - step.backward * before;
            assert!((x * this - (step.higher * next + step.lower * before)).abs() < 1e-6);
            [before, this] = [this, next];
        }
    }
}
