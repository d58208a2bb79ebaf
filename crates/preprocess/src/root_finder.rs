//! Refines where a function along a ray falls through zero.

/// Halvings of a bracket: a bracket of L_min/5 ends 5e-5·L_min wide, a quarter of what the packed file resolves.
pub const HALVINGS: u32 = 12;

/// How a crossing inside a bracket is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum RootFinder {
    /// Halves the bracket: Buchanan and Turner, *Numerical Methods and Analysis*, 1992, the method that the paper names.
    #[default]
    Bisection,
    /// Interpolates, truncates and projects: never slower than bisection, superlinear on smooth functions (Oliveira and
    /// Takahashi, *An enhancement of the bisection method average performance preserving minmax optimality*, ACM TOMS
    /// 47(1), 2020).
    Itp,
    /// Solves the cubic that trilinear f'' is along a ray inside one cell (Parker et al., *Interactive ray tracing for
    /// isosurface rendering*, IEEE Visualization 1998). On other reconstructions, which are none, ITP.
    Cubic,
}

impl RootFinder {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Bisection, Self::Itp, Self::Cubic];

    /// The name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Bisection => "bisection",
            Self::Itp => "itp",
            Self::Cubic => "cubic",
        }
    }
}

/// The place between `inside` and `outside` where `holds` ends, to within `|outside − inside| / 2^(HALVINGS + 1)`.
///
/// Requires `holds(inside)` and `!holds(outside)`; neither is evaluated again.
#[inline(always)]
pub fn bisect(mut inside: f32, mut outside: f32, mut holds: impl FnMut(f32) -> bool) -> f32 {
    for _ in 0..HALVINGS {
        let middle = 0.5 * (inside + outside);
        if holds(middle) {
            inside = middle;
        } else {
            outside = middle;
        }
    }
    0.5 * (inside + outside)
}

/// A crossing of `function` between two places, to within the same width as [`bisect`], by the method ITP with its authors'
/// defaults κ₁ = 0.2 / width, κ₂ = 2, n₀ = 1. `values` are the function's at the two places, the first positive, the second
/// not.
pub fn itp(places: [f32; 2], values: [f32; 2], mut function: impl FnMut(f32) -> f32) -> f32 {
    let [mut inside, mut outside] = places;
    let [mut above, mut below] = values;
    let width = (outside - inside).abs();
    let tolerance = width / (1 << (HALVINGS + 1)) as f32;
    let truncation = 0.2 / width;
    let mut reach = tolerance * (1 << (HALVINGS + 1)) as f32;
    for _ in 0..=HALVINGS {
        let length = (outside - inside).abs();
        if length <= 2.0 * tolerance {
            break;
        }
        let middle = 0.5 * (inside + outside);
        let interpolated = (above * outside - below * inside) / (above - below);
        let towards = (middle - interpolated).signum();
        let truncated = if truncation * length * length <= (middle - interpolated).abs() {
            interpolated + towards * (truncation * length * length).max(tolerance)
        } else {
            middle
        };
        let radius = reach - 0.5 * length;
        let place = if (truncated - middle).abs() <= radius { truncated } else { middle - towards * radius };
        let value = function(place);
        if value > 0.0 {
            (inside, above) = (place, value);
        } else if value == 0.0 {
            return place;
        } else {
            (outside, below) = (place, value);
        }
        reach *= 0.5;
    }
    0.5 * (inside + outside)
}

/// The first place in 0..=1 where the cubic through four values at 0, 1/3, 2/3 and 1 falls from above 0 to 0 or below, in
/// closed form (Cardano's and Viète's formulas).
#[must_use]
pub fn first_fall_of_cubic(values: [f32; 4]) -> Option<f32> {
    let [a, b, c, d] = values.map(f64::from);
    // Newton's divided differences on thirds, expanded.
    let [first, second, third] = [b - a, c - 2.0 * b + a, d - 3.0 * c + 3.0 * b - a];
    let cubic = 4.5 * third;
    let square = 4.5 * (second - third);
    let linear = 3.0 * (first - 0.5 * second + third / 3.0);
    let at = |t: f64| ((cubic * t + square) * t + linear) * t + a;
    let slope = |t: f64| (3.0 * cubic * t + 2.0 * square) * t + linear;
    let mut roots = real_roots(cubic, square, linear, a);
    roots.sort_by(f64::total_cmp);
    let inside = roots.into_iter().filter(|root| (-1e-6..=1.0 + 1e-6).contains(root));
    // Rounding may leave a root beside the one wanted: a fall is a root with a negative slope.
    let fall = inside.filter(|&root| slope(root) < 0.0).map(|root| root.clamp(0.0, 1.0)).next();
    fall.or_else(|| (at(0.0) > 0.0 && at(1.0) <= 0.0).then_some(1.0)).map(|root| root as f32)
}

