//! The GPU ray marcher against its oracle.

use std::sync::Arc;

use glam::DVec3;
use voxrole_pack::GridGeometry;
use voxrole_tests::comparison::{assert_same, draw_on_cpu, draw_on_gpu, gpu_or_skip, lit_share};
use voxrole_viewer::state::{BoundaryEmphasis, Camera, CameraPreset, Integration};
use voxrole_viewer::{Error, Gpu, Renderer, Target, ViewState};

use crate::phantom::{Phantom, SHELLS, Shell, orthographic};

fn compare(gpu: &Gpu, name: &str, phantom: &Phantom, state: &ViewState) {
    let volume = phantom.texels();
    let on_cpu = draw_on_cpu(&volume, state);
    let lit = lit_share(&on_cpu, [0, 0, 0, 255]);
    assert!((0.1..0.9).contains(&lit), "{name}: {lit} of the picture is lit");
    assert_same(name, &on_cpu, &draw_on_gpu(gpu, &volume, state));
}

#[test]
fn gpu_and_cpu_draw_the_same_ball_and_shells() {
    let Some(gpu) = gpu_or_skip("gpu_and_cpu_draw_the_same_ball_and_shells") else { return };
    for (name, phantom) in [("ball", Phantom::ball()), ("shells", Phantom::concentric_shells())] {
        compare(&gpu, name, &phantom, &phantom.state(Camera::default()));
        compare(&gpu, name, &phantom, &phantom.state(orthographic(CameraPreset::Iso)));
    }
}

#[test]
fn gpu_and_cpu_agree_for_every_kind_of_emphasis() {
    let Some(gpu) = gpu_or_skip("gpu_and_cpu_agree_for_every_kind_of_emphasis") else { return };
    let phantom = Phantom::concentric_shells();
    let integrations = [Integration::Preintegrated, Integration::PostClassified].into_iter().cycle();
    for ((name, emphasis), integration) in BoundaryEmphasis::figure_9(15.0).into_iter().zip(integrations) {
        let mut state = phantom.state(Camera::default());
        state.render_settings.image_size = [64, 64];
        state.transfer_function.emphasis = emphasis.into();
        state.render_settings.integration = integration;
        compare(&gpu, name, &phantom, &state);
    }
}

#[test]
fn gpu_and_cpu_agree_where_sides_and_regions_have_an_emphasis_of_their_own() {
    let Some(gpu) = gpu_or_skip("gpu_and_cpu_agree_where_sides_and_regions_have_an_emphasis_of_their_own") else {
        return;
    };
    let phantom = Phantom::concentric_shells();
    let volume = Arc::new(phantom.texels());
    let mut state = phantom.state(Camera::default());
    state.render_settings.image_size = [64, 64];
    let target = Target::new(&gpu, [64, 64]).expect("a target");
    let mut renderer = Renderer::new(&gpu, &volume, None).expect("a renderer");
    let mut pictures = Vec::new();
    for (shared, own) in [
        ("concave,1,3,3", None),
        ("concave,1,3,3/linear,0.2,8", None),
        ("concave,1,3,3/linear,0.2,8", Some("convex,0.6,2,4")),
        ("concave,1,3,3", Some("convex,0.6,2,4/concave,0.5,6,2")),
    ] {
        state.transfer_function.emphasis = shared.parse().expect("an emphasis");
        state.transfer_function.regions[0].emphasis = own.map(|own| own.parse().expect("an emphasis"));
        renderer.draw(&state, &target).expect("is drawn");
        pictures.push(target.read_back(&gpu).expect("a picture"));
        let name = format!("{shared} {own:?}");
        assert_same(&name, &draw_on_cpu(&volume, &state), &pictures[pictures.len() - 1]);
    }
    assert!((1..pictures.len()).all(|picture| pictures[picture] != pictures[picture - 1]));
}

#[test]
fn gpu_and_cpu_agree_on_turned_uneven_and_flat_grids() {
    let Some(gpu) = gpu_or_skip("gpu_and_cpu_agree_on_turned_uneven_and_flat_grids") else { return };
    let mut uneven = Phantom::concentric_shells();
    uneven.geometry = GridGeometry {
        direction: [[0.6, 0.8, 0.0], [0.8, -0.6, 0.0], [0.0, 0.0, 1.0]],
        ..GridGeometry::axis_aligned([60, 40, 30], [1.0, 1.5, 2.0])
    };
    uneven.center = DVec3::new(30.0, 30.0, 29.0);
    let mut state = uneven.state(Camera { roll: 20.0, zoom: 1.5, pan: [0.2, -0.1], ..Camera::default() });
    // A row of this many pixels is not a multiple of what GPUs copy.
    state.render_settings.image_size = [100, 70];
    compare(&gpu, "uneven", &uneven, &state);

    let mut flat = Phantom::cube(64, &SHELLS);
    flat.geometry.dims = [64, 64, 1];
    flat.center.z = 0.0;
    compare(&gpu, "flat", &flat, &flat.state(Camera::from_preset(CameraPreset::Top)));
}

#[test]
fn a_renderer_follows_its_state() {
    let Some(gpu) = gpu_or_skip("a_renderer_follows_its_state") else { return };
    let phantom = Phantom::cube(24, &[Shell { radius: 7.0, step: 80.0 }]);
    let volume = Arc::new(phantom.texels());
    let target = Target::new(&gpu, [64, 64]).expect("a target");
    let mut renderer = Renderer::new(&gpu, &volume, None).expect("a renderer");
    let mut state = phantom.state(Camera::default());
    let mut draw = |state: &ViewState| {
        renderer.draw(state, &target).expect("is drawn");
        target.read_back(&gpu).expect("a picture")
    };
    let first = draw(&state);
    state.transfer_function.regions[0].color = [0.0, 0.0, 1.0];
    let blue = draw(&state);
    assert_ne!(first, blue);
    assert!(blue.pixel(32, 32)[2] > blue.pixel(32, 32)[0]);
    state.transfer_function.regions.clear();
    assert_eq!(lit_share(&draw(&state), [0, 0, 0, 255]), 0.0);
}

#[test]
fn what_does_not_fit_is_refused_with_a_reason() {
    let Some(gpu) = gpu_or_skip("what_does_not_fit_is_refused_with_a_reason") else { return };
    assert!(matches!(Target::new(&gpu, [0, 10]), Err(Error::PictureSize { .. })));
    assert!(matches!(Target::new(&gpu, [10, 1 << 20]), Err(Error::PictureSize { .. })));
    let mut volume = Phantom::cube(8, &[Shell { radius: 2.0, step: 1.0 }]).texels();
    volume.description.dims = [1 << 20, 1, 1];
    volume.texels = vec![[0; 4]; 1 << 20];
    let error = Renderer::new(&gpu, &Arc::new(volume), None).err().expect("is refused").to_string();
    assert!(error.contains("1048576") && error.contains("--cpu"), "{error}");
}
