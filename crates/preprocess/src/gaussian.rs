//! Gaussian smoothing of the value field.

use rayon::prelude::*;

use crate::working_field::{Field, dims_of, voxels, voxels_mut};

/// Convolves with a Gaussian of `sigma` (in multiples of L_min, as is `spacing`), cut `radius` voxels away.
///
/// Weights outside the volume or on NaN voxels are left out and the rest renormalised (normalised convolution, Knutsson
/// and Westin, CVPR 1993), so that constants stay constant to the border; NaN voxels stay NaN.
#[must_use]
pub fn gaussian(field: &Field, spacing: [f32; 3], sigma: f32, radius: usize) -> Field {
    let mut smooth = field.clone();
    let known = voxels(field).par_iter().all(|value| !value.is_nan());
    if known {
        convolve(&mut smooth, spacing, sigma, radius);
        return smooth;
    }
    let mut certainty = field.mapv(|value| if value.is_nan() { 0.0 } else { 1.0 });
    smooth.mapv_inplace(|value| if value.is_nan() { 0.0 } else { value });
    convolve(&mut smooth, spacing, sigma, radius);
    convolve(&mut certainty, spacing, sigma, radius);
    let pairs = voxels_mut(&mut smooth).par_iter_mut().zip(voxels(&certainty)).zip(voxels(field));
    pairs
        .for_each(|((smooth, certainty), value)| *smooth = if value.is_nan() { f32::NAN } else { *smooth / certainty });
    smooth
}

/// One pass per axis.
fn convolve(field: &mut Field, spacing: [f32; 3], sigma: f32, radius: usize) {
    let [nx, ny, nz] = dims_of(field);
    let mut other = field.clone();
    for (axis, len) in [nx, ny, nz].into_iter().enumerate() {
        if len == 1 {
            continue;
        }
        let weights: Vec<f32> =
            (0..=radius).map(|steps| (-0.5 * (steps as f32 * spacing[axis] / sigma).powi(2)).exp()).collect();
        let source = voxels(field);
        voxels_mut(&mut other).par_chunks_mut(nx).enumerate().for_each(|(row, out)| {
            let (j, k) = (row % ny, row / ny);
            match axis {
                0 => along_row(out, &source[row * nx..][..nx], &weights),
                1 => across_rows(out, |j| &source[(k * ny + j) * nx..][..nx], j, ny, &weights),
                _ => across_rows(out, |k| &source[(k * ny + j) * nx..][..nx], k, nz, &weights),
            }
        });
        std::mem::swap(field, &mut other);
    }
}

fn along_row(out: &mut [f32], row: &[f32], weights: &[f32]) {
    for (x, out) in out.iter_mut().enumerate() {
        let (mut sum, mut total) = (row[x] * weights[0], weights[0]);
        for (steps, weight) in weights.iter().enumerate().skip(1) {
            // Both sides first, so that mirroring the axis changes no bit.
            let below = x.checked_sub(steps).map(|x| row[x]);
            let above = row.get(x + steps).copied();
            sum += weight * (below.unwrap_or(0.0) + above.unwrap_or(0.0));
            total += weight * f32::from(u8::from(below.is_some()) + u8::from(above.is_some()));
        }
        *out = sum / total;
    }
}

fn across_rows<'a>(out: &mut [f32], row: impl Fn(usize) -> &'a [f32], at: usize, len: usize, weights: &[f32]) {
    let mut total = weights[0];
    out.iter_mut().zip(row(at)).for_each(|(out, value)| *out = weights[0] * value);
    for (steps, weight) in weights.iter().enumerate().skip(1) {
        let below = at.checked_sub(steps).map(&row);
        let above = Some(at + steps).filter(|&index| index < len).map(&row);
        match (below, above) {
            (Some(below), Some(above)) => {
                out.iter_mut().zip(below).zip(above).for_each(|((out, below), above)| *out += weight * (below + above));
                total += 2.0 * weight;
            }
            (Some(side), None) | (None, Some(side)) => {
                out.iter_mut().zip(side).for_each(|(out, value)| *out += weight * value);
                total += weight;
            }
            (None, None) => {}
        }
    }
    out.iter_mut().for_each(|out| *out /= total);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::naive_mean::{SPACING, check_against_naive, fields, naive_mean};

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn equals_its_naive_twin(field in fields(), radius in 1_usize..4) {
            let sigma = 1.2_f32;
            let found = gaussian(&field, SPACING, sigma, radius);
            // The full three-dimensional sum, where the kernel goes along one axis after another.
            let expected = naive_mean(&field, radius, |squared, _| (-0.5 * squared / f64::from(sigma).powi(2)).exp());
            check_against_naive(&found, &expected)?;
        }
    }
}
