//! Three-sample differences along one axis, with the border rule.

/// Weights and taps of the first and second difference along one axis.
#[derive(Clone, Copy, Debug)]
pub struct AxisStencil {
    len: usize,
    first_border: [f32; 3],
    first_inside: [f32; 3],
    second: [f32; 3],
}

/// The three samples used at one index, and their weights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Taps {
    /// Indices of the samples; the one at the voxel itself is `index[center]`.
    pub index: [usize; 3],
    /// Which of the three is the voxel itself.
    pub center: usize,
    /// Weights of the first derivative, per L_min.
    pub first: [f32; 3],
    /// Weights of the second derivative, per L_min squared.
    pub second: [f32; 3],
}

impl Taps {
    /// Whether the first derivative is the difference of the samples on both sides, as it is everywhere but at the ends.
    #[inline(always)]
    #[must_use]
    pub fn is_central(&self) -> bool {
        self.center == 1 && self.first[1] == 0.0
    }
}

impl AxisStencil {
    /// Differences on an axis of `len` samples, `spacing` apart.
    ///
    /// Inside: central differences, eq. (1) of the paper, second order. At the border: `(−3f0 + 4f1 − f2)/2h`, second
    /// order too and so exact on a ramp up to the last voxel (ITK and VTK halve the gradient there), and the neighbour's
    /// second difference, exact on a parabola. An axis of two samples has its one difference, an axis of one sample 0.
    #[must_use]
    pub fn new(len: usize, spacing: f32) -> Self {
        let per_length = 1.0 / spacing;
        let per_area = per_length * per_length;
        let scaled = |weights: [f32; 3], factor: f32| weights.map(|weight| weight * factor);
        match len {
            0 | 1 => Self { len, first_border: [0.0; 3], first_inside: [0.0; 3], second: [0.0; 3] },
            2 => Self {
                len,
                first_border: scaled([-1.0, 1.0, 0.0], per_length),
                first_inside: [0.0; 3],
                second: [0.0; 3],
            },
            _ => Self {
                len,
                first_border: scaled([-1.5, 2.0, -0.5], per_length),
                first_inside: scaled([-0.5, 0.0, 0.5], per_length),
                second: scaled([1.0, -2.0, 1.0], per_area),
            },
        }
    }

    /// Taps at sample `index`.
    #[must_use]
    pub fn taps(&self, index: usize) -> Taps {
        let last = self.len - 1;
        let start = index.saturating_sub(1).min(last.saturating_sub(2));
        let taps = [start, (start + 1).min(last), (start + 2).min(last)];
        let first = if index == 0 {
            self.first_border
        } else if index < last {
            self.first_inside
        } else {
            self.first_at_end()
        };
        Taps { index: taps, center: index - start, first, second: self.second }
    }

    fn first_at_end(&self) -> [f32; 3] {
        let [near, middle, far] = self.first_border;
        if self.len == 2 { self.first_border } else { [-far, -middle, -near] }
    }
}

/// `Σ weight · sample`, the outer two first, so that mirroring the axis changes no bit.
#[inline(always)]
#[must_use]
pub fn weighted_sum(weights: [f32; 3], samples: [f32; 3]) -> f32 {
    (weights[0] * samples[0] + weights[2] * samples[2]) + weights[1] * samples[1]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn derivatives(samples: &[f32], spacing: f32) -> Vec<(f32, f32)> {
        let stencil = AxisStencil::new(samples.len(), spacing);
        (0..samples.len())
            .map(|index| {
                let taps = stencil.taps(index);
                assert_eq!(taps.index[taps.center], index);
                let values = taps.index.map(|tap| samples[tap]);
                (weighted_sum(taps.first, values), weighted_sum(taps.second, values))
            })
            .collect()
    }

    #[test]
    fn exact_on_parabolas_up_to_the_last_sample() {
        let spacing = 2.0;
        let samples: Vec<f32> = (0..6).map(|i| (i as f32 * spacing).powi(2)).collect();
        for (index, (first, second)) in derivatives(&samples, spacing).into_iter().enumerate() {
            assert_eq!((first, second), (2.0 * index as f32 * spacing, 2.0), "sample {index}");
        }
    }

    #[test]
    fn short_axes() {
        assert_eq!(derivatives(&[7.0], 1.0), [(0.0, 0.0)]);
        assert_eq!(derivatives(&[1.0, 4.0], 1.0), [(3.0, 0.0), (3.0, 0.0)]);
        assert_eq!(derivatives(&[0.0, 1.0, 4.0], 1.0), [(0.0, 2.0), (2.0, 2.0), (4.0, 2.0)]);
    }
}
