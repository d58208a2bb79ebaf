//! Fields of packed files in other programs' formats. `docs/opening.md` says how to open each.

mod format;
mod nifti;
pub mod npy;
#[cfg(feature = "zarr")]
mod ome_metadata;
#[cfg(feature = "zarr")]
mod ome_zarr;
mod tiff;
mod tiff_directory;
mod vti;

use std::io::{self, BufWriter, Write};
use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;
use voxrole_pack::atomic_file::AtomicFile;
use voxrole_pack::{GridGeometry, Reader, ScalarType};

pub use format::ExportFormat;

use crate::atomic_folder::AtomicFolder;
use crate::field_volume::FieldVolume;
use crate::fields::Field;
use crate::io::nrrd_writer::{self, Components, Encoding};
use crate::{Error, Result};

/// What is written, and how.
#[derive(Clone, Copy, Debug)]
pub struct Export {
    /// What.
    pub field: Field,
    /// The level, or with [`ExportFormat::OmeZarr`] the finest one; 0 is the volume itself.
    pub level: usize,
    /// How.
    pub format: ExportFormat,
    /// Whether the numbers of NRRD and VTI are packed.
    pub compress: bool,
}

impl Export {
    /// Writes one field of a packed file to `path`, which is a folder for [`ExportFormat::OmeZarr`] and a file else. It appears
    /// under its name when it is complete, and replaces what had that name. NIfTI is packed if `path` ends in `.gz`.
    ///
    /// Takes the memory of the layer that the field is read from, and up to 0.3 GiB for OME-Zarr, else some 20 MiB.
    ///
    /// Returns what the format could not hold, as sentences for the user.
    ///
    /// # Errors
    /// [`Error::Pack`] when the packed file is damaged or has no such layer or level; [`Error::Parameter`] when the program was
    /// built without the format; [`Error::Io`] when the output cannot be written, or the format
    /// cannot hold such a volume.
    pub fn write(&self, reader: &Reader, path: &Path) -> Result<Vec<String>> {
        if self.format == ExportFormat::OmeZarr {
            #[cfg(feature = "zarr")]
            return ome_zarr::write(reader, self.field, self.level, path);
            #[cfg(not(feature = "zarr"))]
            return Err(Error::Parameter("this program was built without OME-Zarr (cargo feature `zarr`)".into()));
        }
        let volume = FieldVolume::read(reader, self.field, self.level)?;
        let losses = losses(self.format, &volume);
        self.write_file(volume, path).map_err(Error::io(path))?;
        Ok(losses)
    }

    fn write_file(&self, volume: FieldVolume, path: &Path) -> io::Result<()> {
        let mut file = AtomicFile::create(path)?;
        let mut out = BufWriter::with_capacity(1 << 20, file.file_mut());
        match self.format {
            ExportFormat::Nrrd => write_nrrd(&mut out, &volume, self.compress)?,
            ExportFormat::Nifti if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("gz")) => {
                let mut encoder = GzEncoder::new(&mut out, Compression::default());
                nifti::write(&mut encoder, volume)?;
                encoder.finish()?;
            }
            ExportFormat::Nifti => nifti::write(&mut out, volume)?,
            ExportFormat::Vti => vti::write(&mut out, &volume, self.compress)?,
            ExportFormat::Tiff => tiff::write(&mut out, &volume)?,
            ExportFormat::Npy => npy::write(&mut out, &volume)?,
            ExportFormat::OmeZarr => return Err(io::ErrorKind::Unsupported.into()),
        }
        out.flush()?;
        drop(out);
        file.commit()
    }
}

fn write_nrrd(out: &mut impl Write, volume: &FieldVolume, compress: bool) -> io::Result<()> {
    let components = if volume.components() == 1 { Components::Scalar } else { Components::WorldVector };
    let encoding = if compress { Encoding::Gzip } else { Encoding::Raw };
    let (geometry, content) = (volume.geometry(), volume.field().description());
    nrrd_writer::write_header(out, geometry, volume.scalar_type(), components, encoding, content)?;
    if !compress {
        return write_numbers(out, volume);
    }
    let mut encoder = GzEncoder::new(out, Compression::default());
    write_numbers(&mut encoder, volume)?;
    encoder.finish().map(drop)
}

