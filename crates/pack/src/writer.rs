//! Writes a packed file, layer by layer.

use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::Path;

use rayon::prelude::*;

use crate::atomic_file::AtomicFile;
use crate::brick::BrickGrid;
use crate::codec::{self, MAX_HEADER_BYTES};
use crate::compression::{Encoding, Packer};
use crate::directory::{ENTRY_BYTES, Entry, Extent, Order, Place, Table};
use crate::error::vec_with_capacity;
use crate::geometry::GridGeometry;
use crate::header::{Header, Parameter, Source, Statistics};
use crate::histogram::{Histogram, HistogramShape};
use crate::layer::Layer;
use crate::levels::MOST_LEVELS;
use crate::packed_brick::{LayerPacker, PackedBrick, PackedLayerBrick, Workbenches};
use crate::prologue::{PROLOGUE_BYTES, Prologue, TableExtent};
use crate::pyramid::Pyramid;
use crate::scalar::{LittleEndian, Scalar};
use crate::{Error, Limits, Result};

/// Bricks that are compressed at once: bounds the memory in flight whatever the number of threads.
const BRICKS_IN_FLIGHT: usize = 64;

/// A packed file in the making; nothing is seen under its final name before [`Writer::finish`].
pub struct Writer {
    file: BufWriter<AtomicFile>,
    /// The path, for messages.
    name: String,
    position: u64,
    geometry: GridGeometry,
    levels: usize,
    layers: Vec<Layer>,
    histograms: Vec<HistogramShape>,
    /// Per layer and level, in the order of the level's bricks.
    layer_entries: Vec<Vec<Vec<Entry>>>,
    /// Per level; empty without a layer of distances.
    mask_entries: Vec<Vec<Entry>>,
    /// Per level, the CRC-32 of every mask's bits.
    masks: Vec<Vec<u32>>,
    histogram_entries: Vec<Entry>,
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
    /// Starts a file of so many levels of detail: see [`crate::levels::usual_levels`].
    ///
    /// # Errors
    /// [`Error::Format`] for an unusable geometry, [`Error::Parameter`] for less than one level or more than 16, [`Error::Io`]
    /// when the folder cannot be written to.
    pub fn create(path: &Path, geometry: GridGeometry, levels: u32) -> Result<Self> {
        geometry.validate()?;
        if !(1..=MOST_LEVELS).contains(&levels) {
            return Err(Error::Parameter(format!("{levels} levels of detail: expected 1 to {MOST_LEVELS}")));
        }
        let file = AtomicFile::create(path).map_err(Error::io(format!("creating {}", path.display())))?;
        let mut writer = Self {
            name: path.display().to_string(),
            file: BufWriter::with_capacity(1 << 20, file),
            position: 0,
            geometry,
            levels: levels as usize,
            layers: Vec::new(),
            histograms: Vec::new(),
            layer_entries: Vec::new(),
            mask_entries: Vec::new(),
            masks: vec![Vec::new(); levels as usize],
            histogram_entries: Vec::new(),
        };
        writer.append(&[0; PROLOGUE_BYTES])?;
        Ok(writer)
    }

