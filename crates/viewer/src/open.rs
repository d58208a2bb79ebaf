//! Opens what the user named.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::{Context, bail};
use voxrole_pack::Reader;
use voxrole_pack::prologue::MAGIC;

/// Opens a packed file, whatever its name ends in.
///
/// # Errors
/// When it cannot be read, is damaged, or is another kind of file; the message names it.
pub fn open_or_prepare(path: &Path) -> anyhow::Result<Reader> {
    let named = || path.display().to_string();
    let mut start = Vec::new();
    File::open(path).and_then(|file| file.take(MAGIC.len() as u64).read_to_end(&mut start)).with_context(named)?;
    if start != MAGIC {
        bail!(
            "{}: not a packed file (.vxr); make one with `voxrole prepare {} -o OUT.vxr`",
            path.display(),
            path.display()
        );
    }
    Reader::open(path).with_context(named)
}
