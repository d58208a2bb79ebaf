//! Volumes drawn by value alone, or by the opacities that they have themselves.

use std::sync::Arc;

use voxrole_pack::DistanceQuantization;
use voxrole_pack::quantization::NO_NORMAL;
use voxrole_tests::comparison::{
    assert_same, difference, draw_on_cpu, draw_on_gpu, draw_with_budget, gpu_or_skip, lit_share,
};
use voxrole_viewer::reference::RayMarcher;
use voxrole_viewer::state::{Camera, CameraPreset, Classification, Integration, Technique};
use voxrole_viewer::{Renderer, Target, ViewState, VolumeTexels};

use crate::phantom::{Phantom, orthographic};

const BACKGROUND: [u8; 4] = [0, 0, 0, 255];

/// By value alone, with a peak that lies between the values of most samples.
fn by_value(phantom: &Phantom, camera: Camera) -> ViewState {
    let mut state = phantom.state(camera);
    state.transfer_function.classification = Classification::Value;
    let [low, high] = phantom.texels().description.value_range;
    let at = |share: f64| low + share * (high - low);
    let curve = [(0.3, "FF6262", 0.0), (0.5, "FFFFB4", 0.2), (0.55, "FFFFFF", 0.0), (0.8, "00FF00", 0.0)]
        .into_iter()
        .chain([(0.81, "0000FF", 0.9), (0.82, "FF0000", 0.0)]);
    let points: Vec<_> = curve.map(|(share, color, opacity)| format!("{},{color},{opacity}", at(share))).collect();
    state.transfer_function.curve = points.join(";").parse().expect("a curve");
    state
}

/// A box of grey fog around a white ball.
fn stored() -> (Phantom, VolumeTexels) {
    let phantom = Phantom::ball();
    let mut volume = phantom.texels();
    for (index, texel) in volume.texels.iter_mut().enumerate() {
        let place = [index % 64, index / 64 % 64, index / 4096].map(|place| place as f32 - 31.5);
        let radius = place.iter().map(|place| place * place).sum::<f32>().sqrt();
        let (intensity, opacity) = if radius < 15.0 { (65535, 30000) } else { (20000, 300) };
        *texel = [opacity, DistanceQuantization::MASKED as u16, intensity, NO_NORMAL];
    }
    (phantom, volume)
}

#[test]
fn gpu_and_cpu_agree_by_value_and_as_stored() {
    let Some(gpu) = gpu_or_skip("gpu_and_cpu_agree_by_value_and_as_stored") else { return };
    let phantom = Phantom::concentric_shells();
    let volume = phantom.texels();
    for integration in [Integration::PostClassified, Integration::Preintegrated, Integration::FrontToBack] {
        for technique in Technique::ALL {
            let mut state = by_value(&phantom, Camera::default());
            state.render_settings.integration = integration;
            state.render_settings.technique = technique;
            state.render_settings.step = 0.5;
            let on_cpu = draw_on_cpu(&volume, &state);
            assert!(lit_share(&on_cpu, BACKGROUND) > 0.05);
            assert_same(&format!("{integration:?} {technique:?}"), &on_cpu, &draw_on_gpu(&gpu, &volume, &state));
        }
    }
    let (phantom, volume) = stored();
    let mut state = phantom.state(orthographic(CameraPreset::Iso));
    state.transfer_function.classification = Classification::Stored;
    assert_same("stored", &draw_on_cpu(&volume, &state), &draw_on_gpu(&gpu, &volume, &state));
}

#[test]
fn thin_peaks_are_seen_at_any_step() {
    let phantom = Phantom::ball();
    let volume = phantom.texels();
    let mut state = by_value(&phantom, Camera::default());
    let draw = |integration, step, state: &mut ViewState| {
        state.render_settings.integration = integration;
        state.render_settings.step = step;
        draw_on_cpu(&volume, state)
    };
    let truth = draw(Integration::PostClassified, 1.0 / 32.0, &mut state);
    let off = |picture| difference(&truth, &picture).0;
    let [post, one_axis, two_axes] =
        [Integration::PostClassified, Integration::Preintegrated, Integration::FrontToBack]
            .map(|integration| off(draw(integration, 1.0, &mut state)));
    println!("post {post:.2}, pre {one_axis:.2}, pre-2d {two_axes:.2} of 255");
    assert!(3.0 * one_axis < post && 3.0 * two_axes < post, "{post} {one_axis} {two_axes}");
}

