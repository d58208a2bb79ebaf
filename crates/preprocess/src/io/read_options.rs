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
    /// The component to read where a voxel has `count` of them, which are called `what`.
    ///
    /// # Errors
    /// A message, when one has to be chosen or is not there.
    pub(super) fn component_of(&self, count: usize, what: &str) -> Result<usize, String> {
        chosen(self.component, count, what, "--component")
    }

    /// The point of time to read where there are `count`.
    ///
    /// # Errors
    /// As [`Self::component_of`].
    pub(super) fn time_of(&self, count: usize) -> Result<usize, String> {
        chosen(self.time, count, "points of time", "--time")
    }
}

fn chosen(choice: Option<usize>, count: usize, what: &str, option: &str) -> Result<usize, String> {
    match choice {
        None if count == 1 => Ok(0),
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

impl ReadOptions {
    /// Makes sure that no component and no point of time is chosen of a volume of one.
    pub(super) fn expect_no_place(&self, path: &Path) -> Result<()> {
        expect_none(path, "--component", self.component.is_some(), "a volume of several numbers per voxel")?;
        expect_none(path, "--time", self.time.is_some(), "a volume of several points of time")
    }

    /// Makes sure that nothing is chosen that only DICOM has.
    pub(super) fn expect_no_series(&self, path: &Path) -> Result<()> {
        expect_none(path, "--series", self.series.is_some(), "a folder of DICOM series")?;
        expect_none(path, "--resample", self.resample, "a DICOM series")
    }
}

fn expect_none(path: &Path, option: &str, is_given: bool, expected: &str) -> Result<()> {
    if !is_given {
        return Ok(());
    }
    Err(Error::format(path, format!("expected {expected} for {option}, found none: leave the option out")))
}
