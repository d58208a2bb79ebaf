//! The range of what a brick holds, so that readers can skip it unread.

use serde::{Deserialize, Serialize};

/// Smallest and largest physical value among a brick's voxels that have one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ValueRange {
    /// Smallest.
    pub min: f64,
    /// Largest.
    pub max: f64,
}

impl ValueRange {
    /// The range of the finite values, or `None` if there is none.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        values.into_iter().filter(|value| value.is_finite()).fold(None, |range: Option<Self>, value| {
            Some(range.map_or(Self { min: value, max: value }, |Self { min, max }| Self {
                min: min.min(value),
                max: max.max(value),
            }))
        })
    }
}
