//! What decides on colour and opacity.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

/// What decides on colour and opacity at a place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Classification {
    /// Its role: regions and curve, times the opacity by distance to the boundary.
    #[default]
    Roles,
    /// The curve alone, everywhere, boundary or not: classical volume rendering.
    Value,
    /// Intensity and opacity as the file has them: a volume of two numbers a voxel.
    Stored,
}
