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

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::Grid;
    use crate::io::slabs;

    /// A real series that makes no grid: its numbers and places all the same. `VOXROLE_REAL_DATA` names the folder.
    #[test]
    fn the_tilted_series_has_its_numbers_and_places() {
        let Some(folder) = std::env::var_os("VOXROLE_REAL_DATA") else {
            eprintln!("skipped: VOXROLE_REAL_DATA does not name a folder of real volumes");
            return;
        };
        let found = series::find(&PathBuf::from(folder).join("ct_tilt_dicom"), &ReadOptions::default());
        let images = found.unwrap_or_else(|error| panic!("{error}")).images;
        let stack = Stack::new(&images).unwrap_or_else(|error| panic!("{error}"));
        let gaps: Vec<f64> = stack.heights.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let expected = [[4.002; 13].as_slice(), &[1.081], &[6.999; 13]].concat();
        assert!(gaps.iter().zip(&expected).all(|(gap, expected)| (gap - expected).abs() < 1e-3), "{gaps:?}");
        // As SimpleITK 2.5 has them.
        let origin = [-125.0, -123.5404569, 5.8360586];
        let direction =
            [[1.0, 0.0, 0.0], [0.0, 0.948323646598, -0.317304682132], [0.0, 0.317304682132, 0.948323646598]];
        let geometry = placement(&stack, 1.0).geometry(Path::new("tilt")).expect("a grid");
        let off = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off(&geometry.origin, &origin) < 1e-9, "{:?}", geometry.origin);
        assert!(off(geometry.direction.as_flattened(), direction.as_flattened()) < 1e-6, "{:?}", geometry.direction);
        let scalars =
            slabs::read(&Slices::new(images, stack), [512, 512, 28]).unwrap_or_else(|error| panic!("{error}"));
        let grid = Grid::new("tilt", geometry, scalars).expect("a volume");
        let sha256: String = grid.voxels_sha256().iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(sha256, "b9f11236dfdde50d12b3566822e91d0ab3effd7e3f3b5f086bea6384932e19c1");
    }
}
