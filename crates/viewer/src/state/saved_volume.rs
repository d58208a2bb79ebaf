//! Which volume a session was saved of, to notice where it is opened for another one.

use std::fmt;

use serde::{Deserialize, Serialize};

/// What tells a volume from most others.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedVolume {
    /// The name of the file that was prepared.
    pub name: String,
    /// The smallest and the largest value, in the volume's own units.
    pub value_range: [f64; 2],
}

impl SavedVolume {
    /// Of a packed file.
    #[must_use]
    pub fn of(header: &voxrole_pack::Header) -> Self {
        Self { name: header.source.name.clone(), value_range: header.statistics.value_range }
    }

    /// What is worth knowing where a session that was saved of a volume is opened for this one; `None` where that is the same,
    /// or the session does not say.
    #[must_use]
    pub fn mismatch(&self, saved: Option<&Self>) -> Option<String> {
        let saved = saved.filter(|saved| *saved != self)?;
        Some(format!("the session was saved of {saved}, and is opened for {self}: what it says of values may not fit"))
    }
}

impl fmt::Display for SavedVolume {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [low, high] = self.value_range;
        write!(formatter, "{} (values {low} to {high})", self.name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_name_or_range_is_another_volume() {
        let volume = |name: &str, high| SavedVolume { name: name.into(), value_range: [0.5, high] };
        let this = volume("a.nrrd", 255.0);
        assert_eq!([this.mismatch(None), this.mismatch(Some(&this))], [None, None]);
        for other in [volume("b.nrrd", 255.0), volume("a.nrrd", 1e300)] {
            let message = this.mismatch(Some(&other)).expect("is another");
            assert!(
                message.contains(&other.to_string()) && message.contains("a.nrrd (values 0.5 to 255)"),
                "{message}"
            );
        }
    }
}
