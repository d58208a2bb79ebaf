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

impl TransferFunction {
    /// Most [`Self::regions`]: those with an opacity by distance of their own take a megabyte of tables each.
    pub const MOST_REGIONS: usize = 256;

    /// Whether nothing says what is drawn of the boundaries.
    #[must_use]
    pub fn draws_nothing(&self) -> bool {
        self.classification == Classification::Roles && self.regions.is_empty() && self.curve.points().is_empty()
    }
}
