//! Reader of VTI, VTK's image data in XML: <https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html>.
//!
//! It is ours because the crate `vtkio` reads all of a file into memory, trusting its lengths, and knows neither the
//! direction of axes nor 64-bit offsets behind 4 GiB of appended text; XML, base64, zlib and LZ4 are libraries' here too.

mod array;
mod base64_stream;
mod document;
mod numbers;

use std::path::Path;

use array::{Compressor, HeaderType, Place, StoredArray};
use document::{Array, Arrays, Document};
use numbers::NumberType;

use super::header::{Fields, shown};
use super::payload::{Encoding, Payload, Start};
use super::pick::Picks;
use super::placement::Placement;
use super::raw::{ByteOrder, StoredType};
use super::read_options::ReadOptions;
use super::volume_file::{Numbers, VolumeFile};
use crate::{Error, Result};

/// Most numbers of a voxel.
const MAX_COMPONENTS: usize = 1 << 12;

/// Whether a file that begins with `start` is XML of VTK's.
pub(super) fn is_header(start: &[u8]) -> bool {
    start.windows(8).any(|window| window == b"<VTKFile")
}

/// Reads one array: the one that is chosen by name, or the active scalars, of the points or, where the points have none, of the
/// cells, whose centres are the voxels then.
///
/// # Errors
/// As [`super::open_volume`].
pub(super) fn read(path: &Path, options: &ReadOptions) -> Result<VolumeFile> {
    let document = Document::read(path)?;
    options.time_of(1).map_err(|message| Error::format(path, message))?;
    let (array, of_cells) = array(path, &document, options)?;
    let geometry = placement(&document, of_cells)?.geometry(path)?;
    let stored = stored_array(path, &document, array, options, geometry.voxel_count() as u64)?;
    let numbers = match stored.plain_offset()? {
        Some(offset) => Numbers::Payload(Payload {
            path: path.to_owned(),
            start: Start::Section(offset),
            encoding: Encoding::Plain,
            decoded_skip: 0,
            dims: geometry.dims,
            stored: StoredType { scalar_type: stored.number_type.scalar_type(), byte_order: stored.byte_order },
            picks: Picks::default(),
            hint: "the file is cut short",
        }),
        None => Numbers::Slabs(Box::new(stored)),
    };
    VolumeFile::new(path, geometry, numbers, 1.0, 0.0)
}

/// The array to read, and whether its numbers are those of cells.
fn array<'d>(path: &Path, document: &'d Document<'_>, options: &ReadOptions) -> Result<(&'d Array<'d>, bool)> {
    let Document { points, cells, .. } = document;
    let Some(wanted) = &options.array else {
        let of_cells = points.all.is_empty() && !cells.all.is_empty();
        return Ok((active_array(path, if of_cells { cells } else { points })?, of_cells));
    };
    let named = |arrays: &'d Arrays<'_>| arrays.all.iter().find(|array| array.name() == wanted);
    let found = named(points).map(|array| (array, false)).or_else(|| named(cells).map(|array| (array, true)));
    found.ok_or_else(|| {
        let all = names(points.all.iter().chain(&cells.all));
        Error::format(path, format!("expected an array {} for --array, found {all}", shown(wanted)))
    })
}

/// The array that is named as the active scalars, or else the only one.
fn active_array<'d>(path: &Path, arrays: &'d Arrays<'_>) -> Result<&'d Array<'d>> {
    let fail = |message: String| Err(Error::format(path, message));
    match (&arrays.scalars, arrays.all.as_slice()) {
        (_, []) => fail("expected an array of numbers, found none".into()),
        (Some(scalars), all) => match all.iter().find(|array| array.name() == *scalars) {
            Some(array) => Ok(array),
            None => {
                let (wanted, found) = (shown(scalars), names(all));
                fail(format!(
                    "expected an array {wanted}, which is named as the scalars, found {found}: choose with --array"
                ))
            }
        },
        (None, [array]) => Ok(array),
        (None, all) => fail(format!(
            "expected one array, or one named as the scalars, found {}: {}; choose with --array",
            all.len(),
            names(all)
        )),
    }
}

fn names<'d>(arrays: impl IntoIterator<Item = &'d Array<'d>>) -> String {
    arrays.into_iter().map(|array| shown(array.name())).take(20).collect::<Vec<_>>().join(", ")
}

/// Spacing, origin and direction; the origin of VTK's is that of point 0 0 0, which need not be in the extent.
fn placement(document: &Document<'_>, of_cells: bool) -> Result<Placement> {
    let image = &document.image;
    let extent = extent(image, "WholeExtent")?;
    let piece = self::extent(&document.piece, "Extent")?;
    if extent != piece {
        let expected = format!("the whole extent {extent:?}");
        return Err(document.piece.unexpected("Extent", &expected, &format!("{piece:?}")));
    }
    let spacing = image.array(&["Spacing"])?.unwrap_or([1.0; 3]);
    let mut start = [0.0; 3];
    let mut sizes = [0; 3];
    for axis in 0..3 {
        let [first, last] = extent[axis];
        let points = last.abs_diff(first) + 1;
        start[axis] = first as f64;
        sizes[axis] = points;
        if of_cells && points > 1 {
            sizes[axis] = points - 1;
            start[axis] += 0.5;
        }
    }
    let mut placement = Placement::axis_aligned(image.dims("WholeExtent", sizes)?, spacing);
    // Nine numbers, row by row: axes are the columns.
    if let Some([xx, yx, zx, xy, yy, zy, xz, yz, zz]) = image.array(&["Direction"])? {
        placement.direction = [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]];
    }
    let origin = image.array(&["Origin"])?.unwrap_or([0.0; 3]);
    placement.origin = [0, 1, 2].map(|row| {
        let steps = (0..3).map(|axis| placement.direction[axis][row] * spacing[axis] * start[axis]);
        origin[row] + steps.sum::<f64>()
    });
    Ok(placement)
}