    /// Adds a layer; `values` are all voxels as stored, x fastest. Layers that have numbers only at boundaries are smallest
    /// behind the layer of distances.
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
        let (masks, workbenches) = (self.masks[0].clone(), Workbenches::default());
        let grid = BrickGrid::new(self.geometry.dims_usize());
        let packer = LayerPacker { layer: &layer, grid, values, encode, masks: &masks };
        let mut parts = LayerParts::new(self, &layer);
        for first in (0..grid.len()).step_by(BRICKS_IN_FLIGHT) {
            let bricks = packer.pack(first..(first + BRICKS_IN_FLIGHT).min(grid.len()), &workbenches)?;
            for (brick, place) in bricks.into_iter().zip(first..) {
                self.append_layer_brick(&mut parts, 0, place, brick)?;
            }
        }
        self.add_layer(parts)
    }

    /// Adds a layer whose bricks are packed already; they come in the order of the grid, x fastest.
    ///
    /// # Errors
    /// [`Error::Parameter`] when there are more or fewer of them than the grid has, [`Error::Io`] when writing fails, and
    /// whatever a brick comes with.
    pub fn write_packed_layer<T: Scalar>(
        &mut self,
        layer: &Layer,
        bricks: impl IntoIterator<Item = Result<PackedLayerBrick<T>>>,
    ) -> Result<()> {
        let expected = BrickGrid::new(self.geometry.dims_usize()).len();
        let mut parts = LayerParts::new(self, layer);
        let mut found = 0;
        for brick in bricks {
            if found < expected {
                self.append_layer_brick(&mut parts, 0, found, brick?)?;
            }
            found += 1;
        }
        if found != expected {
            let name = layer.kind.name();
            return Err(Error::Parameter(format!("layer `{name}`: {found} bricks given, {expected} expected")));
        }
        self.add_layer(parts)
    }

    /// CRC-32 of the masks of the finest level: what bricks of layers behind the distances are packed with.
    #[must_use]
    pub fn masks(&self) -> &[u32] {
        &self.masks[0]
    }

    /// Writes a brick, and those of coarser levels that it completes.
    fn append_layer_brick<T: Scalar>(
        &mut self,
        parts: &mut LayerParts<'_, T>,
        level: usize,
        place: usize,
        packed: PackedLayerBrick<T>,
    ) -> Result<()> {
        let PackedLayerBrick { brick, mask, coarse } = packed;
        if let Some(mask) = mask {
            let entry = self.append_brick(&mask.brick)?;
            parts.mask_entries[level].push(entry);
            parts.masks[level].push(mask.bits_crc32);
        }
        let entry = self.append_brick(&brick)?;
        parts.entries[level].push(entry);
        let Some(slab) = parts.pyramid.slab(level + 1) else { return Ok(()) };
        if !slab.take(place, &coarse) {
            return Ok(());
        }
        let (grid, first) = (BrickGrid::new(slab.dims()), slab.first_brick());
        let masks = self.masks[level + 1].get(first..first + grid.len()).unwrap_or_default();
        let packer = LayerPacker { layer: parts.layer, grid, values: slab.values(), encode: |value| value, masks };
        let bricks = packer.pack(0..grid.len(), &parts.workbenches)?;
        for (brick, place) in bricks.into_iter().zip(first..) {
            self.append_layer_brick(parts, level + 1, place, brick)?;
        }
        Ok(())
    }

    fn add_layer<T>(&mut self, parts: LayerParts<'_, T>) -> Result<()> {
        if !parts.masks[0].is_empty() {
            if !self.mask_entries.is_empty() {
                return Err(Error::Parameter("a second layer of distances".into()));
            }
            self.masks = parts.masks;
            self.mask_entries = parts.mask_entries;
        }
        self.layers.push(parts.layer.clone());
        self.layer_entries.push(parts.entries);
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
        let packed: Vec<_> = histograms
            .par_iter()
            .map(|histogram| Packer::new()?.pack(&histogram.counts, None))
            .collect::<Result<_>>()?;
        for (histogram, (encoding, bytes)) in histograms.into_iter().zip(packed) {
            let brick = PackedBrick { crc32: crc32fast::hash(&bytes), encoding, bytes, range: None };
            let entry = self.append_brick(&brick)?;
            self.histogram_entries.push(entry);
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
            levels: self.levels as u32,
            parameters: description.parameters,
            statistics: description.statistics,
            layers: std::mem::take(&mut self.layers),
            histograms: std::mem::take(&mut self.histograms),
        };
        header.validate(&Limits::default())?;
        let directory = self.directory(&Order::new(&header))?;
        let header = self.append_table(&codec::encode::<_, MAX_HEADER_BYTES>(&header, "the header")?)?;
        let directory = self.append_table(&directory)?;
        let prologue = Prologue { file_bytes: self.position, header, directory };

        let finishing = || Error::io(format!("writing {}", self.name));
        let mut file = self.file.into_inner().map_err(|error| finishing()(error.into_error()))?;
        file.file_mut().seek(SeekFrom::Start(0)).map_err(finishing())?;
        file.write_all(&prologue.to_bytes()).map_err(finishing())?;
        file.commit().map_err(finishing())?;
        Ok(prologue.file_bytes)
    }

    /// The directory's bytes.
    fn directory(&self, order: &Order) -> Result<Vec<u8>> {
        let mut bytes = vec_with_capacity(order.len() * ENTRY_BYTES, "the directory")?;
        for level in 0..self.levels {
            for table in order.tables() {
                let entries = match table {
                    Table::Mask => &self.mask_entries[level],
                    Table::Layer(layer) => &self.layer_entries[layer][level],
                };
                bytes.extend(entries.iter().flat_map(Entry::to_bytes));
            }
        }
        bytes.extend(self.histogram_entries.iter().flat_map(Entry::to_bytes));
        Ok(bytes)
    }

    fn append(&mut self, bytes: &[u8]) -> Result<u64> {
        let offset = self.position;
        self.file.write_all(bytes).map_err(Error::io(format!("writing {}", self.name)))?;
        self.position += bytes.len() as u64;
        Ok(offset)
    }

    fn append_brick(&mut self, brick: &PackedBrick) -> Result<Entry> {
        let place = if brick.encoding == Encoding::Constant {
            let mut number = [0; 8];
            number[..brick.bytes.len()].copy_from_slice(&brick.bytes);
            Place::Constant(number)
        } else {
            let TableExtent { offset, bytes: stored_bytes, crc32 } = self.append_section(&brick.bytes, brick.crc32)?;
            Place::Stored(Extent { offset, stored_bytes, crc32, encoding: brick.encoding })
        };
        Ok(Entry { place, range: brick.range })
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

/// A layer on its way into the file.
struct LayerParts<'a, T> {
    layer: &'a Layer,
    pyramid: Pyramid<T>,
    workbenches: Workbenches<T>,
    entries: Vec<Vec<Entry>>,
    mask_entries: Vec<Vec<Entry>>,
    masks: Vec<Vec<u32>>,
}

impl<'a, T: Scalar> LayerParts<'a, T> {
    fn new(writer: &Writer, layer: &'a Layer) -> Self {
        Self {
            layer,
            pyramid: Pyramid::new(writer.geometry.dims_usize(), writer.levels),
            workbenches: Workbenches::default(),
            entries: vec![Vec::new(); writer.levels],
            mask_entries: vec![Vec::new(); writer.levels],
            masks: vec![Vec::new(); writer.levels],
        }
    }
}
