//! Opacity for another step than the one it was chosen for.

/// `A = 1 − (1 − A0)^(s/s0)`: the opacity of a path `s` where `opacity` belongs to a path `s0`; `step` is `s/s0`.
///
/// Requires an opacity in 0..=1. Here `s0` is `L_min`, so that a picture does not depend on the sampling step.
#[must_use]
pub fn correct_opacity(opacity: f32, step: f32) -> f32 {
    1.0 - (1.0 - opacity).max(0.0).powf(step)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_quarter_steps_make_one() {
        for opacity in [0.0, 0.1, 0.5, 0.9, 1.0] {
            let quarter = correct_opacity(opacity, 0.25);
            assert!((1.0 - (1.0 - quarter).powi(4) - opacity).abs() < 1e-6);
        }
        assert_eq!(correct_opacity(0.3, 1.0), 1.0 - (1.0 - 0.3));
    }
}
