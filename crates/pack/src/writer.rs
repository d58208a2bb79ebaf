//! Writes a packed file, layer by layer.

use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::Path;

use rayon::prelude::*;

use crate::atomic_file::AtomicFile;
use crate::brick::BrickGrid;
use crate::codec::{self, MAX_DIRECTORY_BYTES, MAX_HEADER_BYTES};
use crate::compression::{self, Encoding};
use crate::directory::{BrickEntry, Directory, Extent};
use crate::geometry::GridGeometry;
use crate::header::{Header, Parameter, Source, Statistics};
use crate::histogram::Histogram;
use crate::layer::Layer;
use crate::prologue::{PROLOGUE_BYTES, Prologue, TableExtent};
use crate::scalar::Scalar;
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
    histograms: Vec<Histogram>,
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

    /// Adds a layer; `values` are all voxels, x fastest. `physical` maps a stored number to what
    /// [`BrickEntry::range`] is about.
    ///
    /// # Errors
    /// [`Error::Parameter`] when the layer's type or length does not fit, [`Error::Io`] when writing fails.
    pub fn write_layer<T: Scalar>(
        &mut self,
        layer: Layer,
        values: &[T],
        physical: impl Fn(T) -> Option<f64> + Sync,
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
        let grid = BrickGrid::new(self.geometry.dims_usize());
        let mut entries = Vec::with_capacity(grid.len());
        for first in (0..grid.len()).step_by(BRICKS_IN_FLIGHT) {
            let packed: Vec<_> = (first..(first + BRICKS_IN_FLIGHT).min(grid.len()))
                .into_par_iter()
                .map(|brick| {
                    let mut voxels = Vec::with_capacity(grid.voxel_count(brick));
                    grid.rows(brick).for_each(|row| voxels.extend_from_slice(&values[row]));
                    let range = ValueRange::of(voxels.iter().filter_map(|&voxel| physical(voxel)));
                    compression::pack(&voxels).map(|(encoding, bytes)| (encoding, bytes, range))
                })
                .collect::<Result<_>>()?;
            for (encoding, bytes, range) in packed {
                entries.push(BrickEntry { extent: self.append_extent(encoding, &bytes)?, range });
            }
        }
        self.layers.push(layer);
        self.directory.layers.push(entries);
        Ok(())
    }

    /// Adds a histogram.
    ///
    /// # Errors
    /// [`Error::Parameter`] when counts and axes disagree, [`Error::Io`] when writing fails.
    pub fn write_histogram(&mut self, histogram: Histogram) -> Result<()> {
        if histogram.shape.bin_count() != Some(histogram.counts.len() as u64) {
            return Err(Error::Parameter(format!(
                "histogram `{}` has {} counts for axes of {:?} bins",
                histogram.shape.kind.name(),
                histogram.counts.len(),
                histogram.shape.axes.iter().map(|axis| axis.bins).collect::<Vec<_>>()
            )));
        }
        let (encoding, bytes) = compression::pack(&histogram.counts)?;
        let extent = self.append_extent(encoding, &bytes)?;
        self.directory.histograms.push(extent);
        self.histograms.push(histogram);
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
            histograms: std::mem::take(&mut self.histograms).into_iter().map(|histogram| histogram.shape).collect(),
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

    fn append_extent(&mut self, encoding: Encoding, bytes: &[u8]) -> Result<Extent> {
        let TableExtent { offset, bytes: stored_bytes, crc32 } = self.append_table(bytes)?;
        Ok(Extent { offset, stored_bytes, crc32, encoding })
    }

    fn append_table(&mut self, bytes: &[u8]) -> Result<TableExtent> {
        let length = u32::try_from(bytes.len())
            .map_err(|_| Error::Parameter(format!("{} bytes are too many for one section", bytes.len())))?;
        Ok(TableExtent { offset: self.append(bytes)?, bytes: length, crc32: crc32fast::hash(bytes) })
    }
}
