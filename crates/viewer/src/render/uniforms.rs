//! A [`Frame`] as the shaders read it.

use bytemuck::{Pod, Zeroable};

use crate::frame::{Frame, MOST_PLANES};
use crate::state::Classification;

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
    ambient: f32,
    direction_up: [f32; 3],
    diffuse: f32,
    box_low: [f32; 3],
    specular: f32,
    box_high: [f32; 3],
    half_step: f32,
    spacing: [f32; 3],
    classification: u32,
    inverse_spacing: [f32; 3],
    occlusion: f32,
    light: [f32; 3],
    padding_after_light: f32,
    background: [f32; 3],
    padding_after_background: f32,
    last_voxel: [i32; 3],
    /// The first row of the strip that is drawn.
    first_row: i32,
    image_size: [f32; 2],
    plane_count: u32,
    jitter: u32,
    planes: [[f32; 4]; MOST_PLANES],
    slicing: [f32; 4],
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
            reach: frame.reach,
            direction_right: rays.direction_right.into(),
            ambient: frame.shading.ambient,
            direction_up: rays.direction_up.into(),
            diffuse: frame.shading.diffuse,
            box_low: frame.box_low.into(),
            specular: frame.shading.specular,
            box_high: frame.box_high.into(),
            half_step: frame.half_step,
            spacing: frame.spacing.into(),
            classification: match (frame.classification, frame.is_ordered) {
                (Classification::Roles, _) => 0,
                (Classification::Stored, _) => 1,
                (Classification::Value, false) => 2,
                (Classification::Value, true) => 3,
            },
            inverse_spacing: frame.spacing.recip().into(),
            occlusion: frame.shading.occlusion,
            light: frame.light.into(),
            padding_after_light: 0.0,
            background: frame.background.into(),
            padding_after_background: 0.0,
            last_voxel: frame.dims.map(|dim| dim as i32 - 1),
            first_row: 0,
            image_size: frame.image_size.map(|side| side as f32),
            plane_count: frame.plane_count,
            jitter: u32::from(frame.jitter),
            planes: frame.planes.map(|plane| plane.to_array()),
            slicing: frame.slicing.map_or([0.0; 4], |slicing| slicing.growth.extend(slicing.offset).to_array()),
        }
    }
}

impl Uniforms {
    /// The same for a strip that begins at a row of the picture.
    pub fn at_row(self, row: u32) -> Self {
        Self { first_row: row as i32, ..self }
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
            ambient,
            direction_up,
            diffuse,
            box_low,
            specular,
            box_high,
            half_step,
            spacing,
            classification,
            inverse_spacing,
            occlusion,
            light,
            padding_after_light,
            background,
            padding_after_background,
            last_voxel,
            first_row,
            image_size,
            plane_count,
            jitter,
            planes,
            slicing,
        );
        assert_eq!(found.as_slice(), expected);
        assert_eq!(size_of::<Uniforms>(), span as usize);
    }
}
