//! Convolutions along an axis with weights that are the same on both sides.
//!
//! Vectors that hardly ever begin where lines of the cache do cost more to load than to convolve. So across lines each sample is
//! loaded once and stays in registers for all results that it counts for, and along a line vectors are put together of two that
//! lie side by side. The sums are those of the plain loops, in their order, whatever the processor.

use fearless_simd::{Simd, prelude::*};

/// Convolves `count` lines of `len` samples across them: line i of `out` is made of the lines i to i + 2·reach of `source`, where
/// the reach is one less than the number of `weights`. Lines lie `strides` apart in `source` and in `out`.
///
/// With a reach of up to 4 one vector is loaded for each result, beyond that all that count for it.
#[inline(always)]
pub fn convolve_across<S: Simd>(
    simd: S,
    source: &[f32],
    out: &mut [f32],
    strides @ [stride, out_stride]: [usize; 2],
    [len, count]: [usize; 2],
    weights: &[f32],
) {
    if len < S::f32s::LEN || weights.len() > 5 {
        for line in 0..count {
            convolve_line(simd, &source[line * stride..], stride, &mut out[line * out_stride..][..len], weights);
        }
        return;
    }
    match weights.len() {
        1 => across::<S, 1>(simd, source, out, strides, [len, count], weights),
        2 => across::<S, 3>(simd, source, out, strides, [len, count], weights),
        3 => across::<S, 5>(simd, source, out, strides, [len, count], weights),
        4 => across::<S, 7>(simd, source, out, strides, [len, count], weights),
        _ => across::<S, 9>(simd, source, out, strides, [len, count], weights),
    }
}

/// Convolves along a line: sample i of `out` is made of the samples i to i + 2·reach of `source`, which has to go on for a
/// vector beyond the last one.
#[inline(always)]
pub fn convolve_along<S: Simd>(simd: S, source: &[f32], out: &mut [f32], weights: &[f32]) {
    if out.len() < S::f32s::LEN || S::f32s::LEN < 2 * weights.len() {
        return convolve_line(simd, source, 1, out, weights);
    }
    match weights.len() {
        2 => along::<S, 3>(simd, source, out, weights),
        3 => along::<S, 5>(simd, source, out, weights),
        4 => along::<S, 7>(simd, source, out, weights),
        _ => convolve_line(simd, source, 1, out, weights),
    }
}

/// A line whose neighbours lie `stride` apart, of any length and with any reach: all that counts is loaded anew for each result.
#[inline(always)]
fn convolve_line<S: Simd>(simd: S, source: &[f32], stride: usize, out: &mut [f32], weights: &[f32]) {
    let (len, middle) = (out.len(), (weights.len() - 1) * stride);
    if len < S::f32s::LEN {
        return convolve_line_plainly(source, stride, out, weights);
    }
    let mut x = 0;
    loop {
        let center = x + middle;
        let mut sum = S::f32s::splat(simd, weights[0]) * lanes(simd, source, center);
        for (steps, &weight) in weights.iter().enumerate().skip(1) {
            let sides = lanes(simd, source, center - steps * stride) + lanes(simd, source, center + steps * stride);
            sum += S::f32s::splat(simd, weight) * sides;
        }
        sum.store_slice(&mut out[x..][..S::f32s::LEN]);
        if x + S::f32s::LEN == len {
            break;
        }
        // The last vector overlaps the one before, so that nothing is left over.
        x = (x + S::f32s::LEN).min(len - S::f32s::LEN);
    }
}

/// [`convolve_line`], sample by sample: the naive twin of all.
#[inline(always)]
fn convolve_line_plainly(source: &[f32], stride: usize, out: &mut [f32], weights: &[f32]) {
    for (x, out) in out.iter_mut().enumerate() {
        let center = x + (weights.len() - 1) * stride;
        *out = weights[0] * source[center];
        for (steps, &weight) in weights.iter().enumerate().skip(1) {
            *out += weight * (source[center - steps * stride] + source[center + steps * stride]);
        }
    }
}

#[inline(always)]
fn across<S: Simd, const TAPS: usize>(
    simd: S,
    source: &[f32],
    out: &mut [f32],
    [stride, out_stride]: [usize; 2],
    [len, count]: [usize; 2],
    weights: &[f32],
) {
    let weights = splat::<S, TAPS>(simd, weights);
    let mut x = 0;
    loop {
        let mut taps = [S::f32s::splat(simd, 0.0); TAPS];
        for (line, tap) in taps.iter_mut().skip(1).enumerate() {
            *tap = lanes(simd, source, line * stride + x);
        }
        for line in 0..count {
            for tap in 1..TAPS {
                taps[tap - 1] = taps[tap];
            }
            taps[TAPS - 1] = lanes(simd, source, (line + TAPS - 1) * stride + x);
            weighted::<S, TAPS>(weights, taps).store_slice(&mut out[line * out_stride + x..][..S::f32s::LEN]);
        }
        if x + S::f32s::LEN == len {
            break;
        }
        x = (x + S::f32s::LEN).min(len - S::f32s::LEN);
    }
}

