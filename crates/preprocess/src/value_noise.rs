//! Where among the values the gradient's noise is stronger than the volume's: photons, reconstruction and coils make the noise
//! of one material a multiple of another's.

use std::fmt;

use rayon::prelude::*;
use serde::Serialize;

use crate::Result;
use crate::differentiation::differentiate;
use crate::noise::{NORMAL_MEDIAN, VoxelMasks};
use crate::noise_gain::GradientNoise;
use crate::settings::Settings;
use crate::working_field::{WorkingField, voxels};

/// Bins of equal width between the smallest and the largest value.
const BINS: usize = 256;
/// Voxels that a bin must have: the quartile of so many gradients is right to 3 %.
const LEAST_VOXELS: usize = 1 << 10;
/// The shares of a bin's gradients that are compared with those of noise: the lower ones, because edges are steep.
const SHARES: [f64; 3] = [0.1, 0.25, 0.5];
/// Which gradients stay below these shares where each of one, two or three components is normal of deviation 1: quantiles of
/// the half normal distribution, Rayleigh's and Maxwell's.
const QUANTILES: [[f32; 3]; 3] = [[0.1257, 0.3186, 0.6745], [0.4590, 0.7585, 1.1774], [0.7644, 1.1012, 1.5382]];
/// No more than by this factor do the deviations differ that the three quantiles of noise speak of.
const MOST_SPREAD: f32 = 1.2;
/// Nor is a larger share of a bin's gradients equal to their quartile.
const MOST_EQUAL: f64 = 0.01;
/// How far apart, in voxels, the samples of the masks are by which noise is told from signals that are smooth: as far as
/// resolved boundaries are from one another at least, and noise is not alike.
const SPREAD: usize = 3;
/// No more than by this factor is the gradient's noise stronger than those masks show it to be. In the noise of an engine's metal
/// and air it is 1.0 to 1.2, in a brain's tissue, which has the gradients of noise too, 1.4 and more, in a tooth's 2.1.
const MOST_SMOOTHNESS: f32 = 1.3;
/// Smaller factors are taken for 1: by so much estimates differ where there is nothing to be found.
const LEAST_FACTOR: f32 = 1.25;

/// By which factor the gradient's noise is stronger where the value is in a bin than in the volume; 1 where it is not known to be.
#[derive(Clone, Debug, PartialEq)]
pub struct ValueNoise {
    low: f32,
    bins_per_value: f32,
    factors: [f32; BINS],
}

/// Values whose noise is stronger than the volume's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct NoisyValues {
    /// The lowest of them, physical.
    pub from: f64,
    /// The highest.
    pub to: f64,
    /// By how much it is stronger.
    pub factor: f64,
}

impl fmt::Display for NoisyValues {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { from, to, factor } = self;
        write!(formatter, "{factor:.2} times as strong from {from:.6} to {to:.6}")
    }
}

impl ValueNoise {
    /// The same noise everywhere.
    pub const EVEN: Self = Self { low: 0.0, bins_per_value: 0.0, factors: [1.0; BINS] };

    /// Judges by smoothed parts of a volume whose working values lie between two and whose value is taken to have white noise of
    /// deviation `noise`, before Gaussians of the given σ.
    ///
    /// A bin of values is noisier where two witnesses say so. The lower half of its gradients is distributed as those of
    /// noise are (three independent normal components: Maxwell), and what the masks of [`crate::noise`] leave of its voxels with
    /// these gradients is no smoother than scanners' noise. The factor is what the less noisy of the two speaks of.
    ///
    /// # Errors
    /// [`crate::Error::Pack`] when memory runs out.
    pub fn find(
        fields: &mut [WorkingField],
        settings: &Settings,
        sigmas: &[f32],
        noise: f32,
        [a, b]: [f32; 2],
    ) -> Result<Self> {
        let (low, width) = (a.min(b), (b - a).abs());
        if noise <= 0.0 || width <= 0.0 {
            return Ok(Self::EVEN);
        }
        let mut found = Self { low, bins_per_value: BINS as f32 / width, factors: [1.0; BINS] };
        let mut bins = [const { Vec::new() }; BINS];
        let mut components = 0;
        for field in fields {
            components = components.max(field.dims().into_iter().filter(|&dim| dim > 1).count());
            for Witness { bin, gradient, residual } in found.witnesses(field, settings, sigmas, noise)? {
                bins[bin].push([gradient, residual]);
            }
        }
        if components > 0 {
            for (factor, bin) in found.factors.iter_mut().zip(&mut bins) {
                *factor = factor_of(bin, QUANTILES[components - 1]);
            }
            found.factors = without_single_bins(found.factors);
        }
        Ok(found)
    }

    /// The factor at a value, 1 or more.
    #[inline]
    #[must_use]
    pub fn at(&self, value: f32) -> f32 {
        self.factors[self.bin(value)]
    }

