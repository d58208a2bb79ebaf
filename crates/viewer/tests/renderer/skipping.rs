//! Skipping changes no picture, and saves most of the samples.

use glam::DVec3;
use voxrole_pack::GridGeometry;
use voxrole_tests::comparison::{difference, draw_on_gpu, gpu_or_skip};
use voxrole_viewer::ViewState;
use voxrole_viewer::reference::RayMarcher;
use voxrole_viewer::state::{BoundaryEmphasis, Camera, CameraPreset, EmphasisKind, Technique};

use crate::phantom::{Phantom, orthographic};

const THIN: BoundaryEmphasis = BoundaryEmphasis { kind: EmphasisKind::Concave, a: 1.0, d_c: 1.5, n: 7.0 };

/// Phantoms and views whose rays run along faces of macrocells, slanting, from within and past the grid's end.
fn scenes() -> Vec<(Phantom, ViewState)> {
    let mut uneven = Phantom::concentric_shells();
    uneven.geometry = GridGeometry::axis_aligned([61, 38, 27], [1.0, 1.5, 2.0]);
    uneven.center = DVec3::new(30.0, 28.0, 26.0);
    let mut flat = Phantom::concentric_shells();
    flat.geometry.dims = [64, 64, 1];
    flat.center.z = 0.0;
    let cameras = [
        Camera::default(),
        Camera::from_preset(CameraPreset::Top),
        orthographic(CameraPreset::Front),
        Camera { zoom: 6.0, pan: [0.3, -0.2], roll: 30.0, ..Camera::default() },
    ];
    let mut scenes = Vec::new();
    for phantom in [Phantom::ball(), Phantom::concentric_shells(), uneven, flat] {
        for (camera, emphasis) in cameras.into_iter().zip([THIN, BoundaryEmphasis::default(), THIN, THIN]) {
            let mut state = phantom.state(camera);
            state.transfer_function.emphasis = emphasis.into();
            state.render_settings.jitter = camera.zoom > 1.0;
            // Not all of the value's range, so that values count, too.
            state.transfer_function.regions[0].value[0] += 1.0;
            scenes.push((phantom.clone(), state));
        }
    }
    scenes
}

fn scenes_of_techniques() -> impl Iterator<Item = (Phantom, ViewState, Technique)> {
    let all = |(phantom, state): (Phantom, ViewState)| {
        Technique::ALL.map(|technique| (phantom.clone(), state.clone(), technique))
    };
    scenes().into_iter().flat_map(all)
}

#[test]
fn leaping_changes_no_pixel() {
    let mut saved = 0;
    for (phantom, mut state, technique) in scenes_of_techniques() {
        let volume = phantom.texels();
        state.render_settings.technique = technique;
        let mut draw = |leaps| {
            state.render_settings.leaps = leaps;
            RayMarcher::new(&volume, &state, [80, 60]).expect("a size").draw_and_count()
        };
        let ((leaping, few), (plodding, many)) = (draw(true), draw(false));
        assert_eq!(leaping, plodding, "{:?}", state.camera);
        assert!(few.taken <= many.taken && few.all == many.all, "{few:?} {many:?}");
        saved += u32::from(few.taken < many.taken);
    }
    // The flat phantom cannot be seen from its front.
    assert_eq!(saved, 45);
}

#[test]
fn leaping_changes_no_pixel_on_the_gpu() {
    let Some(gpu) = gpu_or_skip("leaping_changes_no_pixel_on_the_gpu") else { return };
    for (phantom, mut state, technique) in scenes_of_techniques() {
        let volume = phantom.texels();
        state.render_settings.technique = technique;
        state.render_settings.image_size = [80, 60];
        let mut draw = |leaps| {
            state.render_settings.leaps = leaps;
            draw_on_gpu(&gpu, &volume, &state)
        };
        assert_eq!(draw(true), draw(false), "{:?}", state.camera);
    }
}

#[test]
fn leaping_and_ending_early_save_most_samples() {
    let phantom = Phantom::concentric_shells();
    let volume = phantom.texels();
    let mut state = phantom.state(Camera::default());
    state.transfer_function.emphasis = THIN.into();
    state.transfer_function.regions.iter_mut().for_each(|region| region.opacity = 1.0);
    let (picture, counts) = RayMarcher::new(&volume, &state, [128, 128]).expect("a size").draw_and_count();
    state.render_settings.leaps = false;
    state.render_settings.termination_opacity = 1.0;
    let (full, every) = RayMarcher::new(&volume, &state, [128, 128]).expect("a size").draw_and_count();
    assert_eq!((every.taken, counts.all), (every.all, every.all));
    let (_, most) = difference(&picture, &full);
    assert!(most <= 1, "{most}/255");
    // Of larger volumes more: boundaries are as thin there, and farther apart.
    assert!(counts.saved() >= 0.5, "{counts:?}");
}
