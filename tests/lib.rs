//! What the tests across crates share.

use std::path::PathBuf;

use tempfile::TempDir;
use voxrole_pack::Reader;
use voxrole_preprocess::progress::Silent;
use voxrole_preprocess::settings::Settings;
use voxrole_preprocess::{Grid, prepare};
use voxrole_viewer::{Error, Gpu, Picture, Renderer, Target, ViewState, VolumeTexels};

/// Largest root-mean-square difference of any channel between two pictures of the same state, in 1/255.
pub const MOST_RMSE: f64 = 1.0;
/// Largest difference of any channel of any pixel between two pictures of the same state, in 1/255.
pub const MOST_DIFFERENCE: u8 = 8;

/// A packed file and the folder that goes with it.
pub struct Prepared {
    /// The open file.
    pub reader: Reader,
    _folder: TempDir,
}

/// Prepares a grid in a folder of its own.
///
/// # Panics
/// When that fails.
#[must_use]
pub fn prepared(grid: &Grid, settings: &Settings) -> Prepared {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("roles.vxr");
    prepare(grid, settings, &path, &Silent).expect("prepares");
    Prepared { reader: Reader::open(&path).expect("opens"), _folder: folder }
}

/// The folder of real volumes, or `None` with a message where `VOXROLE_REAL_DATA` does not name one.
#[must_use]
pub fn real_data(test: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("VOXROLE_REAL_DATA").map(PathBuf::from);
    if folder.is_none() {
        println!("{test}: SKIPPED, because VOXROLE_REAL_DATA names no folder of real volumes");
    }
    folder
}

/// Draws on the GPU; `None` with a message where there is no adapter.
///
/// # Panics
/// When there is no adapter and `VOXROLE_REQUIRE_GPU` is set, or drawing fails.
#[must_use]
pub fn draw_on_gpu(test: &str, volume: &VolumeTexels, state: &ViewState) -> Option<Picture> {
    let gpu = match Gpu::new() {
        Ok(gpu) => gpu,
        Err(error @ Error::NoAdapter(_)) => {
            assert!(std::env::var_os("VOXROLE_REQUIRE_GPU").is_none(), "VOXROLE_REQUIRE_GPU is set, but {error}");
            println!("{test}: SKIPPED, because {error}");
            return None;
        }
        Err(error) => panic!("{test}: {error}"),
    };
    let target = Target::new(&gpu, state.render_settings.image_size).expect("a target");
    Renderer::new(&gpu, volume).expect("a renderer").draw(state, &target);
    Some(target.read_back(&gpu).expect("a picture"))
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
    let pixels = f64::from(a.width * a.height);
    (squares.into_iter().fold(0.0, f64::max).sqrt() / pixels.sqrt(), most)
}

/// Asserts that two pictures of the same state agree.
///
/// # Panics
/// When they do not.
pub fn assert_same(name: &str, a: &Picture, b: &Picture) {
    let (rmse, most) = difference(a, b);
    println!("{name}: rmse {rmse:.3}/255, largest difference {most}/255");
    assert!(rmse <= MOST_RMSE && most <= MOST_DIFFERENCE, "{name}: rmse {rmse}, largest difference {most}");
}
