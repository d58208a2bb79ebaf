//! What a packed file tells of every voxel, in physical units.

use rayon::prelude::*;
use voxrole_pack::scalar::Scalar;
use voxrole_pack::{DistanceQuantization, LayerKind, Reader, with_scalars};

use crate::field_volume::{CHUNK_VOXELS, FieldVolume};
use crate::{Error, Result};

/// A quantity per voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Field {
    /// The physical value.
    Value,
    /// Signed distance to the boundary in world units, positive on the high-value side; NaN without a boundary.
    Distance,
    /// Gradient magnitude at the hit; NaN without a boundary.
    HitGradient,
    /// Unit gradient direction along the world's axes, three numbers; NaN without a boundary.
    Normal,
    /// What the voxel is to its boundary: see [`RoleCode`].
    Role,
    /// Gradient magnitude at the voxel.
    GradientMagnitude,
    /// Second derivative along the gradient at the voxel.
    SecondDerivative,
}

impl Field {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::Value,
        Self::Distance,
        Self::HitGradient,
        Self::Normal,
        Self::Role,
        Self::GradientMagnitude,
        Self::SecondDerivative,
    ];

    /// The field's name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Role => "role",
            _ => self.layer().name(),
        }
    }

    /// What the numbers mean, in ASCII.
    #[must_use]
    pub const fn description(self) -> &'static str {
        match self {
            Self::Value => "value",
            Self::Distance => "signed distance to the boundary, positive on the high-value side",
            Self::HitGradient => "gradient magnitude at the hit",
            Self::Normal => "unit gradient direction along the axes of the world",
            Self::Role => "role: 0 no boundary, 1 on it, 2 high-value side, 3 low-value side, -1 masked",
            Self::GradientMagnitude => "gradient magnitude",
            Self::SecondDerivative => "second directional derivative",
        }
    }

    /// The layer that the field is read from.
    #[must_use]
    pub const fn layer(self) -> LayerKind {
        match self {
            Self::Value => LayerKind::Value,
            Self::Distance | Self::Role => LayerKind::Distance,
            Self::HitGradient => LayerKind::HitGradient,
            Self::Normal => LayerKind::Normal,
            Self::GradientMagnitude => LayerKind::GradientMagnitude,
            Self::SecondDerivative => LayerKind::SecondDerivative,
        }
    }
}

/// The numbers of [`Field::Role`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RoleCode {
    /// A sample of the voxel's stencil is NaN or infinite.
    Masked = -1,
    /// No boundary within `d_max`.
    None = 0,
    /// On the boundary: at most half of L_min away.
    Boundary = 1,
    /// Farther, on the high-value side.
    HighSide = 2,
    /// Farther, on the low-value side.
    LowSide = 3,
}

impl RoleCode {
    /// The role of a voxel by its stored distance; `half` is half of L_min.
    pub(crate) fn of(stored: i16, quantization: &DistanceQuantization, half: f32) -> Self {
        match quantization.decode(stored) {
            None if stored == DistanceQuantization::MASKED => Self::Masked,
            None => Self::None,
            Some(distance) if distance.abs() <= half => Self::Boundary,
            Some(distance) if distance > 0.0 => Self::HighSide,
            Some(_) => Self::LowSide,
        }
    }
}

/// Reads a field of one number for every voxel, x fastest, as f32.
///
/// Distances err by at most [`DistanceQuantization::error_bound`], magnitudes at the hit by at most
/// [`voxrole_pack::HitGradientQuantization::error_bound`]; the other quantities are as exact as f32.
///
/// # Errors
/// [`Error::Pack`] when the file is damaged or has no such layer, or memory runs out; [`Error::Parameter`] for
/// [`Field::Normal`].
pub fn read_field(reader: &Reader, field: Field) -> Result<Vec<f32>> {
    if field == Field::Normal {
        return Err(Error::Parameter("normals are three numbers for every voxel".into()));
    }
    let volume = FieldVolume::read(reader, field, 0)?;
    let voxels = volume.geometry().voxel_count();
    let mut numbers = Vec::new();
    numbers
        .try_reserve_exact(voxels)
        .map_err(|_| Error::OutOfMemory { what: format!("the field `{}`", field.name()), bytes: voxels as u128 * 4 })?;
    numbers.resize(voxels, 0.0);
    numbers.par_chunks_mut(CHUNK_VOXELS).enumerate().for_each(|(chunk, numbers)| {
        let first = chunk * CHUNK_VOXELS;
        let decoded = volume.numbers(first..first + numbers.len());
        with_scalars!(&decoded, values => {
            numbers.iter_mut().zip(values).for_each(|(number, value)| *number = value.to_f64() as f32);
        });
    });
    Ok(numbers)
}
