//! One field of one level of a packed file, ready to be written.

use std::ops::Range;

use glam::{DMat3, DVec3};
use rayon::prelude::*;
use voxrole_pack::quantization::decode_normal;
use voxrole_pack::scalar::{LittleEndian, Scalar};
use voxrole_pack::{
    DistanceQuantization, GridGeometry, HitGradientQuantization, LayerKind, Reader, ScalarType, Scalars, with_scalars,
};

use crate::Result;
use crate::fields::{Field, RoleCode};

/// Voxels that are made physical at a time.
pub const CHUNK_VOXELS: usize = 1 << 16;

/// A field's stored numbers, which take the least memory, and what makes them physical as they are asked for.
pub struct FieldVolume {
    field: Field,
    geometry: GridGeometry,
    numbers: Numbers,
}

enum Numbers {
    /// `slope · stored + intercept`.
    Value {
        stored: Scalars,
        slope: f64,
        intercept: f64,
    },
    Distance(Vec<i16>, DistanceQuantization),
    HitGradient(Vec<u16>, HitGradientQuantization),
    Normal {
        stored: Vec<u16>,
        world_from_axes: DMat3,
    },
    Role {
        stored: Vec<i16>,
        quantization: DistanceQuantization,
        half: f32,
    },
    Derivative(Vec<f32>),
}

impl FieldVolume {
    /// Reads a field; level 0 is the volume itself.
    ///
    /// # Errors
    /// [`crate::Error::Pack`] when the file is damaged or has no such layer or level, or memory runs out.
    pub fn read(reader: &Reader, field: Field, level: usize) -> Result<Self> {
        let geometry = reader.geometry(level)?;
        let numbers = match field {
            Field::Value => {
                let (stored, slope, intercept) = reader.read_value_level(level)?;
                Numbers::Value { stored, slope, intercept }
            }
            Field::Distance => Numbers::Distance(reader.read_distance(level)?, reader.distance_quantization()?),
            Field::HitGradient => {
                Numbers::HitGradient(reader.read_hit_gradient(level)?, reader.hit_gradient_quantization()?)
            }
            Field::Normal => Numbers::Normal {
                stored: reader.read_level(LayerKind::Normal, level)?,
                world_from_axes: geometry.world_from_axes(),
            },
            Field::Role => Numbers::Role {
                stored: reader.read_distance(level)?,
                quantization: reader.distance_quantization()?,
                half: 0.5 * reader.header().geometry.smallest_spacing() as f32,
            },
            Field::GradientMagnitude | Field::SecondDerivative => {
                Numbers::Derivative(reader.read_level(field.layer(), level)?)
            }
        };
        Ok(Self { field, geometry, numbers })
    }

    /// What the numbers are.
    #[must_use]
    pub fn field(&self) -> Field {
        self.field
    }

    /// Where the voxels lie.
    #[must_use]
    pub fn geometry(&self) -> &GridGeometry {
        &self.geometry
    }

    /// Numbers of each voxel: 3 for normals, whose components are along the world's axes, else 1.
    #[must_use]
    pub fn components(&self) -> usize {
        if matches!(self.numbers, Numbers::Normal { .. }) { 3 } else { 1 }
    }

    /// Type of the physical numbers: that of the stored values where these are physical; where a slope or intercept makes
    /// them so, f32 for stored numbers of up to 16 bits and f32, f64 for others; i8 for roles; else f32.
    #[must_use]
    pub fn scalar_type(&self) -> ScalarType {
        match &self.numbers {
            Numbers::Value { stored, slope: 1.0, intercept: 0.0 } => stored.scalar_type(),
            Numbers::Value { stored, .. } => match stored.scalar_type() {
                ScalarType::U32 | ScalarType::I32 | ScalarType::F64 => ScalarType::F64,
                _ => ScalarType::F32,
            },
            Numbers::Role { .. } => ScalarType::I8,
            _ => ScalarType::F32,
        }
    }

