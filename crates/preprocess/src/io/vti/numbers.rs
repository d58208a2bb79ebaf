//! Numbers of an array as bytes: whole ones, of one component, in little-endian order, of a type that a volume can have.

use std::str::{self, FromStr};

use voxrole_pack::ScalarType;

use super::super::header::shown;
use super::super::raw::ByteOrder;
use super::array::StoredArray;
use crate::Result;

/// Longest number that is read as text.
const MAX_NUMBER_CHARACTERS: usize = 64;
/// Bytes that are gathered before they are handed on.
const CHUNK_BYTES: usize = 1 << 16;

/// A type of VTK's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NumberType {
    Scalar(ScalarType),
    /// 64-bit integers: read as the 32-bit ones if all of them fit.
    I64,
    /// Likewise.
    U64,
}

impl NumberType {
    /// The type by its name in VTK's XML.
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "Int8" => Self::Scalar(ScalarType::I8),
            "UInt8" => Self::Scalar(ScalarType::U8),
            "Int16" => Self::Scalar(ScalarType::I16),
            "UInt16" => Self::Scalar(ScalarType::U16),
            "Int32" => Self::Scalar(ScalarType::I32),
            "UInt32" => Self::Scalar(ScalarType::U32),
            "Float32" => Self::Scalar(ScalarType::F32),
            "Float64" => Self::Scalar(ScalarType::F64),
            "Int64" => Self::I64,
            "UInt64" => Self::U64,
            _ => return None,
        })
    }

    /// What the numbers are read as.
    pub fn scalar_type(self) -> ScalarType {
        match self {
            Self::Scalar(scalar_type) => scalar_type,
            Self::I64 => ScalarType::I32,
            Self::U64 => ScalarType::U32,
        }
    }

    /// Bytes of a stored number.
    pub fn size(self) -> usize {
        match self {
            Self::Scalar(scalar_type) => scalar_type.size_in_bytes(),
            Self::I64 | Self::U64 => 8,
        }
    }

    /// Whether numbers have to be checked and shortened.
    pub fn is_narrowed(self) -> bool {
        matches!(self, Self::I64 | Self::U64)
    }
}

/// Takes an array's bytes or its text in parts of any length.
pub struct Numbers<'a> {
    array: &'a StoredArray,
    byte_order: ByteOrder,
    sink: &'a mut dyn FnMut(&[u8]) -> Result<()>,
    /// Stored bytes of which no whole voxel was there.
    rest: Vec<u8>,
    picked: Vec<u8>,
    word: Vec<u8>,
}

impl<'a> Numbers<'a> {
    pub fn new(array: &'a StoredArray, sink: &'a mut dyn FnMut(&[u8]) -> Result<()>) -> Self {
        let (rest, picked, word) = (Vec::new(), Vec::new(), Vec::new());
        Self { array, byte_order: array.byte_order, sink, rest, picked, word }
    }

    /// Takes in bytes.
    pub fn push(&mut self, bytes: &[u8]) -> Result<()> {
        let voxel_bytes = self.array.number_type.size() * self.array.components;
        self.rest.extend_from_slice(bytes);
        let whole = self.rest.len() / voxel_bytes * voxel_bytes;
        let rest = self.rest.split_off(whole);
        let voxels = std::mem::replace(&mut self.rest, rest);
        self.pick(voxels, voxel_bytes)
    }

    /// Takes in text; a number is complete behind a blank.
    pub fn push_text(&mut self, text: &[u8]) -> Result<()> {
        self.byte_order = ByteOrder::Little;
        let mut bytes = Vec::with_capacity(text.len());
        for &character in text {
            if !character.is_ascii_whitespace() {
                self.word.push(character);
                if self.word.len() > MAX_NUMBER_CHARACTERS {
                    return Err(self.no_number());
                }
            } else if !self.word.is_empty() {
                self.append_word(&mut bytes)?;
                self.word.clear();
            }
        }
        self.push(&bytes)
    }

    /// Hands on what is left.
    ///
    /// # Errors
    /// Those of the sink; [`crate::Error::Format`] when a number or a voxel is not complete.
    pub fn finish(mut self) -> Result<()> {
        if !self.rest.is_empty() {
            let count = self.array.components;
            return Err(self
                .array
                .fail(format!("expected {count} numbers for each voxel, found fewer for the last one")));
        }
        self.hand_on()
    }

    /// Takes the component that is meant out of whole voxels.
    fn pick(&mut self, mut voxels: Vec<u8>, voxel_bytes: usize) -> Result<()> {
        let StoredArray { number_type, component, components, .. } = *self.array;
        let size = number_type.size();
        if self.byte_order == ByteOrder::Big {
            voxels.chunks_exact_mut(size).for_each(<[u8]>::reverse);
        }
        if components == 1 && !number_type.is_narrowed() {
            return (self.sink)(&voxels);
        }
        for voxel in voxels.chunks_exact(voxel_bytes) {
            let number = &voxel[component * size..][..size];
            if number_type.is_narrowed() {
                let number = number.first_chunk().copied().unwrap_or_default();
                self.picked.extend_from_slice(&self.narrowed(number)?);
            } else {
                self.picked.extend_from_slice(number);
            }
            if self.picked.len() >= CHUNK_BYTES {
                self.hand_on()?;
            }
        }
        self.hand_on()
    }

    fn hand_on(&mut self) -> Result<()> {
        (self.sink)(&self.picked)?;
        self.picked.clear();
        Ok(())
    }

    /// A 64-bit integer as 32 bits.
    fn narrowed(&self, number: [u8; 8]) -> Result<[u8; 4]> {
        let narrowed = match self.array.number_type {
            NumberType::U64 => u32::try_from(u64::from_le_bytes(number)).map(u32::to_le_bytes),
            _ => i32::try_from(i64::from_le_bytes(number)).map(i32::to_le_bytes),
        };
        narrowed.map_err(|_| {
            let found = match self.array.number_type {
                NumberType::U64 => u64::from_le_bytes(number).to_string(),
                _ => i64::from_le_bytes(number).to_string(),
            };
            let message = format!(
                "expected 64-bit integers that fit into 32 bits, found {found}: convert the array to Float64 first"
            );
            self.array.fail(message)
        })
    }

    fn append_word(&self, bytes: &mut Vec<u8>) -> Result<()> {
        fn parsed<T: FromStr>(word: &[u8]) -> Option<T> {
            str::from_utf8(word).ok()?.parse().ok()
        }
        macro_rules! append {
            ($type:ty) => {
                parsed::<$type>(&self.word).map(|number| bytes.extend_from_slice(&number.to_le_bytes()))
            };
        }
        let appended = match self.array.number_type {
            NumberType::Scalar(ScalarType::U8) => append!(u8),
            NumberType::Scalar(ScalarType::I8) => append!(i8),
            NumberType::Scalar(ScalarType::U16) => append!(u16),
            NumberType::Scalar(ScalarType::I16) => append!(i16),
            NumberType::Scalar(ScalarType::U32) => append!(u32),
            NumberType::Scalar(ScalarType::I32) => append!(i32),
            NumberType::Scalar(ScalarType::F32) => append!(f32),
            NumberType::Scalar(ScalarType::F64) => append!(f64),
            NumberType::I64 => append!(i64),
            NumberType::U64 => append!(u64),
        };
        appended.ok_or_else(|| self.no_number())
    }

    fn no_number(&self) -> crate::Error {
        let name = self.array.number_type.scalar_type().name();
        self.array
            .fail(format!("expected numbers of type {name}, found {}", shown(&String::from_utf8_lossy(&self.word))))
    }
}
