//! How far two pictures are apart: all thresholds of image tests are here.

use voxrole_viewer::{Gpu, Picture};

/// Root mean square difference of a channel, in 255ths.
pub const MOST_RMSE: f64 = 1.0;
/// Largest difference of a channel in any pixel, in 255ths.
pub const MOST_DIFFERENCE: u8 = 8;
/// Same, between sampling steps of a quarter and of half a voxel.
pub const MOST_STEP_RMSE: f64 = 2.0;
/// Same, between a boundary and its mirror image in value, whose normals are rounded differently.
pub const MOST_MIRRORED_RMSE: f64 = 1.0;

/// Root mean square difference per channel, and the largest of all.
pub fn difference(a: &Picture, b: &Picture) -> ([f64; 4], u8) {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let mut squares = [0.0; 4];
    let mut most = 0;
    for (a, b) in a.rgba.chunks_exact(4).zip(b.rgba.chunks_exact(4)) {
        for channel in 0..4 {
            let difference = a[channel].abs_diff(b[channel]);
            squares[channel] += f64::from(difference).powi(2);
            most = most.max(difference);
        }
    }
    let pixels = f64::from(a.width) * f64::from(a.height);
    (squares.map(|sum| (sum / pixels).sqrt()), most)
}

/// Panics unless two pictures are the same but for rounding; prints by how much they differ.
pub fn assert_same(name: &str, a: &Picture, b: &Picture) {
    let (rmse, most) = difference(a, b);
    println!("{name}: rmse {rmse:.3?}, largest difference {most}");
    assert!(rmse.iter().all(|&rmse| rmse <= MOST_RMSE) && most <= MOST_DIFFERENCE, "{name}: {rmse:?}, {most}");
}

/// Share of pixels that are not the background.
pub fn lit_share(picture: &Picture, background: [u8; 4]) -> f64 {
    let lit = picture.rgba.chunks_exact(4).filter(|&pixel| pixel != background).count();
    lit as f64 / (f64::from(picture.width) * f64::from(picture.height))
}

/// A GPU, or `None` with a message where there is none; panics instead if `VOXROLE_REQUIRE_GPU=1`.
pub fn gpu_or_skip(test: &str) -> Option<Gpu> {
    match Gpu::new() {
        Ok(gpu) => {
            println!("{test}: on {}", gpu.name);
            Some(gpu)
        }
        Err(error) if std::env::var("VOXROLE_REQUIRE_GPU").is_ok_and(|value| value == "1") => {
            panic!("VOXROLE_REQUIRE_GPU=1, but {error}")
        }
        Err(error) => {
            eprintln!("{test}: SKIPPED, {error}");
            None
        }
    }
}
