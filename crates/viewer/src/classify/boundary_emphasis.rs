//! αd(d), the opacity by distance to the boundary.

use crate::state::{BoundaryEmphasis, EmphasisKind};

/// αd of an unsigned distance in the unit of `emphasis.d_c`: eqs. (7) to (9) of the paper, 0 from `d_c` on.
///
/// Requires `distance >= 0`, `d_c > 0` and `n >= 1`; all kinds fall from `a` at 0 to 0 at `d_c` without a jump.
#[must_use]
pub fn opacity_by_distance(emphasis: &BoundaryEmphasis, distance: f32) -> f32 {
    if distance >= emphasis.d_c {
        return 0.0;
    }
    let share = distance / emphasis.d_c;
    match emphasis.kind {
        EmphasisKind::Linear => emphasis.a * (1.0 - share),
        EmphasisKind::Concave => emphasis.a * (1.0 - share).powf(emphasis.n),
        EmphasisKind::Convex => emphasis.a * (1.0 - share.powf(emphasis.n)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn emphasis(kind: EmphasisKind, n: f32) -> BoundaryEmphasis {
        BoundaryEmphasis { kind, a: 0.8, d_c: 2.0, n }
    }

    #[test]
    fn equations_7_to_9_hold() {
        let at_half = |kind, n| opacity_by_distance(&emphasis(kind, n), 1.0);
        assert!((at_half(EmphasisKind::Linear, 5.0) - 0.4).abs() < 1e-6);
        assert!((at_half(EmphasisKind::Concave, 3.0) - 0.1).abs() < 1e-6);
        assert!((at_half(EmphasisKind::Convex, 3.0) - 0.7).abs() < 1e-6);
    }

    #[test]
    fn every_kind_falls_from_a_to_zero_at_d_c() {
        for kind in EmphasisKind::ALL {
            let emphasis = emphasis(kind, 3.0);
            let curve: Vec<f32> = (0..=30).map(|k| opacity_by_distance(&emphasis, k as f32 * 0.1)).collect();
            assert!((curve[0] - 0.8).abs() < 1e-6);
            assert!(curve.windows(2).all(|pair| pair[1] <= pair[0]));
            assert!(curve[19] > 0.0 && curve[20..].iter().all(|&opacity| opacity == 0.0));
        }
    }

    #[test]
    fn n_of_one_makes_all_kinds_linear() {
        for distance in [0.0, 0.3, 1.7] {
            let [linear, concave, convex] =
                EmphasisKind::ALL.map(|kind| opacity_by_distance(&emphasis(kind, 1.0), distance));
            assert!((linear - concave).abs() < 1e-6 && (linear - convex).abs() < 1e-6);
        }
    }
}
