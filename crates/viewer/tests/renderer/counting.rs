//! Samples that the GPU takes, counted.

use std::sync::Arc;

use voxrole_tests::comparison::{draw_on_gpu, gpu_or_skip};
use voxrole_viewer::reference::{RayMarcher, SampleCounts};
use voxrole_viewer::scene::Surfaces;
use voxrole_viewer::state::{Camera, Integration, Technique};
use voxrole_viewer::{Renderer, Target};

use crate::phantom::Phantom;

/// Rays on which a place is rounded to the other side of a plane, or an opacity to the other side of where rays end, count one
/// more or less, or a few.
const SHARE: f64 = 1e-4;

fn is_close(found: u64, expected: u64) -> bool {
    found.abs_diff(expected) as f64 <= SHARE * expected as f64
}

#[test]
fn the_gpu_takes_the_cpu_s_samples_or_more() {
    let Some(gpu) = gpu_or_skip("the_gpu_takes_the_cpu_s_samples_or_more") else { return };
    let phantom = Phantom::concentric_shells();
    let volume = Arc::new(phantom.texels());
    let mut state = phantom.state(Camera::default());
    state.render_settings.image_size = [96, 80];
    // Else some of the CPU's samples may lie behind where their ray ends.
    state.render_settings.termination_opacity = 1.0;
    let target = Target::new(&gpu, [96, 80]).expect("a target");
    let mut renderer = Renderer::new(&gpu, &volume, None).expect("a renderer");
    renderer.draw(&state, &target).expect("is drawn");
    assert_eq!(renderer.samples().expect("is asked"), None);
    renderer.count_samples().expect("is prepared");
    for integration in [Integration::Preintegrated, Integration::PostClassified] {
        for leaps in [true, false] {
            state.render_settings.integration = integration;
            state.render_settings.leaps = leaps;
            // In two parts, as files are drawn.
            renderer.draw_rows(&state, &target, 0..33).expect("is drawn");
            renderer.draw_rows(&state, &target, 33..80).expect("is drawn");
            let found = renderer.samples().expect("is asked").expect("are counted");
            let marcher = RayMarcher::new(&volume, &state, [96, 80]).expect("is made ready");
            let (_, expected) = marcher.draw_and_count();
            let SampleCounts { taken, all } = found;
            println!("{integration:?}, leaps {leaps}: {found:?}, on the CPU {expected:?}");
            // Where rays leap, the CPU leaves out single cells too.
            let as_expected = if leaps { taken > expected.taken } else { is_close(taken, expected.taken) };
            assert!(as_expected && is_close(all, expected.all), "{found:?} is not {expected:?}");
            assert!(!leaps || 10 * taken < 9 * all, "{found:?}");
            // Counting changes no picture.
            assert!(target.read_back(&gpu).expect("a picture") == draw_on_gpu(&gpu, &volume, &state));
        }
    }
    // Steps that something opaque cuts short are counted as they are taken.
    state.scene.isosurfaces = vec!["70,FFC080".parse().expect("an isosurface")];
    let surfaces = Arc::new(Surfaces::of(&state, &volume).expect("a scene"));
    renderer.prepare_scene(&state.scene, &surfaces, [96, 80]).expect("fits");
    renderer.draw(&state, &target).expect("is drawn");
    let found = renderer.samples().expect("is asked").expect("are counted");
    let (_, expected) = RayMarcher::new(&volume, &state, [96, 80]).expect("is made ready").draw_and_count();
    assert!(
        is_close(found.taken, expected.taken) && is_close(found.all, expected.all),
        "{found:?} is not {expected:?}"
    );
    assert!(expected.taken <= expected.all && found.taken <= found.all, "{found:?} {expected:?}");
    state.render_settings.technique = Technique::Slices;
    renderer.draw(&state, &target).expect("is drawn");
    assert_eq!(renderer.samples().expect("is asked"), None);
}
