//! Stored integer ↔ physical value, each with its error bound.

use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};

/// How many bits a stored distance or gradient magnitude has: from 8 to 16.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Precision(u8);

impl Precision {
    /// So many bits, or `None` unless from 8 to 16.
    #[must_use]
    pub fn new(bits: u8) -> Option<Self> {
        (8..=16).contains(&bits).then_some(Self(bits))
    }

    /// The number of bits.
    #[must_use]
    pub fn bits(self) -> u8 {
        self.0
    }

    /// Whether a number is stored in one byte.
    #[must_use]
    pub fn is_one_byte(self) -> bool {
        self.0 == 8
    }

    /// Codes of an unsigned number: 2 to the number of bits.
    fn codes(self) -> u32 {
        1 << self.0
    }
}

impl Default for Precision {
    fn default() -> Self {
        Self(16)
    }
}

/// Signed distance in whole steps: `d = stored · d_max / steps`; positive on the high-value side of the boundary.
///
/// In memory a stored number is an i16. Where [`Self::is_one_byte`], a file has i8 with its own two lowest numbers for what
/// has no distance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DistanceQuantization {
    /// Largest distance, in world units; positive and finite.
    pub d_max: f32,
    /// Largest stored magnitude, from 126 to 32766.
    pub steps: u16,
}

impl DistanceQuantization {
    /// Stored for a voxel that meets no boundary within `d_max`.
    pub const NO_BOUNDARY: i16 = i16::MIN;
    /// Stored for a voxel whose stencil holds NaN or ±Inf.
    pub const MASKED: i16 = i16::MIN + 1;
    /// Fewest steps that there may be.
    pub const FEWEST_STEPS: u16 = 126;
    /// Most steps that there may be.
    pub const MOST_STEPS: u16 = 32766;

    /// Steps of so many bits.
    #[must_use]
    pub fn new(d_max: f32, precision: Precision) -> Self {
        Self { d_max, steps: (precision.codes() / 2 - 2) as u16 }
    }

    /// Whether every stored number fits one byte.
    #[must_use]
    pub fn is_one_byte(&self) -> bool {
        self.steps == Self::FEWEST_STEPS
    }

    /// Largest difference between a distance within `±d_max` and what is read back, in world units.
    #[must_use]
    pub fn error_bound(&self) -> f32 {
        // Half a step, and what the arithmetic in f32 rounds off: up to 1.6 % of that for numbers of 15 bits.
        0.5 * self.d_max / f32::from(self.steps) * 1.02
    }

    /// The stored number for a distance; clamped to `±d_max`.
    #[must_use]
    #[inline]
    pub fn encode(&self, distance: f32) -> i16 {
        let steps = f32::from(self.steps);
        rounded((distance / self.d_max * steps).clamp(-steps, steps)) as i16
    }

    /// The distance, or `None` where there is no boundary or the voxel is masked.
    #[must_use]
    #[inline]
    pub fn decode(&self, stored: i16) -> Option<f32> {
        (stored > Self::MASKED).then(|| f32::from(stored) * (self.d_max / f32::from(self.steps)))
    }
}

/// The one byte that a file has for a stored distance of at most 126 steps.
#[must_use]
#[inline]
pub fn narrow_distance(stored: i16) -> i8 {
    if stored <= DistanceQuantization::MASKED { (stored - i16::MIN) as i8 + i8::MIN } else { stored as i8 }
}

/// The stored distance of [`narrow_distance`].
#[must_use]
#[inline]
pub fn widened_distance(byte: i8) -> i16 {
    if byte <= i8::MIN + 1 { i16::from(byte - i8::MIN) + i16::MIN } else { i16::from(byte) }
}

/// Gradient magnitude at the hit in whole steps: 0 for no hit, else `low + (stored − 1)/steps · (high − low)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HitGradientQuantization {
    /// Smallest magnitude at any hit.
    pub low: f32,
    /// Largest magnitude at any hit.
    pub high: f32,
    /// Steps from `low` to `high`, from 254 to 65534.
    pub steps: u16,
}

