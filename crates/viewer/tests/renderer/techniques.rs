//! Rays, slices and stacks come to the same picture, on the CPU and the GPU.

use glam::DVec3;
use voxrole_pack::GridGeometry;
use voxrole_preprocess::phantom::{Phantom as Volume, PhantomSettings};
use voxrole_preprocess::settings::{Method, Settings};
use voxrole_tests::comparison::{assert_same, difference, draw_on_cpu, draw_on_gpu, gpu_or_skip, lit_share};
use voxrole_tests::prepared;
use voxrole_viewer::bench::rms;
use voxrole_viewer::reference::RayMarcher;
use voxrole_viewer::state::{Camera, CameraPreset, ClipPlane, Integration, Technique};
use voxrole_viewer::{Gpu, ViewState, VolumeTexels};

use crate::phantom::{Phantom, SHELLS, orthographic, region_at};

/// Largest root-mean-square difference of light and opacity between techniques at a step of a quarter, in 1/255: of rays
/// that meet a corner of the volume and no slice.
const MOST_RMS: f64 = 0.05;
/// Largest difference of any channel of any pixel, in 1/255.
const MOST: u8 = 3;

/// A volume of boundaries, prepared, all of them drawn.
fn read(phantom: Volume) -> (VolumeTexels, ViewState) {
    let settings = PhantomSettings { dims: [48; 3], ..PhantomSettings::default() };
    let grid = phantom.generate(&settings).expect("a phantom");
    let volume = VolumeTexels::read(&prepared(&grid, &Settings::new(Method::Fast)).reader).expect("reads");
    let mut state = ViewState::default();
    state.transfer_function.regions = vec![region_at(0.5, 0.6, [1.0, 0.6, 0.1])];
    state.transfer_function.regions[0].gradient = [0.05, 1.0];
    state.render_settings.image_size = [128, 128];
    (volume, state)
}

/// Phantoms with a state each.
fn scenes() -> Vec<(&'static str, VolumeTexels, ViewState)> {
    let [ball, shells] = [Phantom::ball(), Phantom::concentric_shells()];
    let [(slabs, of_slabs), (junction, of_junction)] = [Volume::Slabs, Volume::Junction].map(read);
    vec![
        ("ball", ball.texels(), ball.state(Camera::default())),
        ("shells", shells.texels(), shells.state(Camera::default())),
        ("slabs", slabs, of_slabs),
        // Three materials meet: sheets where their boundaries are equally near would show.
        ("junction", junction, of_junction),
    ]
}

#[test]
fn all_techniques_come_to_the_same_picture() {
    for (name, volume, mut state) in scenes() {
        for camera in
            [Camera::default(), orthographic(CameraPreset::Iso), Camera { azimuth: 70.0, ..Camera::default() }]
        {
            state.camera = camera;
            state.render_settings.step = 0.25;
            let lights = Technique::ALL.map(|technique| {
                state.render_settings.technique = technique;
                RayMarcher::new(&volume, &state, state.render_settings.image_size).expect("a size").light()
            });
            assert!(
                lights.iter().all(|(_, counts)| counts.taken > 0 && counts.taken < counts.all),
                "samples are counted"
            );
            for (technique, (light, _)) in Technique::ALL.into_iter().zip(&lights).skip(1) {
                let background = Some(glam::Vec3::ZERO);
                let (_, most) = difference(&light.picture(background), &lights[0].0.picture(background));
                let rms = rms(light, &lights[0].0);
                println!("{name} {technique:?} {camera}: rms {rms:.3}/255, largest {most}/255");
                assert!(rms <= MOST_RMS && most <= MOST, "{name} {technique:?}: {rms} {most}");
            }
        }
    }
}

fn compare(gpu: &Gpu, name: &str, volume: &VolumeTexels, state: &ViewState) {
    for technique in [Technique::Slices, Technique::Stacks] {
        let mut state = state.clone();
        state.render_settings.technique = technique;
        let on_cpu = draw_on_cpu(volume, &state);
        let lit = lit_share(&on_cpu, [0, 0, 0, 255]);
        assert!(lit > 0.05, "{name} {technique:?}: {lit} of the picture is lit");
        assert_same(&format!("{name} {technique:?}"), &on_cpu, &draw_on_gpu(gpu, volume, &state));
    }
}

