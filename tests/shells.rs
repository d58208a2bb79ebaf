//! Two concentric shells with different steps, from the formula to the picture.

use glam::Vec3;
use voxrole_pack::HistogramKind;
use voxrole_preprocess::phantom::{Phantom, PhantomSettings};
use voxrole_preprocess::settings::{Method, Settings};
use voxrole_tests::comparison::{assert_same, draw_on_cpu, draw_on_gpu, gpu_or_skip};
use voxrole_tests::{Prepared, prepared};
use voxrole_viewer::classify::propose_regions;
use voxrole_viewer::reference::RayMarcher;
use voxrole_viewer::state::{BoundaryEmphasis, EmphasisKind, Region, Shape};
use voxrole_viewer::{ViewState, VolumeTexels};

const EDGE: u32 = 64;

struct Shells {
    prepared: Prepared,
    volume: VolumeTexels,
    /// Gradient magnitudes of the outer and the inner boundary.
    gradients: [f32; 2],
    /// Their radii.
    radii: [f32; 2],
}

fn shells() -> Shells {
    let settings = PhantomSettings { dims: [EDGE; 3], ..PhantomSettings::default() };
    let grid = Phantom::Shells.generate(&settings).expect("a phantom");
    let prepared = prepared(&grid, &Settings::new(Method::Fast));
    let volume = VolumeTexels::read(&prepared.reader).expect("reads");
    let scene = Phantom::Shells.scene(&settings).expect("a scene");
    let gradients = [0, 1].map(|shell| scene.boundaries[shell].gradient_magnitude() as f32);
    Shells { prepared, volume, gradients, radii: [26.0, 12.0] }
}

fn state(gradient: [f32; 2], emphasis: BoundaryEmphasis) -> ViewState {
    let mut state = ViewState::default();
    let region = Region {
        shape: Shape::Box,
        value: [-0.5, 1.5],
        gradient,
        color: [1.0, 0.5, 0.2],
        opacity: 1.0,
        softness: 0.0,
        emphasis: None,
    };
    state.transfer_function.regions = vec![region];
    state.transfer_function.emphasis = emphasis.into();
    state.render_settings.image_size = [128, 128];
    state
}

const THIN: BoundaryEmphasis = BoundaryEmphasis { kind: EmphasisKind::Concave, a: 0.8, d_c: 4.0, n: 7.0 };

/// Opacities every tenth of a voxel along rays from the middle outwards, by their distance from it.
fn opacities(shells: &Shells, state: &ViewState) -> Vec<(f32, f32)> {
    let marcher = RayMarcher::new(&shells.volume, state, [8, 8]).expect("a marcher");
    let middle = Vec3::new(31.8, 31.3, 31.6);
    let directions =
        [Vec3::X, Vec3::NEG_Y, Vec3::new(1.0, 1.0, 1.0), Vec3::new(-0.3, 0.5, 0.8), Vec3::new(0.9, -0.2, 0.1)];
    let radii = || (0..290).map(|tenth| tenth as f32 / 10.0);
    directions
        .into_iter()
        .map(Vec3::normalize)
        .flat_map(|direction| radii().map(move |radius| (radius, middle + direction * radius)))
        .map(|(radius, index)| (radius, marcher.opacity_at(index)))
        .collect()
}

#[test]
fn boundaries_peak_and_the_medial_surface_is_empty() {
    let shells = shells();
    let state = state([0.0, 1.0], THIN);
    let found = opacities(&shells, &state);
    for radius in shells.radii {
        let near = |&&(r, _): &&(f32, f32)| (r - radius).abs() < 0.3;
        let peaks: Vec<f32> =
            found.chunks(290).map(|ray| ray.iter().filter(near).map(|s| s.1).fold(0.0, f32::max)).collect();
        assert!(peaks.iter().all(|peak| (0.95 * THIN.a..=1.0001 * THIN.a).contains(peak)), "{radius}: {peaks:?}");
    }
    for (radius, opacity) in found {
        let distance = shells.radii.map(|shell| (radius - shell).abs()).into_iter().fold(f32::INFINITY, f32::min);
        if distance > THIN.d_c + 0.1 {
            assert!(opacity == 0.0, "{opacity} at radius {radius}");
        }
    }
}

#[test]
fn with_long_reach_the_medial_surface_is_the_minimum() {
    let shells = shells();
    let linear = BoundaryEmphasis { kind: EmphasisKind::Linear, a: 1.0, d_c: 15.0, n: 1.0 };
    // Where +m meets −m an interpolated signed distance would pass through 0 and draw a sheet of opacity 1.
    for (radius, opacity) in opacities(&shells, &state([0.0, 1.0], linear)) {
        if (18.0..20.0).contains(&radius) {
            assert!((0.5..0.65).contains(&opacity), "{opacity} at radius {radius}");
        }
    }
}

#[test]
fn a_region_between_the_two_gradients_lights_nothing() {
    let shells = shells();
    let [outer, inner] = shells.gradients;
    let between = [outer + 0.3 * (inner - outer), inner - 0.3 * (inner - outer)];
    let convex = BoundaryEmphasis { kind: EmphasisKind::Convex, a: 1.0, d_c: 15.0, n: 3.0 };
    let state = state(between, convex);
    let marcher = RayMarcher::new(&shells.volume, &state, [128, 128]).expect("a marcher");
    let picture = marcher.draw();
    assert!(picture.rgba.chunks_exact(4).all(|pixel| pixel == &picture.rgba[..4]), "something is lit");
    assert!(opacities(&shells, &state).iter().all(|&(_, opacity)| opacity == 0.0));
}

#[test]
fn the_proposed_regions_are_the_two_boundaries() {
    let shells = shells();
    let histogram = shells.prepared.reader.read_histogram(HistogramKind::HitValueHitGradient).expect("reads");
    let regions = propose_regions(&histogram, 1.0);
    let holds =
        |gradient: f32| regions.iter().any(|region| region.gradient[0] < gradient && gradient < region.gradient[1]);
    // Central differences flatten gradients by 7 % at this blur.
    assert!(regions.len() == 2 && shells.gradients.iter().all(|gradient| holds(gradient * 0.93)), "{regions:?}");
}

#[test]
fn cpu_and_gpu_draw_the_same() {
    let Some(gpu) = gpu_or_skip("cpu_and_gpu_draw_the_same") else { return };
    let shells = shells();
    let mut state = state([0.0, 1.0], THIN);
    state.transfer_function.regions[0].opacity = 0.4;
    assert_same("shells", &draw_on_gpu(&gpu, &shells.volume, &state), &draw_on_cpu(&shells.volume, &state));
}
