//! Planes of TIFF pages that have to be decoded: strip by strip, or one row of tiles after the other.

use std::path::{Path, PathBuf};

use ::tiff::decoder::{ChunkType, DecodingResult};
use voxrole_pack::ScalarType;

use super::super::slabs::Slabs;
use super::image_tags::{FileDecoder, ImageTags, broken, open};
use crate::{Error, Result};

/// Most bytes of a row of tiles.
const MAX_BAND_BYTES: usize = 1 << 30;

/// A slice: a page of one of the files and, if its bytes are in one run, where they begin.
#[derive(Clone, Copy, Debug)]
pub struct Plane {
    pub file: usize,
    pub page: usize,
    pub offset: Option<u64>,
}

/// The slices of a volume.
#[derive(Debug)]
pub struct Planes {
    pub files: Vec<PathBuf>,
    pub planes: Vec<Plane>,
    pub tags: ImageTags,
    /// Which of a pixel's numbers is meant.
    pub sample: usize,
}

impl Slabs for Planes {
    fn scalar_type(&self) -> ScalarType {
        self.tags.scalar_type
    }

    fn files(&self) -> &[PathBuf] {
        &self.files
    }

    fn decode(&self, sink: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let mut current: Option<(usize, FileDecoder)> = None;
        for plane in &self.planes {
            let path = &self.files[plane.file];
            let mut decoder = match current.take() {
                Some((file, decoder)) if file == plane.file => decoder,
                _ => open(path)?,
            };
            decoder.seek_to_image(plane.page).map_err(|error| broken(path, error))?;
            self.decode_page(path, &mut decoder, sink)?;
            current = Some((plane.file, decoder));
        }
        Ok(())
    }
}

impl Planes {
    fn decode_page(
        &self,
        path: &Path,
        decoder: &mut FileDecoder,
        sink: &mut dyn FnMut(&[u8]) -> Result<()>,
    ) -> Result<()> {
        let fail = |message: &str| Error::format(path, message.to_owned());
        let (width, height) = (self.tags.width, self.tags.height);
        let (chunk_width, chunk_height) = decoder.chunk_dimensions();
        if decoder.dimensions().ok() != Some((width, height)) || chunk_width == 0 || chunk_height == 0 {
            return Err(fail("expected pages of one size, found that the file has changed or has empty strips"));
        }
        let across = match decoder.get_chunk_type() {
            ChunkType::Strip => 1,
            ChunkType::Tile => width.div_ceil(chunk_width),
        };
        let down = height.div_ceil(chunk_height);
        let number_bytes = self.tags.scalar_type.size_in_bytes();
        let band_bytes = width as usize * chunk_height.min(height) as usize * number_bytes;
        if band_bytes > MAX_BAND_BYTES {
            return Err(fail("expected strips of at most 1 GiB, found larger ones: save the file with more strips"));
        }
        // Where each number of a pixel has a plane of its own, a chunk holds one of them.
        let (plane, sample, samples) = match self.tags.is_planar {
            true => (self.sample as u32, 0, 1),
            false => (0, self.sample, usize::from(self.tags.samples)),
        };
        let mut band = Vec::new();
        for row in 0..down {
            let rows = chunk_height.min(height - row * chunk_height) as usize;
            let row_bytes = width as usize * number_bytes;
            band.clear();
            band.resize(rows * row_bytes, 0);
            for column in 0..across {
                let columns = if across == 1 { width } else { chunk_width.min(width - column * chunk_width) } as usize;
                let chunk = (plane * down + row) * across + column;
                let numbers = decoder.read_chunk(chunk).map_err(|error| broken(path, error))?;
                let picked = Picked { sample, samples, scalar_type: self.tags.scalar_type };
                let bytes =
                    picked.bytes(&numbers).ok_or_else(|| fail("expected numbers of one type, found several"))?;
                if bytes.len() != columns * rows * number_bytes {
                    return Err(fail("expected whole strips and tiles, found one of another size"));
                }
                let start = column as usize * chunk_width as usize * number_bytes;
                for (from, to) in bytes.chunks_exact(columns * number_bytes).zip(band.chunks_exact_mut(row_bytes)) {
                    to[start..start + from.len()].copy_from_slice(from);
                }
            }
            sink(&band)?;
        }
        Ok(())
    }
}

/// Which of the decoded numbers are meant.
struct Picked {
    sample: usize,
    samples: usize,
    scalar_type: ScalarType,
}

impl Picked {
    /// The numbers as little-endian bytes; `None` for another type than was announced.
    fn bytes(&self, numbers: &DecodingResult) -> Option<Vec<u8>> {
        let Self { sample, samples, scalar_type } = *self;
        macro_rules! picked {
            ($values:expr, $variant:ident) => {
                (scalar_type == ScalarType::$variant).then(|| {
                    $values.iter().skip(sample).step_by(samples).flat_map(|value| value.to_le_bytes()).collect()
                })
            };
        }
        match numbers {
            DecodingResult::U8(values) => picked!(values, U8),
            DecodingResult::I8(values) => picked!(values, I8),
            DecodingResult::U16(values) => picked!(values, U16),
            DecodingResult::I16(values) => picked!(values, I16),
            DecodingResult::U32(values) => picked!(values, U32),
            DecodingResult::I32(values) => picked!(values, I32),
            DecodingResult::F32(values) => picked!(values, F32),
            DecodingResult::F64(values) => picked!(values, F64),
            DecodingResult::F16(values) => {
                let values: Vec<f32> = values.iter().map(|value| value.to_f32()).collect();
                picked!(values, F32)
            }
            DecodingResult::U64(_) | DecodingResult::I64(_) => None,
        }
    }
}
