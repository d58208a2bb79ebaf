//! Scalar types and dense arrays of them.

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
    /// Appends the number, little-endian.
    fn append_le(self, bytes: &mut Vec<u8>);
    /// Reads the number from exactly [`Self::SIZE`] bytes.
    fn from_le(bytes: &[u8]) -> Self;
}

/// A number that a layer can hold.
pub trait Scalar: LittleEndian + PartialEq {
    /// Its type's code.
    const TYPE: ScalarType;
    /// The number as f64, exactly.
    fn to_f64(self) -> f64;
}

macro_rules! impl_little_endian {
    ($($primitive:ty),*) => {$(
        impl LittleEndian for $primitive {
            const SIZE: usize = size_of::<Self>();
            fn append_le(self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }
            fn from_le(bytes: &[u8]) -> Self {
                let mut array = [0; Self::SIZE];
                array.copy_from_slice(bytes);
                Self::from_le_bytes(array)
            }
        }
    )*};
}
impl_little_endian!(u8, i8, u16, i16, u32, i32, u64, f32, f64);

macro_rules! impl_scalar {
    ($($primitive:ty => $code:ident),*) => {$(
        impl Scalar for $primitive {
            const TYPE: ScalarType = ScalarType::$code;
            fn to_f64(self) -> f64 {
                f64::from(self)
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
        with_scalars!(self, values => {
            values.iter().map(|value| value.to_f64()).filter(|value| value.is_finite()).fold(None, |range, value| {
                Some(range.map_or([value, value], |[low, high]: [f64; 2]| [low.min(value), high.max(value)]))
            })
        })
    }
}
