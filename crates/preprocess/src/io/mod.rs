//! Readers of volume files, all giving the same [`Grid`]; and the NRRD writer.

mod dicom;
mod header;
mod metaimage;
mod nifti;
mod npy;
mod nrrd;
mod nrrd_axes;
pub mod nrrd_writer;
mod payload;
mod pick;
mod placement;
pub mod raw;
mod raw_guess;
mod raw_header;
mod read_options;
mod slabs;
mod stored_voxels;
#[cfg(feature = "tiff")]
mod tiff;
#[cfg(any(feature = "tiff", feature = "zarr"))]
mod units;
mod volume_file;
mod vti;
mod vvd;
mod xml;
#[cfg(feature = "zarr")]
mod zarr;

use std::ffi::OsStr;
use std::io::{BufReader, Read};
use std::path::Path;

use flate2::bufread::MultiGzDecoder;

pub use raw::{ByteOrder, RawLayout, StoredType};
pub use read_options::ReadOptions;
pub use stored_voxels::StoredVoxels;
pub use volume_file::{StoredVolume, VolumeFile};

use crate::{Error, Grid, Result};

/// How much of a file's beginning decides what it is: a whole NIfTI-1 header, and DICOM's mark at byte 128.
const PROBE_BYTES: usize = 352;

/// What to say about a file that no reader knows.
const WAYS_OUT: &str = "expected NRRD (.nrrd, .nhdr), MetaImage (.mhd, .mha), NIfTI-1 (.nii, .nii.gz, .hdr with \
.img), VTI, TIFF, Zarr, DICOM or NumPy (.npy); if it holds nothing but numbers, say how they lie: --dims X,Y,Z --dtype u16be \
--spacing SX,SY,SZ --skip-bytes N";

/// Reads a volume: [`open_volume`] and [`VolumeFile::load`] in one.
///
/// # Errors
/// As [`open_volume`]; [`Error::Format`] too when there are fewer or more numbers than the header says, or damaged ones,
/// [`Error::OutOfMemory`].
pub fn read_volume(path: &Path, options: &ReadOptions) -> Result<Grid> {
    open_volume(path, options)?.load()
}

/// Reads the header of a volume, finding the format by the file's content.
///
/// With [`ReadOptions::raw`] the file is read as headerless numbers, whatever it looks like. Numbers keep their own type; world
/// positions are in the file's unit, and in the frame left-posterior-superior wherever the file says what its axes mean.
///
/// # Errors
/// [`Error::Io`] when the operating system refuses, [`Error::Format`] for a file of another kind or whose content is not
/// what its format demands. Each names the file, what was expected and what was found.
pub fn open_volume(path: &Path, options: &ReadOptions) -> Result<VolumeFile> {
    let volume = open_as_it_is(path, options)?.with_options(options.typed());
    match options.spacing {
        Some(spacing) => volume.with_spacing(path, spacing),
        None => Ok(volume),
    }
}

fn open_as_it_is(path: &Path, options: &ReadOptions) -> Result<VolumeFile> {
    let may_be_vti = options.raw.is_none() && !path.is_dir();
    if options.array.is_some() && !(may_be_vti && vti::is_header(&probe(path)?)) {
        let message = "expected VTI for --array, found another format: leave the option out";
        return Err(Error::format(path, message));
    }
    if let Some(layout) = &options.raw {
        options.expect_no_place(path).and(options.expect_no_series(path))?;
        return raw::read(path, layout);
    }
    #[cfg(feature = "zarr")]
    if zarr::is_store(path) {
        options.expect_no_series(path)?;
        return zarr::read(path, options);
    }
    #[cfg(feature = "tiff")]
    if tiff::is_stack_folder(path) {
        options.expect_no_series(path)?;
        return tiff::read_folder(path, options);
    }
    if path.is_dir() {
        let volume = dicom::read(path, options);
        return volume.map_err(|error| left_out_folder(path).map_or(error, |message| Error::format(path, message)));
    }
    let start = probe(path)?;
    if dicom::is_dicom(&start) {
        return dicom::read(path, options);
    }
    options.expect_no_series(path)?;
    #[cfg(feature = "tiff")]
    if tiff::is_header(&start) {
        return tiff::read(path, options);
    }
    if start.starts_with(b"NRRD0") {
        return nrrd::read(path, options);
    }
    if npy::is_header(&start) {
        return npy::read(path, options);
    }
    if nifti::is_header(&start) {
        return nifti::read(path, false, options);
    }
    if vvd::is_header(&start) {
        options.expect_no_place(path)?;
        return vvd::read(path);
    }
    if vti::is_header(&start) {
        return vti::read(path, options);
    }
    let has_extension = |extension: &str| {
        path.extension().and_then(OsStr::to_str).is_some_and(|found| found.eq_ignore_ascii_case(extension))
    };
    if (has_extension("mhd") || has_extension("mha")) && metaimage::is_header(&start) {
        return metaimage::read(path, options);
    }
    if start.starts_with(&payload::GZIP_MAGIC) {
        let (file, _) = payload::open(path)?;
        let mut decoded = Vec::new();
        // A damaged stream gives fewer bytes here and is reported in full by the reader that they point to.
        let outcome = MultiGzDecoder::new(BufReader::new(file)).take(PROBE_BYTES as u64).read_to_end(&mut decoded);
        if nifti::is_header(&decoded) {
            return nifti::read(path, true, options);
        }
        let inside = outcome.err().map_or("is not NIfTI".into(), |error| format!("cannot be unpacked ({error})"));
        return bare_numbers(path, options, format!("found a gzip file whose content {inside}; {WAYS_OUT}"));
    }
    match known_otherwise(&start) {
        Some(message) => Err(Error::format(path, message)),
        None => bare_numbers(path, options, format!("found a file of no known kind; {WAYS_OUT}")),
    }
}

