//! Writer of VTK's XML image data (`.vti`) with appended numbers:
//! <https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html>.
//!
//! The direction of the axes is understood by VTK 9 and newer; nothing in the format says what the world's axes mean.

use std::io::{self, Seek, SeekFrom, Write};

use flate2::Compression;
use flate2::write::ZlibEncoder;
use rayon::prelude::*;
use voxrole_pack::ScalarType;

use super::write_numbers;
use crate::field_volume::FieldVolume;

/// Blocks that are packed at the same time.
const BATCH: usize = 64;

/// Writes a field as point data. `compress`: whether the numbers are packed by zlib, in blocks.
///
/// # Errors
/// Whatever `out` says.
pub fn write(out: &mut (impl Write + Seek), volume: &FieldVolume, compress: bool) -> io::Result<()> {
    write_start(out, volume, compress)?;
    if compress {
        write_packed(out, volume)?;
    } else {
        let number_bytes = volume.components() * volume.scalar_type().size_in_bytes();
        let length = volume.geometry().voxel_count() as u64 * number_bytes as u64;
        out.write_all(&length.to_le_bytes())?;
        write_numbers(out, volume)?;
    }
    out.write_all(b"\n  </AppendedData>\n</VTKFile>\n")
}

fn write_start(out: &mut impl Write, volume: &FieldVolume, compress: bool) -> io::Result<()> {
    let geometry = volume.geometry();
    let list = |numbers: &[f64]| {
        // `+ 0.0` makes 0 of −0.
        numbers.iter().map(|number| (number + 0.0).to_string()).collect::<Vec<_>>().join(" ")
    };
    let [x, y, z] = geometry.dims.map(|dim| dim - 1);
    let extent = format!("0 {x} 0 {y} 0 {z}");
    // Row by row, where the columns are the axes.
    let rows = geometry.world_from_axes().transpose().to_cols_array();
    let (name, type_name) = (volume.field().name(), type_name(volume.scalar_type()));
    let (role, components) = if volume.components() == 1 { ("Scalars", 1) } else { ("Vectors", 3) };
    let compressor = if compress { " compressor=\"vtkZLibDataCompressor\"" } else { "" };
    write!(
        out,
        "<?xml version=\"1.0\"?>\n\
         <VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\"{compressor}>\n  \
           <ImageData WholeExtent=\"{extent}\" Origin=\"{}\" Spacing=\"{}\" Direction=\"{}\">\n    \
             <Piece Extent=\"{extent}\">\n      \
               <PointData {role}=\"{name}\">\n        \
                 <DataArray type=\"{type_name}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"appended\" \
                  offset=\"0\"/>\n      \
               </PointData>\n    \
             </Piece>\n  \
           </ImageData>\n  \
           <AppendedData encoding=\"raw\">\n   _",
        list(&geometry.origin),
        list(&geometry.spacing),
        list(&rows)
    )
}

/// Packed blocks of equal length, the last one shorter, behind their count, that length, the last one's and each one's
/// packed length.
fn write_packed(out: &mut (impl Write + Seek), volume: &FieldVolume) -> io::Result<()> {
    let chunks = volume.chunks();
    let voxel_bytes = volume.components() * volume.scalar_type().size_in_bytes();
    let length = |chunk: Option<&std::ops::Range<usize>>| chunk.map_or(0, |chunk| (chunk.len() * voxel_bytes) as u64);
    let (first, last) = (length(chunks.first()), length(chunks.last()));
    let mut table = vec![chunks.len() as u64, first, if last == first { 0 } else { last }];
    let start = out.stream_position()?;
    write_table(out, &vec![0; table.len() + chunks.len()])?;
    for batch in chunks.chunks(BATCH) {
        let pack = |chunk: &std::ops::Range<usize>| {
            let mut bytes = Vec::with_capacity(chunk.len() * voxel_bytes);
            volume.append_le(chunk.clone(), &mut bytes);
            let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
            encoder.write_all(&bytes)?;
            encoder.finish()
        };
        for packed in batch.par_iter().map(pack).collect::<io::Result<Vec<_>>>()? {
            table.push(packed.len() as u64);
            out.write_all(&packed)?;
        }
    }
    let end = out.stream_position()?;
    out.seek(SeekFrom::Start(start))?;
    write_table(out, &table)?;
    out.seek(SeekFrom::Start(end)).map(drop)
}

fn write_table(out: &mut impl Write, table: &[u64]) -> io::Result<()> {
    table.iter().try_for_each(|number| out.write_all(&number.to_le_bytes()))
}

fn type_name(scalar_type: ScalarType) -> &'static str {
    match scalar_type {
        ScalarType::U8 => "UInt8",
        ScalarType::I8 => "Int8",
        ScalarType::U16 => "UInt16",
        ScalarType::I16 => "Int16",
        ScalarType::U32 => "UInt32",
        ScalarType::I32 => "Int32",
        ScalarType::F32 => "Float32",
        ScalarType::F64 => "Float64",
    }
}