    /// Slope and intercept that make stored values physical; 1 and 0 for all other fields.
    #[must_use]
    pub fn mapping(&self) -> [f64; 2] {
        match self.numbers {
            Numbers::Value { slope, intercept, .. } => [slope, intercept],
            _ => [1.0, 0.0],
        }
    }

    /// The same with stored instead of physical values, for a format that holds [`Self::mapping`] itself.
    #[must_use]
    pub fn into_stored(self) -> Self {
        match self.numbers {
            Numbers::Value { stored, .. } => {
                Self { numbers: Numbers::Value { stored, slope: 1.0, intercept: 0.0 }, ..self }
            }
            _ => self,
        }
    }

    /// Whether a voxel without a boundary is NaN.
    #[must_use]
    pub fn is_nan_without_boundary(&self) -> bool {
        matches!(self.field, Field::Distance | Field::HitGradient | Field::Normal)
    }

    /// Smallest and largest finite number; `None` if there is none.
    #[must_use]
    pub fn finite_range(&self) -> Option<[f64; 2]> {
        let ranges = self.chunks().into_par_iter().filter_map(|chunk| self.numbers(chunk).finite_range());
        ranges.reduce_with(|[a, b], [c, d]| [a.min(c), b.max(d)])
    }

    /// The numbers of a run of voxels, in their [`Self::scalar_type`].
    #[must_use]
    pub fn numbers(&self, voxels: Range<usize>) -> Scalars {
        let mut bytes = Vec::new();
        self.append_le(voxels, &mut bytes);
        Scalars::from_le_bytes(self.scalar_type(), &bytes)
    }

    /// The voxels in runs that are small enough to be made physical at once.
    #[must_use]
    pub fn chunks(&self) -> Vec<Range<usize>> {
        let voxels = self.geometry.voxel_count();
        (0..voxels).step_by(CHUNK_VOXELS).map(|first| first..(first + CHUNK_VOXELS).min(voxels)).collect()
    }

    /// Appends the numbers of a run of voxels, little-endian, the components of each one behind the other.
    ///
    /// # Panics
    /// When the volume has no such voxels.
    pub fn append_le(&self, voxels: Range<usize>, bytes: &mut Vec<u8>) {
        match &self.numbers {
            Numbers::Value { stored, slope: 1.0, intercept: 0.0 } => {
                with_scalars!(stored, values => append(values[voxels].iter().copied(), bytes));
            }
            Numbers::Value { stored, slope, intercept } => {
                let is_wide = self.scalar_type() == ScalarType::F64;
                with_scalars!(stored, values => append_physical(&values[voxels], *slope, *intercept, is_wide, bytes));
            }
            Numbers::Distance(stored, quantization) => {
                append(stored[voxels].iter().map(|&stored| quantization.decode(stored).unwrap_or(f32::NAN)), bytes);
            }
            Numbers::HitGradient(stored, quantization) => {
                append(stored[voxels].iter().map(|&stored| quantization.decode(stored).unwrap_or(f32::NAN)), bytes);
            }
            Numbers::Normal { stored, world_from_axes } => {
                let in_world = |stored| {
                    let normal = decode_normal(stored).map(DVec3::from);
                    normal.map_or([f32::NAN; 3], |normal| (world_from_axes * normal).as_vec3().to_array())
                };
                append(stored[voxels].iter().flat_map(|&stored| in_world(stored)), bytes);
            }
            Numbers::Role { stored, quantization, half } => {
                append(stored[voxels].iter().map(|&stored| RoleCode::of(stored, quantization, *half) as i8), bytes);
            }
            Numbers::Derivative(values) => append(values[voxels].iter().copied(), bytes),
        }
    }
}

fn append<T: LittleEndian>(values: impl Iterator<Item = T>, bytes: &mut Vec<u8>) {
    T::append_le(&values.collect::<Vec<_>>(), bytes);
}

fn append_physical<T: Scalar>(values: &[T], slope: f64, intercept: f64, is_wide: bool, bytes: &mut Vec<u8>) {
    let physical = values.iter().map(|value| slope.mul_add(value.to_f64(), intercept));
    if is_wide { append(physical, bytes) } else { append(physical.map(|value| value as f32), bytes) }
}
