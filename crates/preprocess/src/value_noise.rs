//! Where among the values the gradient's noise is stronger than the volume's: photons, reconstruction and coils make the noise
//! of one material a multiple of another's.

use std::fmt;

use rayon::prelude::*;
use serde::Serialize;

use crate::Result;
use crate::differentiation::differentiate;
use crate::noise::{NORMAL_MEDIAN, VoxelMasks};
use crate::noise_gain::GradientNoise;
use crate::plot::numbers::short_number;
use crate::settings::Settings;
use crate::working_field::{WorkingField, voxels};

/// Bins of equal width between the smallest and the largest value.
const BINS: usize = 256;
/// Voxels that a bin must have: the quartile of so many gradients is right to 3 %.
const LEAST_VOXELS: usize = 1 << 10;
/// Slices whose voxels are asked together.
const SLICES: usize = 8;
/// The shares of a bin's gradients that are compared with those of noise: the lower ones, because edges are steep.
const SHARES: [f64; 3] = [0.1, 0.25, 0.5];
/// Which gradients stay below these shares where each of one, two or three components is normal of deviation 1: quantiles of
/// the half normal distribution, Rayleigh's and Maxwell's.
const QUANTILES: [[f32; 3]; 3] = [[0.1257, 0.3186, 0.6745], [0.4590, 0.7585, 1.1774], [0.7644, 1.1012, 1.5382]];
/// No more than by this factor do the deviations differ that the three quantiles of noise speak of.
const MOST_SPREAD: f32 = 1.2;
/// Nor is a larger share of a bin's gradients equal to their quartile.
const MOST_EQUAL: f64 = 0.01;
/// How far apart, in voxels, the samples of the masks are by which noise is told from signals that are smooth. Wide enough for
/// scanners' noise, which is smooth from one voxel to the next; texture is smooth over more.
const SPREAD: usize = 3;
/// No more than by this factor is the gradient's noise stronger than those masks show it to be. In an engine's metal and air it is
/// 0.9 to 1.2 times as strong, in a brain's tissue, whose gradients look like noise too, 1.4 and more (docs/benchmarks.md).
const MOST_SMOOTHNESS: f32 = 1.3;
/// Smaller factors, by either witness, are taken for 1: by so much estimates differ where there is nothing to be found.
const LEAST_FACTOR: f32 = 1.25;

/// By which factor the gradient's noise is stronger where the value is in a bin than the volume's noise makes it; 1 where it is not
/// known to be.
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
    /// By how much it is stronger, at least and at most.
    pub factors: [f64; 2],
}

impl fmt::Display for NoisyValues {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { from, to, factors: [least, most] } = self;
        write!(
            formatter,
            "{least:.2} to {most:.2} times as strong from {} to {}",
            short_number(*from),
            short_number(*to)
        )
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
    /// these gradients is no smoother than scanners' noise. The factor is what the gradients speak of.
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
            found.ask(field, settings, sigmas, noise, &mut bins)?;
        }
        if components > 0 {
            for (factor, bin) in found.factors.iter_mut().zip(&mut bins) {
                *factor = factor_of(bin, QUANTILES[components - 1]);
            }
            found.factors = spread(without_single_bins(found.factors), noise * found.bins_per_value);
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

    /// Runs of values whose factor is above 1, from low to high; `physical` is the value of a working one.
    #[must_use]
    pub fn noisy_values(&self, physical: impl Fn(f32) -> f64) -> Vec<NoisyValues> {
        let end = |bin: usize| physical(self.low + bin as f32 / self.bins_per_value);
        let mut first = 0;
        let runs = self.factors.chunk_by(|a, b| (*a > 1.0) == (*b > 1.0)).filter_map(|run| {
            let bins = first..first + run.len();
            first = bins.end;
            let [least, most] =
                [run.iter().copied().fold(f32::INFINITY, f32::min), run.iter().copied().fold(0.0, f32::max)];
            let factors = [least, most].map(f64::from);
            (least > 1.0).then(|| NoisyValues { from: end(bins.start), to: end(bins.end), factors })
        });
        runs.collect()
    }

    /// Adds to the bins what every voxel says of the noise, but for those with no gradient or nothing left by the masks: padding.
    fn ask(
        &self,
        field: &mut WorkingField,
        settings: &Settings,
        sigmas: &[f32],
        noise: f32,
        bins: &mut [Vec<[f32; 2]>; BINS],
    ) -> Result<()> {
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
            (gradient > 0.0 && residual > 0.0).then(|| (self.bin(values[voxel]), [gradient, residual]))
        };
        // Room for all of them, so that bins that grow take no more than that.
        let mut counts = [0; BINS];
        values.iter().for_each(|&value| counts[self.bin(value)] += 1);
        bins.iter_mut().zip(counts).for_each(|(bin, count)| bin.reserve_exact(count));
        // Some slices at a time, which take little memory beside the bins.
        for first in along_z.clone().step_by(SLICES) {
            let slices = first..(first + SLICES).min(along_z.end);
            let said: Vec<(usize, [f32; 2])> = slices
                .into_par_iter()
                .flat_map_iter(|z| {
                    let (at, along_x) = (&at, along_x.clone());
                    along_y.clone().flat_map(move |y| along_x.clone().filter_map(move |x| at([x, y, z])))
                })
                .collect();
            said.into_iter().for_each(|(bin, said)| bins[bin].push(said));
        }
        Ok(())
    }
}

