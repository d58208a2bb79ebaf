//! A first transfer function without any knob: regions around the peaks of the hit-location histogram.
//!
//! Voxels of one boundary share value and gradient magnitude at the hit, so a boundary is a blob in the histogram of
//! (v at the hit, g at the hit). Noise makes blobs as well, large ones, but at low g: to find blobs, counts are weighted
//! by g², the square because noise fills the bins in proportion to its volume, a boundary only to its surface.

use voxrole_pack::{Histogram, HistogramAxis};

use super::blobs::{Blob, find_blobs};
use crate::state::{Region, Shape};

/// Most regions that are proposed.
pub const MAX_REGIONS: usize = 4;
/// A blob with less than this share of the weightiest one's weight is not proposed.
const LEAST_WEIGHT_SHARE: f64 = 0.04;
/// Nor is one whose peak lies below this share of the strongest boundary's gradient magnitude: noise.
const LEAST_GRADIENT_SHARE: f64 = 0.2;
/// By how many `L_min` a boundary is drawn to either side of where g was measured.
const DRAWN_HALF_WIDTH: f64 = 1.5;
/// Orange, blue, green, yellow, kept apart by all common kinds of colour vision; the innermost takes the first.
///
/// Source: Okabe and Ito, "Color universal design", 2008.
const PALETTE: [[u8; 3]; MAX_REGIONS] = [[230, 159, 0], [86, 180, 233], [0, 158, 115], [240, 228, 66]];
/// αu of the innermost boundary.
const INNER_OPACITY: f32 = 0.9;
/// αu where there is one region alone, which then holds outer and inner boundaries alike.
const LONE_OPACITY: f32 = 0.25;
/// αu of the outermost boundary and of the one next to the innermost.
const OUTER_OPACITY: [f32; 2] = [0.15, 0.3];

/// Proposes up to four regions, the outermost boundary first; none when nothing was hit.
///
/// `histogram` is of two axes, value at the hit and gradient magnitude at the hit
/// ([`voxrole_pack::HistogramKind::HitValueHitGradient`]), `smallest_spacing` is `L_min`. A region's values are those of
/// its blob and, because αu looks up the value around the boundary and not on it, the values that a slope of g reaches
/// within 1.5 `L_min`; where two regions would overlap, the room is shared. Outer boundaries, taken to be those whose
/// slope starts at a low value, are nearly transparent so that inner ones show.
#[must_use]
pub fn propose_regions(histogram: &Histogram, smallest_spacing: f64) -> Vec<Region> {
    let [value_axis, gradient_axis] = histogram.shape.axes.as_slice() else {
        return Vec::new();
    };
    let width = value_axis.bins as usize;
    let mut extents: Vec<Extent> = select(find_blobs(histogram), gradient_axis, width)
        .iter()
        .map(|blob| Extent::of(blob, value_axis, gradient_axis, smallest_spacing))
        .collect();
    // What lies around a boundary inside an object is no background. Values at the boundary itself say less: skin with
    // fat below is brighter in an MRI than the brain's own boundaries.
    extents.sort_by(|a, b| a.outer_value().total_cmp(&b.outer_value()).then(a.peak_value.total_cmp(&b.peak_value)));
    for upper in 1..extents.len() {
        let (below, above) = extents.split_at_mut(upper);
        below.iter_mut().for_each(|lower| share_overlap(lower, &mut above[0]));
    }
    let count = extents.len();
    let regions = extents.iter().enumerate().map(|(place, extent)| Region {
        shape: Shape::Box,
        value: extent.value.map(round_to_digits),
        gradient: extent.gradient.map(|gradient| round_to_digits(gradient.max(0.0))),
        color: PALETTE[count - 1 - place].map(|channel| f32::from(channel) / 255.0),
        opacity: opacity(place, count),
        softness: Region::DEFAULT_SOFTNESS,
        emphasis: None,
    });
    regions.collect()
}

/// The weightiest blobs that are not noise.
///
/// Ranked by count · g: by g² a weak boundary inside, such as grey matter against white, stands no chance beside skin.
fn select(mut blobs: Vec<Blob>, gradient_axis: &HistogramAxis, width: usize) -> Vec<Blob> {
    let gradient = |blob: &Blob| gradient_axis.bin_center(blob.peak / width);
    let strongest = blobs.iter().max_by(|a, b| a.mass.total_cmp(&b.mass)).map_or(0.0, gradient);
    blobs.retain(|blob| gradient(blob) >= LEAST_GRADIENT_SHARE * strongest);
    let weight = |blob: &Blob| blob.mass / gradient(blob).max(f64::MIN_POSITIVE);
    blobs.sort_by(|a, b| weight(b).total_cmp(&weight(a)).then(a.peak.cmp(&b.peak)));
    let least = blobs.first().map_or(0.0, |weightiest| LEAST_WEIGHT_SHARE * weight(weightiest));
    blobs.retain(|blob| weight(blob) >= least);
    blobs.truncate(MAX_REGIONS);
    blobs
}

