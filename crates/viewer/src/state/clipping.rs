//! What is cut away of a volume: all but a box of its voxels, and what lies in front of planes.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::{ParseError, parse_number};

/// What of a volume is drawn; all of it by default.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Clipping {
    /// The box of voxels that is kept.
    pub crop: Crop,
    /// Planes that cut; at most [`Self::MOST_PLANES`] of them.
    pub planes: Vec<ClipPlane>,
}

impl Clipping {
    /// Most planes beside the box's own six.
    pub const MOST_PLANES: usize = 4;
}

/// A box along the volume's own axes: it turns with the volume.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct Crop {
    /// From which voxel to which along x, y, z, in indices of the finest level; infinite where nothing is cut.
    pub ends: [[f32; 2]; 3],
}

impl Default for Crop {
    /// Cuts nothing.
    fn default() -> Self {
        Self { ends: [[f32::NEG_INFINITY, f32::INFINITY]; 3] }
    }
}

impl Crop {
    /// Where the box ends along each axis: at the voxels named; around a single one it is as thick as that.
    #[must_use]
    pub fn faces(&self) -> [[f32; 2]; 3] {
        self.ends.map(|[low, high]| if low == high { [low - 0.5, high + 0.5] } else { [low, high] })
    }
}

impl FromStr for Crop {
    type Err = ParseError;

    /// `x0:x1,y0:y1,z0:z1`, where an end that is left out cuts nothing.
    fn from_str(text: &str) -> Result<Self, ParseError> {
        let usage = || ParseError(format!("`{text}` is not x0:x1,y0:y1,z0:z1 in voxels, such as 10:90,:,40:"));
        let parts: Vec<&str> = text.split(',').map(str::trim).collect();
        let parts: [&str; 3] = parts.try_into().map_err(|_| usage())?;
        let mut crop = Self::default();
        for (ends, part) in crop.ends.iter_mut().zip(parts) {
            let (low, high) = part.split_once(':').ok_or_else(usage)?;
            for (end, text) in ends.iter_mut().zip([low, high]) {
                if !text.trim().is_empty() {
                    *end = parse_number(text, "voxel")?;
                }
            }
            if ends[0] > ends[1] {
                return Err(ParseError(format!("`{part}` is empty: write the smaller voxel first")));
            }
        }
        Ok(crop)
    }
}

impl fmt::Display for Crop {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let end = |end: f32| if end.is_finite() { end.to_string() } else { String::new() };
        let [x, y, z] = self.ends.map(|[low, high]| format!("{}:{}", end(low), end(high)));
        write!(formatter, "{x},{y},{z}")
    }
}

/// A plane that cuts away what lies on the side of a viewer at an azimuth and an elevation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct ClipPlane {
    /// As that of a [`super::Camera`], in degrees.
    pub azimuth: f32,
    /// As that of a [`super::Camera`], in degrees.
    pub elevation: f32,
    /// How far the plane lies from the volume's middle towards that viewer, in radii of the sphere around the volume: at 1
    /// nothing is cut, at −1 everything.
    pub offset: f32,
}

impl FromStr for ClipPlane {
    type Err = ParseError;

    /// `azimuth,elevation[,offset]`; through the middle where no offset is given.
    fn from_str(text: &str) -> Result<Self, ParseError> {
        let parts: Vec<&str> = text.split(',').map(str::trim).collect();
        let (azimuth, elevation, offset) = match parts.as_slice() {
            [azimuth, elevation] => (azimuth, elevation, "0"),
            [azimuth, elevation, offset] => (azimuth, elevation, *offset),
            _ => return Err(ParseError(format!("`{text}` is not AZIMUTH,ELEVATION[,OFFSET] such as 30,0,0.1"))),
        };
        Ok(Self {
            azimuth: parse_number(azimuth, "azimuth")?,
            elevation: parse_number(elevation, "elevation")?,
            offset: parse_number(offset, "offset")?,
        })
    }
}

impl fmt::Display for ClipPlane {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{},{},{}", self.azimuth, self.elevation, self.offset)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn typed_forms_survive_the_round_trip() {
        for text in [":,:,:", "10:90,:,40:", "0.5:1,:7,-3:3"] {
            let crop: Crop = text.parse().expect("a crop");
            assert_eq!(crop.to_string(), text);
        }
        assert_eq!(":,:,:".parse(), Ok(Crop::default()));
        let plane: ClipPlane = "30,-10".parse().expect("a plane");
        assert_eq!(plane, ClipPlane { azimuth: 30.0, elevation: -10.0, offset: 0.0 });
        assert_eq!(plane.to_string().parse(), Ok(plane));
    }

    #[test]
    fn anything_else_is_refused() {
        for text in ["", "1:2", "1:2,3:4", "5:4,:,:", "a:,:,:", "1,2,3", ":,:,:,:", "nan:,:,:"] {
            assert!(text.parse::<Crop>().is_err(), "{text}");
        }
        for text in ["", "1", "1,2,3,4", "1,x"] {
            assert!(text.parse::<ClipPlane>().is_err(), "{text}");
        }
    }
}
