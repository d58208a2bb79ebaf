//! Reads a packed file.

use std::fs::File;
use std::ops::Range;
use std::path::Path;

use rayon::prelude::*;

use crate::brick::{BRICK_EDGE, BrickGrid};
use crate::codec::{self, MAX_HEADER_BYTES};
use crate::compression::{Encoding, Sparse, Unpacker};
use crate::directory::{Directory, Entry, Extent, Order, Place, Section, Table};
use crate::error::vec_with_capacity;
use crate::geometry::GridGeometry;
use crate::header::Header;
use crate::histogram::{Histogram, HistogramKind, HistogramShape};
use crate::layer::{Layer, LayerKind, Quantization};
use crate::mask;
use crate::positioned::read_exact_at;
use crate::prologue::{PROLOGUE_BYTES, Prologue, TableExtent, checksum_fits};
use crate::quantization::widened_distance;
use crate::reused::Reused;
use crate::scalar::{Scalar, ScalarType};
use crate::{DistanceQuantization, Error, HitGradientQuantization, Limits, Result, Scalars};

mod verification;

pub use verification::Verified;

/// An open packed file: header and directory are read and checked, bricks are read when asked for, from any thread.
///
/// ```
/// use voxrole_pack::{LayerKind, Reader};
///
/// let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/v1_ball.vxr");
/// let reader = Reader::open(path.as_ref())?;
/// assert_eq!(reader.header().geometry.dims, [34, 5, 4]);
///
/// // All distances, x fastest, in world units; `None` where there is no boundary.
/// let quantization = reader.distance_quantization()?;
/// let distances = reader.read_distance(0)?.into_iter().map(|stored| quantization.decode(stored));
/// assert_eq!(distances.flatten().count(), 123);
///
/// // A part of the input at half the resolution, in the input's own numbers: x, y and z count the level's voxels.
/// let part = reader.read_region::<u8>(LayerKind::Value, 1, [4..12, 0..3, 1..2])?;
/// assert_eq!(part.len(), 8 * 3);
/// # Ok::<(), voxrole_pack::Error>(())
/// ```
pub struct Reader {
    file: File,
    file_bytes: u64,
    header: Header,
    directory: Directory,
    unpackers: Reused<BrickUnpacker>,
}

/// What one thread needs to unpack bricks.
struct BrickUnpacker {
    unpacker: Unpacker,
    stored: Vec<u8>,
    mask: Vec<u8>,
}

impl BrickUnpacker {
    fn new() -> Result<Self> {
        Ok(Self { unpacker: Unpacker::new()?, stored: Vec::new(), mask: Vec::new() })
    }
}

