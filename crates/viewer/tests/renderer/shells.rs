//! What must and what must not be seen of two concentric shells.

use glam::{DVec3, Vec3};
use voxrole_tests::comparison::{MOST_MIRRORED_RMSE, MOST_STEP_RMSE, difference, draw_on_cpu, lit_share};
use voxrole_viewer::classify::opacity_by_distance;
use voxrole_viewer::reference::RayMarcher;
use voxrole_viewer::state::{BoundaryEmphasis, Camera, CameraPreset, EmphasisKind, Technique};
use voxrole_viewer::{Picture, ViewState, VolumeTexels};

use crate::phantom::{Phantom, SHELLS, orthographic, region_at};

const BACKGROUND: [u8; 4] = [0, 0, 0, 255];

/// Both shells fully opaque.
fn opaque_state(phantom: &Phantom, emphasis: BoundaryEmphasis) -> ViewState {
    let mut state = phantom.state(Camera::default());
    state.transfer_function.regions.iter_mut().for_each(|region| region.opacity = 1.0);
    state.transfer_function.emphasis = emphasis.into();
    state
}

#[test]
fn opacity_follows_the_true_distance_everywhere() {
    let phantom = Phantom::concentric_shells();
    let volume = phantom.texels();
    let emphasis = BoundaryEmphasis { kind: EmphasisKind::Concave, a: 0.8, d_c: 5.0, n: 3.0 };
    let state = opaque_state(&phantom, emphasis);
    let marcher = RayMarcher::new(&volume, &state, [8, 8]).expect("a size");
    for direction in [DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::new(0.3, -0.5, 0.8), DVec3::NEG_ONE] {
        let direction = direction.normalize();
        let mut peaks = [0.0_f32; 2];
        for step in 60..600 {
            let r = f64::from(step) * 0.05;
            let opacity = marcher.opacity_at((phantom.center + r * direction).as_vec3());
            let distances = SHELLS.map(|shell| (shell.radius - r).abs());
            for (peak, distance) in peaks.iter_mut().zip(distances) {
                *peak = if distance < 1.0 { peak.max(opacity) } else { *peak };
            }
            let nearest = distances[0].min(distances[1]);
            let expected = opacity_by_distance(&emphasis, nearest as f32);
            // Planes stand in for a sphere: off by (cell diagonal)²/2R at most, and αd has slope a·n/d_c at most.
            assert!((opacity - expected).abs() < 0.04, "{opacity} is not {expected} at r = {r} along {direction}");
            assert!(nearest < 5.2 || opacity == 0.0, "medial surface: {opacity} at r = {r} along {direction}");
        }
        assert!(peaks.iter().all(|&peak| peak >= 0.95 * emphasis.a), "{peaks:?} along {direction}");
    }
}

#[test]
fn a_thin_boundary_peaks_on_itself() {
    // The paper's thin setting, where interpolating |d| shows the boundary at 13 %.
    let phantom = Phantom::concentric_shells();
    let volume = phantom.texels();
    let emphasis = BoundaryEmphasis { kind: EmphasisKind::Concave, a: 1.0, d_c: 2.0, n: 7.0 };
    let state = opaque_state(&phantom, emphasis);
    let marcher = RayMarcher::new(&volume, &state, [8, 8]).expect("a size");
    for shell in SHELLS {
        for direction in [DVec3::Y, DVec3::new(0.2, 0.9, -0.4), DVec3::new(-0.7, 0.6, 0.5)] {
            let place = |r: f64| (phantom.center + r * direction.normalize()).as_vec3();
            let peak = (-50..=50)
                .map(|step| marcher.opacity_at(place(shell.radius + f64::from(step) * 0.01)))
                .fold(0.0, f32::max);
            assert!(peak >= 0.95, "{peak} at {shell:?} along {direction}");
        }
    }
}

#[test]
fn the_medial_surface_is_empty_in_the_picture() {
    let mut phantom = Phantom::concentric_shells();
    phantom.geometry.dims = [64, 64, 1];
    phantom.center.z = 0.0;
    let mut state = opaque_state(&phantom, BoundaryEmphasis::default());
    state.camera = orthographic(CameraPreset::Top);
    state.render_settings.image_size = [400, 400];
    let volume = phantom.texels();
    for technique in Technique::ALL {
        state.render_settings.technique = technique;
        assert_boundaries_alone(&draw_on_cpu(&volume, &state));
    }
}

