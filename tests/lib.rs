//! What the tests of the viewer and across crates share.

pub mod comparison;

use std::path::PathBuf;

use tempfile::TempDir;
use voxrole_pack::Reader;
use voxrole_preprocess::progress::Silent;
use voxrole_preprocess::settings::Settings;
use voxrole_preprocess::{Grid, prepare};

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