/// First and last point along each axis.
fn extent(fields: &Fields<'_>, name: &str) -> Result<[[i64; 2]; 3]> {
    let text = fields.required(name)?;
    let [x0, x1, y0, y1, z0, z1] =
        fields.array::<i64, 6>(&[name])?.ok_or_else(|| fields.unexpected(name, "6 whole numbers", text))?;
    let extent = [[x0, x1], [y0, y1], [z0, z1]];
    if extent.iter().any(|[first, last]| first > last || last.abs_diff(*first) >= u64::from(u32::MAX)) {
        return Err(fields.unexpected(name, "first and last point of each axis", text));
    }
    Ok(extent)
}

fn stored_array(
    path: &Path,
    document: &Document<'_>,
    array: &Array<'_>,
    options: &ReadOptions,
    voxels: u64,
) -> Result<StoredArray> {
    let fields = &array.fields;
    let type_name = fields.required("type")?;
    let number_type = NumberType::from_name(type_name)
        .ok_or_else(|| fields.unexpected("type", "Int8 to Int64, UInt8 to UInt64, Float32 or Float64", type_name))?;
    let components = fields.number::<usize>("NumberOfComponents")?.unwrap_or(1);
    if !(1..=MAX_COMPONENTS).contains(&components) {
        let expected = format!("1 to {MAX_COMPONENTS}");
        return Err(fields.unexpected("NumberOfComponents", &expected, &components.to_string()));
    }
    let component = options.component_of(components, "numbers per voxel").map_err(|message| fields.fail(message))?;
    let place = place(document, array)?;
    let bytes = (number_type.size() * components) as u64;
    let bytes = bytes
        .checked_mul(voxels)
        .ok_or_else(|| fields.fail("expected an array, found more bytes than a file can have"))?;
    Ok(StoredArray {
        files: [path.to_owned()],
        place,
        header_type: header_type(&document.file)?,
        compressor: compressor(&document.file)?,
        byte_order: byte_order(&document.file)?,
        number_type,
        components,
        component,
        bytes,
    })
}

fn place(document: &Document<'_>, array: &Array<'_>) -> Result<Place> {
    let fields = &array.fields;
    match fields.get(&["format"]).unwrap_or("ascii") {
        "ascii" => Ok(Place::Text(array.text_offset)),
        "binary" => Ok(Place::Base64(array.text_offset)),
        "appended" => {
            let appended = document.appended.as_ref();
            let appended = appended.ok_or_else(|| fields.fail("expected an XML element AppendedData, found none"))?;
            let offset: u64 =
                fields.number("offset")?.ok_or_else(|| fields.fail("expected an `offset`, found none"))?;
            let too_large = || fields.unexpected("offset", "a place in the file", &offset.to_string());
            let offset = appended.offset.checked_add(offset).ok_or_else(too_large)?;
            match appended.encoding.as_str() {
                "raw" => Ok(Place::Raw(offset)),
                "base64" => Ok(Place::Base64(offset)),
                other => Err(fields.unexpected("encoding", "raw or base64", other)),
            }
        }
        other => Err(fields.unexpected("format", "ascii, binary or appended", other)),
    }
}

fn header_type(file: &Fields<'_>) -> Result<HeaderType> {
    match file.get(&["header_type"]).unwrap_or("UInt32") {
        "UInt32" => Ok(HeaderType::U32),
        "UInt64" => Ok(HeaderType::U64),
        other => Err(file.unexpected("header_type", "UInt32 or UInt64", other)),
    }
}

fn compressor(file: &Fields<'_>) -> Result<Option<Compressor>> {
    match file.get(&["compressor"]).unwrap_or_default() {
        "" => Ok(None),
        "vtkZLibDataCompressor" => Ok(Some(Compressor::Zlib)),
        "vtkLZ4DataCompressor" => Ok(Some(Compressor::Lz4)),
        other => {
            let expected = "vtkZLibDataCompressor or vtkLZ4DataCompressor (save the file with one of them, or without)";
            Err(file.unexpected("compressor", expected, other))
        }
    }
}

fn byte_order(file: &Fields<'_>) -> Result<ByteOrder> {
    match file.get(&["byte_order"]).unwrap_or("LittleEndian") {
        "LittleEndian" => Ok(ByteOrder::Little),
        "BigEndian" => Ok(ByteOrder::Big),
        other => Err(file.unexpected("byte_order", "LittleEndian or BigEndian", other)),
    }
}