/// What to do about damage.
const ADVICE: &str = "; prepare the volume again";

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
        let file = File::open(path).map_err(Error::io("opening"))?;
        let file_bytes = file.metadata().map_err(Error::io("opening"))?.len();
        let mut prologue = [0; PROLOGUE_BYTES];
        read_exact_at(&file, &mut prologue, 0).map_err(|error| match error.kind() {
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
        let length = u64::from(prologue.header.bytes);
        if length > MAX_HEADER_BYTES as u64 {
            let limit = MAX_HEADER_BYTES as u64;
            return Err(Error::LimitsExceeded { what: "the header", found: length, limit });
        }
        let header = read_table(&file, file_bytes, prologue.header, "the header")?;
        let header: Header = codec::decode::<_, MAX_HEADER_BYTES>(&header, "the header")?;
        header.validate(limits)?;
        let directory = read_table(&file, file_bytes, prologue.directory, "the directory")?;
        let directory = Directory::new(Order::new(&header), directory)?;
        check_extents(&directory, &prologue)?;
        Ok(Self { file, file_bytes, header, directory, unpackers: Reused::default() })
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

    /// How many levels of detail there are; level 0 is the volume itself.
    #[must_use]
    pub fn levels(&self) -> usize {
        self.header.levels as usize
    }

    /// Where the voxels of a level lie.
    ///
    /// # Errors
    /// [`Error::Parameter`] when there is no such level.
    pub fn geometry(&self, level: usize) -> Result<GridGeometry> {
        self.grid(level).map(|_| self.header.geometry.at_level(level))
    }

    /// The bricks of a level.
    ///
    /// # Errors
    /// [`Error::Parameter`] when there is no such level.
    pub fn grid(&self, level: usize) -> Result<BrickGrid> {
        self.directory.order().levels().get(level).copied().ok_or_else(|| {
            Error::Parameter(format!("the file has no level {level}: its last is {}", self.levels() - 1))
        })
    }

    /// What the directory says of a brick: where it is, and the range of its values, by which it can be skipped unread.
    ///
    /// # Errors
    /// [`Error::Parameter`] when the file has no such layer, level or brick, [`Error::Format`] when the entry is nonsensical.
    pub fn brick_entry(&self, kind: LayerKind, level: usize, brick: usize) -> Result<Entry> {
        let (layer, _) = self.header.layer(kind)?;
        self.entry(Table::Layer(layer), level, brick)
    }

    /// All stored numbers of a layer on the finest level, x fastest.
    ///
    /// # Errors
    /// As [`Self::read_region`].
    pub fn read_layer<T: Scalar>(&self, kind: LayerKind) -> Result<Vec<T>> {
        self.read_level(kind, 0)
    }

    /// All stored numbers of a layer on a level, x fastest.
    ///
    /// # Errors
    /// As [`Self::read_region`].
    pub fn read_level<T: Scalar>(&self, kind: LayerKind, level: usize) -> Result<Vec<T>> {
        let dims = self.geometry(level)?.dims_usize();
        self.read_region(kind, level, dims.map(|dim| 0..dim))
    }

    /// The stored numbers of a layer in a range of a level's voxels along each axis, x fastest. Only bricks that the range touches
    /// are read.
    ///
    /// # Errors
    /// [`Error::Parameter`] when the file has no such layer, level or voxels, or the layer is of another type; [`Error::Format`],
    /// naming the brick, when one is damaged; [`Error::Io`] when memory or the disk fails.
    pub fn read_region<T: Scalar>(&self, kind: LayerKind, level: usize, range: [Range<usize>; 3]) -> Result<Vec<T>> {
        let index = self.typed_layer::<T>(kind)?;
        let (grid, dims) = (self.grid(level)?, self.geometry(level)?.dims_usize());
        if range.iter().zip(dims).any(|(range, dim)| range.start >= range.end || range.end > dim) {
            return Err(Error::Parameter(format!("voxels {range:?} are asked for where level {level} has {dims:?}")));
        }
        let [x, y, z] = range;
        let (width, slice) = (x.len(), x.len() * y.len());
        let mut dense = vec_with_capacity(slice * z.len(), kind.name())?;
        dense.resize(slice * z.len(), T::default());
        let bricks_along = |range: &Range<usize>| range.start / BRICK_EDGE..range.end.div_ceil(BRICK_EDGE);
        let [nx, ny, _] = dims.map(|dim| dim.div_ceil(BRICK_EDGE));
        let mut rest = dense.as_mut_slice();
        for bz in bricks_along(&z) {
            let bricks: Vec<usize> =
                bricks_along(&y).flat_map(|by| bricks_along(&x).map(move |bx| (bz * ny + by) * nx + bx)).collect();
            let unpacked: Vec<Vec<T>> = bricks
                .par_iter()
                .with_max_len(1)
                .map(|&brick| self.read_numbers(Table::Layer(index), level, brick, &grid))
                .collect::<Result<_>>()?;
            let slices = z.start.max(bz * BRICK_EDGE)..z.end.min((bz + 1) * BRICK_EDGE);
            let (slab, behind) = std::mem::take(&mut rest).split_at_mut(slice * slices.len());
            rest = behind;
            slab.par_chunks_mut(slice).zip(slices.into_par_iter()).for_each(|(out, k)| {
                for (&brick, values) in bricks.iter().zip(&unpacked) {
                    let [i, j, depth] = grid.voxel_ranges(brick);
                    let columns = i.start.max(x.start)..i.end.min(x.end);
                    for row in j.start.max(y.start)..j.end.min(y.end) {
                        let to = (row - y.start) * width + columns.start - x.start;
                        let to = &mut out[to..to + columns.len()];
                        match values.as_slice() {
                            [one] => to.fill(*one),
                            _ => {
                                let from =
                                    ((k - depth.start) * j.len() + row - j.start) * i.len() + columns.start - i.start;
                                to.copy_from_slice(&values[from..from + columns.len()]);
                            }
                        }
                    }
                }
            });
        }
        Ok(dense)
    }

    /// The stored numbers of one brick of a layer, x fastest; [`Self::grid`] says where it lies.
    ///
    /// # Errors
    /// As [`Self::read_region`].
    pub fn read_brick<T: Scalar>(&self, kind: LayerKind, level: usize, brick: usize) -> Result<Vec<T>> {
        let mut values = self.read_brick_or_constant(kind, level, brick)?;
        if let [one] = values[..] {
            values.resize(self.grid(level)?.voxel_count(brick), one);
        }
        Ok(values)
    }

    /// As [`Self::read_brick`], but a single number where the directory says that it stands for all of the brick.
    ///
    /// # Errors
    /// As [`Self::read_region`].
    pub fn read_brick_or_constant<T: Scalar>(&self, kind: LayerKind, level: usize, brick: usize) -> Result<Vec<T>> {
        let index = self.typed_layer::<T>(kind)?;
        self.read_numbers(Table::Layer(index), level, brick, &self.grid(level)?)
    }

    /// The input's numbers in their own type, with the factor and offset that make them physical.
    ///
    /// # Errors
    /// As [`Self::read_region`].
    pub fn read_value(&self) -> Result<(Scalars, f64, f64)> {
        self.read_value_level(0)
    }

    /// The input's numbers on a level, as [`Self::read_value`].
    ///
    /// # Errors
    /// As [`Self::read_region`].
    pub fn read_value_level(&self, level: usize) -> Result<(Scalars, f64, f64)> {
        let kind = LayerKind::Value;
        let (_, layer) = self.header.layer(kind)?;
        let Quantization::Linear { slope, intercept } = layer.quantization else {
            return Err(self.wrong_quantization(layer));
        };
        let scalars = match layer.scalar_type {
            ScalarType::U8 => Scalars::U8(self.read_level(kind, level)?),
            ScalarType::I8 => Scalars::I8(self.read_level(kind, level)?),
            ScalarType::U16 => Scalars::U16(self.read_level(kind, level)?),
            ScalarType::I16 => Scalars::I16(self.read_level(kind, level)?),
            ScalarType::U32 => Scalars::U32(self.read_level(kind, level)?),
            ScalarType::I32 => Scalars::I32(self.read_level(kind, level)?),
            ScalarType::F32 => Scalars::F32(self.read_level(kind, level)?),
            ScalarType::F64 => Scalars::F64(self.read_level(kind, level)?),
        };
        Ok((scalars, slope, intercept))
    }

    /// The stored distances of a level, for [`DistanceQuantization::decode`], whatever precision the file has.
    ///
    /// # Errors
    /// As [`Self::read_region`].
    pub fn read_distance(&self, level: usize) -> Result<Vec<i16>> {
        if self.distance_quantization()?.is_one_byte() {
            let bytes: Vec<i8> = self.read_level(LayerKind::Distance, level)?;
            return Ok(bytes.into_par_iter().map(widened_distance).collect());
        }
        self.read_level(LayerKind::Distance, level)
    }

    /// The stored gradient magnitudes at the hit of a level, for [`HitGradientQuantization::decode`], whatever precision the file
    /// has.
    ///
    /// # Errors
    /// As [`Self::read_region`].
    pub fn read_hit_gradient(&self, level: usize) -> Result<Vec<u16>> {
        if self.hit_gradient_quantization()?.is_one_byte() {
            let bytes: Vec<u8> = self.read_level(LayerKind::HitGradient, level)?;
            return Ok(bytes.into_par_iter().map(u16::from).collect());
        }
        self.read_level(LayerKind::HitGradient, level)
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

    fn read_histogram_at(&self, index: usize) -> Result<Histogram> {
        let shape = self.header.histograms[index].clone();
        let name = || histogram_name(&shape);
        let bins = shape.bin_count().unwrap_or(0) as usize;
        let entry = self.directory.entry(self.directory.order().histogram(index))?;
        let counts = self.unpackers.lend(BrickUnpacker::new, |tools| {
            let BrickUnpacker { unpacker, stored, .. } = tools;
            let mut counts = Vec::new();
            let encoding = self.read_stored(entry.place, 8, stored, &name)?;
            if encoding == Encoding::DeltaZstd {
                return Err(Error::Format(format!("{}: counts have no differences", name())));
            }
            unpacker.unpack(encoding, stored, bins, None, &mut counts).map_err(|error| named(error, &name()))?;
            Ok::<_, Error>(counts)
        })??;
        Ok(Histogram { shape, counts })
    }

    /// The numbers of a brick of a layer; a single one where all are the same.
    fn read_numbers<T: Scalar>(&self, table: Table, level: usize, brick: usize, grid: &BrickGrid) -> Result<Vec<T>> {
        self.unpackers.lend(BrickUnpacker::new, |tools| {
            let entry = self.entry(table, level, brick)?;
            let name = || self.name(table, level, brick);
            let voxels = grid.voxel_count(brick);
            let mut values = Vec::new();
            let is_sparse = matches!(entry.place, Place::Stored(Extent { encoding: Encoding::SparseZstd, .. }));
            if is_sparse {
                self.read_mask(tools, level, brick, grid)?;
            }
            let BrickUnpacker { unpacker, stored, mask } = tools;
            let encoding = self.read_stored(entry.place, T::SIZE, stored, &name)?;
            let fill = match table {
                Table::Layer(layer) => self.header.layers[layer].fill(),
                Table::Mask => None,
            };
            let sparse = fill.filter(|_| is_sparse).map(|fill| Sparse { mask: mask.as_slice(), fill });
            let len = if encoding == Encoding::Constant { 1 } else { voxels };
            unpacker.unpack(encoding, stored, len, sparse, &mut values).map_err(|error| named(error, &name()))?;
            Ok(values)
        })?
    }

    /// Puts a brick's mask into `tools.mask`.
    fn read_mask(&self, tools: &mut BrickUnpacker, level: usize, brick: usize, grid: &BrickGrid) -> Result<()> {
        let BrickUnpacker { unpacker, stored, mask } = tools;
        let name = || self.name(Table::Mask, level, brick);
        let voxels = grid.voxel_count(brick);
        let entry = self.entry(Table::Mask, level, brick)?;
        let encoding = self.read_stored(entry.place, 1, stored, &name)?;
        unpacker.unpack(encoding, stored, voxels.div_ceil(8), None, mask).map_err(|error| named(error, &name()))?;
        if mask::is_sound(mask, voxels) {
            return Ok(());
        }
        Err(Error::Format(format!("{}: bits are set behind its {voxels} voxels", name())))
    }

    fn entry(&self, table: Table, level: usize, brick: usize) -> Result<Entry> {
        let places = self.directory.order().bricks(table, level).filter(|places| brick < places.len());
        let Some(places) = places else {
            return Err(Error::Parameter(format!("the file has no {}", self.name(table, level, brick))));
        };
        self.directory.entry(places.start + brick)
    }

    fn name(&self, table: Table, level: usize, brick: usize) -> String {
        let of_level = if level == 0 { String::new() } else { format!(" of level {level}") };
        match table {
            Table::Mask => format!("brick {brick}{of_level} of the mask"),
            Table::Layer(layer) => {
                format!("brick {brick}{of_level} of layer `{}`", self.header.layers[layer].kind.name())
            }
        }
    }

    /// Puts the stored bytes of a place into `bytes` and checks them; `size` is that of a number.
    fn read_stored(
        &self,
        place: Place,
        size: usize,
        bytes: &mut Vec<u8>,
        name: &dyn Fn() -> String,
    ) -> Result<Encoding> {
        bytes.clear();
        let extent = match place {
            Place::Constant(number) => {
                let (number, rest) = number.split_at(size);
                bytes.extend_from_slice(number);
                if rest.iter().any(|&byte| byte != 0) {
                    return Err(Error::Format(format!("{}: more than the number that stands for all", name())));
                }
                return Ok(Encoding::Constant);
            }
            Place::Stored(extent) => extent,
        };
        bytes.resize(extent.stored_bytes as usize, 0);
        read_exact_at(&self.file, bytes, extent.offset).map_err(Error::io(format!("reading {}", name())))?;
        let computed = crc32fast::hash(bytes);
        if !checksum_fits(extent.crc32, computed) {
            return Err(Error::Format(format!(
                "{} is damaged: checksum {:08x} is stored, {computed:08x} computed{ADVICE}",
                name(),
                extent.crc32
            )));
        }
        Ok(extent.encoding)
    }

    fn typed_layer<T: Scalar>(&self, kind: LayerKind) -> Result<usize> {
        let (index, layer) = self.header.layer(kind)?;
        if layer.scalar_type == T::TYPE {
            return Ok(index);
        }
        let (stored, wanted) = (layer.scalar_type.name(), T::TYPE.name());
        Err(Error::Parameter(format!("layer `{}` is stored as {stored}, not {wanted}", kind.name())))
    }

    fn wrong_quantization(&self, layer: &Layer) -> Error {
        Error::Format(format!("layer `{}` is described nonsensically: {layer:?}", layer.kind.name()))
    }
}

/// What the directory lists must fill the file from the prologue to the header without gap or overlap, and header and directory
/// the rest, so that every byte of the file is under a checksum.
fn check_extents(directory: &Directory, prologue: &Prologue) -> Result<()> {
    let mut extents = Vec::new();
    for (place, entry) in directory.entries().enumerate() {
        let Entry { place: stored, range } = entry?;
        let section = || directory.order().section(place);
        if range.is_some() && !matches!(section(), Section::Brick { table: Table::Layer(_), .. }) {
            return Err(Error::Format(format!("{} has a range of values", section())));
        }
        if let Place::Stored(extent) = stored {
            extents.push((extent.offset, extent.stored_bytes, place));
        }
    }
    extents.sort_unstable();
    let mut position = PROLOGUE_BYTES as u64;
    let mut expect = |offset: u64, bytes: u32, section: &dyn Fn() -> String| {
        if offset != position {
            return Err(Error::Format(format!("{} lies at byte {offset}, where {position} is expected", section())));
        }
        // No overflow: all before this lies within the file.
        position = position.saturating_add(u64::from(bytes));
        Ok(())
    };
    for (offset, bytes, place) in extents {
        expect(offset, bytes, &|| directory.order().section(place).to_string())?;
    }
    expect(prologue.header.offset, prologue.header.bytes, &|| "the header".into())?;
    expect(prologue.directory.offset, prologue.directory.bytes, &|| "the directory".into())?;
    if position != prologue.file_bytes {
        return Err(Error::Format(format!("{position} bytes of {} are listed", prologue.file_bytes)));
    }
    Ok(())
}

fn histogram_name(shape: &HistogramShape) -> String {
    format!("histogram `{}`", shape.kind.name())
}

fn named(error: Error, name: &str) -> Error {
    match error {
        Error::Format(message) => Error::Format(format!("{name}: {message}")),
        other => other,
    }
}

fn read_table(file: &File, file_bytes: u64, extent: TableExtent, what: &'static str) -> Result<Vec<u8>> {
    let length = u64::from(extent.bytes);
    if extent.offset.checked_add(length).is_none_or(|end| end > file_bytes) {
        return Err(Error::Format(format!(
            "{what} is said to be {length} bytes at {}, but the file has only {file_bytes}",
            extent.offset
        )));
    }
    let mut bytes = vec_with_capacity(extent.bytes as usize, what)?;
    bytes.resize(extent.bytes as usize, 0);
    read_exact_at(file, &mut bytes, extent.offset).map_err(Error::io(format!("reading {what}")))?;
    let computed = crc32fast::hash(&bytes);
    if !checksum_fits(extent.crc32, computed) {
        return Err(Error::Format(format!(
            "{what} is damaged: checksum {:08x} is stored, {computed:08x} computed",
            extent.crc32
        )));
    }
    Ok(bytes)
}