impl HitGradientQuantization {
    /// Fewest steps that there may be.
    pub const FEWEST_STEPS: u16 = 254;
    /// Most steps that there may be.
    pub const MOST_STEPS: u16 = 65534;

    /// Steps of so many bits.
    #[must_use]
    pub fn new(low: f32, high: f32, precision: Precision) -> Self {
        Self { low, high, steps: (precision.codes() - 2) as u16 }
    }

    /// Whether every stored number fits one byte.
    #[must_use]
    pub fn is_one_byte(&self) -> bool {
        self.steps == Self::FEWEST_STEPS
    }

    /// Largest difference between a magnitude within `low..=high` and what is read back.
    #[must_use]
    pub fn error_bound(&self) -> f32 {
        0.5 * (self.high - self.low) / f32::from(self.steps) + 3.0 * f32::EPSILON * self.high
    }

    /// The stored number for a magnitude; clamped to `low..=high`.
    #[must_use]
    #[inline]
    pub fn encode(&self, magnitude: f32) -> u16 {
        let extent = self.high - self.low;
        let fraction = if extent > 0.0 { ((magnitude - self.low) / extent).clamp(0.0, 1.0) } else { 0.0 };
        1 + rounded(fraction * f32::from(self.steps)) as u16
    }

    /// The magnitude, or `None` where there is no hit.
    #[must_use]
    #[inline]
    pub fn decode(&self, stored: u16) -> Option<f32> {
        let steps = f32::from(stored.checked_sub(1)?);
        Some((self.high - self.low).mul_add(steps / f32::from(self.steps), self.low))
    }
}

/// `number.round()`, without the call that many processors need for that. Requires a magnitude below 2²²; 0 for NaN.
#[inline]
fn rounded(number: f32) -> i32 {
    // The largest number below one half: one half itself would lift what lies just below it to 1.
    (number + 0.499_999_97_f32.copysign(number)) as i32
}

/// Stored for a voxel without a direction.
pub const NO_NORMAL: u16 = 0x8080;

/// Largest angle between a unit vector and what is read back, in radians (0.95°).
pub const NORMAL_ERROR_BOUND: f32 = 0.0166;

/// A unit vector as two signed bytes, x in the low byte, on the unfolded octahedron.
///
/// Source: Cigolle et al., "A survey of efficient representations for independent unit vectors", JCGT 3(2), 2014.
#[must_use]
pub fn encode_normal(normal: Vec3) -> u16 {
    let sum = normal.abs().element_sum();
    if !(sum > 0.0 && sum.is_finite()) {
        return NO_NORMAL;
    }
    let flat = normal / sum;
    let folded = if flat.z >= 0.0 { Vec2::new(flat.x, flat.y) } else { fold(flat.x, flat.y) };
    let bytes = (folded * 127.0).round().clamp(Vec2::splat(-127.0), Vec2::splat(127.0));
    u16::from_le_bytes([bytes.x as i8 as u8, bytes.y as i8 as u8])
}

/// The unit vector of [`encode_normal`], or `None` for [`NO_NORMAL`].
#[must_use]
pub fn decode_normal(stored: u16) -> Option<Vec3> {
    if stored == NO_NORMAL {
        return None;
    }
    let [x, y] = stored.to_le_bytes().map(|byte| f32::from(byte as i8) / 127.0);
    let z = 1.0 - x.abs() - y.abs();
    let flat = if z >= 0.0 { Vec2::new(x, y) } else { fold(x, y) };
    Some(flat.extend(z).normalize())
}

