//! Slices put into order: what makes a volume of them, or why they make none.

use std::path::Path;

use glam::DVec3;

use super::image::{Frame, Image};
use crate::{Error, Result};

/// By how much slices may be off an even grid, in multiples of their distance: decimals are rounded, and 0.02 voxels move no
/// boundary that matters.
const DISTANCE_TOLERANCE: f64 = 0.02;
/// By how much slices may lie closer than this multiple of the usual distance and still be two.
const SAME_PLACE: f64 = 0.01;
/// Tangent of the angle between the normal of the slices and the line on which they lie that is rounding: 0.1 degrees.
const TILT_TOLERANCE: f64 = 0.002;
/// By how much slices may lie beside that line, in pixels.
const SHIFT_TOLERANCE: f64 = 0.1;
/// By how much directions may differ between slices, and pixel spacings, relatively.
const SAME_PLANE: f64 = 1e-4;

/// The frames of a series in the order of their positions along their common normal.
#[derive(Debug)]
pub(super) struct Stack {
    /// The file of each, and which frame of it.
    pub order: Vec<[usize; 2]>,
    pub columns: u16,
    pub rows: u16,
    /// Distance of pixels along rows and down columns.
    pub pixel_spacing: [f64; 2],
    pub origin: DVec3,
    /// Directions along rows, down columns, and of the normal, which is that from slice to slice.
    pub axes: [DVec3; 3],
    /// Position along the normal, from the first slice on: ascending.
    pub heights: Vec<f64>,
    /// By how much each slice is shifted along rows and down columns against the first.
    pub shifts: Vec<[f64; 2]>,
}

impl Stack {
    /// Orders all frames of `images`, at least one.
    ///
    /// # Errors
    /// [`Error::Format`] where they differ in size, orientation or pixel spacing, or two lie at one place.
    pub fn new(images: &[Image]) -> Result<Self> {
        let (first, frame) = (&images[0], &images[0].frames[0]);
        let normal = frame.axes[0].cross(frame.axes[1]).normalize();
        for image in images {
            for other in &image.frames {
                check_alike([first, image], [frame, other])?;
            }
        }
        let mut order: Vec<[usize; 2]> = Vec::new();
        for (file, image) in images.iter().enumerate() {
            order.extend((0..image.frames.len()).map(|frame| [file, frame]));
        }
        let position = |[file, frame]: [usize; 2]| images[file].frames[frame].position;
        order.sort_by(|a, b| position(*a).dot(normal).total_cmp(&position(*b).dot(normal)));
        let origin = position(order[0]);
        let offsets: Vec<DVec3> = order.iter().map(|slice| position(*slice) - origin).collect();
        let stack = Self {
            columns: first.format.columns,
            rows: first.format.rows,
            pixel_spacing: frame.spacing,
            origin,
            axes: [frame.axes[0], frame.axes[1], normal],
            heights: offsets.iter().map(|offset| offset.dot(normal)).collect(),
            shifts: offsets.iter().map(|offset| frame.axes.map(|axis| offset.dot(axis))).collect(),
            order,
        };
        stack.check_places(images)?;
        Ok(stack)
    }

    /// Distances between neighbouring slices.
    fn gaps(&self) -> Vec<f64> {
        self.heights.windows(2).map(|pair| pair[1] - pair[0]).collect()
    }

    /// The median of the distances between neighbouring slices; `None` for a single slice.
    pub fn usual_gap(&self) -> Option<f64> {
        let mut gaps = self.gaps();
        gaps.sort_by(f64::total_cmp);
        gaps.get(gaps.len().saturating_sub(1) / 2).copied()
    }

    /// Makes sure that no two slices lie at one place.
    fn check_places(&self, images: &[Image]) -> Result<()> {
        let total = self.heights[self.heights.len() - 1];
        let usual = self.usual_gap().unwrap_or(1.0).max(total / self.heights.len() as f64);
        let doubled: Vec<usize> =
            (1..self.heights.len()).filter(|&k| self.heights[k] - self.heights[k - 1] <= SAME_PLACE * usual).collect();
        let Some(&k) = doubled.first() else { return Ok(()) };
        let name = |k: usize| {
            let [file, frame] = self.order[k];
            let file = images[file].path.file_name().unwrap_or_default().to_string_lossy();
            if images[self.order[k][0]].frames.len() > 1 { format!("{file} frame {}", frame + 1) } else { file.into() }
        };
        Err(Error::format(
            self.path(images),
            format!(
                "expected one slice at each place, found {} of {} at the place of another, such as {} and {} at {:.3} mm: \
                 put copies, points of time and repeated scans into folders of their own",
                doubled.len(),
                self.heights.len(),
                name(k - 1),
                name(k),
                (self.origin + self.axes[2] * self.heights[k]).dot(self.axes[2])
            ),
        ))
    }

