//! What the tests of phantoms share.

use glam::{DMat3, DVec3};

use super::Part;

/// `∫ f` from `from` to `to` by Gauss and Legendre's rule of five points in each of `cells` equal cells.
pub fn integrate(from: f64, to: f64, cells: u32, f: impl Fn(f64) -> f64) -> f64 {
    const NODES: [(f64, f64); 5] = [
        (0.0, 0.568_888_888_888_888_9),
        (0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
        (-0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
        (0.906_179_845_938_664, 0.236_926_885_056_189_08),
        (-0.906_179_845_938_664, 0.236_926_885_056_189_08),
    ];
    let half = 0.5 * (to - from) / f64::from(cells);
    let cell = |index: u32| {
        let middle = from + half * f64::from(2 * index + 1);
        NODES.iter().map(|(node, weight)| weight * f(middle + half * node)).sum::<f64>()
    };
    half * (0..cells).map(cell).sum::<f64>()
}

/// 300 points spread over a ball of the given radius.
pub fn scattered_points(centre: DVec3, radius: f64) -> impl Iterator<Item = DVec3> {
    // Points of a Weyl sequence in a cube, pushed into the ball.
    (1..=300).map(move |index| {
        let t = f64::from(index);
        let place = DVec3::new(0.819_172_513 * t, 0.671_043_607 * t, 0.549_700_478 * t).fract() * 2.0 - 1.0;
        centre + radius * place / place.length().max(1.0)
    })
}

/// The gradient of `value` and the Hessian from `gradient` by fourth-order central differences of step `h`.
pub fn differences(
    point: DVec3,
    h: f64,
    value: impl Fn(DVec3) -> f64,
    gradient: impl Fn(DVec3) -> DVec3,
) -> (DVec3, DMat3) {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let stencil = [(1.0, 8.0), (-1.0, -8.0), (2.0, -1.0), (-2.0, 1.0)];
    let slope = axes.map(|axis| stencil.iter().map(|(k, w)| w * value(point + k * h * axis)).sum::<f64>() / (12.0 * h));
    let bend =
        axes.map(|axis| stencil.iter().map(|(k, w)| *w * gradient(point + *k * h * axis)).sum::<DVec3>() / (12.0 * h));
    (DVec3::from_array(slope), DMat3::from_cols(bend[0], bend[1], bend[2]))
}

/// Compares derivatives with differences; errors are shares of the step over the detail, or over its square.
pub fn check_derivatives(part: &dyn Part, points: impl Iterator<Item = DVec3>) {
    let (detail, step) = (part.detail(), part.step());
    for point in points {
        let found = part.derivatives(point);
        let (gradient, hessian) =
            differences(point, 1e-3 * detail, |place| part.value(place), |place| part.derivatives(place).gradient);
        let gradient_error = (found.gradient - gradient).length() * detail / step;
        let worst_column = (found.hessian - hessian).to_cols_array().into_iter().fold(0.0, |a: f64, b| a.max(b.abs()));
        assert!(gradient_error < 1e-11, "{part:?} at {point}: {gradient} is {}", found.gradient);
        assert!(worst_column * detail * detail / step < 1e-10, "{part:?} at {point}: {hessian} is {}", found.hessian);
        assert_eq!(found.hessian, found.hessian.transpose(), "{part:?} at {point}");
    }
}
