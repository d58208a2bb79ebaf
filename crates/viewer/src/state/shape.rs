//! The outline of a region inside the rectangle that it spans.

use super::PaintedMap;

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
    /// No outline: a weight for every place.
    Painted(PaintedMap),
}

impl Shape {
    /// The corners of a triangle's or a polygon's outline; none for the others.
    #[must_use]
    pub fn corners(&self) -> &[[f32; 2]] {
        const TRIANGLE: [[f32; 2]; 3] = [[0.5, 0.0], [1.0, 1.0], [0.0, 1.0]];
        match self {
            Self::Box | Self::Ellipse | Self::Painted(_) => &[],
            Self::Triangle => &TRIANGLE,
            Self::Polygon(corners) => corners,
        }
    }

    /// The share, 0 to 1, of the region's opacity at many places on a level.
    ///
    /// `softness`: over how much of the rectangle it rises inwards from an outline to all of it, as [`super::Region::softness`]; a
    /// painted map is as soft as it is painted.
    pub fn weights(&self, softness: f32, xs: &[f32], y: f32, weights: &mut [f32]) {
        let places = xs.iter().zip(weights.iter_mut());
        // How far they lie inside, in shares of the rectangle; negative outside.
        match self {
            Self::Box => places.for_each(|(x, depth)| *depth = x.min(1.0 - x).min(y).min(1.0 - y)),
            Self::Ellipse => places.for_each(|(x, depth)| {
                *depth = 0.5 * (1.0 - squared_length(2.0 * x - 1.0, 2.0 * y - 1.0).sqrt());
            }),
            Self::Triangle | Self::Polygon(_) => polygon_depths(self.corners(), xs, y, weights),
            Self::Painted(map) => return map.weights_at(xs, y, weights),
        }
        for weight in weights {
            *weight = match (*weight < 0.0, softness > 0.0) {
                (true, _) => 0.0,
                (false, true) => (*weight / softness).min(1.0),
                (false, false) => 1.0,
            };
        }
    }

    /// The same as a painted map.
    #[must_use]
    pub fn painted(&self, softness: f32) -> PaintedMap {
        PaintedMap::of(|xs, y, weights| self.weights(softness, xs, y, weights))
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

    /// How far a place lies inside; 0 outside.
    fn depth(shape: &Shape, [x, y]: [f32; 2]) -> f32 {
        let mut weight = [0.0];
        shape.weights(0.5, &[x], y, &mut weight);
        0.5 * weight[0]
    }

    #[test]
    fn depths_are_those_of_geometry() {
        let square = Shape::Polygon(vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
        for (place, expected) in
            [([0.5, 0.5], 0.5), ([0.1, 0.4], 0.1), ([0.9, 0.95], 0.05), ([-0.25, 0.5], 0.0), ([0.5, 1.5], 0.0)]
        {
            for shape in [&square, &Shape::Box] {
                assert!((depth(shape, place) - expected).abs() < 1e-6, "{shape:?} {place:?}");
            }
        }
        assert_eq!((depth(&Shape::Ellipse, [0.5, 0.5]), depth(&Shape::Ellipse, [0.05, 0.05])), (0.5, 0.0));
        assert!(depth(&Shape::Ellipse, [0.0, 0.5]).abs() < 1e-6 && depth(&Shape::Ellipse, [0.01, 0.5]) > 0.0);
        assert!(depth(&Shape::Triangle, [0.5, 0.4]) > 0.0 && depth(&Shape::Triangle, [0.1, 0.4]) == 0.0);
        // A star of five points that crosses itself: its middle is wound around twice.
        let point = |corner: f32| (0.8 * std::f32::consts::PI * corner).sin_cos();
        let star = (0..5).map(|corner| point(corner as f32)).map(|(x, y)| [0.5 + 0.5 * x, 0.5 + 0.5 * y]);
        let star = Shape::Polygon(star.collect());
        assert!(depth(&star, [0.5, 0.5]) == 0.0 && depth(&star, [0.5, 0.85]) > 0.0);
    }

    #[test]
    fn an_outline_is_painted_as_it_is_drawn() {
        for (shape, softness) in [(Shape::Box, 0.1), (Shape::Ellipse, 0.3), (Shape::Triangle, 0.2)] {
            let painted = Shape::Painted(shape.painted(softness));
            for place in [[0.5, 0.5], [0.3, 0.8], [0.2, 0.4], [0.05, 0.5], [0.9, 0.1]] {
                let weight = |shape: &Shape, [x, y]: [f32; 2]| {
                    let mut weight = [0.0];
                    shape.weights(softness, &[x], y, &mut weight);
                    weight[0]
                };
                assert!((weight(&shape, place) - weight(&painted, place)).abs() < 0.02, "{shape:?} {place:?}");
            }
        }
    }
}