/// Writes all numbers, little-endian, x fastest, the components of a voxel one behind the other.
fn write_numbers(out: &mut impl Write, volume: &FieldVolume) -> io::Result<()> {
    let mut bytes = Vec::new();
    for chunk in volume.chunks() {
        bytes.clear();
        volume.append_le(chunk, &mut bytes);
        out.write_all(&bytes)?;
    }
    Ok(())
}

/// One component of vectors of three f32 each.
fn component(bytes: &[u8], axis: usize) -> Vec<u8> {
    bytes.as_chunks::<12>().0.iter().flat_map(|vector| &vector[4 * axis..4 * axis + 4]).copied().collect()
}

/// Checks, before any work is done, that an OME-Zarr of this name can be written: a folder that was written here may be
/// replaced, anything else not.
///
/// # Errors
/// [`io::ErrorKind::AlreadyExists`] when there is something else under that name, [`io::ErrorKind::NotFound`] when there is no
/// folder to write it into.
pub fn check_replaceable_folder(path: &Path) -> io::Result<()> {
    let is_ours = || {
        let metadata = std::fs::read(path.join("zarr.json")).ok()?;
        let metadata: serde_json::Value = serde_json::from_slice(&metadata).ok()?;
        metadata.pointer("/attributes/voxrole").map(drop)
    };
    if path.symlink_metadata().is_ok() && is_ours().is_none() {
        let message =
            "there is something of that name that this program did not write: remove it, or choose another name";
        return Err(io::Error::new(io::ErrorKind::AlreadyExists, message));
    }
    AtomicFolder::create(path).map(drop)
}

/// What `format` does not hold of a volume and its user may take for held.
fn losses(format: ExportFormat, volume: &FieldVolume) -> Vec<String> {
    let geometry = volume.geometry();
    let mut losses = Vec::new();
    if matches!(format, ExportFormat::Tiff | ExportFormat::OmeZarr) && is_turned(geometry) {
        losses.push(format!(
            "{} holds no direction of the axes: they are written as if they were the world's; NRRD, NIfTI and VTI hold it",
            if format == ExportFormat::Tiff { "TIFF" } else { "OME-Zarr" }
        ));
    }
    if format == ExportFormat::Tiff && tiff::written_type(volume.scalar_type()) == ScalarType::F32 {
        let own = volume.scalar_type();
        if own != ScalarType::F32 {
            losses.push(format!("ImageJ knows no {}: the numbers are rounded to 32-bit floats", own.name()));
        }
    }
    if format == ExportFormat::Nifti && nifti::unit_code(&geometry.unit).is_none() {
        losses.push(format!("NIfTI knows m, mm and µm only: the unit {} is left out", geometry.unit));
    }
    #[cfg(feature = "zarr")]
    if format == ExportFormat::OmeZarr && !geometry.unit.is_empty() && ome_metadata::unit_name(&geometry.unit).is_none()
    {
        losses.push(format!("OME-Zarr has no name for the unit {}: it is left out", geometry.unit));
    }
    if format == ExportFormat::Nifti && volume.is_nan_without_boundary() {
        let reason = "as if the boundary was there: write NRRD for these";
        losses.push(format!("programs built on ITK (3D Slicer, ITK-SNAP) read the NaN of NIfTI as 0, {reason}"));
    }
    losses
}

/// Whether index axes are not the world's.
fn is_turned(geometry: &GridGeometry) -> bool {
    let aligned = GridGeometry::axis_aligned(geometry.dims, geometry.spacing).direction;
    geometry.direction.iter().flatten().zip(aligned.iter().flatten()).any(|(found, one)| (found - one).abs() > 1e-6)
}