fn real_roots(cubic: f64, square: f64, linear: f64, constant: f64) -> Vec<f64> {
    let largest = square.abs().max(linear.abs()).max(constant.abs());
    if cubic.abs() <= 1e-9 * largest {
        return quadratic_roots(square, linear, constant);
    }
    let [b, c, d] = [square / cubic, linear / cubic, constant / cubic];
    let shift = b / 3.0;
    let p = c - b * b / 3.0;
    let q = 2.0 * shift.powi(3) - shift * c + d;
    let discriminant = 0.25 * q * q + p.powi(3) / 27.0;
    if discriminant > 0.0 {
        // The larger root of the resolvent, so that nothing cancels.
        let outer = -0.5 * q - q.signum() * discriminant.sqrt();
        let u = outer.cbrt();
        return vec![u - if u == 0.0 { 0.0 } else { p / (3.0 * u) } - shift];
    }
    let radius = 2.0 * (-p / 3.0).sqrt();
    let cosine = if radius == 0.0 { 0.0 } else { (-4.0 * q / radius.powi(3)).clamp(-1.0, 1.0) };
    let third = cosine.acos() / 3.0;
    (0..3).map(|k| radius * (third - std::f64::consts::TAU * f64::from(k) / 3.0).cos() - shift).collect()
}

fn quadratic_roots(square: f64, linear: f64, constant: f64) -> Vec<f64> {
    if square.abs() <= 1e-9 * linear.abs() {
        return if linear == 0.0 { Vec::new() } else { vec![-constant / linear] };
    }
    let discriminant = linear * linear - 4.0 * square * constant;
    if discriminant < 0.0 {
        return Vec::new();
    }
    let outer = -0.5 * (linear + linear.signum() * discriminant.sqrt());
    let mut roots = vec![outer / square];
    if outer != 0.0 {
        roots.push(constant / outer);
    }
    roots
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn bisection_finds_roots_to_the_promised_width() {
        for root in [0.0_f32, 0.013, 0.1, 0.1999, 0.2] {
            let found = bisect(0.0, 0.2, |t| t < root);
            assert!((found - root).abs() <= 0.2 / 8192.0 * 1.01, "{root} {found}");
        }
    }

    #[test]
    fn itp_is_as_exact_as_bisection_and_takes_fewer_evaluations() {
        let mut most = 0;
        for root in [0.001_f32, 0.05, 0.1, 0.17, 0.199] {
            for curvature in [-3.0_f32, 0.0, 3.0] {
                for [start, end] in [[0.0, 0.2], [0.0_f32, -0.2]] {
                    let root = root * end.signum();
                    let mut count = 0;
                    let function = |t: f32| {
                        let s = (root - t) * end.signum();
                        s * (1.0 + curvature * s)
                    };
                    let found = itp([start, end], [function(start), function(end)], |t| {
                        count += 1;
                        function(t)
                    });
                    assert!((found - root).abs() <= 0.2 / 8192.0 * 1.05, "{root} {found}");
                    most = most.max(count);
                }
            }
        }
        assert!(most <= 7, "{most} evaluations");
    }

    #[test]
    fn itp_needs_no_more_than_one_evaluation_above_bisection_on_steps() {
        for root in [0.003_f32, 0.1, 0.19] {
            let mut count = 0;
            let step = |t: f32| if t < root { 1e-6 } else { -1.0 };
            let found = itp([0.0, 0.2], [step(0.0), step(0.2)], |t| {
                count += 1;
                step(t)
            });
            assert!((found - root).abs() <= 0.2 / 8192.0 * 1.05 && count <= HALVINGS + 1, "{root} {found} {count}");
        }
    }

    proptest! {
        #[test]
        fn the_cubic_is_solved_in_closed_form(
            coefficients in prop::array::uniform4(-1.0_f32..1.0),
        ) {
            let function = |t: f64| {
                let [a, b, c, d] = coefficients.map(f64::from);
                ((a * t + b) * t + c) * t + d
            };
            let values = [0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0].map(|t| function(t) as f32);
            let found = first_fall_of_cubic(values);
            // The naive twin: a walk in small steps.
            let steps = 20_000;
            let walked = (0..steps).map(|k| f64::from(k) / f64::from(steps)).find(|&t| {
                function(t) > 0.0 && function(t + 1.0 / f64::from(steps)) <= 0.0
            });
            if let Some(walked) = walked {
                let found = found.expect("there is a fall");
                let error = (f64::from(found) - walked).abs();
                // Where the function only touches zero, the values' rounding decides where.
                prop_assert!(error < 2e-3 || function(f64::from(found)).abs() < 1e-5, "{found} {walked}");
            }
        }
    }
}
