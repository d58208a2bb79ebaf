//! Light on a boundary: diffuse N·L plus specular (N·H)⁸, both sides alike.

use fearless_simd::{Select, Simd, SimdBase, f32x16};
use glam::Vec3;

use super::lanes::{Directions, dot, splat, splat_vector, unit_or_zero};
use crate::state::Shading;

/// Light that comes from one side, and a viewer on another.
#[derive(Clone, Copy, Debug)]
pub struct Lighting {
    to_light: Vec3,
    /// Unit vector halfway to the viewer, or 0 where the light is exactly opposite.
    halfway: Vec3,
    shading: Shading,
}

impl Lighting {
    /// Both directions are unit vectors.
    #[must_use]
    #[inline(always)]
    pub fn new(to_viewer: Vec3, to_light: Vec3, shading: &Shading) -> Self {
        let half = to_light + to_viewer;
        let length = half.dot(half).sqrt();
        let halfway = if length > 1e-6 { half / length } else { Vec3::ZERO };
        Self { to_light, halfway, shading: *shading }
    }

    /// The colour that a surface sends to the viewer, each channel at most 1.
    ///
    /// `normal` is a unit vector; 0 means that there is none, and the colour is returned as it is. Its sign does not
    /// matter: a boundary is seen from either side.
    #[must_use]
    #[inline(always)]
    pub fn shade(&self, color: Vec3, normal: Vec3) -> Vec3 {
        if normal == Vec3::ZERO {
            return color;
        }
        let Shading { ambient, diffuse, specular, .. } = self.shading;
        let aligned = normal.dot(self.halfway);
        let squared = aligned * aligned;
        let fourth = squared * squared;
        let lit = (ambient + diffuse * normal.dot(self.to_light).abs()) * color + specular * (fourth * fourth);
        lit.clamp(Vec3::ZERO, Vec3::ONE)
    }
}

/// As [`Lighting::shade`], for viewers in the directions against which sixteen rays go.
#[inline(always)]
pub(super) fn shade<S: Simd>(
    simd: S,
    shading: &Shading,
    to_light: Vec3,
    directions: &Directions<S>,
    color: &[f32x16<S>; 3],
    normal: &Directions<S>,
) -> [f32x16<S>; 3] {
    let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
    let to_light = splat_vector(simd, to_light);
    let half = [to_light[0] - directions[0], to_light[1] - directions[1], to_light[2] - directions[2]];
    let aligned = dot(normal, &unit_or_zero(simd, &half, 1e-12));
    let squared = aligned * aligned;
    let fourth = squared * squared;
    let highlight = fourth * fourth * shading.specular;
    let diffuse = dot(normal, &to_light).abs() * shading.diffuse + shading.ambient;
    let has_normal = dot(normal, normal).simd_gt(0.0);
    let mut lit = *color;
    for channel in lit.iter_mut() {
        *channel = has_normal.select((diffuse * *channel + highlight).max(zero).min(one), *channel);
    }
    lit
}

#[cfg(test)]
mod tests {
    use fearless_simd::dispatch;
    use voxrole_preprocess::simd;

    use super::super::lanes::LANES;
    use super::*;

    const SHADING: Shading = Shading { ambient: 0.1, diffuse: 0.5, specular: 0.3, occlusion: 0.0 };

    #[test]
    fn both_sides_are_lit_alike() {
        let (to_viewer, to_light) = (Vec3::new(0.6, 0.8, 0.0), Vec3::Z);
        for normal in [Vec3::X, Vec3::new(0.0, 0.6, 0.8), Vec3::new(-0.36, 0.48, -0.8)] {
            let lighting = Lighting::new(to_viewer, to_light, &SHADING);
            assert_eq!(lighting.shade(Vec3::ONE, normal), lighting.shade(Vec3::ONE, -normal));
        }
    }

    #[test]
    fn a_surface_that_faces_light_and_viewer_shows_all_three_terms() {
        let lit = Lighting::new(Vec3::Z, Vec3::Z, &SHADING).shade(Vec3::new(1.0, 0.5, 0.0), Vec3::Z);
        assert!((lit - Vec3::new(0.9, 0.6, 0.3)).length() < 1e-6, "{lit}");
    }

    #[test]
    fn the_highlight_falls_by_the_eighth_power() {
        let to_light = Vec3::new(0.0, 0.6, 0.8);
        let to_viewer = Vec3::new(0.0, -0.6, 0.8);
        // H is z; a normal 30 degrees off has N·H = √3/2.
        let normal = Vec3::new(0.5, 0.0, 0.75_f32.sqrt());
        let lit = Lighting::new(to_viewer, to_light, &SHADING).shade(Vec3::ZERO, normal);
        assert!((lit.x - 0.3 * 0.75_f32.powi(4)).abs() < 1e-6, "{lit}");
    }

    #[test]
    fn a_normal_across_the_light_leaves_the_ambient_term() {
        let lit = Lighting::new(Vec3::Z, Vec3::Z, &SHADING).shade(Vec3::ONE, Vec3::X);
        assert!((lit - Vec3::splat(0.1)).length() < 1e-6);
    }

    #[test]
    fn sixteen_rays_are_lit_as_each_would_be() {
        let to_light = Vec3::new(-0.36, 0.48, -0.8);
        for (direction, normal, color) in [
            (Vec3::new(0.6, 0.8, 0.0), Vec3::new(0.0, 0.6, 0.8), Vec3::new(0.1, 0.5, 1.0)),
            (Vec3::Z, Vec3::ZERO, Vec3::new(0.1, 0.5, 1.0)),
            (to_light, Vec3::X, Vec3::ONE),
            (-to_light, -to_light, Vec3::ONE),
        ] {
            let expected = Lighting::new(-direction, to_light, &SHADING).shade(color, normal);
            let found: [[f32; LANES]; 3] = dispatch!(simd::level(), simd => {
                let [direction, color, normal] = [direction, color, normal].map(|vector| splat_vector(simd, vector));
                shade(simd, &SHADING, to_light, &direction, &color, &normal).map(Into::into)
            });
            let found = Vec3::from_array(found.map(|channel| channel[7]));
            assert!((found - expected).length() < 1e-6, "{found} is not {expected}");
        }
    }
}
