//! The range of what a brick holds, so that readers can skip it unread.

use serde::{Deserialize, Serialize};

use crate::layer::Quantization;
use crate::scalar::{Scalar, range_within};

/// Smallest and largest physical value among a brick's voxels that have one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ValueRange {
    /// Smallest.
    pub min: f64,
    /// Largest.
    pub max: f64,
}

impl ValueRange {
    /// The range of the finite physical values of stored numbers, or `None` if there is none.
    pub fn of<T: Scalar>(stored: &[T], quantization: &Quantization) -> Option<Self> {
        let lowest = quantization.lowest_stored().map_or(T::LOWEST, T::from_f64);
        let ends = range_within(stored, lowest, T::HIGHEST)?;
        // Nothing lies beyond the physical values of the ends, because the mapping never turns round.
        let [first, last] = [quantization.physical(ends[0].to_f64())?, quantization.physical(ends[1].to_f64())?];
        if first.is_finite() && last.is_finite() {
            return Some(Self { min: first.min(last), max: first.max(last) });
        }
        let physical = stored.iter().filter_map(|&value| quantization.physical(value.to_f64()));
        physical.filter(|value| value.is_finite()).fold(None, |range: Option<Self>, value| {
            Some(range.map_or(Self { min: value, max: value }, |Self { min, max }| Self {
                min: min.min(value),
                max: max.max(value),
            }))
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::quantization::Precision;
    use crate::{DistanceQuantization, HitGradientQuantization};

    fn plain<T: Scalar>(stored: &[T], quantization: &Quantization) -> Option<ValueRange> {
        let physical = || {
            stored.iter().filter_map(|value| quantization.physical(value.to_f64())).filter(|value| value.is_finite())
        };
        Some(ValueRange { min: physical().reduce(f64::min)?, max: physical().reduce(f64::max)? })
    }

    proptest! {
        #[test]
        fn ranges_are_those_of_a_plain_loop(
            bits in prop::collection::vec(any::<u64>(), 0..70),
            slope in -10.0_f64..10.0,
            d_max in 0.1_f32..100.0,
        ) {
            let linear = Quantization::Linear { slope, intercept: 3.0 };
            let floats: Vec<f64> = bits.iter().map(|&bits| f64::from_bits(bits)).collect();
            prop_assert_eq!(ValueRange::of(&floats, &linear), plain(&floats, &linear));
            let codes: Vec<i16> = bits.iter().map(|&bits| bits as i16).chain([i16::MIN, i16::MIN + 1]).collect();
            let distance = Quantization::Distance(DistanceQuantization::new(d_max, Precision::default()));
            prop_assert_eq!(ValueRange::of(&codes, &distance), plain(&codes, &distance));
            let codes: Vec<u16> = bits.iter().map(|&bits| bits as u16).chain([0, 0]).collect();
            let hit = Quantization::HitGradient(HitGradientQuantization::new(0.5, 0.5 + d_max, Precision::default()));
            prop_assert_eq!(ValueRange::of(&codes, &hit), plain(&codes, &hit));
            prop_assert_eq!(ValueRange::of(&codes, &Quantization::Octahedral), None);
        }
    }
}
