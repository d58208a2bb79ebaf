//! Rotations given in degrees.

use glam::{DMat3, DVec3};

/// The rotation about the world's x axis, then y, then z, by the given angles in degrees, right-handed.
///
/// Multiples of 90° give axes that are exact.
pub(super) fn from_degrees([x, y, z]: [f64; 3]) -> DMat3 {
    let [(sin_x, cos_x), (sin_y, cos_y), (sin_z, cos_z)] = [x, y, z].map(sin_cos_of_degrees);
    let about_x = DMat3::from_cols(DVec3::X, DVec3::new(0.0, cos_x, sin_x), DVec3::new(0.0, -sin_x, cos_x));
    let about_y = DMat3::from_cols(DVec3::new(cos_y, 0.0, -sin_y), DVec3::Y, DVec3::new(sin_y, 0.0, cos_y));
    let about_z = DMat3::from_cols(DVec3::new(cos_z, sin_z, 0.0), DVec3::new(-sin_z, cos_z, 0.0), DVec3::Z);
    about_z * about_y * about_x
}

/// Sine and cosine; the same bits on every platform, and exact at multiples of 90°.
fn sin_cos_of_degrees(angle: f64) -> (f64, f64) {
    let quarter_turns = (angle / 90.0).round();
    let (sine, cosine) = libm::sincos((angle - 90.0 * quarter_turns).to_radians());
    match quarter_turns.rem_euclid(4.0) {
        1.0 => (cosine, -sine),
        2.0 => (-sine, -cosine),
        3.0 => (-cosine, sine),
        _ => (sine, cosine),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarter_turns_are_exact_and_right_handed() {
        assert_eq!(from_degrees([0.0; 3]), DMat3::IDENTITY);
        assert_eq!(from_degrees([0.0, 0.0, 90.0]) * DVec3::X, DVec3::Y);
        assert_eq!(from_degrees([-270.0, 0.0, 0.0]) * DVec3::Y, DVec3::Z);
        assert_eq!(from_degrees([0.0, 450.0, 0.0]) * DVec3::Z, DVec3::X);
        // First about x, then about z: y goes to z and stays there.
        assert_eq!(from_degrees([90.0, 0.0, 90.0]) * DVec3::Y, DVec3::Z);
    }

    #[test]
    fn agrees_with_turning_about_each_axis() {
        for angles in [[10.0, -35.0, 77.0], [123.0, 200.0, -301.0]] {
            let [x, y, z] = angles.map(f64::to_radians);
            let expected = DMat3::from_rotation_z(z) * DMat3::from_rotation_y(y) * DMat3::from_rotation_x(x);
            assert!(from_degrees(angles).abs_diff_eq(expected, 1e-14), "{angles:?}");
        }
    }
}
