//! What is drawn: `α = αu(v, g) · αd(d)`.

use serde::{Deserialize, Serialize};

use super::{Classification, Curve, Region, TwoSidedEmphasis};

/// Regions of (v, g) that make αu and the colour, and αd.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TransferFunction {
    /// What of the following counts.
    pub classification: Classification,
    /// The selected regions; where several overlap the largest opacity counts and colours mix by opacity.
    pub regions: Vec<Region>,
    /// αu and colour by value alone, for every gradient magnitude: as one more region.
    pub curve: Curve,
    /// Opacity by distance, for the regions that have none of their own.
    pub emphasis: TwoSidedEmphasis,
}
