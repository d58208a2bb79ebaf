//! Writes a packed file, layer by layer.

use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::Path;

use rayon::prelude::*;

use crate::atomic_file::AtomicFile;
use crate::brick::BrickGrid;
use crate::codec::{self, MAX_DIRECTORY_BYTES, MAX_HEADER_BYTES};
use crate::compression::{self, Encoding, Packer, all_same};
use crate::directory::{BrickEntry, Directory, Extent};
use crate::geometry::GridGeometry;
use crate::header::{Header, Parameter, Source, Statistics};
use crate::histogram::{Histogram, HistogramShape};
use crate::layer::{Layer, Quantization};
use crate::prologue::{PROLOGUE_BYTES, Prologue, TableExtent};
use crate::reused::Reused;
use crate::scalar::{LittleEndian, Scalar};
use crate::value_range::ValueRange;
use crate::{Error, Limits, Result};

/// Bricks that are compressed at once: bounds the memory in flight whatever the number of threads.
const BRICKS_IN_FLIGHT: usize = 64;

/// A packed file in the making; nothing is seen under its final name before [`Writer::finish`].
pub struct Writer {
    file: BufWriter<AtomicFile>,
    position: u64,
    geometry: GridGeometry,
    layers: Vec<Layer>,
    histograms: Vec<HistogramShape>,
    directory: Directory,
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.file_mut().write(bytes)
    }
    fn flush(&mut self) -> std::io::Result<()> {
        self.file_mut().flush()
    }
}

/// What the header says beside layers and histograms.
#[derive(Clone, Debug)]
pub struct Description {
    /// Program and version.
    pub made_by: String,
    /// Where the volume came from.
    pub source: Source,
    /// Settings.
    pub parameters: Vec<Parameter>,
    /// Figures.
    pub statistics: Statistics,
}

impl Writer {
    /// Starts a file.
    ///
    /// # Errors
    /// [`Error::Format`] for an unusable geometry, [`Error::Io`] when the folder cannot be written to.
    pub fn create(path: &Path, geometry: GridGeometry) -> Result<Self> {
        geometry.validate()?;
        let file = AtomicFile::create(path).map_err(Error::io("creating the packed file"))?;
        let mut writer = Self {
            file: BufWriter::with_capacity(1 << 20, file),
            position: 0,
            geometry,
            layers: Vec::new(),
            histograms: Vec::new(),
            directory: Directory::default(),
        };
        writer.append(&[0; PROLOGUE_BYTES])?;
        Ok(writer)
    }

    /// Adds a layer; `values` are all voxels as stored, x fastest.
    ///
    /// # Errors
    /// [`Error::Parameter`] when the layer's type or length does not fit, [`Error::Io`] when writing fails.
    pub fn write_layer<T: Scalar>(&mut self, layer: Layer, values: &[T]) -> Result<()> {
        self.write_encoded_layer(layer, values, |value| value)
    }

    /// Adds a layer that stores `encode` of `values`, all voxels, x fastest. The same bytes must be encoded to the same
    /// number. What `encode` captures by value stays in registers.
    ///
    /// # Errors
    /// As [`Self::write_layer`].
    pub fn write_encoded_layer<S: LittleEndian, T: Scalar>(
        &mut self,
        layer: Layer,
        values: &[S],
        encode: impl Fn(S) -> T + Copy + Sync,
    ) -> Result<()> {
        if layer.scalar_type != T::TYPE || values.len() != self.geometry.voxel_count() {
            return Err(Error::Parameter(format!(
                "layer `{}`: {} numbers of {} given, {} of {} expected",
                layer.kind.name(),
                values.len(),
                T::TYPE.name(),
                self.geometry.voxel_count(),
                layer.scalar_type.name()
            )));
        }
        let packer = LayerPacker::new(&layer, self.geometry.dims_usize(), values, encode);
        let mut entries = Vec::with_capacity(packer.grid.len());
        for first in (0..packer.grid.len()).step_by(BRICKS_IN_FLIGHT) {
            for brick in packer.pack(first..(first + BRICKS_IN_FLIGHT).min(packer.grid.len()))? {
                entries.push(self.append_brick(&brick)?);
            }
        }
        self.layers.push(layer);
        self.directory.layers.push(entries);
        Ok(())
    }

