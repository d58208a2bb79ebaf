//! αu by value alone: control points with straight lines between them.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::color::{format_color, parse_color};
use super::{ParseError, parse_number};

/// Colour and opacity at a value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControlPoint {
    /// In the volume's physical unit.
    pub value: f32,
    /// Red, green, blue as display values, 0 to 1.
    pub color: [f32; 3],
    /// αu for a path of `L_min`, 0 to 1.
    pub opacity: f32,
}

/// Control points by growing value; what lies beyond the first and the last is as they are.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct Curve(Vec<ControlPoint>);

impl Curve {
    /// Of points in any order; of several at one value the first counts, and opacities are brought between 0 and 1.
    #[must_use]
    pub fn from_points(mut points: Vec<ControlPoint>) -> Self {
        points.retain(|point| point.value.is_finite());
        points.sort_by(|a, b| a.value.total_cmp(&b.value));
        points.dedup_by(|b, a| a.value == b.value);
        points.iter_mut().for_each(|point| point.opacity = point.opacity.clamp(0.0, 1.0));
        Self(points)
    }

    /// The control points.
    #[must_use]
    pub fn points(&self) -> &[ControlPoint] {
        &self.0
    }

    /// Colour and opacity at a value, continuous; `None` for a curve without points.
    #[must_use]
    pub fn at(&self, value: f32) -> Option<([f32; 3], f32)> {
        let after = self.0.partition_point(|point| point.value <= value);
        let (first, last) = (self.0.first()?, self.0.last()?);
        let (Some(high), true) = (self.0.get(after), after > 0) else {
            let end = if after == 0 { first } else { last };
            return Some((end.color, end.opacity));
        };
        let low = &self.0[after - 1];
        let share = (value - low.value) / (high.value - low.value);
        let between = |low: f32, high: f32| low + share * (high - low);
        let color = [0, 1, 2].map(|channel| between(low.color[channel], high.color[channel]));
        Some((color, between(low.opacity, high.opacity)))
    }
}

impl FromStr for Curve {
    type Err = ParseError;

    /// `v,RRGGBB,opacity;v,RRGGBB,opacity;...` by growing value; nothing for no curve.
    fn from_str(text: &str) -> Result<Self, ParseError> {
        let mut points: Vec<ControlPoint> = Vec::new();
        for part in text.split(';').map(str::trim).filter(|part| !part.is_empty()) {
            let fields: Vec<&str> = part.split(',').map(str::trim).collect();
            let [value, color, opacity] = fields.as_slice() else {
                return Err(ParseError(format!(
                    "`{part}` is not a control point v,RRGGBB,opacity such as 128,FFFFB4,0.5"
                )));
            };
            let point = ControlPoint {
                value: parse_number(value, "value")?,
                color: parse_color(color)?,
                opacity: parse_number(opacity, "opacity")?,
            };
            if !(0.0..=1.0).contains(&point.opacity) {
                return Err(ParseError(format!("opacity {} is not between 0 and 1", point.opacity)));
            }
            if points.last().is_some_and(|last| last.value >= point.value) {
                return Err(ParseError(format!(
                    "`{part}` does not come after the point before it: sort them by value"
                )));
            }
            points.push(point);
        }
        Ok(Self(points))
    }
}

impl fmt::Display for Curve {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, ControlPoint { value, color, opacity }) in self.0.iter().enumerate() {
            let before = if index > 0 { ";" } else { "" };
            write!(formatter, "{before}{value},{},{opacity}", format_color(*color))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four points whose colours and opacities are interpolated linearly.
    const EXERCISE: &str = "64,FF6262,0;128,FFFFB4,1;192,FFFFFF,1;255,FFFFFF,0";

    #[test]
    fn values_between_points_are_interpolated() {
        let curve: Curve = EXERCISE.parse().expect("a curve");
        assert_eq!(curve.to_string(), EXERCISE);
        let near = |value: f32, color: [f32; 3], opacity: f32| {
            let (found, found_opacity) = curve.at(value).expect("points");
            let off = (0..3).map(|channel| (found[channel] - color[channel]).abs()).fold(0.0, f32::max);
            assert!(off < 2e-3 && (found_opacity - opacity).abs() < 1e-6, "{value}: {found:?} {found_opacity}");
        };
        near(0.0, [1.0, 0.384_313, 0.384_313], 0.0);
        near(64.0, [1.0, 0.384_313, 0.384_313], 0.0);
        near(96.0, [1.0, 0.692_156, 0.545_097], 0.5);
        near(128.0, [1.0, 1.0, 0.705_882], 1.0);
        near(160.0, [1.0, 1.0, 0.852_941], 1.0);
        near(223.5, [1.0; 3], 0.5);
        near(255.0, [1.0; 3], 0.0);
        near(300.0, [1.0; 3], 0.0);
        // C⁰: no jump anywhere.
        let steps = (0..=3000).map(|step| curve.at(step as f32 * 0.1).expect("points").1).collect::<Vec<_>>();
        assert!(steps.windows(2).all(|pair| (pair[1] - pair[0]).abs() < 2e-3));
    }

    #[test]
    fn anything_else_is_refused() {
        assert_eq!("".parse(), Ok(Curve::default()));
        assert_eq!(Curve::default().at(1.0), None);
        for text in ["64", "64,FF0000", "64,FF0000,2", "64,FF0000,1;64,FF0000,0", "2,FF0000,1;1,FF0000,0", "x,FF0000,1"]
        {
            assert!(text.parse::<Curve>().is_err(), "{text}");
        }
    }

    #[test]
    fn points_are_put_in_order() {
        let point = |value, opacity| ControlPoint { value, color: [0.0; 3], opacity };
        let curve = Curve::from_points(vec![point(3.0, 2.0), point(f32::NAN, 0.5), point(1.0, 0.25), point(3.0, 0.5)]);
        assert_eq!(curve.points(), [point(1.0, 0.25), point(3.0, 1.0)]);
        assert_eq!(curve.to_string().parse(), Ok(curve));
    }
}
