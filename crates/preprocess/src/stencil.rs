//! Three-sample differences along one axis, with the border rule.

use std::ops::{Add, Mul, Sub};

use fearless_simd::{Simd, prelude::*};

/// Weights and taps of the first and second difference along one axis.
#[derive(Clone, Copy, Debug)]
pub struct AxisStencil {
    len: usize,
    first_border: [f32; 3],
    first_inside: [f32; 3],
    second: f32,
}

/// The three samples used at one index, and their weights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Taps {
    /// Indices of the samples; the one at the voxel itself is `index[center]`.
    pub index: [usize; 3],
    /// Which of the three is the voxel itself.
    pub center: usize,
    /// What they weigh.
    pub weights: Weights<f32>,
}

/// Weights of three samples, of one voxel or in every lane of a vector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weights<V> {
    /// Of the first derivative, per L_min.
    first: [V; 3],
    /// Whether that is the difference of the samples on both sides, as it is everywhere but at the ends.
    pub is_central: bool,
    /// Of the second difference, per L_min squared.
    second: V,
}

/// What is weighed: a number, or as many as a vector holds.
pub trait Number: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {}

impl<V: Copy + Add<Output = V> + Sub<Output = V> + Mul<Output = V>> Number for V {}

impl<V: Number> Weights<V> {
    /// The first derivative. Mirroring the axis changes nothing but its sign.
    #[inline(always)]
    #[must_use]
    pub fn first(&self, [a, b, c]: [V; 3]) -> V {
        let [low, middle, high] = self.first;
        if self.is_central { high * (c - a) } else { (low * a + high * c) + middle * b }
    }

    /// The same weights, known to be central when compiled, so that what weighs nothing is left out.
    #[inline(always)]
    #[must_use]
    pub(crate) fn known_central(self) -> Self {
        debug_assert!(self.is_central, "central weights");
        Self { is_central: true, ..self }
    }

    /// The second derivative. Mirroring the axis changes nothing.
    #[inline(always)]
    #[must_use]
    pub fn second(&self, [a, b, c]: [V; 3]) -> V {
        self.second * ((a + c) - (b + b))
    }
}

impl Weights<f32> {
    /// The same weights in every lane.
    #[inline(always)]
    #[must_use]
    pub(crate) fn splat<S: Simd>(&self, simd: S) -> Weights<S::f32s> {
        let [low, middle, high] = self.first;
        Weights {
            first: [S::f32s::splat(simd, low), S::f32s::splat(simd, middle), S::f32s::splat(simd, high)],
            is_central: self.is_central,
            second: S::f32s::splat(simd, self.second),
        }
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
            0 | 1 => Self { len, first_border: [0.0; 3], first_inside: [0.0; 3], second: 0.0 },
            2 => Self { len, first_border: scaled([-1.0, 1.0, 0.0], per_length), first_inside: [0.0; 3], second: 0.0 },
            _ => Self {
                len,
                first_border: scaled([-1.5, 2.0, -0.5], per_length),
                first_inside: scaled([-0.5, 0.0, 0.5], per_length),
                second: per_area,
            },
        }
    }

    /// Taps at sample `index`.
    #[must_use]
    pub fn taps(&self, index: usize) -> Taps {
        let last = self.len - 1;
        let start = index.saturating_sub(1).min(last.saturating_sub(2));
        let taps = [start, (start + 1).min(last), (start + 2).min(last)];
        let is_central = 0 < index && index < last;
        let first = if is_central {
            self.first_inside
        } else if index == 0 {
            self.first_border
        } else {
            self.first_at_end()
        };
        Taps { index: taps, center: index - start, weights: Weights { first, is_central, second: self.second } }
    }

    fn first_at_end(&self) -> [f32; 3] {
        let [near, middle, far] = self.first_border;
        if self.len == 2 { self.first_border } else { [-far, -middle, -near] }
    }
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
                (taps.weights.first(values), taps.weights.second(values))
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