/// Folds the lower half of the octahedron out to the square's corners, and back.
fn fold(x: f32, y: f32) -> Vec2 {
    Vec2::new((1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn distance_keeps_signs_and_sentinels_apart() {
        let quantization = DistanceQuantization::new(15.0, Precision::default());
        assert_eq!(quantization.decode(DistanceQuantization::NO_BOUNDARY), None);
        assert_eq!(quantization.decode(DistanceQuantization::MASKED), None);
        for end in [-15.0, 0.0, 15.0] {
            assert_eq!(quantization.decode(quantization.encode(end)), Some(end));
        }
    }

    #[test]
    fn one_byte_has_its_own_numbers_for_no_distance() {
        for stored in (-126..=126).chain([DistanceQuantization::NO_BOUNDARY, DistanceQuantization::MASKED]) {
            assert_eq!(widened_distance(narrow_distance(stored)), stored);
        }
        assert_eq!(narrow_distance(DistanceQuantization::NO_BOUNDARY), -128);
        assert_eq!(narrow_distance(DistanceQuantization::MASKED), -127);
    }

    #[test]
    fn the_middle_between_two_steps_is_within_the_bound() {
        let quantization = DistanceQuantization::new(179.281_31, Precision::default());
        let distance = 0.516_068_46 * quantization.d_max;
        let back = quantization.decode(quantization.encode(distance)).expect("a distance");
        assert!((back - distance).abs() <= quantization.error_bound());
    }

    #[test]
    fn the_largest_magnitudes_have_a_bound() {
        assert!(HitGradientQuantization::new(0.0, f32::MAX, Precision::default()).error_bound().is_finite());
    }

    #[test]
    fn equal_hits_survive() {
        let quantization = HitGradientQuantization::new(0.5, 0.5, Precision::default());
        assert_eq!(quantization.decode(quantization.encode(0.5)), Some(0.5));
        assert_eq!(quantization.decode(0), None);
    }

    #[test]
    fn halves_are_rounded_away_from_0() {
        for whole in 0_u16..=u16::MAX {
            let half = f32::from(whole) + 0.5;
            for number in [half.next_down(), half, half.next_up(), f32::from(whole)] {
                assert_eq!([rounded(number), rounded(-number)], [number, -number].map(|number| number.round() as i32));
            }
        }
        assert_eq!(rounded(f32::NAN), 0);
    }

    proptest! {
        #[test]
        fn distance_error_is_bounded(d_max in 1e-3_f32..1e3, fraction in -1.0_f32..=1.0, bits in 8_u8..=16) {
            let quantization = DistanceQuantization::new(d_max, Precision::new(bits).expect("8 to 16"));
            let distance = fraction * d_max;
            let stored = quantization.encode(distance);
            let back = quantization.decode(stored).expect("a distance");
            prop_assert!((back - distance).abs() <= quantization.error_bound());
            prop_assert!(bits > 8 || widened_distance(narrow_distance(stored)) == stored);
        }

        #[test]
        fn hit_gradient_error_is_bounded(
            low in 0.0_f32..10.0,
            extent in 0.0_f32..1e6,
            fraction in 0.0_f32..=1.0,
            bits in 8_u8..=16,
        ) {
            let precision = Precision::new(bits).expect("8 to 16");
            let quantization = HitGradientQuantization::new(low, low + extent, precision);
            let magnitude = (low + fraction * extent).min(quantization.high);
            let stored = quantization.encode(magnitude);
            prop_assert!(bits > 8 || stored <= 255);
            let back = quantization.decode(stored).expect("a magnitude");
            prop_assert!((back - magnitude).abs() <= quantization.error_bound());
        }

        #[test]
        fn normal_error_is_bounded(x in -1.0_f32..1.0, y in -1.0_f32..1.0, z in -1.0_f32..1.0) {
            let vector = Vec3::new(x, y, z);
            prop_assume!(vector.length() > 1e-3);
            let normal = vector.normalize();
            let back = decode_normal(encode_normal(normal)).expect("a direction");
            prop_assert!(back.angle_between(normal) <= NORMAL_ERROR_BOUND);
        }
    }
}
