//! Command-line options that say how to read a volume, shared by both programs.

use std::fmt::Debug;
use std::str::FromStr;

use clap::Args;

use crate::io::{RawLayout, ReadOptions, StoredType};

/// Options for a headerless volume; a file with a header needs none.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Headerless input")]
pub struct RawArgs {
    /// Voxels along x, y, z, where x is fastest in the file.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_triple::<u32>)]
    pub dims: Option<[u32; 3]>,
    /// Type of number: u8, i8, u16, i16, u32, i32, f32, f64; with `be` behind it for big-endian [default: the one that
    /// the file's size leaves, if it is only one].
    #[arg(long, value_name = "TYPE", requires = "dims")]
    pub dtype: Option<StoredType>,
    /// Bytes before the first number.
    #[arg(long, value_name = "N", default_value_t = 0, requires = "dims")]
    pub skip_bytes: u64,
    /// How to read any input.
    #[command(flatten)]
    pub choice: ChoiceArgs,
}

/// Options for an input that holds more than one scalar volume, or does not say enough.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Reading the volume")]
pub struct ChoiceArgs {
    /// Distance between voxels along x, y, z, in place of what the file says; 1,1,1 where it says nothing.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_spacing, allow_hyphen_values = true)]
    pub spacing: Option<[f64; 3]>,
    /// Which of several arrays of a VTI file.
    #[arg(long, value_name = "NAME")]
    pub array: Option<String>,
    /// Which of several numbers of each voxel, from 0.
    #[arg(long, value_name = "N")]
    pub component: Option<usize>,
    /// Which point of time, from 0.
    #[arg(long, value_name = "N")]
    pub time: Option<usize>,
    /// Which DICOM series of a folder.
    #[arg(long, value_name = "UID|NUMBER")]
    pub series: Option<String>,
    /// Interpolate DICOM slices that are tilted or unevenly spaced linearly onto a rectangular, even grid.
    #[arg(long)]
    pub resample: bool,
}

impl RawArgs {
    /// How to read a volume by these options.
    #[must_use]
    pub fn read_options(&self) -> ReadOptions {
        let ChoiceArgs { spacing, array, component, time, series, resample } = self.choice.clone();
        let raw = self.layout();
        // A headerless volume says nothing that it could be in the place of.
        let spacing = spacing.filter(|_| raw.is_none());
        ReadOptions { raw, spacing, array, component, time, series, resample }
    }

    fn layout(&self) -> Option<RawLayout> {
        Some(RawLayout {
            dims: self.dims?,
            scalar: self.dtype,
            spacing: self.choice.spacing.unwrap_or([1.0; 3]),
            skip_bytes: self.skip_bytes,
        })
    }
}

/// Reads `A,B,C`.
///
/// # Errors
/// A message for the user.
pub fn parse_triple<T: FromStr + Copy + Debug>(text: &str) -> Result<[T; 3], String> {
    let numbers: Option<Vec<T>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    numbers.and_then(|numbers| <[T; 3]>::try_from(numbers).ok()).ok_or_else(|| "give three numbers as X,Y,Z".into())
}

fn parse_spacing(text: &str) -> Result<[f64; 3], String> {
    let spacing = parse_triple::<f64>(text)?;
    let is_distance = |number: &f64| number.is_finite() && *number > 0.0;
    if spacing.iter().all(is_distance) { Ok(spacing) } else { Err("distances are finite and above 0".into()) }
}