#[test]
fn leaping_changes_nothing_by_value() {
    let phantom = Phantom::concentric_shells();
    let volume = phantom.texels();
    let (phantom_stored, stored) = stored();
    let mut as_stored = phantom_stored.state(Camera::default());
    as_stored.transfer_function.classification = Classification::Stored;
    for (volume, mut state) in [(&volume, by_value(&phantom, Camera::default())), (&stored, as_stored)] {
        for step in [0.25, 3.0, 12.0] {
            state.render_settings.step = step;
            state.render_settings.leaps = true;
            let leapt = RayMarcher::new(volume, &state, [64, 64]).expect("a size").light();
            state.render_settings.leaps = false;
            let all = RayMarcher::new(volume, &state, [64, 64]).expect("a size").light();
            assert!(leapt.0.pixels.iter().zip(&all.0.pixels).all(|(a, b)| a.light == b.light), "{step}");
            assert!(leapt.1.taken <= all.1.taken);
        }
    }
}

#[test]
fn a_renderer_leaps_by_the_steps_that_it_draws() {
    let Some(gpu) = gpu_or_skip("a_renderer_leaps_by_the_steps_that_it_draws") else { return };
    let phantom = Phantom::concentric_shells();
    let volume = Arc::new(phantom.texels());
    let mut state = by_value(&phantom, Camera::default());
    state.render_settings.step = 12.0;
    let target = Target::new(&gpu, state.render_settings.image_size).expect("a target");
    let mut renderer = Renderer::new(&gpu, &volume, None).expect("a renderer");
    // Steps that are integrated reach into macrocells that those that are not leave alone.
    for integration in [Integration::PostClassified, Integration::Preintegrated] {
        state.render_settings.integration = integration;
        renderer.draw(&state, &target).expect("is drawn");
        let fresh = draw_on_gpu(&gpu, &volume, &state);
        assert!(target.read_back(&gpu).expect("a picture") == fresh, "{integration:?}");
    }
}

#[test]
fn a_budget_changes_nothing_by_value() {
    let Some(gpu) = gpu_or_skip("a_budget_changes_nothing_by_value") else { return };
    let phantom = Phantom::concentric_shells();
    let volume = Arc::new(phantom.texels());
    let mut state = by_value(&phantom, Camera::default());
    state.render_settings.step = 1.5;
    let (whole, _) = draw_with_budget(&gpu, &volume, &state, None);
    let (bricks, uploads) = draw_with_budget(&gpu, &volume, &state, Some(4 * 33 * 33 * 33 * 8));
    assert!(uploads.is_some_and(|uploads| uploads > 0) && bricks == whole);
}

#[test]
fn stored_fog_is_as_opaque_as_it_says() {
    let (phantom, volume) = stored();
    let mut state = phantom.state(orthographic(CameraPreset::Front));
    state.transfer_function.classification = Classification::Stored;
    state.render_settings.image_size = [64, 64];
    let (light, _) = RayMarcher::new(&volume, &state, [64, 64]).expect("a size").light();
    // 12 voxels beside the middle, where 109 voxels of the sphere around the volume span the picture: outside of the
    // ball.
    let beside = light.pixels[32 * 64 + 32 + 14].light;
    let through = (1.0 - 300.0 / 65535.0_f32).powf(63.0);
    assert!((beside.w - (1.0 - through)).abs() < 0.01, "{beside}");
    assert!((beside.x / beside.w - 20000.0 / 65535.0).abs() < 1e-3 && beside.x == beside.z, "{beside}");
    let shown = light.pixels[32 * 64 + 32].light;
    assert!(shown.w > 0.99 && shown.x > 0.8, "{shown}");
}
