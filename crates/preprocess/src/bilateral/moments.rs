//! The filter as a few Gaussian convolutions.
//!
//! With the range weight as a sum of products ([`Expansion`]), `Σ Wd·Wr = Σ_k h_k(x)·M_k(x)`, where the moment M_k is the
//! convolution of `exp(−(1−ρ)·y²/2)·h_k(y)` with Wd alone, which is separable; and because y·h_k(y) is a sum of h_{k+1}(y)
//! and h_{k−1}(y), the same moments give `Σ Wd·Wr·y`. The time grows with the radius, not with its cube.

use fearless_simd::{Level, Simd, dispatch};
use multiversion::multiversion;

use super::convolution::{convolve_across, convolve_along};
use super::expansion::{Expansion, Recurrence};
use super::padded_box::{LANES, MISSING, PaddedBox};
use super::range_weight::exp_of_negative;
use crate::simd;

/// Samples of a slice that go through all the functions of y, and are convolved along z, while the first-level cache holds
/// them.
const STRIP: usize = 128;

/// Range weights for the samples of one box, which are taken as differences to `middle` in multiples of `sigma`.
#[derive(Clone, Debug)]
pub struct RangeExpansion {
    /// The middle of the box's range.
    pub middle: f32,
    /// σr in the units of the samples.
    pub sigma: f32,
    /// The weights.
    pub expansion: Expansion,
}

/// Moments of a box, slice by slice; memory is kept from box to box.
#[derive(Debug, Default)]
pub struct Moments {
    /// Samples from one row, and from one slice, of the window to the next.
    strides: [usize; 2],
    /// Slices of the box.
    depth: usize,
    /// A strip of all slices of the window: y, the function of it to be convolved, the one before.
    places: Vec<f32>,
    current: Vec<f32>,
    previous: Vec<f32>,
    /// All functions of y convolved along z, one after another.
    along_z: Vec<f32>,
    /// A slice of one of them, convolved along y too.
    along_y: Vec<f32>,
    /// A slice of all moments, one after another.
    slice: Vec<f32>,
    slice_len: usize,
}

impl Moments {
    /// Computes all functions of y in the window of a box of `depth` slices, and convolves them along z. Weights are those
    /// of the voxel itself and its neighbours on one side.
    pub fn load(&mut self, window: &PaddedBox, depth: usize, range: &RangeExpansion, weights: &[f32]) {
        self.load_at(simd::level(), window, depth, range, weights);
    }

    /// [`Self::load`] with vectors of a level; the bits are those of any other.
    fn load_at(&mut self, level: Level, window: &PaddedBox, depth: usize, range: &RangeExpansion, weights: &[f32]) {
        self.strides = window.strides;
        self.depth = depth;
        let strip_len = STRIP * (depth + 2 * (weights.len() - 1));
        for strip in [&mut self.places, &mut self.current, &mut self.previous] {
            strip.resize(strip_len, 0.0);
        }
        let slice = self.strides[1];
        self.along_z.resize(slice * depth * (range.expansion.terms() + 1), 0.0);
        for start in (0..slice).step_by(STRIP) {
            dispatch!(level, simd => load_strip(simd, self, &window.samples, start, range, weights));
        }
    }

    /// Computes the moments of slice z of the box, which has `height` rows.
    pub fn load_slice(&mut self, z: usize, height: usize, along_x: &[f32], along_y: &[f32]) {
        self.load_slice_at(simd::level(), z, height, along_x, along_y);
    }

    /// [`Self::load_slice`] with vectors of a level; the bits are those of any other.
    fn load_slice_at(&mut self, level: Level, z: usize, height: usize, along_x: &[f32], along_y: &[f32]) {
        self.slice_len = self.strides[0] * height;
        // Vectors reach beyond the last row.
        self.along_y.resize(self.slice_len + 2 * along_x.len() + LANES, 0.0);
        self.slice.resize(self.slice_len * (self.along_z.len() / (self.strides[1] * self.depth)), 0.0);
        dispatch!(level, simd => convolve_slice(simd, self, z, along_x, along_y));
    }

    /// The filtered samples of row y of the slice. `samples` are those to be filtered; `out` is of whole [`LANES`].
    pub fn filter_row(&self, y: usize, samples: &[f32], range: &RangeExpansion, out: &mut [f32]) {
        filter_row(&self.slice[y * self.strides[0]..], self.slice_len, samples, range, out);
    }
}

/// [`filter_row_plainly`].
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn filter_row(moments: &[f32], moment_len: usize, samples: &[f32], range: &RangeExpansion, out: &mut [f32]) {
    filter_row_plainly(moments, moment_len, samples, range, out);
}

/// Does what [`Moments::load`] does for the samples from `start` on of every slice.
#[inline(always)]
fn load_strip<S: Simd>(
    simd: S,
    moments: &mut Moments,
    samples: &[f32],
    start: usize,
    range: &RangeExpansion,
    weights: &[f32],
) {
    let Moments { strides: [_, slice], depth, places, current, previous, along_z, .. } = moments;
    let len = STRIP.min(*slice - start);
    for plane in 0..samples.len() / *slice {
        let strip = plane * STRIP..plane * STRIP + len;
        begin(&samples[plane * *slice + start..][..len], range, &mut places[strip.clone()], &mut current[strip]);
    }
    previous.fill(0.0);
    for k in 0..=range.expansion.terms() {
        if k > 0 {
            advance(places, current, previous, range.expansion.recurrence[k - 1]);
            std::mem::swap(current, previous);
        }
        let out = &mut along_z[k * *depth * *slice + start..];
        convolve_across(simd, current, out, [STRIP, *slice], [len, *depth], weights);
    }
}

