//! Refines where a function along a ray falls through zero.

/// Halvings of a bracket: a bracket of L_min/5 ends 5e-5·L_min wide, a quarter of what the packed file resolves.
pub const HALVINGS: u32 = 12;

/// How a crossing inside a bracket is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RootFinder {
    /// Halves the bracket: Buchanan and Turner, *Numerical Methods and Analysis*, 1992, the method that the paper names.
    Bisection,
    /// Interpolates inverse quadratics where three places are fit for it, else halves: Chandrupatla, *A new hybrid
    /// quadratic/bisection algorithm for finding the zero of a nonlinear function without using derivatives*, Advances in
    /// Engineering Software 28(3), 1997.
    Chandrupatla,
    /// Solves the cubic that trilinear f'' is along a ray inside one cell (Parker et al., *Interactive ray tracing for
    /// isosurface rendering*, IEEE Visualization 1998). On other reconstructions, which are none, Chandrupatla's method.
    Cubic,
}

impl RootFinder {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Bisection, Self::Chandrupatla, Self::Cubic];

    /// The name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Bisection => "bisection",
            Self::Chandrupatla => "chandrupatla",
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

/// A place, the function's value there, and whatever else it says of it.
pub type Probed<T> = (f32, f32, T);

/// The place between `inside` and `outside` where `function` falls through 0, by Chandrupatla's method: that of all looked at
/// where it is nearest to 0, within a bracket of `|outside − inside| / 2^HALVINGS`; on smooth functions far nearer than that.
///
/// The function's value is above 0 inside and not outside.
#[inline(always)]
pub fn chandrupatla<T: Copy>(
    inside: Probed<T>,
    outside: Probed<T>,
    mut function: impl FnMut(f32) -> (f32, T),
) -> Probed<T> {
    let width = (outside.0 - inside.0).abs();
    // No less than places differ by, so that every step leads to a new one.
    let rounding = 2.0 * f32::EPSILON * outside.0.abs().max(inside.0.abs());
    let tolerance = (width / (2 << HALVINGS) as f32).max(rounding);
    // The ends of the bracket, the one found last first.
    let (mut a, mut b) = (outside, inside);
    // Of the way from a to b; the first place is where the chord is 0.
    let mut share = a.1 / (a.1 - b.1);
    loop {
        let least = tolerance / (b.0 - a.0).abs();
        if a.1 == 0.0 || least > 0.5 || least.is_nan() {
            return if a.1.abs() <= b.1.abs() { a } else { b };
        }
        let place = a.0 + (b.0 - a.0) * share.clamp(least, 1.0 - least);
        let (value, said) = function(place);
        // The place that was an end before.
        let c = if (value > 0.0) == (a.1 > 0.0) { a } else { std::mem::replace(&mut b, a) };
        a = (place, value, said);
        // Whether the inverse quadratic through the three places is monotonic between the ends.
        let (along, rise) = ((a.0 - b.0) / (c.0 - b.0), (a.1 - b.1) / (c.1 - b.1));
        share = if rise * rise < along && (1.0 - rise) * (1.0 - rise) < 1.0 - along {
            a.1 / (b.1 - a.1) * (c.1 / (b.1 - c.1))
                + (c.0 - a.0) / (b.0 - a.0) * (a.1 / (c.1 - a.1)) * (b.1 / (c.1 - b.1))
        } else {
            0.5
        };
    }
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

    /// What the method finds, and in how many evaluations beside those of the ends.
    fn counted(function: impl Fn(f32) -> f32, [inside, outside]: [f32; 2]) -> (f32, u32) {
        let mut count = 0;
        let [inside, outside] = [inside, outside].map(|t| (t, function(t), ()));
        let (found, ..) = chandrupatla(inside, outside, |t| {
            count += 1;
            (function(t), ())
        });
        (found, count)
    }

    #[test]
    fn chandrupatla_is_as_exact_as_bisection_in_a_few_evaluations() {
        for root in [0.0_f32, 0.001, 0.05, 0.1, 0.17, 0.199] {
            for curvature in [-3.0_f32, 0.0, 3.0] {
                for [start, end] in [[0.0, 0.2], [0.0_f32, -0.2]] {
                    let root = root * end.signum();
                    let function = |t: f32| {
                        let s = (root - t) * end.signum();
                        s * (1.0 + curvature * s)
                    };
                    let (found, count) = counted(function, [start, end]);
                    assert!((found - root).abs() <= 0.2 / 8192.0, "{root} {curvature} {found}");
                    assert!(count <= 5, "{root} {curvature}: {count} evaluations");
                }
            }
        }
    }

    #[test]
    fn chandrupatla_keeps_its_promise_on_steps() {
        for root in [0.003_f32, 0.1, 0.19] {
            for [above, below] in [[1e-6, -1.0], [1.0, -1e-6], [1.0, -1.0]] {
                let (found, count) = counted(|t| if t < root { above } else { below }, [0.0, 0.2]);
                assert!((found - root).abs() <= 0.2 / 4096.0 * 1.01, "{root} {above} {below}: {found}");
                assert!(count <= HALVINGS + 2, "{root} {above} {below}: {count} evaluations");
            }
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
