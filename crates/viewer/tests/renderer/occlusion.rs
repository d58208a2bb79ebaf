//! Light that is kept from places among others: where, how much, and the same however it is drawn.

use std::sync::Arc;

use voxrole_pack::quantization::encode_normal;
use voxrole_pack::{DistanceQuantization, Precision};
use voxrole_tests::comparison::{assert_same, draw_on_cpu, draw_on_gpu, draw_with_budget, gpu_or_skip};
use voxrole_viewer::state::{BoundaryEmphasis, Camera, CameraPreset, Classification, EmphasisKind, Technique};
use voxrole_viewer::{Renderer, Target, ViewState, VolumeTexels};

use crate::phantom::{Phantom, Shell, orthographic};

const SHARP: BoundaryEmphasis = BoundaryEmphasis { kind: EmphasisKind::Convex, a: 1.0, d_c: 2.0, n: 3.0 };

/// A ball that is hollow, in a state in which it is opaque and has no highlights.
fn ball() -> (VolumeTexels, ViewState) {
    let phantom = Phantom::cube(64, &[Shell { radius: 14.0, step: 100.0 }]);
    let mut state = phantom.state(orthographic(CameraPreset::Front));
    state.transfer_function.regions[0].opacity = 1.0;
    state.transfer_function.emphasis = SHARP.into();
    state.render_settings.shading.specular = 0.0;
    (phantom.texels(), state)
}

/// A floor and a wall, which meet where y is 50 and z is 12; seen from 45 degrees above, the crease lies in the middle.
fn floor_and_wall() -> (VolumeTexels, ViewState) {
    let (mut volume, mut state) = ball();
    let quantization = DistanceQuantization::new(volume.description.d_max, Precision::default());
    for (index, texel) in volume.texels.iter_mut().enumerate() {
        let (y, z) = ((index / 64 % 64) as f32, (index / 4096) as f32);
        let (to_wall, to_floor) = (50.0 - y, z - 12.0);
        let distance = if to_wall < 0.0 && to_floor < 0.0 { -to_wall.hypot(to_floor) } else { to_wall.min(to_floor) };
        let normal = if to_wall < to_floor { glam::Vec3::NEG_Y } else { glam::Vec3::Z };
        *texel = [30_000, i16::MIN as u16, 0, 0];
        if distance.abs() <= volume.description.d_max {
            *texel = [30_000, quantization.encode(distance) as u16, 30_000, encode_normal(normal)];
        }
    }
    state.camera = Camera { elevation: 45.0, ..orthographic(CameraPreset::Front) };
    state.transfer_function.regions = vec!["-1000:1000,0:1000,FFFFFF,1".parse().expect("a region")];
    (volume, state)
}

/// The share of its light that a pixel in the middle column still has.
fn light_left(volume: &VolumeTexels, state: &ViewState, row: u32) -> f32 {
    let brightness = |occlusion| {
        let mut state = state.clone();
        state.render_settings.shading.occlusion = occlusion;
        f32::from(draw_on_cpu(volume, &state).pixel(64, row)[0])
    };
    brightness(1.0) / brightness(0.0)
}

#[test]
fn creases_are_darker_than_faces() {
    let (volume, mut state) = floor_and_wall();
    for technique in Technique::ALL {
        state.render_settings.technique = technique;
        let [wall, crease, floor] = [42, 64, 87].map(|row| light_left(&volume, &state, row));
        println!(
            "{technique:?}: {wall:.2} of the light on the wall, {crease:.2} in the crease, {floor:.2} on the floor"
        );
        assert!(crease < 0.85 * wall.min(floor) && wall.min(floor) > 0.95, "{technique:?}");
    }
}

#[test]
fn the_inside_of_a_shell_is_darker_than_its_outside() {
    let (volume, mut state) = ball();
    for technique in Technique::ALL {
        state.render_settings.technique = technique;
        state.clipping.planes.clear();
        let outside = light_left(&volume, &state, 64);
        state.clipping.planes = vec!["0,0".parse().expect("a plane")];
        let inside = light_left(&volume, &state, 64);
        println!("{technique:?}: {outside:.2} of the light outside, {inside:.2} inside");
        assert!(outside > 0.9 && inside < 0.7 * outside, "{technique:?}");
    }
}

