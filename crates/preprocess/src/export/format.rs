//! The formats that fields are written in.

use std::path::Path;

/// A format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExportFormat {
    /// NRRD with attached numbers.
    Nrrd,
    /// NIfTI-1 in one file.
    Nifti,
    /// VTK's XML image data.
    Vti,
    /// A stack of pages as ImageJ writes it.
    Tiff,
    /// One array of numpy's.
    Npy,
    /// A folder of several levels in chunks: OME-Zarr 0.5.
    OmeZarr,
}

impl ExportFormat {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::Nrrd, Self::Nifti, Self::Vti, Self::Tiff, Self::Npy, Self::OmeZarr];

    /// The format's name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Nrrd => "nrrd",
            Self::Nifti => "nifti",
            Self::Vti => "vti",
            Self::Tiff => "tiff",
            Self::Npy => "npy",
            Self::OmeZarr => "ome-zarr",
        }
    }

    /// How names of such files end, the usual ending first.
    #[must_use]
    pub const fn extensions(self) -> &'static [&'static str] {
        match self {
            Self::Nrrd => &["nrrd"],
            Self::Nifti => &["nii.gz", "nii"],
            Self::Vti => &["vti"],
            Self::Tiff => &["tif", "tiff"],
            Self::Npy => &["npy"],
            Self::OmeZarr => &["ome.zarr", "zarr"],
        }
    }

    /// The format that a file's name tells.
    #[must_use]
    pub fn from_path(path: &Path) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.is_name_of(path))
    }

    /// Whether a file of this format may have that name.
    #[must_use]
    pub fn is_name_of(self, path: &Path) -> bool {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        self.extensions()
            .iter()
            .any(|extension| name.strip_suffix(extension).is_some_and(|stem| stem.len() > 1 && stem.ends_with('.')))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_the_format() {
        for (name, format) in [
            ("a.nrrd", Some(ExportFormat::Nrrd)),
            ("folder.nrrd/a.NII", Some(ExportFormat::Nifti)),
            ("a.b.nii.gz", Some(ExportFormat::Nifti)),
            ("a.tiff", Some(ExportFormat::Tiff)),
            ("a.ome.zarr", Some(ExportFormat::OmeZarr)),
            ("a.zarr/", Some(ExportFormat::OmeZarr)),
            ("a.gz", None),
            (".nrrd", None),
            ("nrrd", None),
        ] {
            assert_eq!(ExportFormat::from_path(Path::new(name)), format, "{name}");
        }
    }
}