/// Reads a file that says nothing of itself by the header that names it; without one, proposes what it may be.
fn bare_numbers(path: &Path, options: &ReadOptions, message: String) -> Result<VolumeFile> {
    if let Some(volume) = raw_header::find(path, options)? {
        return Ok(volume);
    }
    let proposals = raw_guess::proposals(path);
    if proposals.is_empty() {
        return Err(Error::format(path, message));
    }
    Err(Error::format(path, format!("{message}; likeliest by its size and smoothness: {}", proposals.join(", or "))))
}

/// The file's first [`PROBE_BYTES`], or all of a shorter file.
fn probe(path: &Path) -> Result<Vec<u8>> {
    let (file, _) = payload::open(path)?;
    let mut start = Vec::new();
    file.take(PROBE_BYTES as u64).read_to_end(&mut start).map_err(Error::io(path))?;
    Ok(start)
}

/// Why a file that begins with `start` cannot be read and what to do about it, where it is of a kind that is known.
fn known_otherwise(start: &[u8]) -> Option<String> {
    let convert = |kind: &str, tools: &str| {
        Some(format!(
            "expected NRRD, MetaImage, NIfTI-1, VTI, TIFF, Zarr, DICOM or NumPy, found {kind}, which is not read yet: convert it \
             first ({tools})"
        ))
    };
    let contains = |needle: &[u8]| start.windows(needle.len()).any(|window| window == needle);
    if start.is_empty() {
        return Some(format!("found an empty file; {WAYS_OUT}"));
    }
    if start.starts_with(&voxrole_pack::prologue::MAGIC) {
        return Some("expected a volume to prepare, found an already packed file of voxel roles".into());
    }
    if start.starts_with(b"PK\x03\x04") {
        return Some(
            "expected a volume, found a zip file: if it is a Zarr store or holds slices, unpack it first".into(),
        );
    }
    if contains(b"# vtk DataFile Version") {
        return convert("VTK's legacy format", "for example with ParaView: Save Data, VTK ImageData Files (.vti)");
    }
    if [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"].iter().any(|magic| start.starts_with(*magic)) {
        return Some(left_out("TIFF", "tiff"));
    }
    None
}

/// Why a format cannot be read that the program was built without.
fn left_out(found: &str, feature: &str) -> String {
    format!(
        "found {found}, whose reader was left out when this program was built: build it with the feature `{feature}`"
    )
}

/// The same for a folder.
fn left_out_folder(path: &Path) -> Option<String> {
    if !cfg!(feature = "zarr") && ["zarr.json", ".zarray", ".zgroup"].iter().any(|name| path.join(name).exists()) {
        return Some(left_out("a Zarr store", "zarr"));
    }
    let is_tiff = |name: &Path| {
        name.extension().is_some_and(|found| found.eq_ignore_ascii_case("tif") || found.eq_ignore_ascii_case("tiff"))
    };
    let has_tiff =
        || std::fs::read_dir(path).is_ok_and(|entries| entries.flatten().any(|entry| is_tiff(&entry.path())));
    (!cfg!(feature = "tiff") && has_tiff()).then(|| left_out("a folder of TIFF files", "tiff"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unreadable_kinds_are_told_apart() {
        for (start, expected) in [
            (b"# vtk DataFile Version 3.0\n".as_slice(), ".vti"),
            (b"II*\0\x08\0\0\0", "TIFF"),
            (b"MM\0*\0\0\0\x08", "TIFF"),
            (b"\x89VXR\r\n\x1a\n", "already packed file"),
            (b"", "empty"),
        ] {
            let message = known_otherwise(start).expect("a known kind");
            assert!(message.contains(expected), "{message}");
        }
        assert_eq!(known_otherwise(b"something else"), None);
    }
}