/// A region to be, in physical units.
#[derive(Clone, Copy, Debug)]
struct Extent {
    peak_value: f64,
    /// The values that the boundary's slope reaches to either side of the peak.
    reach: f64,
    value: [f64; 2],
    gradient: [f64; 2],
}

impl Extent {
    fn of(blob: &Blob, value_axis: &HistogramAxis, gradient_axis: &HistogramAxis, smallest_spacing: f64) -> Self {
        let width = value_axis.bins as usize;
        let reach = DRAWN_HALF_WIDTH * smallest_spacing * gradient_axis.bin_center(blob.peak / width);
        let edges = |axis: &HistogramAxis, [first, last]: [usize; 2]| {
            [first, last + 1].map(|bin| (bin as f64).mul_add(axis.bin_width(), axis.low))
        };
        // The fade at a region's edges lies inside it: widened by it, the blob itself keeps its full opacity.
        let widened = |[low, high]: [f64; 2]| {
            let softness = f64::from(Region::DEFAULT_SOFTNESS);
            let fade = (high - low) * softness / (1.0 - 2.0 * softness);
            [low - fade, high + fade]
        };
        let [low, high] = edges(value_axis, blob.value);
        // A little beyond what there is, so that the fade does not reach into it.
        let margin = 0.125 * (value_axis.high - value_axis.low);
        let [least, most] = [value_axis.low - margin, value_axis.high + margin];
        let [low, high] = widened([low - reach, high + reach]);
        Self {
            peak_value: value_axis.bin_center(blob.peak % width),
            reach,
            value: [low.max(least), high.min(most)],
            gradient: widened(edges(gradient_axis, blob.gradient)),
        }
    }

    /// The value on the boundary's outer side.
    fn outer_value(&self) -> f64 {
        self.peak_value - self.reach
    }
}

/// Parts two overlapping extents along the axis on which they overlap less.
fn share_overlap(a: &mut Extent, b: &mut Extent) {
    let overlap = |a: [f64; 2], b: [f64; 2]| {
        let shorter = (a[1] - a[0]).min(b[1] - b[0]).max(f64::MIN_POSITIVE);
        (a[1].min(b[1]) - a[0].max(b[0])) / shorter
    };
    let (by_value, by_gradient) = (overlap(a.value, b.value), overlap(a.gradient, b.gradient));
    if by_value <= 0.0 || by_gradient <= 0.0 {
        return;
    }
    if by_value <= by_gradient {
        let (low, high) = if a.peak_value <= b.peak_value { (a, b) } else { (b, a) };
        // Where the lower boundary's slope ends and the upper one's begins: the material between them.
        let between = 0.5 * (low.peak_value + low.reach + high.outer_value());
        let cut = between.clamp(low.peak_value, high.peak_value);
        low.value[1] = low.value[1].min(cut);
        high.value[0] = high.value[0].max(cut);
    } else {
        let (weak, strong) =
            if a.gradient[0] + a.gradient[1] < b.gradient[0] + b.gradient[1] { (a, b) } else { (b, a) };
        let cut = 0.5 * (weak.gradient[1] + strong.gradient[0]);
        weak.gradient[1] = weak.gradient[1].min(cut);
        strong.gradient[0] = strong.gradient[0].max(cut);
    }
}

/// Opaque for the innermost, growing inwards for the rest.
fn opacity(place: usize, count: usize) -> f32 {
    if count == 1 {
        return LONE_OPACITY;
    }
    let [outermost, next_to_innermost] = OUTER_OPACITY;
    match count - place {
        1 => INNER_OPACITY,
        2 => next_to_innermost,
        _ => {
            let share = place as f32 / (count - 2) as f32;
            let opacity = outermost + (next_to_innermost - outermost) * share;
            (opacity * 100.0).round() / 100.0
        }
    }
}

/// Four significant digits: enough for a region, and short to type.
fn round_to_digits(number: f64) -> f32 {
    format!("{number:.3e}").parse().unwrap_or(number as f32)
}

#[cfg(test)]
mod tests {
    use voxrole_pack::histogram::HistogramShape;
    use voxrole_pack::{HistogramAxis, HistogramKind};

    use super::*;

    /// Normal blobs: value, gradient, spread of each, count.
    fn histogram(blobs: &[[f64; 5]]) -> Histogram {
        let axes = vec![
            HistogramAxis { low: 0.0, high: 256.0, bins: 256 },
            HistogramAxis { low: 0.0, high: 128.0, bins: 256 },
        ];
        let mut counts = vec![0; 256 * 256];
        for &[value, gradient, value_spread, gradient_spread, count] in blobs {
            for (bin, total) in counts.iter_mut().enumerate() {
                let x = (axes[0].bin_center(bin % 256) - value) / value_spread;
                let y = (axes[1].bin_center(bin / 256) - gradient) / gradient_spread;
                let density = (-0.5 * (x * x + y * y)).exp() / (std::f64::consts::TAU * value_spread * gradient_spread);
                *total += (count * density * 0.5) as u64;
            }
        }
        Histogram { shape: HistogramShape { kind: HistogramKind::HitValueHitGradient, axes }, counts }
    }

