//! Writer of attached NRRD files with raw little-endian numbers.
//!
//! Everything goes to a [`Write`]: for a file that appears only when complete, give it a
//! [`voxrole_pack::atomic_file::AtomicFile`]'s file, with a buffer in front.

use std::io::{self, Write};

use voxrole_pack::scalar::LittleEndian;
use voxrole_pack::{GridGeometry, ScalarType, Scalars, WorldFrame, with_scalars};

/// Numbers that are converted to bytes at a time.
const CHUNK_NUMBERS: usize = 1 << 14;

/// What each voxel holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Components {
    /// One number.
    Scalar,
    /// Three numbers, one behind the other: a vector's components along the world axes.
    WorldVector,
}

/// How the numbers behind the header are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// As they are.
    Raw,
    /// As one gzip stream.
    Gzip,
}

/// Writes a volume of one number per voxel, x fastest. `content` is a short description, or empty.
///
/// # Errors
/// Whatever `out` says; [`io::ErrorKind::InvalidInput`] when the count of numbers is not the grid's count of voxels.
pub fn write_scalars(
    out: &mut impl Write,
    geometry: &GridGeometry,
    scalars: &Scalars,
    content: &str,
) -> io::Result<()> {
    check_count(scalars.len(), geometry)?;
    write_header(out, geometry, scalars.scalar_type(), Components::Scalar, Encoding::Raw, content)?;
    with_scalars!(scalars, values => write_numbers(out, values))
}

/// Writes the header alone; the numbers must follow, little-endian, in `encoding`.
///
/// # Errors
/// Whatever `out` says.
pub fn write_header(
    out: &mut impl Write,
    geometry: &GridGeometry,
    scalar_type: ScalarType,
    components: Components,
    encoding: Encoding,
    content: &str,
) -> io::Result<()> {
    let [x, y, z] = geometry.dims;
    let steps = [0, 1, 2].map(|axis| {
        // `+ 0.0` makes 0 of −0, which would be written with its sign.
        let [x, y, z] = geometry.direction[axis].map(|component| component * geometry.spacing[axis] + 0.0);
        format!("({x},{y},{z})")
    });
    let vector = components == Components::WorldVector;
    writeln!(
        out,
        "NRRD0005\n# Complete NRRD file format specification at:\n# http://teem.sourceforge.net/nrrd/format.html"
    )?;
    if !content.is_empty() {
        writeln!(out, "content: {}", content.replace(char::is_control, " "))?;
    }
    writeln!(out, "type: {}\ndimension: {}", type_name(scalar_type), if vector { 4 } else { 3 })?;
    match geometry.frame {
        WorldFrame::Unspecified => writeln!(out, "space dimension: 3")?,
        WorldFrame::LeftPosteriorSuperior => writeln!(out, "space: left-posterior-superior")?,
    }
    writeln!(out, "sizes: {}{x} {y} {z}", if vector { "3 " } else { "" })?;
    writeln!(out, "space directions: {}{}", if vector { "none " } else { "" }, steps.join(" "))?;
    writeln!(out, "kinds: {}domain domain domain", if vector { "vector " } else { "" })?;
    if !geometry.unit.is_empty() {
        let unit = match geometry.unit.as_str() {
            // Readers take headers for ASCII: of µm they would make metres.
            "\u{b5}m" | "\u{3bc}m" => "um",
            unit => unit,
        };
        let unit = unit.replace(char::is_control, " ").replace('\\', "\\\\").replace('"', "\\\"");
        writeln!(out, "space units: \"{unit}\" \"{unit}\" \"{unit}\"")?;
    }
    let [x, y, z] = geometry.origin.map(|coordinate| coordinate + 0.0);
    let encoding = if encoding == Encoding::Gzip { "gzip" } else { "raw" };
    writeln!(out, "endian: little\nencoding: {encoding}\nspace origin: ({x},{y},{z})")?;
    if vector {
        writeln!(out, "measurement frame: (1,0,0) (0,1,0) (0,0,1)")?;
    }
    writeln!(out)
}

