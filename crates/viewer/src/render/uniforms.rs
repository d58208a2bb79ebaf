//! A [`Frame`] as the shaders read it.

use bytemuck::{Pod, Zeroable};

use crate::frame::Frame;
use crate::state::EmphasisKind;

/// The shaders' `Uniforms`: a vector and a number in every 16 bytes. A test compares the offsets with the shader's.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Uniforms {
    origin: [f32; 3],
    step: f32,
    origin_right: [f32; 3],
    termination_opacity: f32,
    origin_up: [f32; 3],
    distance_scale: f32,
    direction: [f32; 3],
    reach: f32,
    direction_right: [f32; 3],
    emphasis_a: f32,
    direction_up: [f32; 3],
    emphasis_d_c: f32,
    box_low: [f32; 3],
    emphasis_n: f32,
    box_high: [f32; 3],
    emphasis_kind: u32,
    spacing: [f32; 3],
    ambient: f32,
    inverse_spacing: [f32; 3],
    diffuse: f32,
    light: [f32; 3],
    specular: f32,
    background: [f32; 3],
    padding: f32,
    last_voxel: [i32; 3],
    padding_after_last_voxel: i32,
    image_size: [f32; 2],
    padding_at_end: [f32; 2],
}

impl From<&Frame> for Uniforms {
    fn from(frame: &Frame) -> Self {
        let rays = &frame.rays;
        Self {
            origin: rays.origin.into(),
            step: frame.step,
            origin_right: rays.origin_right.into(),
            termination_opacity: frame.termination_opacity,
            origin_up: rays.origin_up.into(),
            distance_scale: frame.distance_scale,
            direction: rays.direction.into(),
            reach: frame.reach(),
            direction_right: rays.direction_right.into(),
            emphasis_a: frame.emphasis.a,
            direction_up: rays.direction_up.into(),
            emphasis_d_c: frame.emphasis.d_c,
            box_low: frame.box_low.into(),
            emphasis_n: frame.emphasis.n,
            box_high: frame.box_high.into(),
            emphasis_kind: match frame.emphasis.kind {
                EmphasisKind::Linear => 0,
                EmphasisKind::Concave => 1,
                EmphasisKind::Convex => 2,
            },
            spacing: frame.spacing.into(),
            ambient: frame.shading.ambient,
            inverse_spacing: frame.spacing.recip().into(),
            diffuse: frame.shading.diffuse,
            light: frame.light.into(),
            specular: frame.shading.specular,
            background: frame.background.into(),
            padding: 0.0,
            last_voxel: frame.dims.map(|dim| dim as i32 - 1),
            padding_after_last_voxel: 0,
            image_size: frame.image_size.map(|side| side as f32),
            padding_at_end: [0.0; 2],
        }
    }
}

#[cfg(test)]
mod tests {
    use std::mem::offset_of;

    use super::*;
    use crate::render::shader;

    macro_rules! offsets {
        ($($field:ident),* $(,)?) => { [$((stringify!($field), offset_of!(Uniforms, $field))),*] };
    }

    #[test]
    fn offsets_are_the_shader_s() {
        let module = naga::front::wgsl::parse_str(shader::SOURCE).expect("the shader parses");
        let (members, span) = module
            .types
            .iter()
            .find_map(|(_, kind)| match &kind.inner {
                naga::TypeInner::Struct { members, span } if kind.name.as_deref() == Some("Uniforms") => {
                    Some((members, *span))
                }
                _ => None,
            })
            .expect("the shader has a struct `Uniforms`");
        let expected: Vec<(&str, usize)> = members
            .iter()
            .map(|member| (member.name.as_deref().expect("a named member"), member.offset as usize))
            .collect();
        let found = offsets!(
            origin,
            step,
            origin_right,
            termination_opacity,
            origin_up,
            distance_scale,
            direction,
            reach,
            direction_right,
            emphasis_a,
            direction_up,
            emphasis_d_c,
            box_low,
            emphasis_n,
            box_high,
            emphasis_kind,
            spacing,
            ambient,
            inverse_spacing,
            diffuse,
            light,
            specular,
            background,
            padding,
            last_voxel,
            padding_after_last_voxel,
            image_size,
            padding_at_end,
        );
        assert_eq!(found.as_slice(), expected);
        assert_eq!(size_of::<Uniforms>(), span as usize);
    }
}