#[test]
fn what_is_cut_away_keeps_no_light() {
    // Opaque up to the volume's faces.
    let (volume, mut state) = floor_and_wall();
    state.camera = orthographic(CameraPreset::Front);
    state.transfer_function.classification = Classification::Value;
    state.transfer_function.curve = "0,FFFFFF,0.9;1000,FFFFFF,0.9".parse().expect("a curve");
    let of_the_volume = light_left(&volume, &state, 64);
    state.clipping.planes = vec!["0,0".parse().expect("a plane")];
    let of_the_cut = light_left(&volume, &state, 64);
    println!("{of_the_volume:.2} of the light on the volume's face, {of_the_cut:.2} on that of the cut");
    assert!(of_the_volume > 0.6 && of_the_cut > 0.6);
}

#[test]
fn gpu_and_cpu_keep_the_same_light_away() {
    let Some(gpu) = gpu_or_skip("gpu_and_cpu_keep_the_same_light_away") else { return };
    for (name, (volume, mut state)) in [("ball", ball()), ("crease", floor_and_wall())] {
        state.render_settings.shading.occlusion = 0.8;
        state.render_settings.shading.specular = 0.25;
        state.transfer_function.curve = "0,FF0000,0;40,00FF00,0.2;100,FFFFFF,0.7".parse().expect("a curve");
        for classification in [Classification::Roles, Classification::Value, Classification::Stored] {
            state.transfer_function.classification = classification;
            for technique in Technique::ALL {
                state.render_settings.technique = technique;
                let name = format!("{name} {classification:?} {technique:?}");
                let on_cpu = draw_on_cpu(&volume, &state);
                assert_same(&name, &on_cpu, &draw_on_gpu(&gpu, &volume, &state));
                let mut lit = state.clone();
                lit.render_settings.shading.occlusion = 0.0;
                let is_darker = on_cpu != draw_on_cpu(&volume, &lit);
                assert!(is_darker || classification == Classification::Stored, "{name}: nothing is darker");
            }
        }
    }
}

#[test]
fn leaping_and_bricks_change_nothing() {
    let Some(gpu) = gpu_or_skip("leaping_and_bricks_change_nothing") else { return };
    let (volume, mut state) = floor_and_wall();
    let volume = Arc::new(volume);
    state.render_settings.shading.occlusion = 1.0;
    let (whole, none) = draw_with_budget(&gpu, &volume, &state, None);
    let (bricks, uploads) = draw_with_budget(&gpu, &volume, &state, Some(4 * 33 * 33 * 33 * 8));
    assert!(none.is_none() && uploads.is_some_and(|uploads| uploads > 0) && bricks == whole);
    for technique in Technique::ALL {
        state.render_settings.technique = technique;
        let mut draw = |leaps| {
            state.render_settings.leaps = leaps;
            (draw_on_cpu(&volume, &state), draw_on_gpu(&gpu, &volume, &state))
        };
        assert!(draw(true) == draw(false), "{technique:?}");
    }
}

#[test]
fn a_renderer_follows_the_strength_and_what_is_drawn() {
    let Some(gpu) = gpu_or_skip("a_renderer_follows_the_strength_and_what_is_drawn") else { return };
    let (volume, mut state) = ball();
    let volume = Arc::new(volume);
    let target = Target::new(&gpu, state.render_settings.image_size).expect("a target");
    let mut renderer = Renderer::new(&gpu, &volume, None).expect("a renderer");
    state.clipping.planes = vec!["0,0".parse().expect("a plane")];
    let mut draw = |occlusion: f32, opacity: f32| {
        state.render_settings.shading.occlusion = occlusion;
        state.transfer_function.regions[0].opacity = opacity;
        renderer.draw(&state, &target).expect("is drawn");
        let picture = target.read_back(&gpu).expect("a picture");
        assert_same("of a renderer", &draw_on_cpu(&volume, &state), &picture);
        picture
    };
    let off = draw(0.0, 1.0);
    let pictures = [draw(1.0, 1.0), draw(0.5, 1.0), draw(0.5, 0.3)];
    assert!(pictures.iter().all(|picture| *picture != off) && pictures[0] != pictures[1]);
    // Not a bit of it is left.
    assert!(draw(0.0, 1.0) == off);
}
