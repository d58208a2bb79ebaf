//! Scalar types and dense arrays of them.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// The type of one stored number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum ScalarType {
    /// Unsigned, 8 bit.
    U8,
    /// Signed, 8 bit.
    I8,
    /// Unsigned, 16 bit.
    U16,
    /// Signed, 16 bit.
    I16,
    /// Unsigned, 32 bit.
    U32,
    /// Signed, 32 bit.
    I32,
    /// IEEE 754 single precision.
    F32,
    /// IEEE 754 double precision.
    F64,
}

impl ScalarType {
    /// Every type, in the order of its code in a packed file.
    pub const ALL: [Self; 8] = [Self::U8, Self::I8, Self::U16, Self::I16, Self::U32, Self::I32, Self::F32, Self::F64];

    /// Bytes of one number.
    #[must_use]
    pub const fn size_in_bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Rust's name of the type: `u8`, `i8`, … `f64`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::U8 => "u8",
            Self::I8 => "i8",
            Self::U16 => "u16",
            Self::I16 => "i16",
            Self::U32 => "u32",
            Self::I32 => "i32",
            Self::F32 => "f32",
            Self::F64 => "f64",
        }
    }

    /// The type that [`Self::name`] gives `name`.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|scalar_type| scalar_type.name() == name)
    }
}

/// A number with a fixed little-endian form.
pub trait LittleEndian: Copy + Default + Send + Sync + 'static {
    /// Bytes of one number.
    const SIZE: usize;
    /// Appends numbers, little-endian.
    fn append_le(values: &[Self], bytes: &mut Vec<u8>);
    /// Reads the number from exactly [`Self::SIZE`] bytes.
    fn from_le(bytes: &[u8]) -> Self;
    /// Byte `index` of the little-endian form.
    fn byte(self, index: usize) -> u8;
    /// Whether all bytes are the same: NaNs by their payload, zeros by their sign.
    fn is_same(self, other: Self) -> bool;
    /// Whether neighbours' differences are stored rather than the numbers: for integers of up to 32 bits, whose differences
    /// are small where the numbers change slowly.
    const HAS_DIFFERENCES: bool;
    /// The difference from `previous`, its sign in the lowest bit (0, −1, 1, −2, … become 0, 1, 2, 3, …); of a type that
    /// [has differences](Self::HAS_DIFFERENCES).
    fn difference(self, previous: Self) -> Self;
    /// The number that [`Self::difference`] makes `self` from.
    fn following(self, previous: Self) -> Self;
}

/// A number that a layer can hold.
pub trait Scalar: LittleEndian + PartialOrd {
    /// Its type's code.
    const TYPE: ScalarType;
    /// Smallest finite number.
    const LOWEST: Self;
    /// Largest finite number.
    const HIGHEST: Self;
    /// The number as f64, exactly.
    fn to_f64(self) -> f64;
    /// The nearest number of this type.
    fn from_f64(value: f64) -> Self;
}

macro_rules! impl_little_endian {
    ($primitive:ty as $bits:ty, $has_differences:literal, $difference:expr, $following:expr) => {
        impl LittleEndian for $primitive {
            const SIZE: usize = size_of::<Self>();
            const HAS_DIFFERENCES: bool = $has_differences;
            fn append_le(values: &[Self], bytes: &mut Vec<u8>) {
                let start = bytes.len();
                bytes.resize(start + size_of_val(values), 0);
                let (numbers, _) = bytes[start..].as_chunks_mut::<{ Self::SIZE }>();
                numbers.iter_mut().zip(values).for_each(|(number, value)| *number = value.to_le_bytes());
            }
            #[inline]
            fn from_le(bytes: &[u8]) -> Self {
                let mut array = [0; Self::SIZE];
                array.copy_from_slice(bytes);
                Self::from_le_bytes(array)
            }
            #[inline]
            fn byte(self, index: usize) -> u8 {
                (<$bits>::from_ne_bytes(self.to_ne_bytes()) >> (8 * index)) as u8
            }
            #[inline]
            fn is_same(self, other: Self) -> bool {
                <$bits>::from_ne_bytes(self.to_ne_bytes()) == <$bits>::from_ne_bytes(other.to_ne_bytes())
            }
            #[inline]
            fn difference(self, previous: Self) -> Self {
                $difference(self, previous)
            }
            #[inline]
            fn following(self, previous: Self) -> Self {
                $following(self, previous)
            }
        }
    };
}
macro_rules! impl_integer {
    ($($primitive:ty as $unsigned:ty as $signed:ty),*) => {$(
        impl_little_endian!(
            $primitive as $unsigned,
            true,
            |number: $primitive, previous: $primitive| {
                let difference = number.wrapping_sub(previous) as $signed;
                ((difference << 1) ^ (difference >> (<$signed>::BITS - 1))) as $primitive
            },
            |number: $primitive, previous: $primitive| {
                let folded = number as $unsigned;
                previous.wrapping_add(((folded >> 1) ^ (folded & 1).wrapping_neg()) as $primitive)
            }
        );
    )*};
}
impl_integer!(
    u8 as u8 as i8,
    i8 as u8 as i8,
    u16 as u16 as i16,
    i16 as u16 as i16,
    u32 as u32 as i32,
    i32 as u32 as i32
);
impl_little_endian!(f32 as u32, false, |number, _| number, |number, _| number);
impl_little_endian!(u64 as u64, false, |number, _| number, |number, _| number);
impl_little_endian!(f64 as u64, false, |number, _| number, |number, _| number);

