//! What is read of a file that holds more than one scalar volume, or does not say enough.

use super::raw::RawLayout;

/// How to read a volume; the default reads a file that holds one scalar volume and says everything itself.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadOptions {
    /// The layout of a headerless file; any file is then read as headerless numbers, whatever it looks like.
    pub raw: Option<RawLayout>,
    /// Which of several numbers of a voxel, or channels, counted from 0. Without it only volumes of one are read.
    pub component: Option<usize>,
    /// Which point of time, counted from 0. Without it only volumes of one are read.
    pub time: Option<usize>,
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
