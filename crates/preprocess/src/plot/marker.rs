//! Markers and colours that tell series apart, also for those who cannot tell the colours.

use plotters::coord::Shift;
use plotters::prelude::*;

/// Black, and the colours of Okabe and Ito (*Color universal design*, 2008) without the yellow, which white swallows.
const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(0, 0, 0),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(127, 127, 127),
];

/// How a series looks: one of eight colours and one of eight shapes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SeriesStyle {
    /// Which colour; counts on from the first after the last.
    pub colour: usize,
    /// Which shape, likewise: circle, square, upright triangle, diamond, hanging triangle, diagonal cross, cross, pentagon.
    pub shape: usize,
}

impl SeriesStyle {
    /// Colour and shape of the same number.
    #[must_use]
    pub const fn nth(index: usize) -> Self {
        Self { colour: index, shape: index }
    }

    pub(super) fn colour(self) -> RGBColor {
        COLOURS[self.colour % COLOURS.len()]
    }

    /// The corners of the shape around (0, 0), `radius` large; none for a circle.
    fn corners(self, radius: f64) -> Vec<(f64, f64)> {
        let regular = |count: usize, turned: f64, radius: f64| -> Vec<(f64, f64)> {
            let angle = |corner: usize| (turned + 360.0 * corner as f64 / count as f64).to_radians();
            (0..count).map(|corner| (radius * angle(corner).sin(), -radius * angle(corner).cos())).collect()
        };
        match self.shape % 8 {
            1 => regular(4, 45.0, 1.25 * radius),
            2 => regular(3, 0.0, 1.35 * radius),
            3 => regular(4, 0.0, 1.3 * radius),
            4 => regular(3, 180.0, 1.35 * radius),
            7 => regular(5, 0.0, 1.15 * radius),
            5 => star(45.0, radius),
            6 => star(0.0, radius),
            _ => Vec::new(),
        }
    }
}

/// The outline of a cross of four thick arms.
fn star(turned: f64, radius: f64) -> Vec<(f64, f64)> {
    let (long, thin) = (1.35 * radius, 0.42 * radius);
    let quarter = [(-thin, -long), (thin, -long), (thin, -thin)];
    let corner = |index: usize| {
        let (x, y) = quarter[index % 3];
        let (sine, cosine) = (turned + 90.0 * (index / 3) as f64).to_radians().sin_cos();
        (cosine.mul_add(x, -sine * y), sine.mul_add(x, cosine * y))
    };
    (0..12).map(corner).collect()
}

/// Draws a marker; a hollow one is white inside.
pub(super) fn draw_marker<DB: DrawingBackend>(
    root: &DrawingArea<DB, Shift>,
    (x, y): (i32, i32),
    style: SeriesStyle,
    radius: i32,
    hollow: bool,
) -> Result<(), DrawingAreaErrorKind<DB::ErrorType>> {
    let colour = style.colour();
    let inside = if hollow { WHITE } else { colour };
    let outline = colour.stroke_width((radius / 3).max(1) as u32);
    let corners = style.corners(f64::from(radius));
    if corners.is_empty() {
        root.draw(&Circle::new((x, y), radius, inside.filled()))?;
        return root.draw(&Circle::new((x, y), radius, outline));
    }
    let place = |&(dx, dy): &(f64, f64)| (x + dx.round() as i32, y + dy.round() as i32);
    let mut places: Vec<(i32, i32)> = corners.iter().map(place).collect();
    root.draw(&Polygon::new(places.clone(), inside.filled()))?;
    places.push(places[0]);
    root.draw(&PathElement::new(places, outline))
}
