//! Refines where a predicate along a ray turns from true to false.

/// Halvings of a bracket: a bracket of L_min/5 ends 5e-5·L_min wide, a quarter of what the packed file resolves.
pub const ITERATIONS: u32 = 12;

/// The place between `inside` and `outside` where `holds` ends, to within `|outside − inside| / 2^(ITERATIONS + 1)`.
///
/// Requires `holds(inside)` and `!holds(outside)`; neither is evaluated again.
///
/// Source: Buchanan and Turner, *Numerical Methods and Analysis*, 1992, the method that the paper names.
pub fn bisect(mut inside: f32, mut outside: f32, mut holds: impl FnMut(f32) -> bool) -> f32 {
    for _ in 0..ITERATIONS {
        let middle = 0.5 * (inside + outside);
        if holds(middle) {
            inside = middle;
        } else {
            outside = middle;
        }
    }
    0.5 * (inside + outside)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_roots_to_the_promised_width() {
        for root in [0.0_f32, 0.013, 0.1, 0.1999, 0.2] {
            let found = bisect(0.0, 0.2, |t| t < root);
            assert!((found - root).abs() <= 0.2 / 8192.0 * 1.01, "{root} {found}");
        }
    }
}