    /// Adds a layer whose bricks are packed already; they come in the order of the grid, x fastest.
    ///
    /// # Errors
    /// [`Error::Parameter`] when there are more or fewer of them than the grid has, [`Error::Io`] when writing fails, and
    /// whatever a brick comes with.
    pub fn write_packed_layer(
        &mut self,
        layer: Layer,
        bricks: impl IntoIterator<Item = Result<PackedBrick>>,
    ) -> Result<()> {
        let expected = BrickGrid::new(self.geometry.dims_usize()).len();
        let mut entries = Vec::with_capacity(expected);
        for brick in bricks {
            entries.push(self.append_brick(&brick?)?);
        }
        if entries.len() != expected {
            let (name, found) = (layer.kind.name(), entries.len());
            return Err(Error::Parameter(format!("layer `{name}`: {found} bricks given, {expected} expected")));
        }
        self.layers.push(layer);
        self.directory.layers.push(entries);
        Ok(())
    }

    /// Adds histograms.
    ///
    /// # Errors
    /// [`Error::Parameter`] when counts and axes disagree, [`Error::Io`] when writing fails.
    pub fn write_histograms(&mut self, histograms: Vec<Histogram>) -> Result<()> {
        for Histogram { shape, counts } in &histograms {
            if shape.bin_count() != Some(counts.len() as u64) {
                return Err(Error::Parameter(format!(
                    "histogram `{}` has {} counts for axes of {:?} bins",
                    shape.kind.name(),
                    counts.len(),
                    shape.axes.iter().map(|axis| axis.bins).collect::<Vec<_>>()
                )));
            }
        }
        let packed: Vec<_> =
            histograms.par_iter().map(|histogram| Packer::new()?.pack(&histogram.counts)).collect::<Result<_>>()?;
        for (histogram, (encoding, bytes)) in histograms.into_iter().zip(packed) {
            let extent = self.append_extent(encoding, &bytes, crc32fast::hash(&bytes))?;
            self.directory.histograms.push(extent);
            self.histograms.push(histogram.shape);
        }
        Ok(())
    }

    /// Writes header, directory and prologue, and gives the file its name. Returns the file's length in bytes.
    ///
    /// # Errors
    /// [`Error::Io`] when writing fails, [`Error::Format`] or [`Error::LimitsExceeded`] when what was given could not
    /// be read back.
    pub fn finish(mut self, description: Description) -> Result<u64> {
        let header = Header {
            made_by: description.made_by,
            source: description.source,
            geometry: self.geometry.clone(),
            parameters: description.parameters,
            statistics: description.statistics,
            layers: std::mem::take(&mut self.layers),
            histograms: std::mem::take(&mut self.histograms),
        };
        header.validate(&Limits::default())?;
        let header = self.append_table(&codec::encode::<_, MAX_HEADER_BYTES>(&header, "the header")?)?;
        let directory = codec::encode::<_, MAX_DIRECTORY_BYTES>(&self.directory, "the directory")?;
        let directory = self.append_table(&directory)?;
        let prologue = Prologue { file_bytes: self.position, header, directory };

        let finishing = || Error::io("finishing the packed file");
        let mut file = self.file.into_inner().map_err(|error| finishing()(error.into_error()))?;
        file.file_mut().seek(SeekFrom::Start(0)).map_err(finishing())?;
        file.write_all(&prologue.to_bytes()).map_err(finishing())?;
        file.commit().map_err(finishing())?;
        Ok(prologue.file_bytes)
    }

    fn append(&mut self, bytes: &[u8]) -> Result<u64> {
        let offset = self.position;
        self.file.write_all(bytes).map_err(Error::io("writing the packed file"))?;
        self.position += bytes.len() as u64;
        Ok(offset)
    }

    fn append_brick(&mut self, brick: &PackedBrick) -> Result<BrickEntry> {
        Ok(BrickEntry { extent: self.append_extent(brick.encoding, &brick.bytes, brick.crc32)?, range: brick.range })
    }

    fn append_extent(&mut self, encoding: Encoding, bytes: &[u8], crc32: u32) -> Result<Extent> {
        let TableExtent { offset, bytes: stored_bytes, crc32 } = self.append_section(bytes, crc32)?;
        Ok(Extent { offset, stored_bytes, crc32, encoding })
    }

    fn append_table(&mut self, bytes: &[u8]) -> Result<TableExtent> {
        self.append_section(bytes, crc32fast::hash(bytes))
    }

    fn append_section(&mut self, bytes: &[u8], crc32: u32) -> Result<TableExtent> {
        let length = u32::try_from(bytes.len())
            .map_err(|_| Error::Parameter(format!("{} bytes are too many for one section", bytes.len())))?;
        Ok(TableExtent { offset: self.append(bytes)?, bytes: length, crc32 })
    }
}

