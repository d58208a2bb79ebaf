//! What is drawn beside the volume: lines that show where it lies and how large it is, and opaque surfaces.

use std::fmt;
use std::path::Path;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::color::{format_color, parse_color};
use super::{ParseError, parse_number};

/// What is drawn beside the volume; nothing by default.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Scene {
    /// Whether the edges of the volume's box are drawn, and those of the box of voxels that is kept where one is cut
    /// out of it.
    pub bounding_box: bool,
    /// Whether arrows along the world's axes are drawn.
    pub axes: bool,
    /// Whether a bar of a round length lies over the picture.
    pub scale_bar: bool,
    /// Surfaces out of files; with the isosurfaces at most [`Self::MOST_SURFACES`].
    pub meshes: Vec<MeshFile>,
    /// Surfaces of one value.
    pub isosurfaces: Vec<Isosurface>,
}

impl Scene {
    /// Most meshes and isosurfaces together.
    pub const MOST_SURFACES: usize = 32;

    /// Whether nothing of it lies inside the volume's space.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        !self.bounding_box && !self.axes && !self.has_surfaces()
    }

    /// Whether there are meshes or isosurfaces.
    #[must_use]
    pub fn has_surfaces(&self) -> bool {
        !self.meshes.is_empty() || !self.isosurfaces.is_empty()
    }

    /// Checks the number of surfaces.
    ///
    /// # Errors
    /// [`ParseError`] when there are more than [`Self::MOST_SURFACES`].
    pub fn check(&self) -> Result<(), ParseError> {
        let (found, most) = (self.meshes.len() + self.isosurfaces.len(), Self::MOST_SURFACES);
        if found > most {
            return Err(ParseError(format!("meshes and isosurfaces: expected {most} at most, found {found}")));
        }
        Ok(())
    }
}

/// A surface of triangles in a file, STL or OBJ, in the volume's world coordinates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct MeshFile {
    /// Where the file lies.
    pub path: String,
    /// Red, green, blue as display values, 0 to 1.
    pub color: [f32; 3],
}

impl MeshFile {
    /// The colour of a mesh that was given none.
    pub const DEFAULT_COLOR: [f32; 3] = [0.8; 3];
}

impl FromStr for MeshFile {
    type Err = ParseError;

    /// `FILE[,RRGGBB]`.
    fn from_str(text: &str) -> Result<Self, ParseError> {
        // A name may hold commas: only what looks like a colour is one, or stands behind a name that is complete.
        let is_complete = |path: &str| {
            let extension = Path::new(path).extension();
            extension.is_some_and(|found| ["stl", "obj"].iter().any(|known| found.eq_ignore_ascii_case(known)))
        };
        let (path, color) = match text.rsplit_once(',') {
            Some((path, color)) if parse_color(color).is_ok() || (is_complete(path) && !is_complete(text)) => {
                (path, parse_color(color)?)
            }
            _ => (text, Self::DEFAULT_COLOR),
        };
        if path.is_empty() {
            return Err(ParseError(format!("`{text}` is not FILE[,RRGGBB] such as bone.stl,FFE0B0")));
        }
        Ok(Self { path: path.to_owned(), color })
    }
}

impl fmt::Display for MeshFile {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{},{}", self.path, format_color(self.color))
    }
}

/// The surface on which the value, interpolated between voxels, is one number.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct Isosurface {
    /// In the volume's physical unit.
    pub value: f32,
    /// Red, green, blue as display values, 0 to 1.
    pub color: [f32; 3],
}

impl Isosurface {
    /// The colour of an isosurface that was given none.
    pub const DEFAULT_COLOR: [f32; 3] = [1.0, 224.0 / 255.0, 176.0 / 255.0];
}

impl FromStr for Isosurface {
    type Err = ParseError;

    /// `VALUE[,RRGGBB]`.
    fn from_str(text: &str) -> Result<Self, ParseError> {
        let (value, color) = match text.split_once(',') {
            Some((value, color)) => (value, parse_color(color)?),
            None => (text, Self::DEFAULT_COLOR),
        };
        Ok(Self { value: parse_number(value, "value")?, color })
    }
}

impl fmt::Display for Isosurface {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{},{}", self.value, format_color(self.color))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn typed_forms_survive_the_round_trip() {
        for text in ["bone.stl,FFE0B0", "a, b,c.obj,000000"] {
            assert_eq!(text.parse::<MeshFile>().expect("a mesh").to_string(), text);
        }
        let plain: MeshFile = "left,right.stl".parse().expect("a mesh");
        assert_eq!(plain, MeshFile { path: "left,right.stl".to_owned(), color: MeshFile::DEFAULT_COLOR });
        for text in ["-1000.5,FF0000", "300,E69F00"] {
            assert_eq!(text.parse::<Isosurface>().expect("an isosurface").to_string(), text);
        }
        assert_eq!("7".parse::<Isosurface>().expect("an isosurface").color, Isosurface::DEFAULT_COLOR);
    }

    #[test]
    fn anything_else_is_refused() {
        assert!(["", ",FF0000", "bone.stl,GG0000", "bone.stl,"].iter().all(|text| text.parse::<MeshFile>().is_err()));
        assert!(["", "x", "1,red", "nan", "1,FF0000,2"].iter().all(|text| text.parse::<Isosurface>().is_err()));
        let isosurfaces = vec!["7".parse().expect("an isosurface"); Scene::MOST_SURFACES + 1];
        assert!(Scene { isosurfaces, ..Scene::default() }.check().is_err());
    }
}