/// Does what [`Moments::load_slice`] does.
#[inline(always)]
fn convolve_slice<S: Simd>(simd: S, moments: &mut Moments, z: usize, weights_x: &[f32], weights_y: &[f32]) {
    let Moments { strides: [row, slice], depth, along_z, along_y, slice: out, slice_len, .. } = moments;
    let height = *slice_len / *row;
    for k in 0..out.len() / *slice_len {
        let source = &along_z[(k * *depth + z) * *slice..];
        convolve_across(simd, source, along_y, [*row; 2], [*row, height], weights_y);
        convolve_along(simd, along_y, &mut out[k * *slice_len..][..*slice_len], weights_x);
    }
}

/// y, and the first function of it; 0 for what is missing.
#[inline(always)]
fn begin(samples: &[f32], range: &RangeExpansion, places: &mut [f32], current: &mut [f32]) {
    let (per_sigma, falloff) = (1.0 / range.sigma, range.expansion.falloff);
    for ((&sample, place), current) in samples.iter().zip(places).zip(current) {
        let known = sample < MISSING;
        *place = if known { (sample - range.middle) * per_sigma } else { 0.0 };
        let weight = exp_of_negative(*place * *place * falloff);
        *current = if known { weight } else { 0.0 };
    }
}

/// The next function, in place of the one before.
#[inline(always)]
fn advance(places: &[f32], current: &[f32], previous: &mut [f32], step: Recurrence) {
    for ((&place, &current), previous) in places.iter().zip(current).zip(previous) {
        *previous = step.forward * place * current - step.backward * *previous;
    }
}

/// Does what [`Moments::filter_row`] does.
#[inline(always)]
fn filter_row_plainly(moments: &[f32], moment_len: usize, samples: &[f32], range: &RangeExpansion, out: &mut [f32]) {
    let per_sigma = 1.0 / range.sigma;
    for (block, out) in out.chunks_exact_mut(LANES).enumerate() {
        let at = block * LANES;
        let samples = block_at::<LANES>(samples, at);
        let mut places = [0.0; LANES];
        for lane in 0..LANES {
            places[lane] = (samples[lane] - range.middle) * per_sigma;
        }
        let (mut before, mut this) = ([0.0; LANES], [1.0; LANES]);
        let (mut moment_before, mut moment) = ([0.0; LANES], *block_at::<LANES>(moments, at));
        let (mut sums, mut totals) = ([0.0; LANES], [0.0; LANES]);
        for (k, step) in range.expansion.recurrence.iter().enumerate() {
            let moment_after = block_at::<LANES>(moments, (k + 1) * moment_len + at);
            for lane in 0..LANES {
                totals[lane] += this[lane] * moment[lane];
                sums[lane] += this[lane] * (step.higher * moment_after[lane] + step.lower * moment_before[lane]);
                let next = step.forward * places[lane] * this[lane] - step.backward * before[lane];
                before[lane] = this[lane];
                this[lane] = next;
                moment_before[lane] = moment[lane];
                moment[lane] = moment_after[lane];
            }
        }
        for lane in 0..LANES {
            out[lane] = range.middle + range.sigma * (sums[lane] / totals[lane]);
        }
    }
}

#[inline(always)]
fn block_at<const N: usize>(samples: &[f32], from: usize) -> &[f32; N] {
    samples[from..].first_chunk().expect("fields reach beyond their last block")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::working_field::Field;

    #[test]
    fn every_processor_gives_the_same_bits() {
        let number = |index: usize| (index as u32).wrapping_mul(2_654_435_761) as f32 / u32::MAX as f32;
        let field = Field::from_shape_fn((5, 9, 40), |(k, j, i)| number((k * 9 + j) * 40 + i));
        let mut window = PaddedBox::default();
        window.load(&field, &[0..40, 0..9, 0..5], [2; 3], 1.0);
        let expansion = Expansion::new(1.0, 1e-6).expect("few terms");
        let range = RangeExpansion { middle: 0.5, sigma: 0.5, expansion };
        let weights = [1.0, 0.6, 0.1];
        let mut out = [[0.0; 2 * LANES]; 2];

        let [mut fast, mut plain] = [Moments::default(), Moments::default()];
        fast.load(&window, 5, &range, &weights);
        fast.load_slice(3, 9, &weights, &weights);
        let samples = &window.samples[window.row_start([4, 3])..];
        fast.filter_row(4, samples, &range, &mut out[0]);

        plain.load_at(Level::baseline(), &window, 5, &range, &weights);
        plain.load_slice_at(Level::baseline(), 3, 9, &weights, &weights);
        // Called from here, this is compiled for the baseline processor.
        let moments = &plain.slice[4 * plain.strides[0]..];
        filter_row_plainly(moments, plain.slice_len, samples, &range, &mut out[1]);

        assert!(out[0].iter().all(|filtered| (0.0..1.0).contains(filtered)));
        assert_eq!(out[0], out[1]);
    }
}
