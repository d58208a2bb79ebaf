//! Real volumes, from the file to the picture.

use voxrole_pack::{HistogramKind, Reader};
use voxrole_preprocess::io::{ReadOptions, read_volume};
use voxrole_preprocess::settings::{Method, Settings};
use voxrole_tests::comparison::{assert_same, draw_on_cpu, draw_on_gpu, gpu_or_skip, lit_share};
use voxrole_tests::{prepared, real_data};
use voxrole_viewer::classify::propose_regions;
use voxrole_viewer::{ViewState, VolumeTexels};

fn first_picture(reader: &Reader) -> ViewState {
    let mut state = ViewState::default();
    let histogram = reader.read_histogram(HistogramKind::HitValueHitGradient).expect("reads");
    state.transfer_function.regions = propose_regions(&histogram, reader.header().geometry.smallest_spacing());
    state.render_settings.image_size = [192, 192];
    state.render_settings.step = 0.5;
    state
}

#[test]
fn engine_on_cpu_and_gpu() {
    let Some(folder) = real_data("engine_on_cpu_and_gpu") else { return };
    let grid = read_volume(&folder.join("engine/engine.mhd"), &ReadOptions::default()).expect("reads");
    let prepared = prepared(&grid, &Settings::new(Method::Fast));
    prepared.reader.verify().expect("is sound");
    let volume = VolumeTexels::read(&prepared.reader).expect("reads");
    let state = first_picture(&prepared.reader);
    assert!(!state.transfer_function.regions.is_empty());
    let on_cpu = draw_on_cpu(&volume, &state);
    let lit = lit_share(&on_cpu, [0, 0, 0, 255]);
    assert!((0.1..0.7).contains(&lit), "{lit} of the picture is lit");
    let Some(gpu) = gpu_or_skip("engine_on_cpu_and_gpu") else { return };
    assert_same("engine", &draw_on_gpu(&gpu, &volume, &state), &on_cpu);
}