    #[inline]
    fn bin(&self, value: f32) -> usize {
        (((value - self.low) * self.bins_per_value) as usize).min(BINS - 1)
    }

    /// Values whose factor is above 1, from low to high; `physical` is the value of a working one.
    #[must_use]
    pub fn noisy_values(&self, physical: impl Fn(f32) -> f64) -> Vec<NoisyValues> {
        let end = |bin: usize| physical(self.low + bin as f32 / self.bins_per_value);
        let noisy = self.factors.iter().enumerate().filter(|(_, factor)| **factor > 1.0);
        noisy
            .map(|(bin, &factor)| NoisyValues { from: end(bin), to: end(bin + 1), factor: f64::from(factor) })
            .collect()
    }

    /// What every voxel says of the noise, but for those with no gradient or nothing left by the masks: padding.
    fn witnesses(
        &self,
        field: &mut WorkingField,
        settings: &Settings,
        sigmas: &[f32],
        noise: f32,
    ) -> Result<Vec<Witness>> {
        let dims @ [nx, ny, _] = field.dims();
        let (derivatives, _) = differentiate(field, settings.kernel, settings.operator)?;
        let gradients = voxels(&derivatives.gradient_magnitude);
        let values = voxels(&field.values);
        let gradient_noise = GradientNoise::new(settings.kernel, sigmas, field.spacing, dims, noise)?;
        let masks = VoxelMasks::new(dims, SPREAD);
        // The masks see the field that is differentiated, with the Gaussian that may be part of the kernel.
        let smoothed: Vec<f32> = sigmas.iter().copied().chain(settings.kernel.sigma()).collect();
        let per_noise = (noise * masks.gain(field.spacing, &smoothed)).recip();
        let [along_x, along_y, along_z] = [0, 1, 2].map(|axis| masks.inner(axis));
        let at = |[x, y, z]: [usize; 3]| {
            let voxel = (z * ny + y) * nx + x;
            let gradient = gradients[voxel] / gradient_noise.at([x, y, z]);
            let residual = masks.residual(values, voxel) * per_noise;
            let bin = self.bin(values[voxel]);
            (gradient > 0.0 && residual > 0.0).then_some(Witness { bin, gradient, residual })
        };
        Ok(along_z
            .into_par_iter()
            .flat_map_iter(|z| {
                let (at, along_x) = (&at, along_x.clone());
                along_y.clone().flat_map(move |y| along_x.clone().filter_map(move |x| at([x, y, z])))
            })
            .collect())
    }
}

/// What a voxel says of the noise around it, in multiples of the volume's.
struct Witness {
    bin: usize,
    /// Gradient magnitude over the deviation of a component.
    gradient: f32,
    /// Magnitude of what the masks leave over its deviation.
    residual: f32,
}

/// The factor of a bin whose voxels have these gradients and residuals.
fn factor_of(bin: &mut [[f32; 2]], quantiles: [f32; 3]) -> f32 {
    if bin.len() < LEAST_VOXELS {
        return 1.0;
    }
    let deviations: [f32; 3] = std::array::from_fn(|place| {
        let at = (SHARES[place] * bin.len() as f64) as usize;
        bin.select_nth_unstable_by(at, |a, b| a[0].total_cmp(&b[0])).1[0] / quantiles[place]
    });
    let [least, most] =
        [deviations.into_iter().fold(f32::INFINITY, f32::min), deviations.into_iter().fold(0.0, f32::max)];
    // Of values rounded as coarsely as they are noisy gradients are few numbers, and quantiles say nothing.
    let quartile = deviations[1] * quantiles[1];
    let equal = bin.iter().filter(|[gradient, _]| (gradient - quartile).abs() <= 1e-5 * quartile).count();
    if equal as f64 > MOST_EQUAL * bin.len() as f64 {
        return 1.0;
    }
    // By now the lower half of the gradients is in front.
    let half = bin.len() / 2;
    let (_, &mut [_, residual], _) = bin[..half].select_nth_unstable_by(half / 2, |a, b| a[1].total_cmp(&b[1]));
    let left_by_masks = residual / NORMAL_MEDIAN;
    let factor = deviations[1];
    let is_noise = most <= MOST_SPREAD * least && factor <= MOST_SMOOTHNESS * left_by_masks;
    let is_stronger = factor.min(left_by_masks) >= LEAST_FACTOR;
    if is_noise && is_stronger { factor } else { 1.0 }
}

/// Noise spreads over more than one bin: where neither neighbour has it, a bin is that of an edge's foot.
fn without_single_bins(factors: [f32; BINS]) -> [f32; BINS] {
    let is_noisy = |bin: usize| factors.get(bin).is_some_and(|factor| *factor > 1.0);
    std::array::from_fn(|bin| if is_noisy(bin.wrapping_sub(1)) || is_noisy(bin + 1) { factors[bin] } else { 1.0 })
}
