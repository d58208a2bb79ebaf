//! One DICOM file that holds images: what it says of each of its frames.

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::attribute::{self as at, Attribute};
use super::data_set::{DataSet, Result};
use super::parser::{Parsed, Pixels};
use super::pixel_format::PixelFormat;
use crate::Error;

/// What files of one series have in common.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Series {
    pub uid: String,
    pub number: String,
    pub modality: String,
    pub description: String,
}

/// A file of images.
#[derive(Debug)]
pub(super) struct Image {
    pub path: PathBuf,
    pub pixels: Pixels,
    pub format: PixelFormat,
    /// In the order of the file, at least one.
    pub frames: Vec<Frame>,
}

/// Where one frame lies, and what its numbers mean.
#[derive(Clone, Debug)]
pub(super) struct Frame {
    /// Centre of its first pixel, in millimetres.
    pub position: DVec3,
    /// Directions along its rows and down its columns.
    pub axes: [DVec3; 2],
    /// Distance of pixels along its rows and down its columns, in millimetres.
    pub spacing: [f64; 2],
    /// Slope and intercept.
    pub rescale: [f64; 2],
}

/// By how much the length of a direction may differ from 1, and two from right angles: decimals are rounded.
const ORTHONORMAL_TOLERANCE: f64 = 1e-3;

impl Series {
    pub fn new(attributes: &DataSet) -> Self {
        let text = |attribute| attributes.text(attribute).unwrap_or_default();
        Self {
            uid: text(at::SERIES_UID),
            number: text(at::SERIES_NUMBER),
            modality: text(at::MODALITY),
            description: text(at::SERIES_DESCRIPTION),
        }
    }
}

impl Image {
    /// What `parsed` says, whose pixels are `pixels`.
    ///
    /// # Errors
    /// [`Error::Format`] for images that are no slices of a scalar volume.
    pub fn new(path: &Path, parsed: &Parsed, pixels: Pixels) -> crate::Result<Self> {
        let fail = |message| Error::format(path, message);
        let attributes = &parsed.attributes;
        let format = PixelFormat::new(attributes, &parsed.transfer_syntax).map_err(fail)?;
        let frames = frames(attributes).map_err(fail)?;
        format.check_length(&pixels, frames.len()).map_err(fail)?;
        Ok(Self { path: path.to_owned(), pixels, format, frames })
    }
}

fn frames(attributes: &DataSet) -> Result<Vec<Frame>> {
    let groups = attributes.items(at::FRAME_GROUPS);
    let count = match attributes.decimal(at::FRAMES)? {
        None => 1,
        Some(count) if count >= 1.0 && count.fract() == 0.0 && count <= f64::from(u32::MAX) => count as usize,
        Some(count) => return Err(format!("NumberOfFrames: expected a count from 1 up, found {count}")),
    };
    if count != groups.len() && (count > 1 || groups.len() > 1) {
        return Err(format!(
            "expected a position for each of the {count} frames of this file ({}), found {}: split it into slices first, or \
             convert it, for example with dcm2niix",
            at::FRAME_GROUPS.name,
            groups.len()
        ));
    }
    let shared = attributes.items(at::SHARED_GROUPS).first();
    let nothing = DataSet::default();
    let frame = |group: &DataSet| Source { group, shared: shared.unwrap_or(&nothing), file: attributes }.frame();
    if groups.is_empty() { Ok(vec![frame(&nothing)?]) } else { groups.iter().map(frame).collect() }
}

/// Where the attributes of a frame are: its own group, that of all frames, or the file's as in files of one frame.
struct Source<'a> {
    group: &'a DataSet,
    shared: &'a DataSet,
    file: &'a DataSet,
}

impl Source<'_> {
    fn decimals<const N: usize>(&self, sequence: Attribute, attribute: Attribute) -> Result<Option<[f64; N]>> {
        let nested = [self.group, self.shared].into_iter().filter_map(|groups| groups.items(sequence).first());
        for set in nested.chain([self.file]) {
            if let Some(numbers) = set.decimals(attribute)? {
                return Ok(Some(numbers));
            }
        }
        Ok(None)
    }

    fn required<const N: usize>(&self, sequence: Attribute, attribute: Attribute) -> Result<[f64; N]> {
        self.decimals(sequence, attribute)?.ok_or_else(|| {
            format!(
                "expected the attribute {}, found none: without it the image has no place in a volume (is it a radiograph, a \
                 screenshot or a localizer?)",
                attribute.name
            )
        })
    }

    fn frame(&self) -> Result<Frame> {
        let position: [f64; 3] = self.required(at::POSITION_SEQUENCE, at::POSITION)?;
        let orientation: [f64; 6] = self.required(at::ORIENTATION_SEQUENCE, at::ORIENTATION)?;
        let [down, along]: [f64; 2] = self.required(at::MEASURES_SEQUENCE, at::PIXEL_SPACING)?;
        let [xx, xy, xz, yx, yy, yz] = orientation;
        let (x, y) = (DVec3::new(xx, xy, xz), DVec3::new(yx, yy, yz));
        let deviation = [x.length() - 1.0, y.length() - 1.0, x.dot(y)];
        if deviation.iter().any(|deviation| deviation.abs() > ORTHONORMAL_TOLERANCE) {
            return Err(format!(
                "{}: expected two unit vectors at right angles, found {orientation:?}",
                at::ORIENTATION.name
            ));
        }
        if !(along > 0.0 && down > 0.0) {
            return Err(format!("{}: expected positive lengths, found {down} and {along}", at::PIXEL_SPACING.name));
        }
        let slope = self.decimals::<1>(at::RESCALE_SEQUENCE, at::SLOPE)?.map_or(1.0, |[slope]| slope);
        let intercept = self.decimals::<1>(at::RESCALE_SEQUENCE, at::INTERCEPT)?.map_or(0.0, |[intercept]| intercept);
        if slope == 0.0 {
            return Err(format!("{}: expected a number other than 0, found 0", at::SLOPE.name));
        }
        Ok(Frame {
            position: DVec3::from_array(position),
            axes: [x, y],
            spacing: [along, down],
            rescale: [slope, intercept],
        })
    }
}
