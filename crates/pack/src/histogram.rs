//! Histograms over all voxels, taken at full precision before anything is quantised.

use serde::{Deserialize, Serialize};

/// Which quantities a histogram counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum HistogramKind {
    /// Value against gradient magnitude, every voxel.
    ValueGradient,
    /// Value against second directional derivative, every voxel.
    ValueSecondDerivative,
    /// The voxel's own value against the gradient magnitude at its hit: what αu(v, g) looks up.
    ValueHitGradient,
    /// Value at the hit against gradient magnitude at the hit: the paper's graph.
    HitValueHitGradient,
    /// Signed distance of every voxel that has a boundary.
    Distance,
}

impl HistogramKind {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::ValueGradient,
        Self::ValueSecondDerivative,
        Self::ValueHitGradient,
        Self::HitValueHitGradient,
        Self::Distance,
    ];

    /// The histogram's name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::ValueGradient => "v-g",
            Self::ValueSecondDerivative => "v-f2",
            Self::ValueHitGradient => "v-hit",
            Self::HitValueHitGradient => "hit-hit",
            Self::Distance => "distance",
        }
    }

    /// Number of its axes.
    #[must_use]
    pub const fn axis_count(self) -> usize {
        if matches!(self, Self::Distance) { 1 } else { 2 }
    }
}

/// Equal bins from `low` to `high`; the last holds `high` too.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HistogramAxis {
    /// Lower edge of the first bin.
    pub low: f64,
    /// Upper edge of the last bin; above `low`.
    pub high: f64,
    /// Number of bins.
    pub bins: u32,
}

impl HistogramAxis {
    /// Width of a bin.
    #[must_use]
    pub fn bin_width(&self) -> f64 {
        (self.high - self.low) / f64::from(self.bins)
    }

    /// The bin of `value`; values outside go to the nearest bin.
    #[must_use]
    #[inline]
    pub fn bin_of(&self, value: f64) -> usize {
        let bin = (value - self.low) / (self.high - self.low) * f64::from(self.bins);
        (bin.max(0.0) as usize).min(self.bins as usize - 1)
    }

    /// The middle of a bin.
    #[must_use]
    pub fn bin_center(&self, bin: usize) -> f64 {
        (bin as f64 + 0.5).mul_add(self.bin_width(), self.low)
    }
}

/// What a histogram counts, and over which axes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HistogramShape {
    /// Which quantities.
    pub kind: HistogramKind,
    /// As many as [`HistogramKind::axis_count`] says.
    pub axes: Vec<HistogramAxis>,
}

impl HistogramShape {
    /// Number of bins over all axes, or `None` where that overflows.
    #[must_use]
    pub fn bin_count(&self) -> Option<u64> {
        self.axes.iter().try_fold(1_u64, |product, axis| product.checked_mul(u64::from(axis.bins)))
    }
}

/// A histogram.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    /// What is counted.
    pub shape: HistogramShape,
    /// The counts, first axis fastest.
    pub counts: Vec<u64>,
}

impl Histogram {
    /// Number of voxels counted.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.counts.iter().fold(0, |total, &count| total.saturating_add(count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_hold_their_lower_edge_and_the_last_its_upper() {
        let axis = HistogramAxis { low: -1.0, high: 3.0, bins: 4 };
        assert_eq!([-5.0, -1.0, 0.0, 2.999, 3.0, 9.0].map(|value| axis.bin_of(value)), [0, 0, 1, 3, 3, 3]);
        assert!((axis.bin_center(1) - 0.5).abs() < 1e-12);
    }
}
