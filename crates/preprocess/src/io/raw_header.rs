//! Finds the header that names a file of bare numbers.

use std::fs;
use std::path::{Path, PathBuf};

use super::read_options::ReadOptions;
use super::volume_file::VolumeFile;
use super::{metaimage, nifti, nrrd, vvd};
use crate::{Error, Result};

/// Kinds of header that name other files.
const EXTENSIONS: [&str; 4] = ["mhd", "nhdr", "hdr", "vvd"];
/// Most headers that are looked at.
const MOST_HEADERS: usize = 1000;

/// The volume of the header in the same folder that says that its numbers are in the file `data`, if there is one.
///
/// # Errors
/// [`Error::Format`] when a header of the same name cannot be used.
pub(super) fn find(data: &Path, options: &ReadOptions) -> Result<Option<VolumeFile>> {
    let folder = data.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let Ok(entries) = fs::read_dir(folder) else { return Ok(None) };
    let is_header = |path: &PathBuf| {
        EXTENSIONS.iter().any(|known| path.extension().is_some_and(|found| found.eq_ignore_ascii_case(known)))
    };
    let mut headers: Vec<PathBuf> = entries
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| is_header(path) && !is_same(path, data))
        .take(MOST_HEADERS)
        .collect();
    let name = data.file_name().unwrap_or_default().to_string_lossy();
    let is_of_same_name = |header: &PathBuf| {
        let stem = header.file_stem().unwrap_or_default().to_string_lossy();
        name.strip_prefix(&*stem).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
    };
    // Those of the same name first.
    headers.sort_by_key(|path| (!is_of_same_name(path), path.clone()));
    for header in &headers {
        match open(header, options) {
            Ok(volume) if volume.files().iter().any(|file| is_same(file, data)) => {
                let name = header.file_name().unwrap_or_default().to_string_lossy();
                return Ok(Some(volume.with_notes(vec![format!("read by its header {name}")])));
            }
            Err(error) if is_of_same_name(header) => {
                return Err(Error::format(data, format!("expected a volume by the header beside it, found: {error}")));
            }
            _ => {}
        }
    }
    Ok(None)
}

fn open(header: &Path, options: &ReadOptions) -> Result<VolumeFile> {
    match header.extension().and_then(|extension| extension.to_str()).map(str::to_lowercase).as_deref() {
        Some("mhd") => metaimage::read(header, options),
        Some("nhdr") => nrrd::read(header, options),
        Some("hdr") => nifti::read(header, false, options),
        _ => {
            options.expect_no_place(header)?;
            vvd::read(header)
        }
    }
}

fn is_same(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}
