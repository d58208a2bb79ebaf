//! What is cut away is not drawn, and everything else is as it was.

use glam::Vec3;
use voxrole_tests::comparison::{assert_same, difference, draw_on_cpu, draw_on_gpu, gpu_or_skip, lit_share};
use voxrole_viewer::bench::measure;
use voxrole_viewer::reference::RayMarcher;
use voxrole_viewer::reference::shading::Lighting;
use voxrole_viewer::state::{BoundaryEmphasis, Camera, CameraPreset, ClipPlane, EmphasisKind, Technique};
use voxrole_viewer::{Picture, ViewState};

use crate::phantom::{Phantom, orthographic};

const BLACK: [u8; 4] = [0, 0, 0, 255];

fn plane(azimuth: f32, elevation: f32, offset: f32) -> ClipPlane {
    ClipPlane { azimuth, elevation, offset }
}

#[test]
fn half_of_a_ball_is_cut_away_and_the_other_half_stays() {
    let phantom = Phantom::ball();
    let volume = phantom.texels();
    let whole = phantom.state(orthographic(CameraPreset::Front));
    let picture = draw_on_cpu(&volume, &whole);
    let mut by_plane = whole.clone();
    by_plane.clipping.planes = vec![plane(90.0, 0.0, 0.0)];
    let mut by_crop = whole;
    by_crop.clipping.crop = ":31.5,:,:".parse().expect("a crop");
    for state in [&by_plane, &by_crop] {
        let cut = draw_on_cpu(&volume, state);
        let mut lit = 0;
        for (x, y) in (0..128).flat_map(|y| (0..128).map(move |x| (x, y))) {
            if x < 64 {
                assert_eq!(cut.pixel(x, y), picture.pixel(x, y), "{x} {y}");
                lit += u32::from(cut.pixel(x, y) != BLACK);
            } else {
                assert_eq!(cut.pixel(x, y), BLACK, "{x} {y}");
            }
        }
        assert!(lit > 500, "{lit} pixels");
    }
    by_plane.clipping.planes[0].offset = -1.0;
    assert!(draw_on_cpu(&volume, &by_plane).rgba.chunks_exact(4).all(|pixel| pixel == BLACK));
    by_plane.clipping.planes[0].offset = 1.0;
    assert_eq!(draw_on_cpu(&volume, &by_plane), picture);
}

#[test]
fn a_cut_face_is_lit_as_the_plane_it_is() {
    let phantom = Phantom::ball();
    let volume = phantom.texels();
    let mut state = phantom.state(orthographic(CameraPreset::Front));
    state.transfer_function.regions[0].opacity = 1.0;
    state.transfer_function.emphasis =
        BoundaryEmphasis { kind: EmphasisKind::Convex, a: 1.0, d_c: 6.0, n: 100.0 }.into();
    state.clipping.planes = vec![plane(0.0, 0.0, 0.0)];
    let marcher = RayMarcher::new(&volume, &state, [128, 128]).expect("a size");
    let light = marcher.frame().light;
    let color = Vec3::from_array(state.transfer_function.regions[0].color);
    let lit = Lighting::new(Vec3::NEG_Y, light, &state.render_settings.shading).shade(color, Vec3::NEG_Y);
    let expected = (lit * 255.0 + 0.5).to_array().map(|channel| channel as u8);
    for technique in Technique::ALL {
        state.render_settings.technique = technique;
        assert_ring(&draw_on_cpu(&volume, &state), expected);
    }
}

/// Asserts that the ring within four voxels of the ball's surface is of one colour.
fn assert_ring(picture: &Picture, expected: [u8; 3]) {
    // A pixel is 0.86 voxels.
    let mut pixels = 0;
    for (x, y) in (0..128_u32).flat_map(|y| (0..128_u32).map(move |x| (x, y))) {
        let from_middle = [x, y].map(|at| (f64::from(at) - 63.5) * f64::from(63.0_f32.hypot(63.0).hypot(63.0)) / 128.0);
        let radius = from_middle[0].hypot(from_middle[1]);
        if (radius - 20.0).abs() < 4.0 {
            let found = picture.pixel(x, y);
            let off = (0..3).map(|channel| found[channel].abs_diff(expected[channel])).max();
            // The table of integrals leaves a hundredth of the light to the samples behind the face.
            assert!(off <= Some(3), "{x} {y}: {found:?}, expected {expected:?}");
            pixels += 1;
        }
    }
    assert!(pixels > 500, "{pixels} pixels");
}

fn cut_states(phantom: &Phantom) -> Vec<ViewState> {
    let mut states = Vec::new();
    for (crop, planes) in [
        ("20:,:,:40", vec![]),
        (":,:,:", vec![plane(30.0, 20.0, 0.1), plane(-70.0, 50.0, 0.3)]),
        ("5:60,10:,:", vec![plane(30.0, 20.0, -0.2), plane(120.0, -30.0, 0.5), plane(0.0, 90.0, 0.4)]),
    ] {
        for camera in [Camera::default(), orthographic(CameraPreset::Iso), Camera { zoom: 6.0, ..Camera::default() }] {
            let mut state = phantom.state(camera);
            state.clipping.crop = crop.parse().expect("a crop");
            state.clipping.planes = planes.clone();
            states.push(state);
        }
    }
    states
}

#[test]
fn a_box_of_one_voxel_along_an_axis_is_as_thick_as_that() {
    let phantom = Phantom::concentric_shells();
    let volume = phantom.texels();
    let mut state = phantom.state(Camera::default());
    let mut of = |crop: &str| {
        state.clipping.crop = crop.parse().expect("a crop");
        draw_on_cpu(&volume, &state)
    };
    let thin = of("30:30,:,:");
    assert!(lit_share(&thin, [0, 0, 0, 255]) > 0.01);
    assert_eq!(thin.rgba, of("29.5:30.5,:,:").rgba);
}

#[test]
fn leaping_changes_nothing_that_is_cut() {
    let phantom = Phantom::concentric_shells();
    let volume = phantom.texels();
    for mut state in cut_states(&phantom) {
        let leaping = draw_on_cpu(&volume, &state);
        state.render_settings.leaps = false;
        let (_, most) = difference(&leaping, &draw_on_cpu(&volume, &state));
        assert_eq!(most, 0, "{:?}", state.clipping);
    }
}

#[test]
fn gpu_and_cpu_cut_alike() {
    let Some(gpu) = gpu_or_skip("gpu_and_cpu_cut_alike") else { return };
    let phantom = Phantom::concentric_shells();
    let volume = phantom.texels();
    for state in cut_states(&phantom) {
        let name = format!("{} {:?}", state.clipping.crop, state.clipping.planes);
        assert_same(&name, &draw_on_cpu(&volume, &state), &draw_on_gpu(&gpu, &volume, &state));
    }
}

#[test]
fn cut_faces_look_the_same_at_every_step() {
    let phantom = Phantom::concentric_shells();
    let mut state = phantom.state(Camera::default());
    state.render_settings.image_size = [40, 40];
    state.clipping.planes = vec![plane(30.0, 10.0, 0.1)];
    for row in measure(&phantom.texels(), &state).expect("something is visible") {
        // A ray's first slice stands for half a step to one and a half, so that the face is as deep.
        let longest = if row.technique == Technique::Rays { 0.5 } else { 0.25 };
        assert!(row.step > longest || row.largest <= 4, "{row:?}");
    }
}
