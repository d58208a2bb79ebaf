//! How much of the value's noise reaches its derivatives.

use crate::Result;
use crate::bspline::Coefficients;
use crate::differentiation::Kernel;
use crate::gaussian::{gaussian, radius_of};
use crate::padded_field::{PADDING, PaddedField};
use crate::separable_derivative::SeparableKernel;
use crate::working_field::Field;

/// Voxels over which the impulse response of a spline's filter decays: 0.43³² is 2e-12.
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
    /// The gains of a kernel after Gaussians of the given σ in multiples of L_min, as is `spacing`, far from every face:
    /// the norms of the impulse responses.
    ///
    /// # Errors
    /// [`crate::Error::Pack`] when memory runs out.
    pub fn new(kernel: Kernel, sigmas: &[f32], spacing: [f32; 3]) -> Result<Self> {
        let mut axes = [[0.0; 3]; 3];
        for (norms, spacing) in axes.iter_mut().zip(spacing) {
            let line = Line::new(kernel, sigmas, spacing);
            let middle = line.reach();
            *norms = line.responses(middle, 2 * middle + 1)?.map(|response| norm(&response));
        }
        let largest = |order: usize| {
            let along =
                |axis: usize| (0..3).map(|other| axes[other][if other == axis { order } else { 0 }]).product::<f32>();
            (0..3).map(along).fold(0.0, f32::max)
        };
        Ok(Self { gradient: largest(1), second_derivative: largest(2) })
    }
}

/// How large the gradient is that noise alone makes, voxel by voxel: near the faces kernels average over fewer samples.
#[derive(Clone, Debug)]
pub struct GradientNoise {
    /// By axis and depth below the nearer face: the gains of the value and of the first derivative. The last depth stands
    /// for all beyond.
    axes: [Vec<[f32; 2]>; 3],
    dims: [usize; 3],
    noise: f32,
    /// See [`Self::least`].
    least: f32,
}

impl GradientNoise {
    /// The noise of a kernel's gradient after Gaussians of the given σ, on a volume of `dims` voxels whose value has white
    /// noise of deviation `noise`.
    ///
    /// # Errors
    /// [`crate::Error::Pack`] when memory runs out.
    pub fn new(kernel: Kernel, sigmas: &[f32], spacing: [f32; 3], dims: [usize; 3], noise: f32) -> Result<Self> {
        let mut axes = [const { Vec::new() }; 3];
        for ((gains, spacing), len) in axes.iter_mut().zip(spacing).zip(dims) {
            *gains = Line::new(kernel, sigmas, spacing).gains_by_depth(len)?;
        }
        let least = axes.each_ref().map(|gains: &Vec<[f32; 2]>| {
            gains.iter().fold([f32::INFINITY; 2], |[value, first], gain| [value.min(gain[0]), first.min(gain[1])])
        });
        Ok(Self { axes, dims, noise, least: noisiest(noise, least) })
    }

    /// A bound that [`Self::at`] is nowhere below.
    #[inline]
    #[must_use]
    pub fn least(&self) -> f32 {
        self.least
    }

    /// The standard deviation of the noisiest component of the gradient at a voxel.
    #[inline(always)]
    #[must_use]
    pub fn at(&self, voxel: [usize; 3]) -> f32 {
        let gains = |axis: usize| {
            let depth = voxel[axis].min(self.dims[axis] - 1 - voxel[axis]);
            self.axes[axis][depth.min(self.axes[axis].len() - 1)]
        };
        noisiest(self.noise, [gains(0), gains(1), gains(2)])
    }
}

/// The noise of the noisiest component of a gradient, by the gains along each axis; one order of products, so that rounding is
/// the same for all.
#[inline(always)]
fn noisiest(noise: f32, [[x, along_x], [y, along_y], [z, along_z]]: [[f32; 2]; 3]) -> f32 {
    noise * (along_x * y * z).max(x * along_y * z).max(x * y * along_z)
}

/// What happens to the value along one axis.
struct Line {
    kernel: Kernel,
    sigmas: Vec<f32>,
    spacing: f32,
}

impl Line {
    fn new(kernel: Kernel, sigmas: &[f32], spacing: f32) -> Self {
        let own = if let Kernel::Gaussian(sigma) = kernel { Some(sigma as f32) } else { None };
        Self { kernel, sigmas: sigmas.iter().copied().chain(own).collect(), spacing }
    }

    fn radius(&self, sigma: f32) -> usize {
        radius_of(sigma, [self.spacing; 3])
    }

    /// Voxels beyond which a sample is not felt.
    fn reach(&self) -> usize {
        self.sigmas.iter().map(|&sigma| self.radius(sigma)).sum::<usize>() + DECAY
    }

