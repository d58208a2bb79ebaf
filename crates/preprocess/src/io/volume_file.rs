//! A volume file whose header is read and whose numbers are not yet.

use std::path::{Path, PathBuf};

use voxrole_pack::{GridGeometry, ScalarType};

use super::payload::Payload;
use super::slabs::{self, Slabs};
use super::stored_voxels::StoredVoxels;
use crate::{Error, Grid, Result, grid};

/// What the header of a volume file says.
#[derive(Debug)]
pub struct VolumeFile {
    name: String,
    geometry: GridGeometry,
    slope: f64,
    intercept: f64,
    numbers: Numbers,
    notes: Vec<String>,
    read_with: String,
}

/// Where the numbers are.
#[derive(Debug)]
pub(super) enum Numbers {
    /// In one run of one file, compressed as a whole or not at all.
    Payload(Payload),
    /// Anywhere else.
    Slabs(Box<dyn Slabs>),
}

impl From<Payload> for Numbers {
    fn from(payload: Payload) -> Self {
        Self::Payload(payload)
    }
}

/// A volume whose numbers stay in a file.
#[derive(Debug)]
pub struct StoredVolume {
    /// The input's file name, without folders.
    pub name: String,
    /// The options that the input was read with, as they are typed.
    pub read_with: String,
    /// Where the voxels lie.
    pub geometry: GridGeometry,
    /// `physical = slope · stored + intercept`.
    pub slope: f64,
    /// See [`Self::slope`].
    pub intercept: f64,
    /// The stored numbers.
    pub voxels: StoredVoxels,
}

impl VolumeFile {
    /// The volume at `path`.
    ///
    /// # Errors
    /// [`Error::Format`], naming `path`, for a mapping that cannot be used.
    pub(super) fn new(
        path: &Path,
        geometry: GridGeometry,
        numbers: impl Into<Numbers>,
        slope: f64,
        intercept: f64,
    ) -> Result<Self> {
        grid::check_mapping(slope, intercept).map_err(|error| Error::format(path, error.to_string()))?;
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        Ok(Self {
            name,
            geometry,
            slope,
            intercept,
            numbers: numbers.into(),
            notes: Vec::new(),
            read_with: String::new(),
        })
    }

    /// The same, read with these options, as they are typed.
    pub(super) fn with_options(self, read_with: String) -> Self {
        Self { read_with, ..self }
    }

    /// The same with voxels at another distance from each other; the first one stays where it is.
    ///
    /// # Errors
    /// [`Error::Format`], naming `path`, for a distance that cannot be used.
    pub(super) fn with_spacing(self, path: &Path, spacing: [f64; 3]) -> Result<Self> {
        let geometry = GridGeometry { spacing, ..self.geometry.clone() };
        geometry.validate().map_err(|error| Error::format(path, format!("--spacing: {error}")))?;
        let [before, after] = [self.geometry.spacing, spacing].map(|[x, y, z]| format!("{x},{y},{z}"));
        let note = format!("voxels are taken to be {after} apart in place of {before}");
        Ok(Self { geometry, ..self }.with_notes(vec![note]))
    }

    /// The same with what is worth telling of how it was read.
    pub(super) fn with_notes(self, notes: Vec<String>) -> Self {
        Self { notes: [self.notes, notes].concat(), ..self }
    }

    /// What is worth telling of how it was read, a line each: files that were skipped or found, numbers that were resampled.
    #[must_use]
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The files that hold the numbers, which an output must not overwrite.
    #[must_use]
    pub fn files(&self) -> &[PathBuf] {
        match &self.numbers {
            Numbers::Payload(payload) => std::slice::from_ref(&payload.path),
            Numbers::Slabs(slabs) => slabs.files(),
        }
    }

    /// Voxels along x, y, z.
    #[must_use]
    pub fn dims(&self) -> [usize; 3] {
        self.geometry.dims_usize()
    }

    /// The numbers' type.
    #[must_use]
    pub fn scalar_type(&self) -> ScalarType {
        match &self.numbers {
            Numbers::Payload(payload) => payload.stored.scalar_type,
            Numbers::Slabs(slabs) => slabs.scalar_type(),
        }
    }

    /// Reads all numbers.
    ///
    /// # Errors
    /// As [`super::read_volume`].
    pub fn load(self) -> Result<Grid> {
        let scalars = match &self.numbers {
            Numbers::Payload(payload) => payload.read()?,
            Numbers::Slabs(slabs) => slabs::read(slabs.as_ref(), self.dims())?,
        };
        let grid = Grid::with_mapping(self.name, self.geometry, scalars, self.slope, self.intercept)?;
        Ok(Grid { read_with: self.read_with, ..grid })
    }

    /// Leaves the numbers where they are; compressed and scattered ones are unpacked into a temporary file in `folder`.
    ///
    /// # Errors
    /// As [`super::read_volume`], and [`Error::Io`] when `folder` cannot be written to.
    pub fn stored(self, folder: &Path) -> Result<StoredVolume> {
        let dims = self.dims();
        let Self { name, read_with, geometry, slope, intercept, numbers, .. } = self;
        let voxels = match numbers {
            Numbers::Payload(payload) => payload.stored(folder)?,
            Numbers::Slabs(slabs) => slabs::stored(slabs.as_ref(), dims, folder)?,
        };
        Ok(StoredVolume { name, read_with, geometry, slope, intercept, voxels })
    }
}