#[inline(always)]
fn along<S: Simd, const TAPS: usize>(simd: S, source: &[f32], out: &mut [f32], weights: &[f32]) {
    let weights = splat::<S, TAPS>(simd, weights);
    let len = out.len();
    let mut x = 0;
    loop {
        let (low, high) = (lanes(simd, source, x), lanes(simd, source, x + S::f32s::LEN));
        let mut taps = [low; TAPS];
        for (steps, tap) in taps.iter_mut().enumerate().skip(1) {
            *tap = shifted::<S>(low, high, steps);
        }
        weighted::<S, TAPS>(weights, taps).store_slice(&mut out[x..][..S::f32s::LEN]);
        if x + S::f32s::LEN == len {
            break;
        }
        x = (x + S::f32s::LEN).min(len - S::f32s::LEN);
    }
}

/// As many samples as a vector holds from sample `steps` of two vectors on.
#[inline(always)]
fn shifted<S: Simd>(low: S::f32s, high: S::f32s, steps: usize) -> S::f32s {
    match steps {
        1 => low.slide::<1>(high),
        2 => low.slide::<2>(high),
        3 => low.slide::<3>(high),
        4 => low.slide::<4>(high),
        5 => low.slide::<5>(high),
        6 => low.slide::<6>(high),
        _ => unreachable!("as many taps as there are here"),
    }
}

/// The sum of an odd number of taps, the middle one first.
#[inline(always)]
fn weighted<S: Simd, const TAPS: usize>(weights: [S::f32s; TAPS], taps: [S::f32s; TAPS]) -> S::f32s {
    let middle = TAPS / 2;
    let mut sum = weights[0] * taps[middle];
    for steps in 1..=middle {
        sum += weights[steps] * (taps[middle - steps] + taps[middle + steps]);
    }
    sum
}

/// Weights in all lanes; of the array only as many are used as there are weights.
#[inline(always)]
fn splat<S: Simd, const TAPS: usize>(simd: S, weights: &[f32]) -> [S::f32s; TAPS] {
    let mut splat = [S::f32s::splat(simd, 0.0); TAPS];
    for steps in 0..=TAPS / 2 {
        splat[steps] = S::f32s::splat(simd, weights[steps]);
    }
    splat
}

#[inline(always)]
fn lanes<S: Simd>(simd: S, samples: &[f32], from: usize) -> S::f32s {
    S::f32s::from_slice(simd, &samples[from..][..S::f32s::LEN])
}

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};

    use super::*;
    use crate::simd;

    #[test]
    fn equal_their_naive_twin() {
        let number = |index: usize| (index as u32).wrapping_mul(2_654_435_761) as f32 / u32::MAX as f32 - 0.3;
        let weights = [0.9, 0.7, 0.4, 0.2, 0.1, 0.05, 0.03].map(|weight: f32| weight.sqrt());
        for level in [Level::baseline(), simd::level()] {
            for len in [1, 3, 4, 15, 16, 17, 38, 70] {
                for weights in (1..=weights.len()).map(|count| &weights[..count]) {
                    let (count, stride, out_stride) = (5, len + 3, len + 2);
                    let source: Vec<f32> = (0..stride * (count + 2 * weights.len()) + 64).map(number).collect();
                    let [mut expected, mut found] = [vec![0.0; out_stride * count], vec![0.0; out_stride * count]];
                    for (line, out) in expected.chunks_exact_mut(out_stride).enumerate() {
                        convolve_line_plainly(&source[line * stride..], stride, &mut out[..len], weights);
                    }
                    let strides = [stride, out_stride];
                    dispatch!(level, simd => convolve_across(simd, &source, &mut found, strides, [len, count], weights));
                    assert_eq!(found, expected, "{level:?} {len} {weights:?}");
                    convolve_line_plainly(&source, 1, &mut expected[..len], weights);
                    dispatch!(level, simd => convolve_along(simd, &source, &mut found[..len], weights));
                    assert_eq!(found, expected, "{level:?} {len} {weights:?}");
                }
            }
        }
    }
}