    fn holds(region: &Region, value: f32, gradient: f32) -> bool {
        (region.value[0]..region.value[1]).contains(&value)
            && (region.gradient[0]..region.gradient[1]).contains(&gradient)
    }

    #[test]
    fn boundaries_are_found_from_the_outermost_to_the_innermost_and_noise_is_not() {
        let noise = [40.0, 1.0, 15.0, 0.4, 1e6];
        let histogram = histogram(&[noise, [60.0, 20.0, 4.0, 2.0, 4e4], [150.0, 50.0, 6.0, 4.0, 2e4]]);
        let regions = propose_regions(&histogram, 1.0);
        assert_eq!(regions.len(), 2, "{regions:?}");
        assert!(holds(&regions[0], 60.0, 20.0) && holds(&regions[1], 150.0, 50.0), "{regions:?}");
        assert!(regions.iter().all(|region| region.gradient[0] > 5.0), "{regions:?}");
        assert_eq!((regions[0].opacity, regions[1].opacity), (0.3, 0.9));
        assert_ne!(regions[0].color, regions[1].color);
    }

    #[test]
    fn values_reach_as_far_as_the_slope_does() {
        let regions = propose_regions(&histogram(&[[100.0, 20.0, 2.0, 2.0, 1e5]]), 0.5);
        let [low, high] = regions[0].value;
        // 1.5 L_min at slope 20 and L_min 0.5 is 15; the smoothed blob reaches 2.8 spreads of 2.8; a tenth fades.
        assert!((69.0..74.0).contains(&low) && (126.0..131.0).contains(&high), "{regions:?}");
        let [low, high] = regions[0].gradient;
        assert!((13.0..18.0).contains(&low) && (22.0..27.0).contains(&high), "{regions:?}");
        assert_eq!(regions[0].opacity, LONE_OPACITY);
    }

    #[test]
    fn a_weak_boundary_between_bright_materials_is_the_inner_one() {
        // As in an MRI of a head: skin on fat is brighter than the boundary of grey and white matter.
        let regions = propose_regions(&histogram(&[[110.0, 60.0, 6.0, 4.0, 4e4], [98.0, 15.0, 4.0, 2.0, 1e5]]), 1.0);
        assert_eq!(regions.iter().map(|region| region.opacity).collect::<Vec<_>>(), [0.3, 0.9]);
        assert!(holds(&regions[0], 110.0, 60.0) && holds(&regions[1], 98.0, 15.0), "{regions:?}");
    }

    #[test]
    fn regions_do_not_overlap() {
        // Air to metal and metal to a denser metal, at the same slope: both reach the metal's value.
        let regions = propose_regions(&histogram(&[[70.0, 50.0, 5.0, 4.0, 1e5], [190.0, 48.0, 5.0, 4.0, 3e4]]), 1.0);
        assert_eq!(regions.len(), 2);
        assert_eq!(regions[0].value[1], regions[1].value[0], "{regions:?}");
        assert!((120.0..140.0).contains(&regions[0].value[1]), "{regions:?}");
    }

    #[test]
    fn no_more_than_four_and_the_faint_ones_go() {
        let row = |value: f64, count: f64| [value, 60.0, 4.0, 3.0, count];
        let five = [row(20.0, 5e4), row(70.0, 6e4), row(120.0, 7e4), row(170.0, 8e4), row(220.0, 9e4)];
        let regions = propose_regions(&histogram(&five), 0.01);
        assert_eq!(regions.iter().map(|region| region.opacity).collect::<Vec<_>>(), [0.15, 0.23, 0.3, 0.9]);
        assert!(holds(&regions[0], 70.0, 60.0) && holds(&regions[3], 220.0, 60.0), "{regions:?}");
        let faint = [row(20.0, 1e3), row(220.0, 9e4)];
        assert_eq!(propose_regions(&histogram(&faint), 0.01).len(), 1);
    }

    #[test]
    fn a_rough_blob_is_one_blob() {
        let mut histogram = histogram(&[[128.0, 64.0, 8.0, 6.0, 1e5]]);
        // Counting noise of a few per cent.
        let mut state = 1_u64;
        for count in &mut histogram.counts {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            *count += (*count as f64 * (state >> 40) as f64 / f64::from(1 << 24) * 0.3) as u64;
        }
        assert_eq!(propose_regions(&histogram, 0.1).len(), 1);
    }

    #[test]
    fn the_typed_form_says_the_same() {
        for region in propose_regions(&histogram(&[[60.3, 20.7, 4.0, 2.0, 4e4], [150.1, 50.0, 6.0, 4.0, 2e4]]), 0.3) {
            assert_eq!(region.to_string().parse(), Ok(region));
        }
    }

    #[test]
    fn nothing_hit_proposes_nothing() {
        assert!(propose_regions(&histogram(&[]), 1.0).is_empty());
    }
}
