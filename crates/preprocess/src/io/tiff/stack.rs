//! What the planes of a file mean: slices, channels, points of time, and their spacing.

use std::path::Path;

use super::image_tags::Pages;
use super::{imagej, ome};
use crate::{Error, Result};

/// The planes of a file by channel, slice and point of time.
#[derive(Clone, Debug, PartialEq)]
pub struct Stack {
    pub channels: usize,
    pub slices: usize,
    pub times: usize,
    /// The plane of each channel, slice and time, channels fastest, then slices.
    pub planes: Vec<usize>,
    pub spacing: [f64; 3],
    pub unit: String,
    pub slope: f64,
    pub intercept: f64,
}

impl Stack {
    /// What the descriptions of ImageJ or OME say or, where there is none, slices of unknown spacing: resolutions of plain
    /// TIFF tell how large to print.
    ///
    /// # Errors
    /// [`Error::Format`] for descriptions that do not fit the pages.
    pub fn of(path: &Path, pages: &Pages) -> Result<Self> {
        if let Some(description) = imagej::Description::parse(&pages.description) {
            return Self::of_imagej(path, pages, &description);
        }
        if ome::is_description(&pages.description) {
            return ome::stack(path, pages);
        }
        Ok(Self::in_order(1, pages.count(), 1))
    }

    /// Planes in ImageJ's order, of unknown spacing.
    pub fn in_order(channels: usize, slices: usize, times: usize) -> Self {
        let planes = (0..channels * slices * times).collect();
        let (spacing, unit) = ([1.0; 3], String::new());
        Self { channels, slices, times, planes, spacing, unit, slope: 1.0, intercept: 0.0 }
    }

    /// The plane of a channel, slice and point of time.
    pub fn plane(&self, [channel, slice, time]: [usize; 3]) -> usize {
        self.planes[(time * self.slices + slice) * self.channels + channel]
    }

    fn of_imagej(path: &Path, pages: &Pages, description: &imagej::Description<'_>) -> Result<Self> {
        let count = |name, default| {
            let message =
                || format!("expected a count of {name} in ImageJ's description, found no whole number from 1 up");
            description.count(name, default).ok_or_else(|| Error::format(path, message()))
        };
        let images = count("images", 1)?;
        let (channels, times) = (count("channels", 1)?, count("frames", 1)?);
        let per_slice = channels.saturating_mul(times);
        // Old versions write nothing but `images`.
        let slices = count("slices", if per_slice == 1 { images } else { 1 })?;
        let planes = per_slice.saturating_mul(slices);
        if planes != images || (images != pages.count()) {
            let found = pages.count();
            let message = format!(
                "expected {images} pages by ImageJ's description ({channels} channels, {slices} slices, {times} frames), found {found}"
            );
            return Err(Error::format(path, message));
        }
        let step = |axis: usize| pages.resolution[axis].map_or(1.0, |resolution| 1.0 / resolution);
        let depth = description.number("spacing").map(f64::abs).filter(|&spacing| spacing > 0.0).unwrap_or(1.0);
        let (slope, intercept) = description.calibration().unwrap_or((1.0, 0.0));
        let spacing = [step(0), step(1), depth];
        Ok(Self { spacing, unit: description.unit(), slope, intercept, ..Self::in_order(channels, slices, times) })
    }
}
