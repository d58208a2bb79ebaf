//! Opens what the user named.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::Context;
use tempfile::TempDir;
use voxrole_pack::Reader;
use voxrole_pack::prologue::MAGIC;
use voxrole_preprocess::console::tell;
use voxrole_preprocess::io::{ReadOptions, read_volume};
use voxrole_preprocess::prepare;
use voxrole_preprocess::progress::Silent;
use voxrole_preprocess::settings::{Method, Settings};

/// A packed file to read from.
pub struct Opened {
    /// Its reader.
    pub reader: Reader,
    /// The folder of a file that was prepared only for this; removed with it.
    _prepared: Option<TempDir>,
}

/// Opens a packed file, whatever its name ends in. A volume that has not been prepared is prepared first, with default
/// settings, into a temporary file.
///
/// # Errors
/// When it cannot be read, is damaged, or is not a volume; the message names it.
pub fn open_or_prepare(path: &Path, options: &ReadOptions) -> anyhow::Result<Opened> {
    let named = || path.display().to_string();
    let mut start = Vec::new();
    File::open(path).and_then(|file| file.take(MAGIC.len() as u64).read_to_end(&mut start)).with_context(named)?;
    if start == MAGIC {
        return Ok(Opened { reader: Reader::open(path).with_context(named)?, _prepared: None });
    }
    let grid = read_volume(path, options)?;
    let folder = tempfile::tempdir().context("making a temporary folder")?;
    let packed = folder.path().join("prepared.vxr");
    let file = path.display();
    tell(format!("voxrole-view: preparing {file}; `voxrole prepare {file} -o OUT.vxr` keeps the result"));
    prepare(&grid, &Settings::new(Method::Auto), &packed, &Silent).with_context(named)?;
    Ok(Opened { reader: Reader::open(&packed).with_context(named)?, _prepared: Some(folder) })
}
