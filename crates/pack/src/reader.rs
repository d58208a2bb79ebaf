//! Reads a packed file.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Mutex;

use rayon::prelude::*;

use crate::brick::BrickGrid;
use crate::codec::{self, MAX_DIRECTORY_BYTES, MAX_HEADER_BYTES};
use crate::compression;
use crate::directory::{BrickEntry, Directory, Extent, Section};
use crate::error::vec_with_capacity;
use crate::header::Header;
use crate::histogram::{Histogram, HistogramKind};
use crate::layer::{Layer, LayerKind, Quantization};
use crate::prologue::{PROLOGUE_BYTES, Prologue, TableExtent};
use crate::scalar::{Scalar, ScalarType};
use crate::{DistanceQuantization, Error, HitGradientQuantization, Limits, Result, Scalars};

/// An open packed file: header and directory are read and checked, bricks are read when asked for.
pub struct Reader {
    file: Mutex<File>,
    file_bytes: u64,
    header: Header,
    directory: Directory,
}

/// What [`Reader::verify`] looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Verified {
    /// Bricks whose checksum and content are sound.
    pub bricks: u64,
    /// Bytes of the file, all of them covered by a checksum.
    pub bytes: u64,
}

impl Reader {
    /// Opens a file within default [`Limits`].
    ///
    /// # Errors
    /// As [`Self::open_with`].
    pub fn open(path: &Path) -> Result<Self> {
        Self::open_with(path, &Limits::default())
    }

    /// Opens a file and checks prologue, header and directory.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be read, [`Error::Format`] when it is damaged or another kind of file,
    /// [`Error::LimitsExceeded`] when it asks for more than `limits`.
    pub fn open_with(path: &Path, limits: &Limits) -> Result<Self> {
        let mut file = File::open(path).map_err(Error::io("opening"))?;
        let file_bytes = file.metadata().map_err(Error::io("opening"))?.len();
        let mut prologue = [0; PROLOGUE_BYTES];
        file.read_exact(&mut prologue).map_err(|error| match error.kind() {
            std::io::ErrorKind::UnexpectedEof => Error::Format(format!(
                "{file_bytes} bytes long: too short for a packed file, which starts with {PROLOGUE_BYTES}"
            )),
            _ => Error::io("reading the first bytes")(error),
        })?;
        let prologue = Prologue::from_bytes(&prologue)?;
        if prologue.file_bytes != file_bytes {
            return Err(Error::Format(format!(
                "{file_bytes} bytes long, but written as {}: cut short or added to",
                prologue.file_bytes
            )));
        }
        let header: Header = codec::decode::<_, MAX_HEADER_BYTES>(
            &read_table(&mut file, file_bytes, prologue.header, MAX_HEADER_BYTES, "the header")?,
            "the header",
        )?;
        header.validate(limits)?;
        let directory: Directory = codec::decode::<_, MAX_DIRECTORY_BYTES>(
            &read_table(&mut file, file_bytes, prologue.directory, MAX_DIRECTORY_BYTES, "the directory")?,
            "the directory",
        )?;
        let reader = Self { file: Mutex::new(file), file_bytes, header, directory };
        reader.check_directory(&prologue)?;
        Ok(reader)
    }

    /// What the file says of itself.
    #[must_use]
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Where everything lies.
    #[must_use]
    pub fn directory(&self) -> &Directory {
        &self.directory
    }

    /// Length of the file.
    #[must_use]
    pub fn file_bytes(&self) -> u64 {
        self.file_bytes
    }

    /// All stored numbers of a layer, x fastest.
    ///
    /// # Errors
    /// [`Error::Parameter`] when the file has no such layer or it is of another type; [`Error::Format`], naming the
    /// brick, when one is damaged; [`Error::Io`] when memory or the disk fails.
    pub fn read_layer<T: Scalar>(&self, kind: LayerKind) -> Result<Vec<T>> {
        let (index, layer) = self.header.layer(kind)?;
        if layer.scalar_type != T::TYPE {
            return Err(Error::Parameter(format!(
                "layer `{}` is stored as {}, not {}",
                kind.name(),
                layer.scalar_type.name(),
                T::TYPE.name()
            )));
        }
        let grid = BrickGrid::new(self.header.geometry.dims_usize());
        let voxels = self.header.geometry.voxel_count();
        let mut dense = vec_with_capacity(voxels, kind.name())?;
        dense.resize(voxels, T::default());
        for first in (0..grid.len()).step_by(64) {
            let bricks: Vec<(usize, Vec<T>)> = (first..(first + 64).min(grid.len()))
                .into_par_iter()
                .map(|brick| Ok((brick, self.read_brick(index, brick, &grid)?)))
                .collect::<Result<_>>()?;
            for (brick, values) in bricks {
                let mut rest = values.as_slice();
                for row in grid.rows(brick) {
                    let (head, tail) = rest.split_at(row.len());
                    dense[row].copy_from_slice(head);
                    rest = tail;
                }
            }
        }
        Ok(dense)
    }

