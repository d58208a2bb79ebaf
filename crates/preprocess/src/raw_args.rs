//! Command-line options that describe a headerless volume, shared by both programs.

use std::fmt::Debug;
use std::str::FromStr;

use clap::Args;

use crate::io::{RawLayout, ReadOptions, StoredType};

/// Options for a headerless volume; a file with a header needs none.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Headerless input")]
pub struct RawArgs {
    /// Voxels along x, y, z, where x is fastest in the file.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_triple::<u32>, requires = "dtype")]
    pub dims: Option<[u32; 3]>,
    /// Type of number: u8, i8, u16, i16, u32, i32, f32, f64; with `be` behind it for big-endian.
    #[arg(long, value_name = "TYPE", requires = "dims")]
    pub dtype: Option<StoredType>,
    /// Distance between voxels along x, y, z [default: 1,1,1].
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_triple::<f64>, requires = "dims", allow_hyphen_values = true)]
    pub spacing: Option<[f64; 3]>,
    /// Bytes before the first number.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub skip_bytes: u64,
}

impl RawArgs {
    /// How to read a volume by these options.
    #[must_use]
    pub fn read_options(&self) -> ReadOptions {
        ReadOptions { raw: self.layout(), ..ReadOptions::default() }
    }

    fn layout(&self) -> Option<RawLayout> {
        Some(RawLayout {
            dims: self.dims?,
            scalar: self.dtype?,
            spacing: self.spacing.unwrap_or([1.0; 3]),
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
