//! What a packed file holds for every voxel.

use serde::{Deserialize, Serialize};

use crate::quantization::{DistanceQuantization, HitGradientQuantization};
use crate::scalar::ScalarType;

/// The meaning of a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum LayerKind {
    /// The input's stored numbers, exactly.
    Value,
    /// Signed distance to the boundary, i16; see [`DistanceQuantization`].
    Distance,
    /// Gradient magnitude at the hit location, u16; see [`HitGradientQuantization`].
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
            Self::Distance(quantization) => quantization.decode(stored as i16).map(f64::from),
            Self::HitGradient(quantization) => quantization.decode(stored as u16).map(f64::from),
            Self::Octahedral => None,
        }
    }

    /// The smallest stored number that may stand for a value; `None` if any may.
    #[must_use]
    pub fn lowest_stored(&self) -> Option<f64> {
        match self {
            Self::Distance(_) => Some(f64::from(-DistanceQuantization::STEPS)),
            Self::HitGradient(_) => Some(1.0),
            Self::Linear { .. } | Self::Octahedral => None,
        }
    }
}