    /// The input's numbers in their own type, with the factor and offset that make them physical.
    ///
    /// # Errors
    /// As [`Self::read_layer`].
    pub fn read_value(&self) -> Result<(Scalars, f64, f64)> {
        let kind = LayerKind::Value;
        let (_, layer) = self.header.layer(kind)?;
        let Quantization::Linear { slope, intercept } = layer.quantization else {
            return Err(self.wrong_quantization(layer));
        };
        let scalars = match layer.scalar_type {
            ScalarType::U8 => Scalars::U8(self.read_layer(kind)?),
            ScalarType::I8 => Scalars::I8(self.read_layer(kind)?),
            ScalarType::U16 => Scalars::U16(self.read_layer(kind)?),
            ScalarType::I16 => Scalars::I16(self.read_layer(kind)?),
            ScalarType::U32 => Scalars::U32(self.read_layer(kind)?),
            ScalarType::I32 => Scalars::I32(self.read_layer(kind)?),
            ScalarType::F32 => Scalars::F32(self.read_layer(kind)?),
            ScalarType::F64 => Scalars::F64(self.read_layer(kind)?),
        };
        Ok((scalars, slope, intercept))
    }

    /// How the distance layer is stored.
    ///
    /// # Errors
    /// [`Error::Parameter`] when the file has none.
    pub fn distance_quantization(&self) -> Result<DistanceQuantization> {
        match self.header.layer(LayerKind::Distance)?.1 {
            Layer { quantization: Quantization::Distance(quantization), .. } => Ok(*quantization),
            layer => Err(self.wrong_quantization(layer)),
        }
    }

    /// How the layer of gradient magnitudes at the hit is stored.
    ///
    /// # Errors
    /// [`Error::Parameter`] when the file has none.
    pub fn hit_gradient_quantization(&self) -> Result<HitGradientQuantization> {
        match self.header.layer(LayerKind::HitGradient)?.1 {
            Layer { quantization: Quantization::HitGradient(quantization), .. } => Ok(*quantization),
            layer => Err(self.wrong_quantization(layer)),
        }
    }

    /// One histogram.
    ///
    /// # Errors
    /// [`Error::Parameter`] when the file has none of that kind, [`Error::Format`] when it is damaged.
    pub fn read_histogram(&self, kind: HistogramKind) -> Result<Histogram> {
        let index = self
            .header
            .histograms
            .iter()
            .position(|shape| shape.kind == kind)
            .ok_or_else(|| Error::Parameter(format!("the file has no histogram `{}`", kind.name())))?;
        self.read_histogram_at(index)
    }

    /// Reads everything and checks every byte.
    ///
    /// # Errors
    /// The first damage found, by brick and layer.
    pub fn verify(&self) -> Result<Verified> {
        let grid = BrickGrid::new(self.header.geometry.dims_usize());
        for (index, layer) in self.header.layers.iter().enumerate() {
            (0..grid.len()).into_par_iter().try_for_each(|brick| match layer.scalar_type {
                ScalarType::U8 | ScalarType::I8 => self.read_brick::<u8>(index, brick, &grid).map(drop),
                ScalarType::U16 | ScalarType::I16 => self.read_brick::<u16>(index, brick, &grid).map(drop),
                ScalarType::U32 | ScalarType::I32 | ScalarType::F32 => {
                    self.read_brick::<u32>(index, brick, &grid).map(drop)
                }
                ScalarType::F64 => self.read_brick::<f64>(index, brick, &grid).map(drop),
            })?;
        }
        for index in 0..self.header.histograms.len() {
            self.read_histogram_at(index)?;
        }
        Ok(Verified { bricks: (self.header.layers.len() * grid.len()) as u64, bytes: self.file_bytes })
    }

    fn read_histogram_at(&self, index: usize) -> Result<Histogram> {
        let shape = self.header.histograms[index].clone();
        let extent = self.directory.histograms[index];
        let name = || format!("histogram `{}`", shape.kind.name());
        let bins = shape.bin_count().unwrap_or(0) as usize;
        let counts = compression::unpack(extent.encoding, &self.read_extent(extent, &name)?, bins)
            .map_err(|error| named(error, &name()))?;
        Ok(Histogram { shape, counts })
    }