macro_rules! impl_scalar {
    ($($primitive:ty => $code:ident),*) => {$(
        impl Scalar for $primitive {
            const TYPE: ScalarType = ScalarType::$code;
            const LOWEST: Self = <$primitive>::MIN;
            const HIGHEST: Self = <$primitive>::MAX;
            #[inline]
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
            #[inline]
            fn from_f64(value: f64) -> Self {
                value as Self
            }
        }
    )*};
}
impl_scalar!(u8 => U8, i8 => I8, u16 => U16, i16 => I16, u32 => U32, i32 => I32, f32 => F32, f64 => F64);

/// Numbers in their own type, x fastest.
#[derive(Clone, Debug, PartialEq)]
pub enum Scalars {
    /// Unsigned, 8 bit.
    U8(Vec<u8>),
    /// Signed, 8 bit.
    I8(Vec<i8>),
    /// Unsigned, 16 bit.
    U16(Vec<u16>),
    /// Signed, 16 bit.
    I16(Vec<i16>),
    /// Unsigned, 32 bit.
    U32(Vec<u32>),
    /// Signed, 32 bit.
    I32(Vec<i32>),
    /// Single precision.
    F32(Vec<f32>),
    /// Double precision.
    F64(Vec<f64>),
}

/// Runs an expression with the vector inside a [`Scalars`], whatever its type.
#[macro_export]
macro_rules! with_scalars {
    ($scalars:expr, $values:ident => $body:expr) => {
        match $scalars {
            $crate::Scalars::U8($values) => $body,
            $crate::Scalars::I8($values) => $body,
            $crate::Scalars::U16($values) => $body,
            $crate::Scalars::I16($values) => $body,
            $crate::Scalars::U32($values) => $body,
            $crate::Scalars::I32($values) => $body,
            $crate::Scalars::F32($values) => $body,
            $crate::Scalars::F64($values) => $body,
        }
    };
}

/// Runs an expression with a name for the type of number that a [`ScalarType`] stands for.
#[macro_export]
macro_rules! with_scalar_type {
    ($scalar_type:expr, $name:ident => $body:expr) => {{
        macro_rules! with {
            ($primitive:ty) => {{
                type $name = $primitive;
                $body
            }};
        }
        match $scalar_type {
            $crate::ScalarType::U8 => with!(u8),
            $crate::ScalarType::I8 => with!(i8),
            $crate::ScalarType::U16 => with!(u16),
            $crate::ScalarType::I16 => with!(i16),
            $crate::ScalarType::U32 => with!(u32),
            $crate::ScalarType::I32 => with!(i32),
            $crate::ScalarType::F32 => with!(f32),
            $crate::ScalarType::F64 => with!(f64),
        }
    }};
}

impl Scalars {
    /// The numbers' type.
    #[must_use]
    pub fn scalar_type(&self) -> ScalarType {
        fn type_of<T: Scalar>(_: &[T]) -> ScalarType {
            T::TYPE
        }
        with_scalars!(self, values => type_of(values))
    }

