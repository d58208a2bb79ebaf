//! Volumes of which the device has no room for all.

use std::sync::Arc;

use glam::DVec3;
use voxrole_tests::comparison::{assert_same, draw_on_cpu, draw_with_budget, gpu_or_skip, lit_share};
use voxrole_viewer::drawing::Drawing;
use voxrole_viewer::state::{Camera, CameraPreset, Classification, Integration, Projection, Scene, Technique};
use voxrole_viewer::{Error, Renderer, Target};

use crate::phantom::{Phantom, Shell, orthographic};

/// Bytes of a brick of 32 cells along each axis.
const BRICK: u64 = 33 * 33 * 33 * 8;

/// Three times as large as a budget of nine bricks, and more.
fn shells() -> Phantom {
    Phantom::cube(96, &[Shell { radius: 20.0, step: 80.0 }, Shell { radius: 40.0, step: 40.0 }])
}

#[test]
fn a_budget_changes_nothing() {
    let Some(gpu) = gpu_or_skip("a_budget_changes_nothing") else { return };
    let phantom = shells();
    let volume = Arc::new(phantom.texels());
    for camera in [Camera::default(), orthographic(CameraPreset::Top), Camera { zoom: 6.0, ..Camera::default() }] {
        for (leaps, budgets) in [(true, &[24, 9, 4, 1][..]), (false, &[9])] {
            let mut state = phantom.state(camera);
            state.render_settings.leaps = leaps;
            state.render_settings.image_size = [90, 100];
            let (whole, none) = draw_with_budget(&gpu, &volume, &state, None);
            assert!(none.is_none() && lit_share(&whole, [0, 0, 0, 255]) > 0.1);
            for &bricks in budgets {
                let (picture, uploads) = draw_with_budget(&gpu, &volume, &state, Some(bricks * BRICK));
                assert!(picture == whole, "{bricks} bricks, {leaps}: another picture");
                let uploads = uploads.expect("is drawn brick by brick");
                // Where there is room, none is brought twice.
                assert!(uploads > 0, "{bricks} bricks, {leaps}");
            }
        }
    }
}

#[test]
fn what_cannot_be_drawn_is_never_uploaded() {
    let Some(gpu) = gpu_or_skip("what_cannot_be_drawn_is_never_uploaded") else { return };
    // A ball that reaches into one brick of 64.
    let mut phantom = Phantom::cube(128, &[Shell { radius: 9.0, step: 80.0 }]);
    phantom.center = DVec3::splat(16.0);
    let volume = Arc::new(phantom.texels());
    let state = phantom.state(Camera::default());
    let (picture, uploads) = draw_with_budget(&gpu, &volume, &state, Some(20 * BRICK));
    assert_eq!(uploads, Some(1));
    assert_same("one brick", &draw_on_cpu(&volume, &state), &picture);
    let mut empty = state;
    empty.transfer_function.regions.clear();
    assert_eq!(draw_with_budget(&gpu, &volume, &empty, Some(20 * BRICK)).1, Some(0));
}

#[test]
fn a_volume_longer_than_textures_is_drawn() {
    let Some(gpu) = gpu_or_skip("a_volume_longer_than_textures_is_drawn") else { return };
    let limit = gpu.device.limits().max_texture_dimension_3d;
    let long = (limit + 1).max(4096);
    let mut phantom = Phantom::cube(64, &[Shell { radius: 20.0, step: 80.0 }]);
    phantom.geometry.dims[0] = long;
    phantom.center.x = f64::from(long) - 31.0;
    let volume = Arc::new(phantom.texels());
    let mut state = phantom.state(Camera::from_preset(CameraPreset::Front));
    // At the ball, which lies at the far end.
    (state.camera.zoom, state.camera.pan) = (60.0, [0.98, 0.0]);
    let (picture, uploads) = draw_with_budget(&gpu, &volume, &state, None);
    assert!(uploads.is_some(), "one texture has room for {limit} voxels alone");
    let on_cpu = draw_on_cpu(&volume, &state);
    assert!(lit_share(&on_cpu, [0, 0, 0, 255]) > 0.05);
    assert_same("long", &on_cpu, &picture);
}

#[test]
fn rays_that_wait_end_at_what_is_opaque() {
    let Some(gpu) = gpu_or_skip("rays_that_wait_end_at_what_is_opaque") else { return };
    let phantom = shells();
    let volume = Arc::new(phantom.texels());
    let mut state = phantom.state(Camera::default());
    state.scene.bounding_box = true;
    state.scene.isosurfaces = vec!["90,00FF00".parse().expect("an isosurface")];
    let (whole, _) = draw_with_budget(&gpu, &volume, &state, None);
    assert_same("opaque", &draw_on_cpu(&volume, &state), &whole);
    let (bricks, uploads) = draw_with_budget(&gpu, &volume, &state, Some(5 * BRICK));
    assert!(bricks == whole && uploads.is_some_and(|uploads| uploads > 0));
    state.scene = Scene::default();
    assert!(draw_with_budget(&gpu, &volume, &state, None).0 != whole);
}

