//! How a phantom's values become integers.

use voxrole_pack::ScalarType;

use crate::{Error, Result};

/// Which integers stand for which values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantization {
    /// The stored numbers of the phantom's lowest and highest plateau; values between them are mapped linearly and
    /// rounded to the nearest.
    pub plateaus: [f64; 2],
    /// The smallest and largest number that is stored; what lies beyond is clamped.
    pub limits: [f64; 2],
}

impl Quantization {
    /// Twelve bits in a wider type, as scanners store: 0 to 4095.
    pub const U12: Self = Self { plateaus: [320.0, 3760.0], limits: [0.0, 4095.0] };

    /// What `scalar_type` gets if nothing else is said, or `None` for floats, which hold the value itself.
    ///
    /// Both plateaus lie inside the type's range, so that noise of a few per cent is seldom clamped.
    #[must_use]
    pub const fn of(scalar_type: ScalarType) -> Option<Self> {
        let plateaus = match scalar_type {
            ScalarType::U8 => [20.0, 235.0],
            ScalarType::I8 => [-100.0, 100.0],
            ScalarType::U16 | ScalarType::I16 => [1000.0, 30_000.0],
            ScalarType::U32 | ScalarType::I32 => [100_000.0, 3_000_000.0],
            ScalarType::F32 | ScalarType::F64 => return None,
        };
        match type_limits(scalar_type) {
            Some(limits) => Some(Self { plateaus, limits }),
            None => None,
        }
    }

    /// Checks that the numbers fit `scalar_type`.
    pub(super) fn validate(&self, scalar_type: ScalarType) -> Result<()> {
        let name = scalar_type.name();
        let Some([least, most]) = type_limits(scalar_type) else {
            return Err(Error::Parameter(format!("{name} is not quantised: give an integer type, or a value scale")));
        };
        let Self { plateaus: [low, high], limits: [smallest, largest] } = *self;
        // Written so that NaN fails.
        if !(least <= smallest && smallest <= low && low < high && high <= largest && largest <= most) {
            return Err(Error::Parameter(format!(
                "plateaus at {low} and {high} within {smallest} to {largest}: they must rise and fit {name}, which \
                 holds {least} to {most}"
            )));
        }
        Ok(())
    }
}

/// The smallest and largest integer of a type, or `None` for floats.
const fn type_limits(scalar_type: ScalarType) -> Option<[f64; 2]> {
    Some(match scalar_type {
        ScalarType::U8 => [0.0, u8::MAX as f64],
        ScalarType::I8 => [i8::MIN as f64, i8::MAX as f64],
        ScalarType::U16 => [0.0, u16::MAX as f64],
        ScalarType::I16 => [i16::MIN as f64, i16::MAX as f64],
        ScalarType::U32 => [0.0, u32::MAX as f64],
        ScalarType::I32 => [i32::MIN as f64, i32::MAX as f64],
        ScalarType::F32 | ScalarType::F64 => return None,
    })
}

/// The stored numbers of a phantom's lowest and highest plateau if nothing else is said, or `None` for floats, which hold
/// the value itself.
#[must_use]
pub const fn stored_range(scalar_type: ScalarType) -> Option<[f64; 2]> {
    match Quantization::of(scalar_type) {
        Some(quantization) => Some(quantization.plateaus),
        None => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_fits_the_type_is_taken() {
        assert!(Quantization::U12.validate(ScalarType::U16).is_ok());
        assert!(Quantization::U12.validate(ScalarType::I16).is_ok());
        for scalar_type in [ScalarType::U8, ScalarType::I8, ScalarType::F32] {
            assert!(Quantization::U12.validate(scalar_type).is_err(), "{}", scalar_type.name());
        }
        for plateaus in [[10.0, 10.0], [20.0, 10.0], [-1.0, 10.0], [f64::NAN, 10.0], [0.0, 5000.0]] {
            assert!(Quantization { plateaus, ..Quantization::U12 }.validate(ScalarType::U16).is_err(), "{plateaus:?}");
        }
        for scalar_type in ScalarType::ALL {
            assert!(Quantization::of(scalar_type).is_none_or(|own| own.validate(scalar_type).is_ok()));
        }
    }
}
