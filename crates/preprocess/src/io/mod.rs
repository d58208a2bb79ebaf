//! Readers of volume files, all giving the same [`Grid`]; and the NRRD writer.

mod header;
mod metaimage;
mod nifti;
mod nrrd;
mod nrrd_axes;
pub mod nrrd_writer;
mod payload;
mod placement;
pub mod raw;
mod read_options;
mod slabs;
mod stored_voxels;
#[cfg(feature = "tiff")]
mod tiff;
#[cfg(any(feature = "tiff", feature = "zarr"))]
mod units;
mod volume_file;
mod vti;
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
.img), VTI, TIFF or Zarr; if it holds nothing but numbers, say how they lie: --dims X,Y,Z --dtype u16be --spacing SX,SY,SZ --skip-bytes N";

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
    if let Some(layout) = &options.raw {
        return raw::read(path, layout);
    }
    #[cfg(feature = "zarr")]
    if zarr::is_store(path) {
        return zarr::read(path, options);
    }
    #[cfg(feature = "tiff")]
    if tiff::is_stack_folder(path) {
        return tiff::read_folder(path, options);
    }
    let start = probe(path)?;
    #[cfg(feature = "tiff")]
    if tiff::is_header(&start) {
        return tiff::read(path, options);
    }
    if start.starts_with(b"NRRD0") {
        return nrrd::read(path);
    }
    if nifti::is_header(&start) {
        return nifti::read(path, false);
    }
    if vti::is_header(&start) {
        return vti::read(path, options);
    }
    let has_extension = |extension: &str| {
        path.extension().and_then(OsStr::to_str).is_some_and(|found| found.eq_ignore_ascii_case(extension))
    };
    if (has_extension("mhd") || has_extension("mha")) && metaimage::is_header(&start) {
        return metaimage::read(path);
    }
    if start.starts_with(&payload::GZIP_MAGIC) {
        let (file, _) = payload::open(path)?;
        let mut decoded = Vec::new();
        // A damaged stream gives fewer bytes here and is reported in full by the reader that they point to.
        let outcome = MultiGzDecoder::new(BufReader::new(file)).take(PROBE_BYTES as u64).read_to_end(&mut decoded);
        if nifti::is_header(&decoded) {
            return nifti::read(path, true);
        }
        let inside = outcome.err().map_or("is not NIfTI".into(), |error| format!("cannot be unpacked ({error})"));
        return Err(Error::format(path, format!("found a gzip file whose content {inside}; {WAYS_OUT}")));
    }
    Err(Error::format(path, unreadable(&start)))
}

/// The file's first [`PROBE_BYTES`], or all of a shorter file.
fn probe(path: &Path) -> Result<Vec<u8>> {
    let (file, _) = payload::open(path)?;
    let mut start = Vec::new();
    file.take(PROBE_BYTES as u64).read_to_end(&mut start).map_err(Error::io(path))?;
    Ok(start)
}

/// Why a file that begins with `start` cannot be read, and what to do about it.
fn unreadable(start: &[u8]) -> String {
    let convert = |kind: &str, tools: &str| {
        format!(
            "expected NRRD, MetaImage, NIfTI-1, VTI, TIFF or Zarr, found {kind}, which is not read yet: convert it first ({tools})"
        )
    };
    let contains = |needle: &[u8]| start.windows(needle.len()).any(|window| window == needle);
    if start.is_empty() {
        return format!("found an empty file; {WAYS_OUT}");
    }
    if start.starts_with(&voxrole_pack::prologue::MAGIC) {
        return "expected a volume to prepare, found an already packed file of voxel roles".into();
    }
    if start.get(128..132) == Some(b"DICM") {
        return convert("DICOM", "for example with dcm2niix, or with 3D Slicer");
    }
    if start.starts_with(b"PK\x03\x04") {
        return "expected a volume, found a zip file: if it is a Zarr store or holds slices, unpack it first".into();
    }
    if contains(b"# vtk DataFile Version") {
        return convert("VTK's legacy format", "for example with ParaView: Save Data, VTK ImageData Files (.vti)");
    }
    if [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"].iter().any(|magic| start.starts_with(*magic)) {
        return "found TIFF, whose reader was left out when this program was built: build it with the feature `tiff`"
            .into();
    }
    format!("found a file of no known kind; {WAYS_OUT}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unreadable_kinds_are_told_apart() {
        let mut dicom = vec![0; 128];
        dicom.extend_from_slice(b"DICM\x02\0");
        for (start, expected) in [
            (dicom.as_slice(), "DICOM"),
            (b"# vtk DataFile Version 3.0\n", ".vti"),
            (b"II*\0\x08\0\0\0", "TIFF"),
            (b"MM\0*\0\0\0\x08", "TIFF"),
            (b"\x89VXR\r\n\x1a\n", "already packed file"),
            (b"", "empty"),
            (b"something else", "--dims X,Y,Z --dtype u16be"),
        ] {
            let message = unreadable(start);
            assert!(message.contains(expected), "{message}");
        }
    }
}