/// Asserts that a picture of a slab's 400 × 400 pixels shows the two boundaries and nothing between or around them.
fn assert_boundaries_alone(picture: &Picture) {
    // At zoom 1 the sphere around the slab spans the picture.
    let pixels_per_voxel = 200.0 / (0.5 * (2.0 * 63.0_f64.powi(2) + 1.0).sqrt());
    let mut seen = [0; 3];
    for y in 0..400 {
        for x in 0..400 {
            let r = (f64::from(x) + 0.5 - 200.0).hypot(f64::from(y) + 0.5 - 200.0) / pixels_per_voxel;
            let distance = (r - SHELLS[0].radius).abs().min((r - SHELLS[1].radius).abs());
            let pixel = picture.pixel(x, y);
            if distance < 0.5 {
                seen[0] += 1;
                assert!(pixel[..3].iter().any(|&channel| channel > 40), "boundary at r = {r}: {pixel:?}");
            } else if (r - 18.0).abs() < 2.0 {
                seen[1] += 1;
                assert_eq!(pixel, BACKGROUND, "medial surface at r = {r}");
            } else if distance > 3.3 {
                seen[2] += 1;
                assert_eq!(pixel, BACKGROUND, "r = {r}");
            }
        }
    }
    assert!(seen.iter().all(|&count| count > 2000), "{seen:?}");
}

#[test]
fn a_gradient_between_the_two_lights_nothing() {
    let phantom = Phantom::concentric_shells();
    let mut state = phantom.state(Camera::default());
    let between = 0.5 * (SHELLS[0].gradient() + SHELLS[1].gradient());
    state.transfer_function.emphasis.high.d_c = 15.0;
    state.transfer_function.emphasis.low.d_c = 15.0;
    let volume = phantom.texels();
    for technique in Technique::ALL {
        state.render_settings.technique = technique;
        state.transfer_function.regions = vec![region_at(between, 1.0, [1.0; 3])];
        assert_eq!(lit_share(&draw_on_cpu(&volume, &state), BACKGROUND), 0.0);
        // The test can fail: the same region at one of the two lights a good part of the picture.
        state.transfer_function.regions = vec![region_at(SHELLS[0].gradient(), 1.0, [1.0; 3])];
        assert!(lit_share(&draw_on_cpu(&volume, &state), BACKGROUND) > 0.05);
    }
}

#[test]
fn inner_and_outer_boundary_are_seen_at_once() {
    let phantom = Phantom::concentric_shells();
    let volume = phantom.texels();
    let mut state = phantom.state(orthographic(CameraPreset::Front));
    for technique in Technique::ALL {
        state.render_settings.technique = technique;
        assert_both_are_seen(&draw_on_cpu(&volume, &state));
    }
}

fn assert_both_are_seen(picture: &Picture) {
    // 128 pixels span the sphere around a cube of 63 voxels.
    let pixel_at = |voxels: f64| picture.pixel((64.0 + voxels * 128.0 / (63.0 * 3.0_f64.sqrt())) as u32, 64);
    let [inner, outer, outside] = [pixel_at(0.0), pixel_at(18.0), pixel_at(30.0)];
    assert!(inner[0] > inner[2], "orange shows through: {inner:?}");
    assert!(outer[2] > outer[0] && outer[2] > 30, "blue alone: {outer:?}");
    assert_eq!(outside, BACKGROUND);
}

#[test]
fn opacity_does_not_depend_on_the_step() {
    let phantom = Phantom::concentric_shells();
    let volume = phantom.texels();
    let mut state = phantom.state(Camera::default());
    for technique in Technique::ALL {
        state.render_settings.technique = technique;
        let [quarter, half] = [0.25, 0.5].map(|step| {
            state.render_settings.step = step;
            draw_on_cpu(&volume, &state)
        });
        let (rmse, _) = difference(&quarter, &half);
        assert!(rmse < MOST_STEP_RMSE, "{technique:?}: {rmse}");
    }
}

#[test]
fn a_boundary_looks_the_same_whichever_side_is_higher() {
    let phantom = Phantom::concentric_shells();
    let volume = phantom.texels();
    let state = phantom.state(Camera::default());
    let mut mirrored = volume.clone();
    for texel in &mut mirrored.texels {
        if VolumeTexels::has_hit(*texel) {
            texel[1] = (-(texel[1] as i16)) as u16;
            let normal = voxrole_pack::quantization::decode_normal(texel[3]).unwrap_or(Vec3::ZERO);
            texel[3] = voxrole_pack::quantization::encode_normal(-normal);
        }
    }
    assert_ne!(volume, mirrored);
    let (rmse, _) = difference(&draw_on_cpu(&volume, &state), &draw_on_cpu(&mirrored, &state));
    assert!(rmse < MOST_MIRRORED_RMSE, "{rmse}");
}

#[test]
fn a_voxel_without_a_hit_adds_nothing_and_bends_nothing() {
    let phantom = Phantom::ball();
    let mut volume = phantom.texels();
    let state = opaque_state(&phantom, BoundaryEmphasis::default());
    // On the boundary along x: 31.5 + 20.
    let place = Vec3::new(51.5, 32.0, 32.0);
    let before = RayMarcher::new(&volume, &state, [8, 8]).expect("a size").opacity_at(place);
    let texel = &mut volume.texels[(32 * 64 + 32) * 64 + 51];
    texel[1] = i16::MIN as u16;
    texel[2] = 0;
    let after = RayMarcher::new(&volume, &state, [8, 8]).expect("a size").opacity_at(place);
    // The voxel has half the weight there; the other half is as it was.
    assert!(before > 0.95 && (after - 0.5 * before).abs() < 0.03, "{before} {after}");
}
