//! Drawing the same state on the CPU and the GPU, and how far two pictures are apart: all thresholds of image tests.

use std::sync::Arc;

use voxrole_viewer::reference::RayMarcher;
use voxrole_viewer::scene::Surfaces;
use voxrole_viewer::{Error, Gpu, Picture, Renderer, Target, ViewState, VolumeTexels};

/// Largest root-mean-square difference of a channel between two pictures of the same state, in 1/255.
pub const MOST_RMSE: f64 = 1.0;
/// Largest difference of a channel of any pixel between two pictures of the same state, in 1/255.
pub const MOST_DIFFERENCE: u8 = 8;
/// As [`MOST_RMSE`], between sampling steps of a quarter and of half a voxel.
pub const MOST_STEP_RMSE: f64 = 2.0;
/// As [`MOST_RMSE`], between a boundary and its mirror image in value, whose normals are rounded differently.
pub const MOST_MIRRORED_RMSE: f64 = 1.0;

/// A GPU, or `None` with a message where there is none.
///
/// # Panics
/// When there is none and `VOXROLE_REQUIRE_GPU=1`, or it cannot be opened for another reason.
#[must_use]
pub fn gpu_or_skip(test: &str) -> Option<Gpu> {
    match Gpu::new() {
        Ok(gpu) => {
            println!("{test}: on {}", gpu.name);
            Some(gpu)
        }
        Err(error @ Error::NoAdapter(_)) => {
            let required = std::env::var_os("VOXROLE_REQUIRE_GPU").is_some_and(|value| value == "1");
            assert!(!required, "VOXROLE_REQUIRE_GPU=1, but {error}");
            println!("{test}: SKIPPED, because {error}");
            None
        }
        Err(error) => panic!("{test}: {error}"),
    }
}

/// Draws on the CPU, at the state's picture size.
///
/// # Panics
/// When that size cannot be drawn.
#[must_use]
pub fn draw_on_cpu(volume: &VolumeTexels, state: &ViewState) -> Picture {
    RayMarcher::new(volume, state, state.render_settings.image_size).expect("a size").draw()
}

/// Draws on the GPU, at the state's picture size.
///
/// # Panics
/// When that fails.
#[must_use]
pub fn draw_on_gpu(gpu: &Gpu, volume: &VolumeTexels, state: &ViewState) -> Picture {
    draw_with_budget(gpu, &Arc::new(volume.clone()), state, None).0
}

/// Draws on the GPU, of whose memory the volume takes `budget` bytes at most; says how many bricks were uploaded, if any.
///
/// # Panics
/// When that fails.
#[must_use]
pub fn draw_with_budget(
    gpu: &Gpu,
    volume: &Arc<VolumeTexels>,
    state: &ViewState,
    budget: Option<u64>,
) -> (Picture, Option<u64>) {
    let target = Target::new(gpu, state.render_settings.image_size).expect("a target");
    let mut renderer = Renderer::new(gpu, volume, budget).expect("a renderer");
    let surfaces = Surfaces::of(state, volume).expect("a scene");
    renderer.prepare_scene(&state.scene, &Arc::new(surfaces), target.size()).expect("has room");
    renderer.draw(state, &target).expect("draws");
    (target.read_back(gpu).expect("a picture"), renderer.bricks_uploaded())
}

/// Root-mean-square difference of the worst channel, and the largest difference of any.
///
/// # Panics
/// When the pictures differ in size.
#[must_use]
pub fn difference(a: &Picture, b: &Picture) -> (f64, u8) {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let mut squares = [0.0; 4];
    let mut most = 0;
    for (a, b) in a.rgba.chunks_exact(4).zip(b.rgba.chunks_exact(4)) {
        for channel in 0..4 {
            let off = a[channel].abs_diff(b[channel]);
            squares[channel] += f64::from(off).powi(2);
            most = most.max(off);
        }
    }
    let pixels = f64::from(a.width) * f64::from(a.height);
    ((squares.into_iter().fold(0.0, f64::max) / pixels).sqrt(), most)
}

/// Asserts that two pictures of the same state agree but for rounding; prints by how much they differ.
///
/// # Panics
/// When they do not.
pub fn assert_same(name: &str, a: &Picture, b: &Picture) {
    let (rmse, most) = difference(a, b);
    println!("{name}: rmse {rmse:.3}/255, largest difference {most}/255");
    assert!(rmse <= MOST_RMSE && most <= MOST_DIFFERENCE, "{name}: rmse {rmse}, largest difference {most}");
}

/// Share of pixels that are not the background.
#[must_use]
pub fn lit_share(picture: &Picture, background: [u8; 4]) -> f64 {
    let lit = picture.rgba.chunks_exact(4).filter(|&pixel| pixel != background).count();
    lit as f64 / (f64::from(picture.width) * f64::from(picture.height))
}
