//! One selected region of (v, g): an outline with a colour, an opacity and soft edges.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::color::{format_color, parse_color};
use super::{ParseError, Shape, TwoSidedEmphasis, parse_number};

/// What stands before a painted map.
const PAINTED: &str = "painted:";
/// What stands before the name of a file with one.
pub const MAP_FILE: &str = "map:";

/// A region of value and gradient magnitude at the hit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct Region {
    /// Its outline inside the rectangle of the two ranges.
    pub shape: Shape,
    /// From which value to which, in the volume's physical unit.
    pub value: [f32; 2],
    /// From which gradient magnitude at the hit to which, in value units per world unit.
    pub gradient: [f32; 2],
    /// Red, green, blue as display values, 0 to 1.
    pub color: [f32; 3],
    /// Opacity αu in the region's middle for a path of `L_min`, 0 to 1.
    pub opacity: f32,
    /// Share of each extent over which the opacity fades to zero, at both ends and inwards; 0 to 0.5. A painted map is as
    /// soft as it is painted, whatever this is.
    pub softness: f32,
    /// Opacity by distance of its boundaries alone.
    pub emphasis: Option<TwoSidedEmphasis>,
}

impl Region {
    /// The softness of a region that was not given one.
    pub const DEFAULT_SOFTNESS: f32 = 0.1;
}

impl FromStr for Region {
    type Err = ParseError;

    /// `[SHAPE,]v0:v1,g0:g1,RRGGBB[,opacity[,softness]][@KIND,a,dc,n]`, where the shape is `box`, `ellipse` or `triangle`, or
    /// `polygon,v:g,v:g,v:g,...,RRGGBB...` by its corners, or `painted:BASE64` by a picture; opacity 1 where none is given.
    fn from_str(text: &str) -> Result<Self, ParseError> {
        let (shape, rest) = text.split_once(',').unwrap_or((text, ""));
        match shape.trim() {
            "box" => Self::from_form(Shape::Box, rest),
            "ellipse" => Self::from_form(Shape::Ellipse, rest),
            "triangle" => Self::from_form(Shape::Triangle, rest),
            "polygon" => Self::from_form(Shape::Polygon(Vec::new()), rest),
            shape if shape.starts_with(MAP_FILE) => {
                Err(ParseError(format!("`{shape}` is for the command line: what is kept holds the map itself")))
            }
            shape => match shape.strip_prefix(PAINTED) {
                Some(map) => Self::from_form(Shape::Painted(map.parse()?), rest),
                None => Self::from_form(Shape::Box, text),
            },
        }
    }
}

impl Region {
    /// A region of this shape by the form behind it, `v0:v1,g0:g1,RRGGBB[,opacity[,softness]][@KIND,a,dc,n]`; a polygon's
    /// begins with its corners, a painted map's has no softness.
    ///
    /// # Errors
    /// [`ParseError`] for anything else.
    pub fn from_form(shape: Shape, form: &str) -> Result<Self, ParseError> {
        let (region, emphasis) = match form.split_once('@') {
            Some((region, emphasis)) => (region, Some(emphasis.parse()?)),
            None => (form, None),
        };
        let parts: Vec<&str> = region.split(',').map(str::trim).collect();
        let (shape, [value, gradient], rest) = match (shape, parts.as_slice()) {
            (Shape::Polygon(_), parts) => {
                let corners = parts.iter().take_while(|part| part.contains(':')).count();
                let (shape, ranges) = parse_corners(&parts[..corners])?;
                (shape, ranges, &parts[corners..])
            }
            (shape, [value, gradient, rest @ ..]) => {
                (shape, [parse_range(value, "value")?, parse_range(gradient, "gradient magnitude")?], rest)
            }
            _ => return Err(usage(form)),
        };
        let [color, rest @ ..] = rest else { return Err(usage(form)) };
        let (opacity, softness) = match rest {
            [] => ("1", None),
            [opacity] => (*opacity, None),
            [opacity, softness] => (*opacity, Some(*softness)),
            _ => return Err(usage(form)),
        };
        if let (Shape::Painted(_), Some(_)) = (&shape, softness) {
            return Err(ParseError("a painted map has no softness: it is as soft as it is painted".into()));
        }
        let region = Self {
            softness: match (&shape, softness) {
                (Shape::Painted(_), _) => 0.0,
                (_, Some(softness)) => parse_number(softness, "softness")?,
                (_, None) => Self::DEFAULT_SOFTNESS,
            },
            shape,
            value,
            gradient,
            color: parse_color(color)?,
            opacity: parse_number(opacity, "opacity")?,
            emphasis,
        };
        if !(0.0..=1.0).contains(&region.opacity) {
            return Err(ParseError(format!("opacity {} is not between 0 and 1", region.opacity)));
        }
        if !(0.0..=0.5).contains(&region.softness) {
            return Err(ParseError(format!("softness {} is not between 0 and 0.5", region.softness)));
        }
        Ok(region)
    }
}

fn usage(form: &str) -> ParseError {
    ParseError(format!(
        "`{form}` is not [SHAPE,]v0:v1,g0:g1,RRGGBB[,opacity[,softness]][@KIND,a,dc,n] such as 80:255,10:40,E69F00,0.5 or \
         ellipse,80:255,10:40,E69F00, nor polygon,v:g,v:g,v:g,...,RRGGBB[,...]"
    ))
}

