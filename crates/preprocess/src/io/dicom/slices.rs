//! The numbers of an ordered series, slice by slice.

use std::path::PathBuf;

use rayon::prelude::*;
use voxrole_pack::ScalarType;

use super::image::Image;
use super::pixels;
use super::stack::Stack;
use crate::Result;
use crate::io::slabs::Slabs;

/// Memory for slices that are decoded at a time.
const BATCH_BYTES: usize = 64 << 20;
/// Bits of a whole number that 32-bit floats hold exactly.
const F32_BITS: u32 = 24;

/// What becomes of the numbers that files store.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Conversion {
    /// Nothing: one slope and intercept for all slices map them.
    Stored { slope: f64, intercept: f64 },
    /// The intercept is added, to whole numbers of 16 bits: Hounsfield units as every program of the field shows them.
    Shifted,
    /// Slope and intercept are applied, since they differ between slices: 32-bit floats round by at most 6e-8 of the value.
    /// Numbers of more than 24 bits become 64-bit floats.
    Physical(ScalarType),
}

impl Conversion {
    /// What suits all frames of `images`, at least one.
    pub fn new(images: &[Image]) -> Self {
        let frames = || images.iter().flat_map(|image| image.frames.iter().map(move |frame| (&image.format, frame)));
        let (format, first) = (&images[0].format, &images[0].frames[0]);
        let [slope, intercept] = first.rescale;
        let is_uniform = frames()
            .all(|(other, frame)| other.scalar_type() == format.scalar_type() && frame.rescale == first.rescale);
        if is_uniform && slope == 1.0 && intercept == 0.0 {
            return Self::Stored { slope, intercept };
        }
        let limits = [f64::from(i16::MIN), f64::from(i16::MAX)];
        let fits = frames().all(|(format, frame)| {
            let [slope, intercept] = frame.rescale;
            let ends = format.range().map(|end| end as f64 + intercept);
            slope == 1.0 && intercept.fract() == 0.0 && ends.iter().all(|end| (limits[0]..=limits[1]).contains(end))
        });
        if fits {
            return Self::Shifted;
        }
        if is_uniform {
            return Self::Stored { slope, intercept };
        }
        let is_long = images.iter().any(|image| {
            let [low, high] = image.format.range();
            high.max(-low) > 1 << F32_BITS
        });
        Self::Physical(if is_long { ScalarType::F64 } else { ScalarType::F32 })
    }

    /// Slope and intercept from the numbers given to physical values.
    pub fn mapping(self) -> [f64; 2] {
        match self {
            Self::Stored { slope, intercept } => [slope, intercept],
            Self::Shifted | Self::Physical(_) => [1.0, 0.0],
        }
    }
}

/// An ordered series.
#[derive(Debug)]
pub(super) struct Slices {
    pub images: Vec<Image>,
    pub stack: Stack,
    conversion: Conversion,
    files: Vec<PathBuf>,
}

impl Slices {
    pub fn new(images: Vec<Image>, stack: Stack) -> Self {
        let conversion = Conversion::new(&images);
        // The first slice's file is the one to complain of.
        let first = stack.order[0][0];
        let mut files: Vec<PathBuf> = images.iter().map(|image| image.path.clone()).collect();
        files.swap(0, first);
        Self { images, stack, conversion, files }
    }

    /// Slope and intercept of the whole volume.
    pub fn mapping(&self) -> [f64; 2] {
        self.conversion.mapping()
    }

    /// Physical values of slice `k`; NaN where nothing was measured.
    pub fn physical(&self, k: usize) -> Result<Vec<f32>> {
        let [file, frame] = self.stack.order[k];
        let image = &self.images[file];
        let [slope, intercept] = image.frames[frame].rescale;
        let bytes = pixels::unpacked(image, frame)?;
        let value = |number: i64| {
            if image.format.is_padding(number) { f32::NAN } else { (slope * number as f64 + intercept) as f32 }
        };
        Ok(image.format.numbers(&bytes).map(value).collect())
    }

    /// Bytes of slice `k`.
    fn slice(&self, k: usize) -> Result<Vec<u8>> {
        let [file, frame] = self.stack.order[k];
        let image = &self.images[file];
        let format = &image.format;
        let [slope, intercept] = image.frames[frame].rescale;
        let bytes = pixels::unpacked(image, frame)?;
        let numbers = format.numbers(&bytes);
        Ok(match (self.conversion, format.bytes) {
            (Conversion::Stored { .. }, 1) => numbers.map(|number| number as u8).collect(),
            (Conversion::Stored { .. }, 2) => numbers.flat_map(|number| (number as u16).to_le_bytes()).collect(),
            (Conversion::Stored { .. }, _) => numbers.flat_map(|number| (number as u32).to_le_bytes()).collect(),
            (Conversion::Shifted, _) => {
                let intercept = intercept as i64;
                numbers.flat_map(|number| ((number + intercept) as i16).to_le_bytes()).collect()
            }
            (Conversion::Physical(ScalarType::F64), _) => {
                numbers.flat_map(|number| (slope * number as f64 + intercept).to_le_bytes()).collect()
            }
            (Conversion::Physical(_), _) => {
                numbers.flat_map(|number| ((slope * number as f64 + intercept) as f32).to_le_bytes()).collect()
            }
        })
    }
}

impl Slabs for Slices {
    fn scalar_type(&self) -> ScalarType {
        match self.conversion {
            Conversion::Stored { .. } => self.images[0].format.scalar_type(),
            Conversion::Shifted => ScalarType::I16,
            Conversion::Physical(scalar_type) => scalar_type,
        }
    }

    fn files(&self) -> &[PathBuf] {
        &self.files
    }

    fn decode(&self, sink: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let slice_bytes = self.images[0].format.pixels() * size_of::<f64>();
        let batch = (BATCH_BYTES / slice_bytes).clamp(1, rayon::current_num_threads());
        let slices: Vec<usize> = (0..self.stack.order.len()).collect();
        for batch in slices.chunks(batch) {
            let decoded: Vec<Result<Vec<u8>>> = batch.par_iter().map(|&k| self.slice(k)).collect();
            decoded.into_iter().try_for_each(|slice| sink(&slice?))?;
        }
        Ok(())
    }
}