/// The factor of a bin whose voxels have these gradients, over the deviation of a component, and magnitudes of what the masks
/// leave, over its deviation.
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

/// A noisy material's values lie around its own by as much as they are noisy: the bins that are nearer to a noisy one than one
/// deviation are as noisy. Most of what has their values is that material; what is not, or its edge, hides that from
/// [`factor_of`]. `deviation` is that of the volume's noise, in bins.
fn spread(factors: [f32; BINS], deviation: f32) -> [f32; BINS] {
    let mut spread = factors;
    for (bin, &factor) in factors.iter().enumerate().filter(|(_, factor)| **factor > 1.0) {
        let width = (factor * deviation).min(BINS as f32) as usize;
        for near in &mut spread[bin.saturating_sub(width)..(bin + width + 1).min(BINS)] {
            *near = near.max(factor);
        }
    }
    // What a bin says of itself stands.
    std::array::from_fn(|bin| if factors[bin] > 1.0 { factors[bin] } else { spread[bin] })
}

#[cfg(test)]
mod tests {
    use voxrole_pack::{GridGeometry, Scalars};

    use super::*;
    use crate::Grid;
    use crate::gaussian::gaussian;
    use crate::noise::noise_sigma;
    use crate::phantom::NoiseKind;
    use crate::settings::Method;
    use crate::working_field::Field;

    /// Independent normal numbers of deviation 1.
    fn normal(counter: u64) -> f32 {
        NoiseKind::Gaussian.apply(0.0, 1.0, 1, counter) as f32
    }

