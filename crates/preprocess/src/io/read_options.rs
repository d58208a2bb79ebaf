//! What is read of a file that holds more than one scalar volume, or does not say enough.

use std::path::Path;

use super::raw::RawLayout;
use crate::{Error, Result};

/// How to read a volume; the default reads a file that holds one scalar volume and says everything itself.
///
/// What has no effect on a file is an error.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadOptions {
    /// The layout of a headerless file; any file is then read as headerless numbers, whatever it looks like.
    pub raw: Option<RawLayout>,
    /// Distance between voxels along x, y, z, in place of what the file says, or does not say.
    pub spacing: Option<[f64; 3]>,
    /// Which of several arrays of a VTI file, by name. Without it that is read which is named as the scalars, or the only one.
    pub array: Option<String>,
    /// Which of several numbers of a voxel, or channels, counted from 0. Without it only volumes of one are read.
    pub component: Option<usize>,
    /// Which point of time, counted from 0. Without it only volumes of one are read.
    pub time: Option<usize>,
    /// Which DICOM series of a folder, by UID or number. Without it only folders of one are read.
    pub series: Option<String>,
    /// Whether to interpolate tilted or unevenly spaced DICOM slices onto a rectangular, even grid. Without it they are refused.
    pub resample: bool,
}

impl ReadOptions {
    /// The options that are given, as they are typed; empty for none. A packed file says them, so that its numbers can be told from
    /// those of the same input read otherwise.
    #[must_use]
    pub fn typed(&self) -> String {
        let Self { raw, spacing, array, component, time, series, resample } = self;
        let triple = |[x, y, z]: [f64; 3]| format!("{x},{y},{z}");
        let options = [
            raw.as_ref().map(RawLayout::typed),
            spacing.map(|spacing| format!("--spacing {}", triple(spacing))),
            array.as_ref().map(|array| format!("--array {array}")),
            component.map(|component| format!("--component {component}")),
            time.map(|time| format!("--time {time}")),
            series.as_ref().map(|series| format!("--series {series}")),
            resample.then(|| "--resample".into()),
        ];
        options.into_iter().flatten().collect::<Vec<_>>().join(" ")
    }

    /// The component to read where a voxel has `count` of them, which are called `what`.
    ///
    /// # Errors
    /// A message, when one has to be chosen or is not there.
    pub(super) fn component_of(&self, count: usize, what: &str) -> std::result::Result<usize, String> {
        chosen(self.component, count, what, "--component")
    }

    /// The point of time to read where there are `count`.
    ///
    /// # Errors
    /// As [`Self::component_of`].
    pub(super) fn time_of(&self, count: usize) -> std::result::Result<usize, String> {
        chosen(self.time, count, "points of time", "--time")
    }

    /// What to tell of a volume whose file does not say how far voxels are apart.
    pub(super) fn note_on_spacing(&self) -> Vec<String> {
        let note = "the file does not say how far voxels are apart, so that it is 1 along each axis: give --spacing X,Y,Z if not";
        if self.spacing.is_none() { vec![note.into()] } else { Vec::new() }
    }

    /// Makes sure that no component and no point of time is chosen of a volume of one.
    pub(super) fn expect_no_place(&self, path: &Path) -> Result<()> {
        let places = self.component_of(1, "numbers per voxel").and(self.time_of(1));
        places.map(drop).map_err(|message| Error::format(path, message))
    }

    /// Makes sure that nothing is chosen that only DICOM has.
    pub(super) fn expect_no_series(&self, path: &Path) -> Result<()> {
        let given = [("--series", self.series.is_some()), ("--resample", self.resample)];
        given.iter().filter(|(_, is_given)| *is_given).try_for_each(|(option, _)| {
            let message = format!("expected a DICOM series for {option}, found another format: leave the option out");
            Err(Error::format(path, message))
        })
    }
}

fn chosen(choice: Option<usize>, count: usize, what: &str, option: &str) -> std::result::Result<usize, String> {
    match choice {
        _ if count == 0 => Err(format!("expected a scalar volume, found no {what}")),
        None if count == 1 => Ok(0),
        Some(index) if count == 1 => {
            Err(format!("expected several {what} for {option} {index}, found one: leave the option out"))
        }
        None => Err(format!(
            "expected a scalar volume, found {count} {what}: choose one of 0 to {} with {option}",
            count - 1
        )),
        Some(index) if index < count => Ok(index),
        Some(index) => Err(format!("{option} {index}: expected one of 0 to {}, found {count} {what}", count - 1)),
    }
}

impl From<RawLayout> for ReadOptions {
    fn from(layout: RawLayout) -> Self {
        Self { raw: Some(layout), ..Self::default() }
    }
}