    /// How many numbers there are.
    #[must_use]
    pub fn len(&self) -> usize {
        with_scalars!(self, values => values.len())
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number `index` as f64, exactly.
    ///
    /// # Panics
    /// When `index` is not below [`Self::len`].
    #[must_use]
    pub fn get(&self, index: usize) -> f64 {
        with_scalars!(self, values => values[index].to_f64())
    }

    /// Numbers of type `scalar_type` from little-endian bytes; a rest shorter than one number is dropped.
    #[must_use]
    pub fn from_le_bytes(scalar_type: ScalarType, bytes: &[u8]) -> Self {
        fn convert<T: Scalar>(bytes: &[u8]) -> Vec<T> {
            bytes.chunks_exact(T::SIZE).map(T::from_le).collect()
        }
        match scalar_type {
            ScalarType::U8 => Self::U8(bytes.to_vec()),
            ScalarType::I8 => Self::I8(convert(bytes)),
            ScalarType::U16 => Self::U16(convert(bytes)),
            ScalarType::I16 => Self::I16(convert(bytes)),
            ScalarType::U32 => Self::U32(convert(bytes)),
            ScalarType::I32 => Self::I32(convert(bytes)),
            ScalarType::F32 => Self::F32(convert(bytes)),
            ScalarType::F64 => Self::F64(convert(bytes)),
        }
    }

    /// Smallest and largest finite number, or `None` if there is none.
    #[must_use]
    pub fn finite_range(&self) -> Option<[f64; 2]> {
        fn of<T: Scalar>(values: &[T]) -> Option<[f64; 2]> {
            par_range_within(values, T::LOWEST, T::HIGHEST).map(|ends| ends.map(T::to_f64))
        }
        with_scalars!(self, values => of(values))
    }
}

/// As [`range_within`], on every thread.
#[must_use]
pub fn par_range_within<T: Scalar>(values: &[T], lowest: T, highest: T) -> Option<[T; 2]> {
    values
        .par_chunks(1 << 16)
        .filter_map(|chunk| range_within(chunk, lowest, highest))
        .reduce_with(|[a, b], [c, d]| [if c < a { c } else { a }, if d > b { d } else { b }])
}

/// Numbers that are compared at once.
const LANES: usize = 16;

/// Smallest and largest of the numbers within `lowest..=highest`, or `None` if there is none.
#[must_use]
pub fn range_within<T: Scalar>(values: &[T], lowest: T, highest: T) -> Option<[T; 2]> {
    let mut low = [highest; LANES];
    let mut high = [lowest; LANES];
    let mut take = |lane: usize, value: T| {
        let [below, above] = if value >= lowest && value <= highest { [value; 2] } else { [highest, lowest] };
        low[lane] = if below < low[lane] { below } else { low[lane] };
        high[lane] = if above > high[lane] { above } else { high[lane] };
    };
    let (blocks, rest) = values.as_chunks::<LANES>();
    for block in blocks {
        for (lane, &value) in block.iter().enumerate() {
            take(lane, value);
        }
    }
    rest.iter().enumerate().for_each(|(lane, &value)| take(lane, value));
    let low = low.into_iter().reduce(|a, b| if b < a { b } else { a })?;
    let high = high.into_iter().reduce(|a, b| if b > a { b } else { a })?;
    (low <= high).then_some([low, high])
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn ranges_are_those_of_a_plain_loop(
            values in prop::collection::vec(prop_oneof![any::<f32>(), -3.0_f32..3.0, Just(f32::MAX)], 0..70),
        ) {
            let finite = || values.iter().copied().filter(|value| value.is_finite()).map(f64::from);
            let expected = finite().reduce(f64::min).zip(finite().reduce(f64::max)).map(|(low, high)| [low, high]);
            prop_assert_eq!(Scalars::F32(values.clone()).finite_range(), expected);
        }

        #[test]
        fn codes_below_the_lowest_are_left_out(values in prop::collection::vec(any::<i16>(), 0..70), lowest in any::<i16>()) {
            let kept = || values.iter().copied().filter(|&value| value >= lowest);
            let expected = kept().min().zip(kept().max()).map(|(low, high)| [low, high]);
            prop_assert_eq!(range_within(&values, lowest, i16::MAX), expected);
        }
    }

    #[test]
    fn bytes_are_little_endian() {
        let number = 0x0102_0304_u32;
        assert_eq!([0, 1, 2, 3].map(|index| number.byte(index)), [4, 3, 2, 1]);
        let mut bytes = vec![9];
        LittleEndian::append_le(&[number, 5], &mut bytes);
        assert_eq!(bytes, [9, 4, 3, 2, 1, 5, 0, 0, 0]);
        assert!(f32::NAN.is_same(f32::NAN) && !0.0_f32.is_same(-0.0));
    }
}