    fn found(values: &Field, smoothing: Option<f32>) -> ValueNoise {
        let (nz, ny, nx) = values.dim();
        let geometry = GridGeometry::axis_aligned([nx, ny, nz].map(|dim| dim as u32), [1.0; 3]);
        let grid = Grid::new("n", geometry, Scalars::F32(values.iter().copied().collect())).expect("a grid");
        let mut field = WorkingField::new(&grid).expect("a field");
        let noise = noise_sigma(&field);
        if let Some(sigma) = smoothing {
            field.values = gaussian(&field.values, [1.0; 3], sigma, crate::gaussian::radius_of(sigma, [1.0; 3]));
        }
        let range = field
            .values
            .iter()
            .fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], value| [low.min(*value), high.max(*value)]);
        let settings = Settings::new(Method::Fast);
        let sigmas: Vec<f32> = smoothing.into_iter().collect();
        ValueNoise::find(&mut [field], &settings, &sigmas, noise, range).expect("fits")
    }

    /// A wall between two materials; the noise of the brighter one is smooth and `ratio` times as strong, or the same white noise
    /// for a ratio of 1.
    fn two_materials(dims: (usize, usize, usize), ratio: f32) -> Field {
        let white = Field::from_shape_fn(dims, |(k, j, i)| normal(((k * dims.1 + j) * dims.2 + i) as u64));
        let smooth = gaussian(&white, [1.0; 3], 0.5, 2);
        let scale = (white.len() as f32 / smooth.iter().map(|value| value * value).sum::<f32>()).sqrt();
        Field::from_shape_fn(dims, |at| {
            let place = (at.2 as f32 - 0.6 * dims.2 as f32) / 2.0_f32.sqrt();
            let share = 0.5 + 0.5 * libm::erff(place / 1.2);
            let other = if ratio == 1.0 { white[at] } else { ratio * scale * smooth[at] };
            share + 0.004 * ((1.0 - share) * white[at] + share * other)
        })
    }

    #[test]
    fn noise_of_one_material_is_found_and_measured() {
        for smoothing in [None, Some(0.7)] {
            let noise = found(&two_materials((48, 48, 64), 4.0), smoothing);
            // Values above 1 make the working ones half as large.
            let noisy = noise.noisy_values(|value| 2.0 * f64::from(value));
            assert!(!noisy.is_empty(), "{smoothing:?}");
            for NoisyValues { from, to, factors: [least, most] } in noisy {
                assert!(from > 0.9 && to < 1.1, "{smoothing:?}: {from} to {to}");
                assert!(least > 3.0 && most < 7.0, "{smoothing:?}: {least} to {most} from {from} to {to}");
            }
        }
    }

    #[test]
    fn even_noise_is_taken_for_even() {
        for (dims, smoothing) in [((48, 48, 64), None), ((48, 48, 64), Some(1.0)), ((1, 200, 300), None)] {
            let noisy = found(&two_materials(dims, 1.0), smoothing).noisy_values(f64::from);
            assert_eq!(noisy, [], "{dims:?} {smoothing:?}");
        }
    }

    #[test]
    fn smooth_random_signals_are_not_taken_for_noise() {
        // Waves of 12 to 16 voxels in all directions, with a little white noise by which all else is measured.
        let waves: Vec<_> = (0..60_u64)
            .map(|wave| {
                let direction = glam::Vec3::from_array([0, 1, 2].map(|axis| normal(1_000_000 + 4 * wave + axis)));
                let period = 12.0 + 4.0 * (wave as f32 / 60.0);
                (direction.normalize() * std::f32::consts::TAU / period, normal(2_000_000 + wave))
            })
            .collect();
        for amplitude in [0.02, 0.1] {
            let values = Field::from_shape_fn((64, 64, 64), |(k, j, i)| {
                let place = glam::Vec3::new(i as f32, j as f32, k as f32);
                let signal: f32 = waves.iter().map(|(wave, phase)| libm::cosf(wave.dot(place) + 3.0 * phase)).sum();
                let step = if i < 32 { 0.0 } else { 1.0 };
                step + amplitude / 60.0_f32.sqrt() * signal + 0.001 * normal((i + 64 * (j + 64 * k)) as u64)
            });
            for smoothing in [None, Some(1.25)] {
                assert_eq!(found(&values, smoothing).factors, [1.0; BINS], "{amplitude} {smoothing:?}");
            }
        }
    }

    #[test]
    fn factors_are_what_sorting_all_says() {
        let strong = |scale: f32, count: u64| -> Vec<[f32; 2]> {
            let component = |voxel: u64, axis: u64| scale * normal(8 * voxel + axis);
            (0..count)
                .map(|voxel| {
                    let squares: f32 = (0..3).map(|axis| component(voxel, axis).powi(2)).sum();
                    [squares.sqrt(), component(voxel, 3).abs()]
                })
                .collect()
        };
        let mut bin = strong(2.5, 20_000);
        let mut gradients: Vec<f32> = bin.iter().map(|[gradient, _]| *gradient).collect();
        gradients.sort_by(f32::total_cmp);
        let found = factor_of(&mut bin, QUANTILES[2]);
        assert_eq!(found, gradients[5_000] / QUANTILES[2][1]);
        assert!((found / 2.5 - 1.0).abs() < 0.03, "{found}");
        // Weak noise, too few voxels, edges, residuals of something smooth, and rounded numbers say nothing.
        assert_eq!(factor_of(&mut strong(1.1, 20_000), QUANTILES[2]), 1.0);
        assert_eq!(factor_of(&mut strong(2.5, 1_000), QUANTILES[2]), 1.0);
        let changed = |change: fn([f32; 2]) -> [f32; 2]| {
            let mut bin: Vec<_> = strong(2.5, 20_000).into_iter().map(change).collect();
            factor_of(&mut bin, QUANTILES[2])
        };
        assert_eq!(changed(|[gradient, residual]| [gradient.powi(2), residual]), 1.0);
        assert_eq!(changed(|[gradient, residual]| [gradient, 0.5 * residual]), 1.0);
        assert_eq!(changed(|[gradient, residual]| [gradient.round(), residual]), 1.0);
    }

    #[test]
    fn values_outside_the_range_and_none_at_all_have_a_factor() {
        let mut noise = ValueNoise { low: -0.5, bins_per_value: BINS as f32, factors: [1.0; BINS] };
        noise.factors[0] = 2.0;
        noise.factors[BINS - 1] = 3.0;
        assert_eq!([-9.0, -0.5, 0.0, 0.5, 9.0].map(|value| noise.at(value)), [2.0, 2.0, 1.0, 3.0, 3.0]);
        assert!(noise.at(f32::NAN) >= 1.0);
        assert_eq!(ValueNoise::EVEN.at(0.3), 1.0);
    }

    #[test]
    fn noisy_values_reach_as_far_as_they_are_noisy() {
        let mut factors = [1.0; BINS];
        (factors[100], factors[101], factors[BINS - 1]) = (2.0, 4.0, 3.0);
        let spread = spread(factors, 0.8);
        let noisy: Vec<_> = (0..BINS).filter(|bin| spread[*bin] > 1.0).map(|bin| (bin, spread[bin])).collect();
        let expected = [(98, 4.0), (99, 4.0), (100, 2.0), (101, 4.0), (102, 4.0), (103, 4.0), (104, 4.0)];
        assert_eq!(noisy[..7], expected);
        assert_eq!(noisy[7..], [(BINS - 3, 3.0), (BINS - 2, 3.0), (BINS - 1, 3.0)]);
        assert_eq!(super::spread([1.0; BINS], 9.0), [1.0; BINS]);
    }

    #[test]
    fn a_single_bin_is_none() {
        let mut factors = [1.0; BINS];
        for (bin, factor) in [(0, 2.0), (1, 3.0), (7, 4.0), (BINS - 1, 5.0)] {
            factors[bin] = factor;
        }
        let kept = without_single_bins(factors);
        assert_eq!((kept[0], kept[1], kept[7], kept[BINS - 1]), (2.0, 3.0, 1.0, 1.0));
    }
}