#[test]
fn gpu_and_cpu_draw_the_same_slices() {
    let Some(gpu) = gpu_or_skip("gpu_and_cpu_draw_the_same_slices") else { return };
    for (name, volume, mut state) in scenes() {
        compare(&gpu, name, &volume, &state);
        state.camera = orthographic(CameraPreset::Iso);
        state.render_settings.integration = Integration::PostClassified;
        compare(&gpu, name, &volume, &state);
        state.render_settings.integration = Integration::Preintegrated;
        // Long steps, seen along an axis, and leaping over nothing.
        state.camera = orthographic(CameraPreset::Right);
        (state.render_settings.step, state.render_settings.leaps) = (3.0, false);
        compare(&gpu, name, &volume, &state);
    }
}

#[test]
fn gpu_and_cpu_draw_the_same_slices_of_turned_uneven_and_flat_grids() {
    let Some(gpu) = gpu_or_skip("gpu_and_cpu_draw_the_same_slices_of_turned_uneven_and_flat_grids") else { return };
    let mut uneven = Phantom::concentric_shells();
    uneven.geometry = GridGeometry {
        direction: [[0.6, 0.8, 0.0], [0.8, -0.6, 0.0], [0.0, 0.0, 1.0]],
        ..GridGeometry::axis_aligned([60, 40, 30], [1.0, 1.5, 2.0])
    };
    uneven.center = DVec3::new(30.0, 30.0, 29.0);
    let volume = uneven.texels();
    for camera in
        [Camera { roll: 20.0, zoom: 1.5, pan: [0.2, -0.1], ..Camera::default() }, orthographic(CameraPreset::Top)]
    {
        let mut state = uneven.state(camera);
        state.render_settings.image_size = [100, 70];
        compare(&gpu, "uneven", &volume, &state);
    }
    let mut flat = Phantom::cube(64, &SHELLS);
    flat.geometry.dims = [64, 64, 1];
    flat.center.z = 0.0;
    for camera in [Camera::from_preset(CameraPreset::Top), orthographic(CameraPreset::Bottom)] {
        compare(&gpu, "flat", &flat.texels(), &flat.state(camera));
    }
}

#[test]
fn gpu_and_cpu_draw_the_same_slices_of_what_is_cut_and_from_within() {
    let Some(gpu) = gpu_or_skip("gpu_and_cpu_draw_the_same_slices_of_what_is_cut_and_from_within") else { return };
    let phantom = Phantom::concentric_shells();
    let volume = phantom.texels();
    let plane = |azimuth, elevation, offset| ClipPlane { azimuth, elevation, offset };
    for (crop, planes) in [
        ("20:,:,:40", vec![]),
        (":,:,:", vec![plane(30.0, 20.0, 0.1), plane(-70.0, 50.0, 0.3)]),
        ("5:60,10:,:", vec![plane(30.0, 20.0, -0.2), plane(120.0, -30.0, 0.5), plane(0.0, 90.0, 0.4)]),
    ] {
        let wide = Camera { zoom: 3.0, field_of_view: 100.0, ..Camera::default() };
        for camera in
            [Camera::default(), orthographic(CameraPreset::Iso), Camera { zoom: 8.0, ..Camera::default() }, wide]
        {
            let mut state = phantom.state(camera);
            state.clipping.crop = crop.parse().expect("a crop");
            state.clipping.planes = planes.clone();
            compare(&gpu, &format!("{crop} {camera}"), &volume, &state);
        }
    }
}

