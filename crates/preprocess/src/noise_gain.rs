//! How much of the value's noise reaches its derivatives.

use crate::Result;
use crate::bspline::Coefficients;
use crate::differentiation::Kernel;
use crate::gaussian::{gaussian, radius_of};
use crate::padded_field::{PADDING, PaddedField};
use crate::separable_derivative::SeparableKernel;
use crate::working_field::Field;

/// Voxels over which the impulse response of a recursive filter decays: 0.43³² is 2e-12.
const DECAY: usize = 32;

/// Standard deviations of derivatives where the value is white noise of deviation 1 and nothing else.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseGain {
    /// Of a component of the gradient, per L_min: the largest of the three.
    pub gradient: f32,
    /// Of a second derivative along an axis, per L_min squared: the largest of the three.
    pub second_derivative: f32,
}

impl NoiseGain {
    /// The gains of a kernel after Gaussians of the given σ in multiples of L_min, as is `spacing`: the norms of the
    /// impulse responses.
    ///
    /// # Errors
    /// [`crate::Error::Pack`] when memory runs out.
    pub fn new(kernel: Kernel, sigmas: &[f32], spacing: [f32; 3]) -> Result<Self> {
        let mut axes = [Norms::default(); 3];
        for (norms, spacing) in axes.iter_mut().zip(spacing) {
            *norms = Norms::new(kernel, sigmas, spacing)?;
        }
        let largest = |of: fn(&Norms) -> f32| {
            let along = |axis: usize| {
                (0..3).fold(1.0, |product, other| {
                    product * if other == axis { of(&axes[axis]) } else { axes[other].value }
                })
            };
            (0..3).map(along).fold(0.0, f32::max)
        };
        Ok(Self { gradient: largest(|norms| norms.first), second_derivative: largest(|norms| norms.second) })
    }
}

/// Norms of one axis' impulse responses.
#[derive(Clone, Copy, Default)]
struct Norms {
    value: f32,
    first: f32,
    second: f32,
}

impl Norms {
    fn new(kernel: Kernel, sigmas: &[f32], spacing: f32) -> Result<Self> {
        let own = if let Kernel::Gaussian(sigma) = kernel { Some(sigma as f32) } else { None };
        let sigmas: Vec<f32> = sigmas.iter().copied().chain(own).collect();
        let reach: usize = sigmas.iter().map(|&sigma| radius_of(sigma, [spacing; 3])).sum();
        let middle = reach + DECAY;
        let mut line = Field::zeros((1, 1, 2 * middle + 1));
        line[[0, 0, middle]] = 1.0;
        for sigma in sigmas {
            line = gaussian(&line, [spacing; 3], sigma, radius_of(sigma, [spacing; 3]));
        }
        let norm = |values: &[f32]| values.iter().map(|value| value * value).sum::<f32>().sqrt();
        let value = norm(line.as_slice().unwrap_or_default());
        let (field, weights) = match kernel.spline() {
            Some(degree) => (Coefficients::new(line, degree)?.field, SeparableKernel::spline(degree)),
            None if kernel == Kernel::Central2 => (PaddedField::new(&line)?, SeparableKernel::CENTRAL_2),
            None => (PaddedField::new(&line)?, SeparableKernel::CENTRAL_4),
        };
        let [row, slice] = field.strides();
        let start = PADDING * (row + slice);
        let samples = &field.values()[start..start + row];
        let respond = |[own, next, after]: [f32; 3], sign: f32| {
            let response = samples
                .windows(5)
                .map(|taps| own * taps[2] + next * (taps[3] + sign * taps[1]) + after * (taps[4] + sign * taps[0]));
            norm(&response.collect::<Vec<_>>())
        };
        Ok(Self {
            value,
            first: respond(weights.first, -1.0) / spacing,
            second: respond(weights.second, 1.0) / (spacing * spacing),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_of_differences_are_their_norms() {
        let gain = NoiseGain::new(Kernel::Central2, &[], [1.0; 3]).expect("fits");
        assert!(
            (gain.gradient - 0.5_f32.sqrt()).abs() < 1e-6 && (gain.second_derivative - 6.0_f32.sqrt()).abs() < 1e-6
        );
        let gain = NoiseGain::new(Kernel::Central4, &[], [1.0, 2.0, 2.0]).expect("fits");
        assert!((gain.gradient - 130.0_f32.sqrt() / 12.0).abs() < 1e-6);
    }

    #[test]
    fn gains_of_splines_approach_those_of_ideal_differentiation() {
        let [cubic, quintic] = [Kernel::CubicSpline, Kernel::QuinticSpline]
            .map(|kernel| NoiseGain::new(kernel, &[], [1.0; 3]).expect("fits").gradient);
        // The norm of a band-limited differentiator is π/√3.
        let ideal = std::f32::consts::PI / 3.0_f32.sqrt();
        assert!(0.7 < cubic && cubic < quintic && quintic < ideal, "{cubic} {quintic}");
    }

    #[test]
    fn smoothing_tames_them_as_the_continuous_kernel_says() {
        // The norm of ∂G/∂x in three dimensions is √(1 / (16·π^{3/2}·σ⁵)), of ∂²G/∂x² √(3 / (32·π^{3/2}·σ⁷)).
        let sigma = 1.5_f32;
        let volume = std::f32::consts::PI.powf(1.5);
        let expected = [(16.0 * volume * sigma.powi(5)).sqrt().recip(), (3.0 / (32.0 * volume * sigma.powi(7))).sqrt()];
        for gain in [
            NoiseGain::new(Kernel::QuinticSpline, &[sigma], [1.0; 3]).expect("fits"),
            NoiseGain::new(Kernel::Gaussian(1.5), &[], [1.0; 3]).expect("fits"),
        ] {
            assert!((gain.gradient / expected[0] - 1.0).abs() < 0.01, "{gain:?}");
            assert!((gain.second_derivative / expected[1] - 1.0).abs() < 0.02, "{gain:?}");
        }
    }
}