/// A brick, ready to be written.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedBrick {
    /// How `bytes` are to be unpacked.
    pub encoding: Encoding,
    /// The stored bytes.
    pub bytes: Vec<u8>,
    /// Their CRC-32.
    pub crc32: u32,
    /// Range of the physical values, or `None` if no voxel has one.
    pub range: Option<ValueRange>,
}

impl PackedBrick {
    /// The `len` numbers of the brick.
    ///
    /// # Errors
    /// [`Error::Format`] when the bytes are damaged.
    pub fn unpack<T: LittleEndian>(&self, len: usize) -> Result<Vec<T>> {
        compression::unpack(self.encoding, &self.bytes, len)
    }
}

/// Packs all bricks of a layer of a block of `dims` voxels, in the order of its grid: `encode` of `values`, x fastest. A
/// volume's block that begins at multiples of [`crate::brick::BRICK_EDGE`] has the same bricks as the volume.
///
/// # Errors
/// [`Error::Io`] when zstd fails.
///
/// # Panics
/// When there are fewer values than voxels.
pub fn pack_bricks<S: LittleEndian, T: Scalar>(
    layer: &Layer,
    dims: [usize; 3],
    values: &[S],
    encode: impl Fn(S) -> T + Copy + Sync,
) -> Result<Vec<PackedBrick>> {
    let packer = LayerPacker::new(layer, dims, values, encode);
    packer.pack(0..packer.grid.len())
}

/// Packs single bricks, on any thread.
#[derive(Default)]
pub struct BrickPacker<T>(Reused<Workbench<T>>);

impl<T: Scalar> BrickPacker<T> {
    /// Packs a brick of a layer: `encode` of all its values, x fastest.
    ///
    /// # Errors
    /// [`Error::Io`] when zstd fails.
    pub fn pack<S: LittleEndian>(&self, layer: &Layer, values: &[S], encode: impl Fn(S) -> T) -> Result<PackedBrick> {
        self.0.lend(Workbench::new, |workbench| {
            workbench.stored.clear();
            workbench.stored.extend(values.iter().map(|&value| encode(value)));
            workbench.pack(&layer.quantization)
        })?
    }
}

/// Packs the bricks of a layer on every thread.
struct LayerPacker<'a, S, T, E> {
    grid: BrickGrid,
    quantization: Quantization,
    values: &'a [S],
    encode: E,
    workbenches: Reused<Workbench<T>>,
}

impl<'a, S: LittleEndian, T: Scalar, E: Fn(S) -> T + Copy + Sync> LayerPacker<'a, S, T, E> {
    fn new(layer: &Layer, dims: [usize; 3], values: &'a [S], encode: E) -> Self {
        let workbenches = Reused::default();
        Self { grid: BrickGrid::new(dims), quantization: layer.quantization, values, encode, workbenches }
    }

    fn pack(&self, bricks: Range<usize>) -> Result<Vec<PackedBrick>> {
        let packed = |brick: usize| -> Result<PackedBrick> {
            self.workbenches.lend(Workbench::new, |workbench| {
                workbench.gather(&self.grid, brick, self.values, self.encode);
                workbench.pack(&self.quantization)
            })?
        };
        // Bricks differ too much in work for more than one to be taken at a time.
        bricks.into_par_iter().with_max_len(1).map(packed).collect()
    }
}

/// What one thread needs to pack bricks.
struct Workbench<T> {
    packer: Packer,
    /// The brick's numbers, or a single one where they are all the same.
    stored: Vec<T>,
}

impl<T: Scalar> Workbench<T> {
    fn new() -> Result<Self> {
        Ok(Self { packer: Packer::new()?, stored: Vec::new() })
    }

    fn gather<S: LittleEndian>(&mut self, grid: &BrickGrid, brick: usize, values: &[S], encode: impl Fn(S) -> T) {
        self.stored.clear();
        let first = grid.rows(brick).next().map(|row| values[row.start]);
        if let Some(first) = first.filter(|&first| grid.rows(brick).all(|row| all_same(&values[row], first))) {
            self.stored.push(encode(first));
            return;
        }
        for row in grid.rows(brick) {
            self.stored.extend(values[row].iter().map(|&value| encode(value)));
        }
    }

    fn pack(&mut self, quantization: &Quantization) -> Result<PackedBrick> {
        let range = ValueRange::of(&self.stored, quantization);
        let (encoding, bytes) = self.packer.pack(&self.stored)?;
        Ok(PackedBrick { crc32: crc32fast::hash(&bytes), encoding, bytes, range })
    }
}