    /// What an impulse of 1 at sample `at` of a line of `len` makes of the value and its first two derivatives.
    fn responses(&self, at: usize, len: usize) -> Result<[Vec<f32>; 3]> {
        let mut line = Field::zeros((1, 1, len));
        line[[0, 0, at]] = 1.0;
        for &sigma in &self.sigmas {
            line = gaussian(&line, [self.spacing; 3], sigma, self.radius(sigma));
        }
        let value = line.iter().copied().collect();
        let (field, weights) = match self.kernel.spline() {
            Some(degree) => (Coefficients::new(&line, degree)?.field, SeparableKernel::spline(degree)),
            None if self.kernel == Kernel::Central2 => (PaddedField::new(&line)?, SeparableKernel::CENTRAL_2),
            None => (PaddedField::new(&line)?, SeparableKernel::CENTRAL_4),
        };
        let [row, slice] = field.strides();
        let samples = &field.values()[PADDING * (row + slice)..][..len + 2 * PADDING];
        let respond = |[own, next, after]: [f32; 3], sign: f32, scale: f32| {
            let response = samples.windows(5).map(|taps| {
                let [a, b, c, d, e] = [taps[0], taps[1], taps[2], taps[3], taps[4]];
                scale * (own * c + next * (d + sign * b) + after * (e + sign * a))
            });
            response.collect()
        };
        let per_length = self.spacing.recip();
        Ok([value, respond(weights.first, -1.0, per_length), respond(weights.second, 1.0, per_length * per_length)])
    }

    /// The gains of the value and of the first derivative by depth below the face of a line of `len` samples.
    fn gains_by_depth(&self, len: usize) -> Result<Vec<[f32; 2]>> {
        let depths = self.reach().min(len.div_ceil(2));
        // Long enough for the far face not to be felt, unless the line itself is shorter.
        let len = len.min(depths + 2 * self.reach());
        let mut squares = vec![[0.0; 2]; depths];
        for at in 0..len {
            let [value, first, _] = self.responses(at, len)?;
            let mut first = first;
            if let (Kernel::Central2, [a, b, c, ..]) = (self.kernel, value.as_slice()) {
                // Central differences of second order have a border rule of their own.
                first[0] = (-1.5 * a + 2.0 * b - 0.5 * c) / self.spacing;
            }
            for (sums, response) in squares.iter_mut().zip(value.iter().zip(&first)) {
                sums[0] += response.0 * response.0;
                sums[1] += response.1 * response.1;
            }
        }
        Ok(squares.into_iter().map(|sums| sums.map(f32::sqrt)).collect())
    }
}

fn norm(values: &[f32]) -> f32 {
    values.iter().map(|value| value * value).sum::<f32>().sqrt()
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
    fn the_gradient_s_noise_is_what_its_gains_say() {
        // White noise through the kernels themselves, at the faces and inside.
        for (kernel, sigmas) in [
            (Kernel::Central2, vec![]),
            (Kernel::Central2, vec![0.5_f32]),
            (Kernel::QuinticSpline, vec![]),
            (Kernel::QuinticSpline, vec![1.0]),
        ] {
            let mut sums = [0.0_f64; 3];
            let mut expected = [0.0; 3];
            let count = 40;
            for seed in 0..count {
                let values = Field::from_shape_fn((12, 12, 32), |(k, j, i)| {
                    let bits = ((k * 64 + j) * 64 + i + 1_000_003 * seed) as u32;
                    let hash = (bits ^ (bits >> 15)).wrapping_mul(0x2c1b_3c6d);
                    let hash = (hash ^ (hash >> 12)).wrapping_mul(0x297a_2d39);
                    ((hash ^ (hash >> 15)) as f64 / f64::from(u32::MAX) - 0.5) as f32 * 12.0_f32.sqrt()
                });
                let mut values = values;
                for &sigma in &sigmas {
                    values = gaussian(&values, [1.0; 3], sigma, radius_of(sigma, [1.0; 3]));
                }
                let grid = crate::Grid::new(
                    "noise",
                    voxrole_pack::GridGeometry::axis_aligned([32, 12, 12], [1.0; 3]),
                    voxrole_pack::Scalars::F32(values.iter().copied().collect()),
                );
                let mut field = crate::working_field::WorkingField::new(&grid.expect("a grid")).expect("a field");
                let scale = field.value_scale;
                let (_, source) =
                    crate::differentiation::differentiate(&mut field, kernel, Default::default()).expect("fits");
                let gradient = crate::differentiation::Gradient::new(&field, &source);
                let noise = GradientNoise::new(kernel, &sigmas, [1.0; 3], [32, 12, 12], 1.0).expect("fits");
                for (place, x) in [0, 1, 15].into_iter().enumerate() {
                    let voxels = (4..8).flat_map(|k| (4..8).map(move |j| [x, j, k]));
                    sums[place] +=
                        voxels.map(|voxel| (f64::from(gradient.at(voxel).x) * scale).powi(2)).sum::<f64>() / 16.0;
                    expected[place] = noise.at([x, 6, 6]);
                }
            }
            for (sum, expected) in sums.into_iter().zip(expected) {
                let found = (sum / count as f64).sqrt();
                assert!((found / f64::from(expected) - 1.0).abs() < 0.15, "{kernel} {sigmas:?}: {found} {expected}");
            }
        }
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
