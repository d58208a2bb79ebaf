//! Reader of DICOM series: a folder, or any file in it, is read as one volume.
//!
//! Slices are ordered by their positions along the normal of their planes, never by name. Stored numbers stay in their own
//! type and are mapped by slope and intercept, except that whole Hounsfield units which fit 16 bits are read as such, and
//! that slices whose slopes differ are read as floats; see [`slices::Conversion`]. The world is the patient's, left-posterior-
//! superior, in millimetres.

mod attribute;
mod data_set;
mod image;
mod jpeg;
mod parser;
mod pixel_format;
mod pixels;
mod resampled;
mod rle;
mod series;
mod slices;
mod stack;
mod transfer_syntax;

use std::path::Path;

pub(super) use parser::is_dicom;

use self::resampled::Resampled;
use self::series::Found;
use self::slices::Slices;
use self::stack::Stack;
use super::placement::{FileFrame, Placement};
use super::read_options::ReadOptions;
use super::volume_file::{Numbers, VolumeFile};
use crate::{Error, Result};

/// Reads the series in a folder, or that of one file.
///
/// # Errors
/// As [`super::read_volume`]; [`Error::Format`] too when there is no series or more than one to choose from, and when slices
/// make no rectangular, even grid without [`ReadOptions::resample`].
pub(super) fn read(path: &Path, options: &ReadOptions) -> Result<VolumeFile> {
    options.expect_no_place(path)?;
    let Found { images, notes } = series::find(path, options)?;
    let stack = Stack::new(&images)?;
    let even = stack.even_distance();
    let slices = Slices::new(images, stack);
    let fail = |message: String| Err(Error::format(path, message));
    match even {
        Ok(_) if options.resample => fail(
            "expected a tilted or uneven series for --resample, found a rectangular, even one: leave it out".into(),
        ),
        Ok(distance) => {
            let geometry = placement(&slices.stack, distance).geometry(path)?;
            let [slope, intercept] = slices.mapping();
            Ok(VolumeFile::new(path, geometry, Numbers::Slabs(Box::new(slices)), slope, intercept)?.with_notes(notes))
        }
        Err(wrong) if options.resample => {
            let resampled = Resampled::new(slices)?;
            let notes = [notes, vec![resampled.description(&wrong)]].concat();
            let geometry = resampled.placement().geometry(path)?;
            Ok(VolumeFile::new(path, geometry, Numbers::Slabs(Box::new(resampled)), 1.0, 0.0)?.with_notes(notes))
        }
        Err(wrong) => fail(format!(
            "expected slices straight above one another at even distances, found {wrong}: add what is missing, or give \
             --resample to interpolate linearly onto a rectangular, even grid"
        )),
    }
}

fn placement(stack: &Stack, distance: f64) -> Placement {
    let [x, y] = stack.pixel_spacing;
    let dims = [u32::from(stack.columns), u32::from(stack.rows), stack.heights.len() as u32];
    Placement {
        origin: stack.origin.to_array(),
        direction: stack.axes.map(|axis| axis.to_array()),
        unit: "mm".into(),
        frame: FileFrame::LeftPosteriorSuperior,
        ..Placement::axis_aligned(dims, [x, y, distance])
    }
}
