//! Regions that are painted.

use voxrole_tests::comparison::{assert_same, difference, draw_on_cpu, draw_on_gpu, gpu_or_skip};
use voxrole_viewer::ViewState;
use voxrole_viewer::state::{Camera, PaintedMap, Region, Shape};

use crate::phantom::{Phantom, SHELLS};

/// A painted region over all that the phantom has, with a stroke at this shell's gradient magnitude.
fn painted(phantom: &Phantom, gradient: f64) -> ViewState {
    let high = 1.5 * SHELLS[0].gradient() as f32;
    let level = gradient as f32 / high;
    let mut map = PaintedMap::blank();
    map.stroke([0.0, level], [1.0, level], [0.1, 0.15], false);
    let [low, most] = phantom.value_range().map(|value| value as f32);
    let mut state = phantom.state(Camera::default());
    state.transfer_function.regions = vec![Region {
        shape: Shape::Painted(map),
        value: [low, most],
        gradient: [0.0, high],
        softness: 0.0,
        ..state.transfer_function.regions[0].clone()
    }];
    state
}

#[test]
fn a_stroke_over_a_shell_draws_it_as_a_box_around_it_does() {
    let phantom = Phantom::concentric_shells();
    let volume = phantom.texels();
    for (index, shell) in SHELLS.iter().enumerate() {
        let state = painted(&phantom, shell.gradient());
        let picture = draw_on_cpu(&volume, &state);
        let mut boxed = phantom.state(Camera::default());
        let region = boxed.transfer_function.regions.swap_remove(index);
        let Region { color, opacity, .. } = state.transfer_function.regions[0];
        boxed.transfer_function.regions = vec![Region { color, opacity, ..region }];
        assert_same("painted", &picture, &draw_on_cpu(&volume, &boxed));
    }
}

#[test]
fn gpu_and_cpu_paint_alike() {
    let Some(gpu) = gpu_or_skip("gpu_and_cpu_paint_alike") else { return };
    let phantom = Phantom::concentric_shells();
    let volume = phantom.texels();
    let [inner, outer] = SHELLS.map(|shell| painted(&phantom, shell.gradient()));
    let [of_inner, of_outer] = [&inner, &outer].map(|state| draw_on_cpu(&volume, state));
    assert!(difference(&of_inner, &of_outer).0 > 10.0, "what is painted decides");
    assert_same("inner", &of_inner, &draw_on_gpu(&gpu, &volume, &inner));
    // Between none and all of the weight, so that the map's soft edge counts.
    let soft = painted(&phantom, SHELLS[0].gradient() + 0.11 * 1.5 * SHELLS[0].gradient());
    let picture = draw_on_cpu(&volume, &soft);
    let off = difference(&picture, &of_inner).0;
    assert!(off > 2.0, "{off}");
    assert_same("soft", &picture, &draw_on_gpu(&gpu, &volume, &soft));
}