/// A polygon, and the ranges of value and gradient magnitude that it spans, by its corners.
fn parse_corners(parts: &[&str]) -> Result<(Shape, [[f32; 2]; 2]), ParseError> {
    if parts.len() < 3 {
        return Err(ParseError(format!("a polygon has three corners v:g or more, found {}", parts.len())));
    }
    let mut corners = Vec::with_capacity(parts.len());
    let mut ranges = [[f32::INFINITY, f32::NEG_INFINITY]; 2];
    for part in parts {
        let (value, gradient) =
            part.split_once(':').ok_or_else(|| ParseError(format!("corner `{part}` is not v:g")))?;
        let corner = [parse_number(value, "value")?, parse_number(gradient, "gradient magnitude")?];
        for ([low, high], number) in ranges.iter_mut().zip(corner) {
            (*low, *high) = (low.min(number), high.max(number));
        }
        corners.push(corner);
    }
    if ranges.iter().any(|[low, high]| low >= high) {
        return Err(ParseError("the corners of a polygon lie on a line".into()));
    }
    for corner in &mut corners {
        for (number, [low, high]) in corner.iter_mut().zip(ranges) {
            *number = (*number - low) / (high - low);
        }
    }
    Ok((Shape::Polygon(corners), ranges))
}

fn parse_range(text: &str, what: &str) -> Result<[f32; 2], ParseError> {
    let (low, high) =
        text.split_once(':').ok_or_else(|| ParseError(format!("{what} range `{text}` is not LOW:HIGH")))?;
    let range = [parse_number(low, what)?, parse_number(high, what)?];
    if range[0] >= range[1] {
        return Err(ParseError(format!("{what} range `{text}` is empty: write the smaller number first")));
    }
    Ok(range)
}

impl fmt::Display for Region {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([v0, v1], [g0, g1]) = (self.value, self.gradient);
        match &self.shape {
            Shape::Box => write!(formatter, "{v0}:{v1},{g0}:{g1}")?,
            Shape::Ellipse => write!(formatter, "ellipse,{v0}:{v1},{g0}:{g1}")?,
            Shape::Triangle => write!(formatter, "triangle,{v0}:{v1},{g0}:{g1}")?,
            Shape::Polygon(corners) => {
                write!(formatter, "polygon")?;
                for [x, y] in corners {
                    write!(formatter, ",{}:{}", v0 + x * (v1 - v0), g0 + y * (g1 - g0))?;
                }
            }
            Shape::Painted(map) => write!(formatter, "{PAINTED}{map},{v0}:{v1},{g0}:{g1}")?,
        }
        write!(formatter, ",{},{}", format_color(self.color), self.opacity)?;
        if self.softness != Self::DEFAULT_SOFTNESS && !matches!(self.shape, Shape::Painted(_)) {
            write!(formatter, ",{}", self.softness)?;
        }
        if let Some(emphasis) = self.emphasis {
            write!(formatter, "@{emphasis}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::PaintedMap;

    #[test]
    fn typed_forms_survive_the_round_trip() {
        for text in [
            "-1000:250.5,0:1e-3,FF8000",
            "1:2,3:4,00ff00,0.25",
            "1:2,3:4,00ff00,0.25,0.3",
            "1:2,3:4,00ff00@concave,1,2,7",
            "ellipse,1:2,3:4,00ff00,0.25",
            "triangle,1:2,3:4,00ff00@concave,1,2,7",
            "polygon,1:2,3:4,2:8,00ff00,0.5,0.2",
            "1:2,3:4,00ff00,0.5,0.2@concave,1,2,7/linear,0.2,4",
        ] {
            let region: Region = text.parse().expect("a region");
            assert_eq!(region.to_string().parse(), Ok(region.clone()), "{text}");
        }
        let region: Region = "1:2,3:4,00ff00".parse().expect("a region");
        assert_eq!((region.value, region.gradient, region.opacity), ([1.0, 2.0], [3.0, 4.0], 1.0));
        assert_eq!(region.softness, Region::DEFAULT_SOFTNESS);
    }

    #[test]
    fn a_painted_map_is_kept_with_its_place() {
        let mut map = PaintedMap::blank();
        map.stroke([0.1, 0.2], [0.8, 0.9], [0.1, 0.05], false);
        let typed = format!("painted:{map},-1:2,3:4,00FF00,0.25@concave,1,2,7");
        let region: Region = typed.parse().expect("a region");
        assert_eq!((&region.shape, region.value, region.opacity), (&Shape::Painted(map.clone()), [-1.0, 2.0], 0.25));
        assert_eq!(region.to_string().parse(), Ok(region));
        for (form, expected) in [
            (format!("painted:{map},1:2,3:4,00FF00,1,0.2"), "no softness"),
            (format!("painted:{map},1:2"), "v0:v1"),
            ("map:a.png,1:2,3:4,00FF00".to_owned(), "for the command line"),
            ("painted:AAAA,1:2,3:4,00FF00".to_owned(), "PNG"),
            ("painted:?,1:2,3:4,00FF00".to_owned(), "base64"),
        ] {
            let message = form.parse::<Region>().expect_err("is refused").to_string();
            assert!(message.contains(expected) && message.len() < 400, "{message}");
        }
    }

    #[test]
    fn anything_else_is_refused() {
        for text in ["", "1:2,3:4", "2:1,3:4,00ff00", "1:1,3:4,00ff00", "1:2,3,00ff00", "1:2,3:4,00ff00,2"] {
            assert!(text.parse::<Region>().is_err(), "{text}");
        }
        for text in
            ["circle,1:2,3:4,00ff00", "polygon,1:2,3:4,00ff00", "polygon,1:2,1:3,1:4,00ff00", "polygon,1:2,3:4,2:8"]
        {
            assert!(text.parse::<Region>().is_err(), "{text}");
        }
        assert!("1:2,3:4,00ff00,1,0.6".parse::<Region>().is_err());
        assert!("1:nan,3:4,00ff00".parse::<Region>().is_err());
        assert!("1:2,3:4,00ff00@cubic,1,2,7".parse::<Region>().is_err());
    }
}
