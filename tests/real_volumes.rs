//! Real volumes, from the file to the picture.

use voxrole_pack::{HistogramKind, Reader};
use voxrole_preprocess::io::read_volume;
use voxrole_preprocess::settings::{Method, Settings};
use voxrole_tests::{assert_same, draw_on_gpu, prepared, real_data};
use voxrole_viewer::classify::propose_regions;
use voxrole_viewer::reference::RayMarcher;
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
    let grid = read_volume(&folder.join("engine/engine.mhd"), None).expect("reads");
    let prepared = prepared(&grid, &Settings::new(Method::Fast));
    prepared.reader.verify().expect("is sound");
    let volume = VolumeTexels::read(&prepared.reader).expect("reads");
    let state = first_picture(&prepared.reader);
    assert!(!state.transfer_function.regions.is_empty());
    let cpu = RayMarcher::new(&volume, &state, state.render_settings.image_size).expect("a marcher").draw();
    let lit = cpu.rgba.chunks_exact(4).filter(|pixel| pixel[..3] != cpu.rgba[..3]).count();
    assert!((0.1..0.7).contains(&(lit as f64 / (192.0 * 192.0))), "{lit} pixels are lit");
    let Some(gpu) = draw_on_gpu("engine_on_cpu_and_gpu", &volume, &state) else { return };
    assert_same("engine", &gpu, &cpu);
}
