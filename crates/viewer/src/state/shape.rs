//! The outline of a region inside the rectangle that it spans.

/// An outline in shares of the rectangle: value to the right, gradient magnitude upwards, each 0 to 1.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Shape {
    /// The rectangle itself.
    #[default]
    Box,
    /// The ellipse that touches its sides.
    Ellipse,
    /// From a point in the middle of its lower side to its upper corners: the triangular
    /// widget of Kniss, Kindlmann and Hansen, Multidimensional transfer functions for interactive volume rendering, 2002.
    Triangle,
    /// Any outline of at least three corners, which may cross itself: inside is what it winds around an odd number of times.
    Polygon(Vec<[f32; 2]>),
}

impl Shape {
    /// The corners of a triangle's or a polygon's outline; none for the others.
    #[must_use]
    pub fn corners(&self) -> &[[f32; 2]] {
        const TRIANGLE: [[f32; 2]; 3] = [[0.5, 0.0], [1.0, 1.0], [0.0, 1.0]];
        match self {
            Self::Box | Self::Ellipse => &[],
            Self::Triangle => &TRIANGLE,
            Self::Polygon(corners) => corners,
        }
    }

    /// How far a place lies inside the outline, in shares of the rectangle; negative outside.
    #[must_use]
    pub fn depth(&self, [x, y]: [f32; 2]) -> f32 {
        let mut depth = [0.0];
        self.depths(&[x], y, &mut depth);
        depth[0]
    }

    /// The same for many places on a level.
    pub fn depths(&self, xs: &[f32], y: f32, depths: &mut [f32]) {
        let places = xs.iter().zip(depths.iter_mut());
        match self {
            Self::Box => places.for_each(|(x, depth)| *depth = x.min(1.0 - x).min(y).min(1.0 - y)),
            Self::Ellipse => places.for_each(|(x, depth)| {
                *depth = 0.5 * (1.0 - squared_length(2.0 * x - 1.0, 2.0 * y - 1.0).sqrt());
            }),
            Self::Triangle | Self::Polygon(_) => polygon_depths(self.corners(), xs, y, depths),
        }
    }
}

/// The distances to the nearest side, negative outside.
fn polygon_depths(corners: &[[f32; 2]], xs: &[f32], y: f32, depths: &mut [f32]) {
    // The square of the distance, negative outside, until all sides are known.
    depths.fill(f32::NEG_INFINITY);
    for (&[x0, y0], &[x1, y1]) in corners.iter().zip(corners.iter().cycle().skip(1)) {
        let (dx, dy) = (x1 - x0, y1 - y0);
        let squared = squared_length(dx, dy);
        let per_square = if squared > 0.0 { 1.0 / squared } else { 0.0 };
        // A ray to the right crosses the side if it begins before this.
        let crossing = if (y0 > y) != (y1 > y) { x0 + (y - y0) / dy * dx } else { f32::NEG_INFINITY };
        for (x, depth) in xs.iter().zip(depths.iter_mut()) {
            let along = (((x - x0) * dx + (y - y0) * dy) * per_square).clamp(0.0, 1.0);
            let square = squared_length(x - x0 - along * dx, y - y0 - along * dy).min(depth.abs());
            let side = if *x < crossing { -*depth } else { *depth };
            *depth = square.copysign(side);
        }
    }
    for depth in depths {
        *depth = depth.abs().sqrt().copysign(*depth);
    }
}

fn squared_length(x: f32, y: f32) -> f32 {
    x * x + y * y
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_are_those_of_geometry() {
        let square = Shape::Polygon(vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
        for place in [[0.5, 0.5], [0.1, 0.4], [0.9, 0.95], [-0.25, 0.5], [0.5, 1.5]] {
            assert!((square.depth(place) - Shape::Box.depth(place)).abs() < 1e-6, "{place:?}");
        }
        assert_eq!(Shape::Ellipse.depth([0.5, 0.5]), 0.5);
        assert!(Shape::Ellipse.depth([0.0, 0.5]).abs() < 1e-6 && Shape::Ellipse.depth([0.05, 0.05]) < 0.0);
        assert!(Shape::Triangle.depth([0.5, 0.4]) > 0.0 && Shape::Triangle.depth([0.1, 0.4]) < 0.0);
        // A star of five points that crosses itself: its middle is wound around twice.
        let point = |corner: f32| (0.8 * std::f32::consts::PI * corner).sin_cos();
        let star = (0..5).map(|corner| point(corner as f32)).map(|(x, y)| [0.5 + 0.5 * x, 0.5 + 0.5 * y]);
        let star = Shape::Polygon(star.collect());
        assert!(star.depth([0.5, 0.5]) < 0.0 && star.depth([0.5, 0.85]) > 0.0);
    }
}
