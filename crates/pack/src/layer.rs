//! What a packed file holds for every voxel.

use serde::{Deserialize, Serialize};

use crate::quantization::{
    DistanceQuantization, HitGradientQuantization, NO_NORMAL, NORMAL_ERROR_BOUND, widened_distance,
};
use crate::scalar::{Scalar, ScalarType};

/// The meaning of a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum LayerKind {
    /// The input's stored numbers, exactly.
    Value,
    /// Signed distance to the boundary, i16 or i8; see [`DistanceQuantization`].
    Distance,
    /// Gradient magnitude at the hit location, u16 or u8; see [`HitGradientQuantization`].
    HitGradient,
    /// Unit gradient direction in grid axes, u16; see [`crate::quantization::encode_normal`].
    Normal,
    /// Gradient magnitude at the voxel, f32, value units per world unit.
    GradientMagnitude,
    /// Second derivative along the gradient at the voxel, f32, value units per world unit squared.
    SecondDerivative,
}

impl LayerKind {
    /// The layer's name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Value => "value",
            Self::Distance => "distance",
            Self::HitGradient => "hit-gradient",
            Self::Normal => "normal",
            Self::GradientMagnitude => "gradient-magnitude",
            Self::SecondDerivative => "second-derivative",
        }
    }
}

/// One layer as described in the header: what is stored, and how it maps to physical values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Layer {
    /// What the numbers mean.
    pub kind: LayerKind,
    /// How each is stored.
    pub scalar_type: ScalarType,
    /// How a stored number maps to a physical one.
    pub quantization: Quantization,
    /// [`Quantization::error_bound`].
    pub error_bound: f64,
}

impl Layer {
    /// The layer of a quantity, in the type that its quantization asks for; `scalar_type` is that of values.
    #[must_use]
    pub fn new(kind: LayerKind, scalar_type: ScalarType, quantization: Quantization) -> Self {
        let scalar_type = quantization.scalar_type().unwrap_or(scalar_type);
        Self { kind, scalar_type, quantization, error_bound: quantization.error_bound() }
    }

    /// The stored number of voxels without a boundary, where the layer has one.
    pub(crate) fn fill<T: Scalar>(&self) -> Option<T> {
        match self.quantization {
            Quantization::Linear { .. } => None,
            Quantization::Distance(_) => Some(T::LOWEST),
            Quantization::HitGradient(_) => Some(T::default()),
            Quantization::Octahedral => Some(T::from_f64(f64::from(NO_NORMAL))),
        }
    }
}

/// How stored numbers map to physical values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Quantization {
    /// `physical = slope · stored + intercept`; slope 1 and intercept 0 for floats.
    Linear {
        /// Factor, finite and not 0.
        slope: f64,
        /// Offset, finite.
        intercept: f64,
    },
    /// Signed distance.
    Distance(DistanceQuantization),
    /// Gradient magnitude at the hit.
    HitGradient(HitGradientQuantization),
    /// Octahedral unit vector.
    Octahedral,
}

impl Quantization {
    /// The physical value of a stored number; `None` for one that stands for no value, and for directions. Never falls, or
    /// never rises, as stored numbers rise.
    #[must_use]
    pub fn physical(&self, stored: f64) -> Option<f64> {
        match self {
            Self::Linear { slope, intercept } => Some(slope.mul_add(stored, *intercept)),
            Self::Distance(quantization) if quantization.is_one_byte() => {
                quantization.decode(widened_distance(stored as i8)).map(f64::from)
            }
            Self::Distance(quantization) => quantization.decode(stored as i16).map(f64::from),
            Self::HitGradient(quantization) => quantization.decode(stored as u16).map(f64::from),
            Self::Octahedral => None,
        }
    }

    /// Largest difference between what was computed and what is read back: in world units for distances, in value units per
    /// world unit for gradient magnitudes, in radians for normals, 0 where numbers are stored as they are.
    #[must_use]
    pub fn error_bound(&self) -> f64 {
        match self {
            Quantization::Linear { .. } => 0.0,
            Quantization::Distance(distance) => f64::from(distance.error_bound()),
            Quantization::HitGradient(hit) => f64::from(hit.error_bound()),
            Quantization::Octahedral => f64::from(NORMAL_ERROR_BOUND),
        }
    }

    /// The type of the stored numbers; `None` if it may be any.
    #[must_use]
    pub fn scalar_type(&self) -> Option<ScalarType> {
        match self {
            Self::Linear { .. } => None,
            Self::Distance(quantization) if quantization.is_one_byte() => Some(ScalarType::I8),
            Self::Distance(_) => Some(ScalarType::I16),
            Self::HitGradient(quantization) if quantization.is_one_byte() => Some(ScalarType::U8),
            Self::HitGradient(_) | Self::Octahedral => Some(ScalarType::U16),
        }
    }

    /// The smallest stored number that may stand for a value; `None` if any may.
    #[must_use]
    pub fn lowest_stored(&self) -> Option<f64> {
        match self {
            Self::Distance(quantization) => Some(-f64::from(quantization.steps)),
            Self::HitGradient(_) => Some(1.0),
            Self::Linear { .. } | Self::Octahedral => None,
        }
    }
}
