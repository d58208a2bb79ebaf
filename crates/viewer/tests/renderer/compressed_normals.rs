//! Volumes whose normals are compressed on the device.

use std::sync::Arc;

use voxrole_tests::comparison::{difference, draw_on_cpu, gpu_or_skip};
use voxrole_viewer::render::{DeviceMemory, Normals};
use voxrole_viewer::state::{Camera, Classification};
use voxrole_viewer::{Error, Gpu, Renderer, Target, VolumeTexels};
use wgpu::{Backends, DeviceDescriptor, Features, Instance, InstanceDescriptor};

use crate::phantom::Phantom;

const COMPRESSED: DeviceMemory = DeviceMemory { most: None, normals: Normals::Compressed };

/// A device that can hold compressed normals; `None`, and a word, where there is none.
fn compressing_gpu_or_skip(test: &str) -> Option<Gpu> {
    let gpu = gpu_or_skip(test)?;
    if !gpu.has_compressed_volumes() {
        eprintln!("skipped {test}: {} has no compressed 3D textures", gpu.name);
        return None;
    }
    Some(gpu)
}

#[test]
fn pictures_differ_by_little_and_memory_by_an_eighth() {
    let Some(gpu) = compressing_gpu_or_skip("pictures_differ_by_little_and_memory_by_an_eighth") else { return };
    for (name, phantom) in [("ball", Phantom::ball()), ("shells", Phantom::concentric_shells())] {
        let volume = Arc::new(phantom.texels());
        let mut state = phantom.state(Camera::default());
        state.render_settings.image_size = [96, 96];
        let mut exact = Renderer::new(&gpu, &volume, None).expect("a renderer");
        let mut renderer = Renderer::new(&gpu, &volume, COMPRESSED).expect("a renderer");
        let [whole, part] = [&exact, &renderer].map(Renderer::volume_bytes);
        assert!((0.87..0.89).contains(&(part as f64 / whole as f64)), "{name}: {part} of {whole} bytes");
        let target = Target::new(&gpu, [96, 96]).expect("a target");
        renderer.draw(&state, &target).expect("is drawn");
        let compressed = target.read_back(&gpu).expect("a picture");
        let (rmse, most) = difference(&draw_on_cpu(&volume, &state), &compressed);
        println!("{name}: {rmse:.3} rms, {most} at most");
        assert!(rmse > 0.0 && rmse < 0.5 && most < 8, "{name}: {rmse} rms, {most} at most");

        // Opacity by value alone: normals give light and nothing else.
        state.transfer_function.classification = Classification::Value;
        state.transfer_function.curve = "0,FFFFFF,0;1000,FFFFFF,0.5".parse().expect("a curve");
        let [of_exact, of_compressed] = [&mut exact, &mut renderer].map(|renderer| {
            renderer.draw(&state, &target).expect("is drawn");
            target.read_back(&gpu).expect("a picture")
        });
        let (rmse, most) = difference(&of_exact, &of_compressed);
        println!("{name} by value: {rmse:.3} rms, {most} at most");
        assert!(rmse < 0.5 && most < 8, "{name} by value: {rmse} rms, {most} at most");
    }
}

#[test]
fn flat_volumes_and_odd_sizes_have_whole_blocks() {
    let Some(gpu) = compressing_gpu_or_skip("flat_volumes_and_odd_sizes_have_whole_blocks") else { return };
    let phantom = Phantom::ball();
    for dims in [[1, 1, 1], [5, 2, 3], [9, 1, 2]] {
        let mut volume = phantom.texels();
        volume.description.dims = dims;
        volume.texels.truncate(dims.iter().product::<u32>() as usize);
        let mut renderer = Renderer::new(&gpu, &Arc::new(volume), COMPRESSED).expect("a renderer");
        let target = Target::new(&gpu, [8, 8]).expect("a target");
        renderer.draw(&phantom.state(Camera::default()), &target).expect("is drawn");
        target.read_back(&gpu).expect("a picture");
    }
}

fn refusal(gpu: &Gpu, volume: &Arc<VolumeTexels>, memory: DeviceMemory) -> String {
    match Renderer::new(gpu, volume, memory) {
        Err(error @ Error::Normals { .. }) => error.to_string(),
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("is not refused"),
    }
}

#[test]
fn bricks_with_compressed_normals_are_refused() {
    let Some(gpu) = compressing_gpu_or_skip("bricks_with_compressed_normals_are_refused") else { return };
    let volume = Arc::new(Phantom::ball().texels());
    let message = refusal(&gpu, &volume, DeviceMemory { most: Some(300_000), ..COMPRESSED });
    assert!(message.contains("--gpu-memory") && message.contains("leave `--normals` out"), "{message}");
}

#[test]
fn a_device_without_compressed_textures_is_refused() {
    if gpu_or_skip("a_device_without_compressed_textures_is_refused").is_none() {
        return;
    }
    let instance = Instance::new(InstanceDescriptor::new_without_display_handle_from_env());
    let adapters = pollster::block_on(instance.enumerate_adapters(Backends::all()));
    let adapter = adapters.first().expect("there is one");
    let descriptor = DeviceDescriptor { required_features: Features::empty(), ..Gpu::device_descriptor(adapter) };
    let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).expect("a device");
    let gpu = Gpu::from_parts(adapter, device, queue);
    let message = refusal(&gpu, &Arc::new(Phantom::ball().texels()), COMPRESSED);
    assert!(message.contains(&gpu.name) && message.contains("BC5"), "{message}");
}