#[test]
fn slices_are_the_same_however_few_bricks_there_is_room_for() {
    let Some(gpu) = gpu_or_skip("slices_are_the_same_however_few_bricks_there_is_room_for") else { return };
    let phantom = shells();
    let volume = Arc::new(phantom.texels());
    let mut plain = phantom.state(Camera::default());
    plain.render_settings.image_size = [24, 20];
    plain.render_settings.step = 3.0;
    let mut from_within = plain.clone();
    from_within.camera.zoom = 9.0;
    from_within.render_settings.integration = Integration::PostClassified;
    from_within.clipping.planes.push("20,10,0.2".parse().expect("a plane"));
    // Of stacks some lie on either side of the eye.
    let mut between = plain.clone();
    between.render_settings.image_size = [64, 10];
    between.camera = Camera { azimuth: 45.0, elevation: 0.0, zoom: 8.0, field_of_view: 60.0, ..Camera::default() };
    let mut unskipped = plain.clone();
    unskipped.camera.projection = Projection::Orthographic;
    unskipped.render_settings.leaps = false;
    unskipped.render_settings.termination_opacity = 1.0;
    let mut by_value = plain.clone();
    by_value.transfer_function.classification = Classification::Value;
    by_value.transfer_function.curve = "20,0060FF,0;60,00C0FF,0.1;110,FFC080,0.6".parse().expect("a curve");
    let mut shadowed = plain.clone();
    shadowed.render_settings.shading.occlusion = 0.8;
    for (name, mut state, budgets) in [
        ("plain", plain, &[18, 24][..]),
        ("from within", from_within, &[18, 24][..]),
        ("between", between, &[24]),
        ("unskipped", unskipped, &[18, 24][..]),
        ("by value", by_value, &[18, 24][..]),
        ("shadowed", shadowed, &[18, 24][..]),
    ] {
        for technique in [Technique::Slices, Technique::Stacks] {
            state.render_settings.technique = technique;
            let (whole, _) = draw_with_budget(&gpu, &volume, &state, None);
            assert!(lit_share(&whole, [0, 0, 0, 255]) > 0.05, "{name}");
            for &bricks in budgets {
                let (picture, uploads) = draw_with_budget(&gpu, &volume, &state, Some(bricks * BRICK));
                assert!(picture == whole, "{name}, {technique:?}, {bricks} bricks: another picture");
                assert!(uploads.is_some_and(|uploads| uploads > 0), "{name}");
            }
        }
    }
}

#[test]
fn slices_that_need_more_bricks_at_once_say_what_to_do() {
    let Some(gpu) = gpu_or_skip("slices_that_need_more_bricks_at_once_say_what_to_do") else { return };
    let phantom = shells();
    let mut state = phantom.state(Camera::default());
    state.render_settings.technique = Technique::Slices;
    let target = Target::new(&gpu, [32, 32]).expect("a target");
    let mut renderer = Renderer::new(&gpu, &Arc::new(phantom.texels()), Some(BRICK)).expect("has room for a brick");
    let error = renderer.draw(&state, &target).expect_err("is refused").to_string();
    assert!(
        error.contains("there is room for 1 bricks of it, and slices need") && error.contains("with rays"),
        "{error}"
    );
}

#[test]
fn a_lost_device_is_opened_again() {
    let phantom = shells();
    let volume = Arc::new(phantom.texels());
    let mut state = phantom.state(Camera::default());
    state.render_settings.image_size = [64, 64];
    for (budget, technique) in [(None, Technique::Rays), (Some(9 * BRICK), Technique::Rays), (None, Technique::Slices)]
    {
        let Some(gpu) = gpu_or_skip("a_lost_device_is_opened_again") else { return };
        state.render_settings.technique = technique;
        let mut drawing = Drawing::on_gpu(gpu.clone(), &volume, &state, budget).expect("fits");
        let before = drawing.draw(&state.camera).expect("is drawn").picture;
        gpu.device.destroy();
        assert!(drawing.draw(&state.camera).expect("is drawn again").picture == before);
    }
}

#[test]
fn less_than_a_brick_is_refused() {
    let Some(gpu) = gpu_or_skip("less_than_a_brick_is_refused") else { return };
    let volume = Arc::new(shells().texels());
    let error = Renderer::new(&gpu, &volume, Some(BRICK - 1)).err().expect("is refused");
    assert!(matches!(error, Error::VolumeTooLarge { .. }), "{error}");
    assert!(error.to_string().contains("a brick of it takes"), "{error}");
}
