//! What the command line says of regions: as sessions do, or with a painted map out of a file.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use crate::state::region::MAP_FILE;
use crate::state::{PaintedMap, ParseError, Region, Shape};

/// Longest picture that is read: more than one of [`PaintedMap::MOST_PIXELS`] takes.
const MOST_BYTES: u64 = 128 << 20;
/// What such a name ends with.
const EXTENSION: &str = ".png";

/// What was typed.
#[derive(Clone, Debug, PartialEq)]
pub struct TypedRegion {
    /// The region; its map is blank where that lies in a file.
    region: Region,
    /// The file of its map.
    pub map: Option<PathBuf>,
}

impl TypedRegion {
    /// The region, with its map.
    ///
    /// # Errors
    /// [`ParseError`], naming the file, where that cannot be read.
    pub fn read(&self) -> Result<Region, ParseError> {
        let mut region = self.region.clone();
        if let Some(path) = &self.map {
            let map = read_map(path);
            let map = map
                .map_err(|ParseError(reason)| ParseError(format!("--region {MAP_FILE}{}: {reason}", path.display())))?;
            region.shape = Shape::Painted(map);
        }
        Ok(region)
    }
}

/// A region as [`Region`] is typed, or `map:FILE.png,v0:v1,g0:g1,RRGGBB[,opacity][@KIND,a,dc,n]`: a picture that lies over the
/// ranges, value to the right and gradient magnitude upwards.
///
/// # Errors
/// [`ParseError`] for anything else, whatever the file holds.
pub fn parse_region(text: &str) -> Result<TypedRegion, ParseError> {
    let Some(rest) = text.trim_start().strip_prefix(MAP_FILE) else {
        return Ok(TypedRegion { region: text.parse()?, map: None });
    };
    let (path, form) = split_path(rest)
        .ok_or_else(|| ParseError(format!("`{text}` is not {MAP_FILE}FILE{EXTENSION},v0:v1,g0:g1,RRGGBB[,opacity]")))?;
    Ok(TypedRegion { region: Region::from_form(Shape::Painted(PaintedMap::blank()), form)?, map: Some(path.into()) })
}

/// A file's name, which may have commas, and what follows.
fn split_path(text: &str) -> Option<(&str, &str)> {
    let end = text.to_ascii_lowercase().find(&format!("{EXTENSION},"))? + EXTENSION.len();
    Some((&text[..end], &text[end + 1..]))
}

fn read_map(path: &Path) -> Result<PaintedMap, ParseError> {
    let mut png = Vec::new();
    let file = File::open(path).map_err(|error| ParseError(error.to_string()))?;
    file.take(MOST_BYTES + 1).read_to_end(&mut png).map_err(|error| ParseError(error.to_string()))?;
    if png.len() as u64 > MOST_BYTES {
        return Err(ParseError(format!("more than {} MiB are not read", MOST_BYTES >> 20)));
    }
    PaintedMap::from_png(&png)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_are_read_out_of_files_of_any_name() {
        let mut map = PaintedMap::blank();
        map.stroke([0.2, 0.3], [0.7, 0.8], [0.2, 0.1], false);
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a, b@c.PNG");
        std::fs::write(&path, map.to_png().expect("is encoded")).expect("writes");
        let typed = format!("map:{},-1:2,3:4,00FF00,0.25@concave,1,2,7", path.display());
        let typed = parse_region(&typed).expect("a region");
        let region = typed.read().expect("a map");
        assert_eq!((region.shape.clone(), region.value, typed.map), (Shape::Painted(map), [-1.0, 2.0], Some(path)));
        let typed = |region: Region| Ok(TypedRegion { region, map: None });
        assert_eq!(parse_region(&region.to_string()), typed(region));
        assert_eq!(parse_region("1:2,3:4,00FF00"), typed("1:2,3:4,00FF00".parse().expect("a region")));
    }

    #[test]
    fn what_is_no_map_is_refused_by_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("text.png");
        std::fs::write(&path, "no picture").expect("writes");
        let path = path.display();
        for (typed, expected) in [
            (format!("map:{path},1:2,3:4,00FF00"), "text.png: a map is a PNG"),
            (format!("map:{path}.png,1:2,3:4,00FF00"), ".png.png: "),
        ] {
            let message = parse_region(&typed).expect("names a file").read().expect_err("is refused").to_string();
            assert!(message.contains(expected), "{message}");
        }
        for typed in [format!("map:{path}"), "map:a.jpg,1:2,3:4,00FF00".to_owned()] {
            let message = parse_region(&typed).expect_err("is refused").to_string();
            assert!(message.contains("is not map:FILE.png"), "{message}");
        }
    }
}