fn write_numbers<T: LittleEndian>(out: &mut impl Write, values: &[T]) -> io::Result<()> {
    let mut bytes = Vec::with_capacity(values.len().min(CHUNK_NUMBERS) * T::SIZE);
    for chunk in values.chunks(CHUNK_NUMBERS) {
        bytes.clear();
        T::append_le(chunk, &mut bytes);
        out.write_all(&bytes)?;
    }
    Ok(())
}

fn check_count(found: usize, geometry: &GridGeometry) -> io::Result<()> {
    let expected = geometry.voxel_count();
    if found == expected {
        return Ok(());
    }
    let message = format!("expected the {expected} voxels of a grid of {:?}, found {found}", geometry.dims);
    Err(io::Error::new(io::ErrorKind::InvalidInput, message))
}

/// The names that teem, ITK and pynrrd all know.
fn type_name(scalar_type: ScalarType) -> &'static str {
    match scalar_type {
        ScalarType::U8 => "uint8",
        ScalarType::I8 => "int8",
        ScalarType::U16 => "uint16",
        ScalarType::I16 => "int16",
        ScalarType::U32 => "uint32",
        ScalarType::I32 => "int32",
        ScalarType::F32 => "float",
        ScalarType::F64 => "double",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn geometry() -> GridGeometry {
        GridGeometry {
            origin: [1.5, -0.0, 1e-7],
            direction: [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
            unit: "mm".into(),
            frame: WorldFrame::LeftPosteriorSuperior,
            ..GridGeometry::axis_aligned([1, 2, 1], [0.5, 2.0, 3.0])
        }
    }

    #[test]
    fn a_scalar_file_is_written_to_the_byte() {
        let mut out = Vec::new();
        write_scalars(&mut out, &geometry(), &Scalars::U16(vec![1, 0x0203]), "a\nb").expect("into memory");
        let header = "NRRD0005\n# Complete NRRD file format specification at:\n\
            # http://teem.sourceforge.net/nrrd/format.html\ncontent: a b\ntype: uint16\ndimension: 3\n\
            space: left-posterior-superior\nsizes: 1 2 1\nspace directions: (0,0.5,0) (-2,0,0) (0,0,3)\n\
            kinds: domain domain domain\nspace units: \"mm\" \"mm\" \"mm\"\nendian: little\nencoding: raw\n\
            space origin: (1.5,0,0.0000001)\n\n";
        assert_eq!(String::from_utf8_lossy(&out[..header.len()]), header);
        assert_eq!(out[header.len()..], [1, 0, 3, 2]);
    }

    #[test]
    fn a_vector_file_has_a_first_axis_of_three() {
        let mut out = Vec::new();
        let geometry = GridGeometry::axis_aligned([1, 2, 1], [1.0; 3]);
        write_header(&mut out, &geometry, ScalarType::F32, Components::WorldVector, Encoding::Gzip, "")
            .expect("into memory");
        let text = String::from_utf8_lossy(&out);
        for line in [
            "type: float",
            "dimension: 4",
            "space dimension: 3",
            "sizes: 3 1 2 1",
            "space directions: none (1,0,0) (0,1,0) (0,0,1)",
            "kinds: vector domain domain domain",
            "measurement frame: (1,0,0) (0,1,0) (0,0,1)",
            "encoding: gzip",
        ] {
            assert!(text.lines().any(|found| found == line), "{line} in {text}");
        }
        assert!(text.ends_with("\n\n"));
    }

    #[test]
    fn a_wrong_count_is_refused_before_anything_is_written() {
        let mut out = Vec::new();
        let error = write_scalars(&mut out, &geometry(), &Scalars::F32(vec![1.0]), "").expect_err("one of two voxels");
        assert_eq!((error.kind(), out.len()), (io::ErrorKind::InvalidInput, 0));
    }
}