    /// The file to complain of.
    fn path<'a>(&self, images: &'a [Image]) -> &'a Path {
        &images[self.order[0][0]].path
    }

    /// The distance between slices, if they make a rectangular, even grid; else what is wrong, with figures.
    pub fn even_distance(&self) -> std::result::Result<f64, String> {
        let (Some(usual), count) = (self.usual_gap(), self.heights.len()) else { return Ok(1.0) };
        let mean = self.heights[count - 1] / (count - 1) as f64;
        let mut wrong = Vec::new();
        let off = |(k, height): (usize, &f64)| (height - mean * k as f64).abs() > DISTANCE_TOLERANCE * mean;
        if self.heights.iter().enumerate().any(off) {
            wrong.push(self.unevenness(usual));
        }
        let [tilt, scatter] = self.tilt();
        if tilt > TILT_TOLERANCE {
            wrong.push(format!("a gantry tilt of {:.1} degrees", tilt.atan().to_degrees()));
        }
        if scatter > SHIFT_TOLERANCE {
            wrong.push(format!("slices up to {scatter:.1} pixels beside the line of the others"));
        }
        if wrong.is_empty() { Ok(mean) } else { Err(wrong.join(" and ")) }
    }

    fn unevenness(&self, usual: f64) -> String {
        let gaps = self.gaps();
        let multiple = |gap: &f64| (gap / usual).round();
        let is_multiple = |gap: &f64| (gap / usual - multiple(gap)).abs() < 2.0 * DISTANCE_TOLERANCE;
        let missing: f64 = gaps.iter().map(|gap| multiple(gap) - 1.0).sum();
        if missing >= 1.0 && gaps.iter().all(is_multiple) {
            let first = gaps.iter().position(|gap| multiple(gap) > 1.0).unwrap_or_default();
            let place = (self.origin + self.axes[2] * self.heights[first]).dot(self.axes[2]);
            return format!(
                "gaps where {missing} slices are missing, the first behind slice {} at {place:.3} mm (others are {usual:.3} mm \
                 apart)",
                first + 1
            );
        }
        let ends = gaps.iter().fold([f64::MAX, 0.0_f64], |[low, high], &gap| [low.min(gap), high.max(gap)]);
        format!("distances of {:.3} to {:.3} mm between slices (mostly {usual:.3})", ends[0], ends[1])
    }

    /// Tangent of the angle by which the stack leans, and the farthest that a slice lies beside its line, in pixels.
    fn tilt(&self) -> [f64; 2] {
        let square: f64 = self.heights.iter().map(|height| height * height).sum();
        let lean = [0, 1].map(|axis| {
            self.heights.iter().zip(&self.shifts).map(|(height, shift)| height * shift[axis]).sum::<f64>() / square
        });
        let beside = self.heights.iter().zip(&self.shifts).flat_map(|(height, shift)| {
            [0, 1].map(|axis| (shift[axis] - lean[axis] * height).abs() / self.pixel_spacing[axis])
        });
        [lean[0].hypot(lean[1]), beside.fold(0.0, f64::max)]
    }
}

/// Makes sure that two frames can be slices of one volume.
fn check_alike(files: [&Image; 2], frames: [&Frame; 2]) -> Result<()> {
    let [a, b] = frames;
    let sizes = files.map(|file| [file.format.columns, file.format.rows]);
    let differ = |what: &str, found: String, expected: String| {
        let other = files[0].path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Error::format(
            &files[1].path,
            format!(
                "expected {what} {expected} as in {other}, found {found}: put slices that belong together into a folder of \
                 their own"
            ),
        )
    };
    if sizes[0] != sizes[1] {
        let size = |[x, y]: [u16; 2]| format!("{x} x {y}");
        return Err(differ("an image of", size(sizes[1]), size(sizes[0])));
    }
    if (0..2).any(|axis| (a.axes[axis] - b.axes[axis]).length() > SAME_PLANE) {
        let show = |frame: &Frame| {
            let [x, y] = frame.axes;
            format!("{:.4?}", [x.x, x.y, x.z, y.x, y.y, y.z])
        };
        return Err(differ("the orientation", show(b), show(a)));
    }
    if (0..2).any(|axis| (a.spacing[axis] - b.spacing[axis]).abs() > SAME_PLANE * a.spacing[axis]) {
        return Err(differ("a pixel spacing of", format!("{:?}", b.spacing), format!("{:?}", a.spacing)));
    }
    Ok(())
}