#[test]
fn gpu_and_cpu_draw_the_same_with_more_slices_than_fit_at_once_and_with_none() {
    let Some(gpu) = gpu_or_skip("gpu_and_cpu_draw_the_same_with_more_slices_than_fit_at_once_and_with_none") else {
        return;
    };
    let mut long = Phantom::cube(16, &SHELLS);
    long.geometry.dims[2] = 400;
    long.center.z = 60.0;
    let volume = long.texels();
    let mut state = long.state(Camera { zoom: 8.0, ..orthographic(CameraPreset::Bottom) });
    state.render_settings.image_size = [32, 32];
    state.render_settings.step = 1.0 / 64.0;
    compare(&gpu, "long", &volume, &state);
    state.clipping.planes = vec!["0,90,-1".parse().expect("a plane")];
    for technique in Technique::ALL {
        state.render_settings.technique = technique;
        assert_eq!(lit_share(&draw_on_gpu(&gpu, &volume, &state), [0, 0, 0, 255]), 0.0, "{technique:?}");
    }
}

#[test]
fn rows_drawn_in_parts_are_those_of_the_whole() {
    let Some(gpu) = gpu_or_skip("rows_drawn_in_parts_are_those_of_the_whole") else { return };
    let phantom = Phantom::ball();
    let volume = std::sync::Arc::new(phantom.texels());
    let target = voxrole_viewer::Target::new(&gpu, [128, 128]).expect("a target");
    let mut renderer = voxrole_viewer::Renderer::new(&gpu, &volume, None).expect("a renderer");
    for technique in Technique::ALL {
        let mut state = phantom.state(Camera::default());
        state.render_settings.technique = technique;
        // Another picture first: rows that are not drawn stay.
        renderer.draw(&phantom.state(Camera::from_preset(CameraPreset::Top)), &target).expect("is drawn");
        for rows in [0..50, 50..51, 51..128] {
            renderer.draw_rows(&state, &target, rows).expect("is drawn");
        }
        assert!(target.read_back(&gpu).expect("a picture") == draw_on_gpu(&gpu, &volume, &state), "{technique:?}");
    }
}

#[test]
fn a_marcher_that_looks_from_elsewhere_leaps_over_nothing_that_shows() {
    let phantom = Phantom::concentric_shells();
    let volume = phantom.texels();
    for technique in Technique::ALL {
        let mut state = phantom.state(Camera::default());
        (state.render_settings.technique, state.render_settings.step) = (technique, 2.0);
        let mut marcher = RayMarcher::new(&volume, &state, [64, 64]).expect("a size");
        // Wide angles make longer ways between slices.
        state.camera = Camera { field_of_view: 110.0, zoom: 2.0, azimuth: -50.0, ..Camera::default() };
        marcher.look_from(&state.camera);
        state.render_settings.leaps = false;
        let plodding = RayMarcher::new(&volume, &state, [64, 64]).expect("a size").draw();
        assert!(marcher.draw() == plodding, "{technique:?}");
    }
}

/// An adapter, opened as one that cannot blend numbers of single precision.
fn without_single_precision() -> Gpu {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
    let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    let adapter = adapters.first().expect("one was opened before");
    let required_features = wgpu::Features::empty();
    let descriptor = wgpu::DeviceDescriptor { required_features, ..Gpu::device_descriptor(adapter) };
    let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).expect("a device");
    Gpu::from_parts(adapter, device, queue)
}

#[test]
fn devices_that_blend_in_half_precision_draw_slices_too() {
    if gpu_or_skip("devices_that_blend_in_half_precision_draw_slices_too").is_none() {
        return;
    }
    let gpu = without_single_precision();
    let phantom = Phantom::concentric_shells();
    let volume = phantom.texels();
    let mut state = phantom.state(Camera::default());
    // What many faint slices add is less than the last place of a half.
    for (emphasis, limit) in [("concave,1,3,3", 4), ("linear,0.1,15", 12)] {
        state.transfer_function.emphasis = emphasis.parse().expect("an emphasis");
        for technique in [Technique::Slices, Technique::Stacks] {
            state.render_settings.technique = technique;
            let (rmse, most) = difference(&draw_on_cpu(&volume, &state), &draw_on_gpu(&gpu, &volume, &state));
            println!("{emphasis} {technique:?}: rmse {rmse:.3}/255, largest {most}/255");
            assert!(most <= limit, "{emphasis} {technique:?}: {rmse} {most}");
        }
    }
}
