//! Blobs of a two-dimensional histogram: the neighbourhoods of its peaks.

use voxrole_pack::Histogram;

/// Share of a peak that still belongs to its blob.
const BLOB_SHARE: f64 = 0.18;
/// Share of a peak that does so at nearly the same gradient magnitude, see [`SAME_GRADIENT`].
const SAME_GRADIENT_SHARE: f64 = 0.02;
/// Interpolated g at the hit varies by up to a seventh over one boundary; if its weakest voxels were left out, it would be
/// drawn with holes. Farther down lies noise, which must be left out.
const SAME_GRADIENT: f64 = 0.2;
/// A peak counts as one of its own if the saddle to a higher one lies below this share of it.
const SADDLE_SHARE: f64 = 0.7;
/// Standard deviations of the smoothing to an axis: counts are noisy, boundaries some bins wide.
const SIGMAS_PER_AXIS: f64 = 128.0;
/// The most of it, in bins: an axis may claim millions of them.
const LARGEST_SIGMA: f64 = 16.0;

/// One blob, in bins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blob {
    /// The bin of its peak, first axis fastest.
    pub peak: usize,
    /// Sum of its weights.
    pub mass: f64,
    /// First and last bin along the first axis.
    pub value: [usize; 2],
    /// First and last bin along the second axis.
    pub gradient: [usize; 2],
}

/// The blobs of a histogram of value and gradient magnitude, counts weighted by g², highest peak first.
///
/// Requires two axes.
#[must_use]
pub fn find_blobs(histogram: &Histogram) -> Vec<Blob> {
    let dims = [0, 1].map(|axis| histogram.shape.axes[axis].bins as usize);
    blobs(&weights(histogram, dims), dims)
}

/// Counts weighted by g², then smoothed: the other way round, noise would leak upwards and be weighted there.
fn weights(histogram: &Histogram, dims: [usize; 2]) -> Vec<f64> {
    let gradient_axis = &histogram.shape.axes[1];
    let highest = gradient_axis.high.abs().max(f64::MIN_POSITIVE);
    let row_weight = |row: usize| (gradient_axis.bin_center(row).max(0.0) / highest).powi(2);
    let weighted: Vec<f64> =
        histogram.counts.iter().enumerate().map(|(bin, &count)| count as f64 * row_weight(bin / dims[0])).collect();
    smooth(&weighted, dims, dims.map(|bins| (bins as f64 / SIGMAS_PER_AXIS).min(LARGEST_SIGMA)))
}

/// A Gaussian of the given widths in bins, cut at three of them, zero beyond the borders.
fn smooth(field: &[f64], [width, height]: [usize; 2], sigmas: [f64; 2]) -> Vec<f64> {
    let [kernel_x, kernel_y] = sigmas.map(gaussian);
    let mut rows = vec![0.0; field.len()];
    for (source, target) in field.chunks_exact(width).zip(rows.chunks_exact_mut(width)) {
        for (x, sum) in target.iter_mut().enumerate() {
            *sum = convolve(&kernel_x, x, width, |x| source[x]);
        }
    }
    let mut smoothed = vec![0.0; field.len()];
    for (y, target) in smoothed.chunks_exact_mut(width).enumerate() {
        for (x, sum) in target.iter_mut().enumerate() {
            *sum = convolve(&kernel_y, y, height, |y| rows[y * width + x]);
        }
    }
    smoothed
}

/// One half of a Gaussian, from its middle outwards.
fn gaussian(sigma: f64) -> Vec<f64> {
    let half: Vec<f64> =
        (0..=(3.0 * sigma).ceil() as usize).map(|offset| (-0.5 * (offset as f64 / sigma).powi(2)).exp()).collect();
    let sum = 2.0 * half.iter().sum::<f64>() - half[0];
    half.into_iter().map(|weight| weight / sum).collect()
}

fn convolve(half_kernel: &[f64], at: usize, len: usize, value: impl Fn(usize) -> f64) -> f64 {
    let side = |offset: usize| {
        let below = at.checked_sub(offset).map_or(0.0, &value);
        let above = if at + offset < len { value(at + offset) } else { 0.0 };
        below + above
    };
    half_kernel.iter().enumerate().skip(1).fold(half_kernel[0] * value(at), |sum, (k, weight)| sum + weight * side(k))
}

/// The blobs around all peaks that stand out: bins join the highest neighbour from the highest bin down, and where two
/// blobs meet the lower one is swallowed unless the saddle lies clearly below its peak.
fn blobs(weights: &[f64], [width, height]: [usize; 2]) -> Vec<Blob> {
    let mut order: Vec<usize> = (0..weights.len()).filter(|&bin| weights[bin] > 0.0).collect();
    order.sort_by(|&a, &b| weights[b].total_cmp(&weights[a]).then(a.cmp(&b)));
    let mut labels = vec![usize::MAX; weights.len()];
    // Peak bin and the blob that swallowed it, itself at first.
    let (mut peaks, mut owners) = (Vec::new(), Vec::<usize>::new());
    for &bin in &order {
        let [x, y] = [bin % width, bin / width];
        let mut met: Vec<usize> = neighbours(x, y, width, height)
            .filter(|&neighbour| labels[neighbour] != usize::MAX)
            .map(|neighbour| root(&owners, labels[neighbour]))
            .collect();
        met.sort_unstable();
        met.dedup();
        match met.split_first() {
            None => {
                labels[bin] = peaks.len();
                owners.push(peaks.len());
                peaks.push(bin);
            }
            Some((&highest, lower)) => {
                labels[bin] = highest;
                for &label in lower {
                    if weights[bin] > SADDLE_SHARE * weights[peaks[label]] {
                        owners[label] = highest;
                    }
                }
            }
        }
    }
    let mut blobs: Vec<Blob> =
        peaks.iter().map(|&peak| Blob { peak, mass: 0.0, value: [usize::MAX, 0], gradient: [usize::MAX, 0] }).collect();
    for &bin in &order {
        let blob = &mut blobs[root(&owners, labels[bin])];
        let [x, y] = [bin % width, bin / width];
        let share = weights[bin] / weights[blob.peak];
        if share >= BLOB_SHARE {
            blob.mass += weights[bin];
        }
        let off = y.abs_diff(blob.peak / width) as f64 / (blob.peak / width).max(1) as f64;
        if share >= BLOB_SHARE || (share >= SAME_GRADIENT_SHARE && off <= SAME_GRADIENT) {
            blob.value = [blob.value[0].min(x), blob.value[1].max(x)];
            blob.gradient = [blob.gradient[0].min(y), blob.gradient[1].max(y)];
        }
    }
    blobs.into_iter().enumerate().filter(|&(label, _)| owners[label] == label).map(|(_, blob)| blob).collect()
}

fn root(owners: &[usize], mut label: usize) -> usize {
    while owners[label] != label {
        label = owners[label];
    }
    label
}

fn neighbours(x: usize, y: usize, width: usize, height: usize) -> impl Iterator<Item = usize> {
    (y.saturating_sub(1)..(y + 2).min(height))
        .flat_map(move |row| (x.saturating_sub(1)..(x + 2).min(width)).map(move |column| row * width + column))
}