    fn read_brick<T: Scalar>(&self, layer: usize, brick: usize, grid: &BrickGrid) -> Result<Vec<T>> {
        let BrickEntry { extent, .. } = self.directory.layers[layer][brick];
        let name = || format!("brick {brick} of layer `{}`", self.header.layers[layer].kind.name());
        let stored = self.read_extent(extent, &name)?;
        compression::unpack(extent.encoding, &stored, grid.voxel_count(brick)).map_err(|error| named(error, &name()))
    }

    fn read_extent(&self, extent: Extent, name: &dyn Fn() -> String) -> Result<Vec<u8>> {
        let mut bytes = vec![0; extent.stored_bytes as usize];
        {
            // A poisoned lock only means that another thread panicked between seek and read: both are done anew here.
            let mut file = self.file.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            file.seek(SeekFrom::Start(extent.offset))
                .and_then(|_| file.read_exact(&mut bytes))
                .map_err(Error::io(format!("reading {}", name())))?;
        }
        let computed = crc32fast::hash(&bytes);
        if computed != extent.crc32 {
            return Err(Error::Format(format!(
                "{} is damaged: checksum {:08x} is stored, {computed:08x} computed; prepare the volume again",
                name(),
                extent.crc32
            )));
        }
        Ok(bytes)
    }

    /// The directory must describe exactly the header's layers and histograms, and its extents must follow one another
    /// from the prologue to the header without gap or overlap, so that every byte of the file is under a checksum.
    fn check_directory(&self, prologue: &Prologue) -> Result<()> {
        let bricks = BrickGrid::new(self.header.geometry.dims_usize()).len();
        let expected = (self.header.layers.len(), self.header.histograms.len());
        let found = (self.directory.layers.len(), self.directory.histograms.len());
        if found != expected {
            return Err(Error::Format(format!(
                "the directory lists {found:?} layers and histograms where the header has {expected:?}"
            )));
        }
        if let Some(entries) = self.directory.layers.iter().find(|entries| entries.len() != bricks) {
            return Err(Error::Format(format!(
                "the directory lists {} bricks of a layer where its dimensions make {bricks}",
                entries.len()
            )));
        }
        let mut position = PROLOGUE_BYTES as u64;
        let extents = self.directory.extents().map(|(section, extent)| (section, extent.offset, extent.stored_bytes));
        let tables = [(Section::Header, prologue.header), (Section::Directory, prologue.directory)];
        let tables = tables.map(|(section, table)| (section, table.offset, table.bytes));
        for (section, offset, bytes) in extents.chain(tables) {
            if offset != position {
                return Err(Error::Format(format!("{section} lies at byte {offset}, where {position} is expected")));
            }
            position += u64::from(bytes);
        }
        if position != self.file_bytes {
            return Err(Error::Format(format!("{} bytes at the end mean nothing", self.file_bytes - position)));
        }
        Ok(())
    }

    fn wrong_quantization(&self, layer: &Layer) -> Error {
        Error::Format(format!("layer `{}` is described nonsensically: {layer:?}", layer.kind.name()))
    }
}

fn named(error: Error, name: &str) -> Error {
    match error {
        Error::Format(message) => Error::Format(format!("{name}: {message}")),
        other => other,
    }
}

fn read_table(
    file: &mut File,
    file_bytes: u64,
    extent: TableExtent,
    limit: usize,
    what: &'static str,
) -> Result<Vec<u8>> {
    let length = u64::from(extent.bytes);
    if length > limit as u64 {
        return Err(Error::LimitsExceeded { what, found: length, limit: limit as u64 });
    }
    if extent.offset.checked_add(length).is_none_or(|end| end > file_bytes) {
        return Err(Error::Format(format!(
            "{what} is said to be {length} bytes at {}, but the file has only {file_bytes}",
            extent.offset
        )));
    }
    let mut bytes = vec![0; extent.bytes as usize];
    file.seek(SeekFrom::Start(extent.offset))
        .and_then(|_| file.read_exact(&mut bytes))
        .map_err(Error::io(format!("reading {what}")))?;
    let computed = crc32fast::hash(&bytes);
    if computed != extent.crc32 {
        return Err(Error::Format(format!(
            "{what} is damaged: checksum {:08x} is stored, {computed:08x} computed",
            extent.crc32
        )));
    }
    Ok(bytes)
}
