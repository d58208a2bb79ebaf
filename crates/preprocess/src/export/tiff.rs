//! Writer of TIFF stacks that ImageJ opens with spacing and unit: TIFF 6.0, BigTIFF where offsets need more than 32 bits.
//!
//! Written here and not by the crate `tiff`: ImageJ takes all pages of a stack to lie one behind the other from the first
//! page's offset on, where that crate puts each page's directory between them. So the first directory lies before the pages
//! and the others behind them, as ImageJ itself writes it (`ij.io.TiffEncoder`).

use std::fmt::Write as _;
use std::io::{self, Write};

use voxrole_pack::scalar::Scalar;
use voxrole_pack::{GridGeometry, ScalarType, with_scalars};

use super::component;
use super::tiff_directory::{Directory, Entry};
use crate::field_volume::FieldVolume;

/// Where the first page begins is a multiple of this.
const ALIGNMENT: u64 = 16;

/// The type that a field's numbers are written as, of those that ImageJ knows: i8 becomes i16; u32, i32 and f64 become f32.
#[must_use]
pub fn written_type(scalar_type: ScalarType) -> ScalarType {
    match scalar_type {
        ScalarType::I8 => ScalarType::I16,
        ScalarType::U32 | ScalarType::I32 | ScalarType::F64 => ScalarType::F32,
        own => own,
    }
}

/// Writes a field, one slice a page; of normals three pages a slice, ImageJ's channels. The direction of the axes finds no
/// place.
///
/// # Errors
/// [`io::ErrorKind::InvalidInput`] where a spacing is no ratio of two 32-bit numbers; else whatever `out` says.
pub fn write(out: &mut impl Write, volume: &FieldVolume) -> io::Result<()> {
    let classic = Stack::new(volume, false)?;
    let stack = if classic.end() > u64::from(u32::MAX) { Stack::new(volume, true)? } else { classic };
    stack.write(out, volume)
}

/// Where everything lies.
struct Stack {
    is_big: bool,
    first: Directory,
    /// Of each other page, without its place.
    other: Directory,
    pages: u64,
    page_bytes: u64,
}

impl Stack {
    fn new(volume: &FieldVolume, is_big: bool) -> io::Result<Self> {
        let geometry = volume.geometry();
        let [width, height, depth] = geometry.dims;
        let scalar_type = written_type(volume.scalar_type());
        let sample_format = match scalar_type {
            ScalarType::U8 | ScalarType::U16 | ScalarType::U32 => 1,
            ScalarType::I8 | ScalarType::I16 | ScalarType::I32 => 2,
            ScalarType::F32 | ScalarType::F64 => 3,
        };
        let bytes = scalar_type.size_in_bytes() as u64;
        let page_bytes = u64::from(width) * u64::from(height) * bytes;
        let entries = |description: Option<Entry>| -> io::Result<Vec<Entry>> {
            let mut entries = vec![
                Entry::long(256, width),
                Entry::long(257, height),
                Entry::short(258, 8 * bytes as u16),
                Entry::short(259, 1),
                Entry::short(262, 1),
            ];
            entries.extend(description);
            entries.extend([
                Entry::offset(273, 0, is_big),
                Entry::short(277, 1),
                Entry::long(278, height),
                Entry::offset(279, page_bytes, is_big),
                Entry::rational(282, ratio(1.0 / geometry.spacing[0])?),
                Entry::rational(283, ratio(1.0 / geometry.spacing[1])?),
                Entry::short(296, 1),
                Entry::short(339, sample_format),
            ]);
            Ok(entries)
        };
        let first = Directory::new(is_big, entries(Some(Entry::text(270, &description(volume))))?);
        let other = Directory::new(is_big, entries(None)?);
        Ok(Self { is_big, first, other, pages: u64::from(depth) * volume.components() as u64, page_bytes })
    }

    fn header_bytes(&self) -> u64 {
        if self.is_big { 16 } else { 8 }
    }

    fn first_page(&self) -> u64 {
        (self.header_bytes() + self.first.len()).next_multiple_of(ALIGNMENT)
    }

    /// Where the directory of a page other than the first lies; 0, which means that there is none, behind the last.
    fn directory_offset(&self, page: u64) -> u64 {
        if page == self.pages {
            return 0;
        }
        let behind_pages = (self.first_page() + self.pages * self.page_bytes).next_multiple_of(ALIGNMENT);
        behind_pages + (page - 1) * self.other.len()
    }

    fn end(&self) -> u64 {
        let last = self.directory_offset(self.pages - 1);
        if self.pages == 1 { self.first_page() + self.page_bytes } else { last + self.other.len() }
    }

    fn write(&self, out: &mut impl Write, volume: &FieldVolume) -> io::Result<()> {
        let header = self.header_bytes();
        if self.is_big {
            out.write_all(b"II\x2b\0\x08\0\0\0")?;
            out.write_all(&header.to_le_bytes())?;
        } else {
            out.write_all(b"II\x2a\0")?;
            out.write_all(&(header as u32).to_le_bytes())?;
        }
        out.write_all(&self.first.bytes(header, self.first_page(), self.directory_offset(1)))?;
        write_zeros(out, self.first_page() - header - self.first.len())?;
        write_pages(out, volume)?;
        let end = self.first_page() + self.pages * self.page_bytes;
        if self.pages > 1 {
            write_zeros(out, self.directory_offset(1) - end)?;
        }
        for page in 1..self.pages {
            let strip = self.first_page() + page * self.page_bytes;
            out.write_all(&self.other.bytes(self.directory_offset(page), strip, self.directory_offset(page + 1)))?;
        }
        Ok(())
    }
}

fn write_pages(out: &mut impl Write, volume: &FieldVolume) -> io::Result<()> {
    let [width, height, depth] = volume.geometry().dims_usize();
    let mut bytes = Vec::new();
    for z in 0..depth {
        let slice = z * width * height..(z + 1) * width * height;
        bytes.clear();
        if volume.components() == 1 {
            append_as_written(volume, slice, &mut bytes);
            out.write_all(&bytes)?;
            continue;
        }
        volume.append_le(slice, &mut bytes);
        for axis in 0..volume.components() {
            out.write_all(&component(&bytes, axis))?;
        }
    }
    Ok(())
}

/// The numbers of some voxels in their [`written_type`].
fn append_as_written(volume: &FieldVolume, voxels: std::ops::Range<usize>, bytes: &mut Vec<u8>) {
    fn convert<T: Scalar, U: Scalar>(values: &[T], bytes: &mut Vec<u8>) {
        U::append_le(&values.iter().map(|value| U::from_f64(value.to_f64())).collect::<Vec<_>>(), bytes);
    }
    let own = volume.scalar_type();
    match written_type(own) {
        written if written == own => volume.append_le(voxels, bytes),
        ScalarType::I16 => with_scalars!(&volume.numbers(voxels), values => convert::<_, i16>(values, bytes)),
        _ => with_scalars!(&volume.numbers(voxels), values => convert::<_, f32>(values, bytes)),
    }
}

fn write_zeros(out: &mut impl Write, count: u64) -> io::Result<()> {
    out.write_all(&vec![0; count as usize])
}

/// What ImageJ reads: the stack's shape, the distance between slices, the unit, the origin in pixels and the range to show.
fn description(volume: &FieldVolume) -> String {
    let geometry = volume.geometry();
    let [_, _, slices] = geometry.dims;
    let channels = volume.components();
    let mut text = format!("ImageJ=1.54f\nimages={}\n", u64::from(slices) * channels as u64);
    // Writing to a string cannot fail.
    let _infallible = if channels == 1 {
        writeln!(text, "slices={slices}")
    } else {
        writeln!(text, "channels={channels}\nslices={slices}\nhyperstack=true\nmode=grayscale")
    };
    let unit = if geometry.unit.is_empty() { "pixel".into() } else { escaped(&geometry.unit) };
    let _infallible = writeln!(text, "unit={unit}\nspacing={}\nloop=false", geometry.spacing[2]);
    for (name, origin) in ["xorigin", "yorigin", "zorigin"].into_iter().zip(origin_in_voxels(geometry)) {
        let _infallible = writeln!(text, "{name}={origin}");
    }
    if let Some([low, high]) = volume.finite_range() {
        let _infallible = writeln!(text, "min={low}\nmax={high}");
    }
    text
}

/// The voxel at which the world's origin lies if the axes are taken to be the world's.
fn origin_in_voxels(geometry: &GridGeometry) -> [f64; 3] {
    [0, 1, 2].map(|axis| 0.0 - geometry.origin[axis] / geometry.spacing[axis])
}

/// As Java's properties are written: ASCII only.
fn escaped(text: &str) -> String {
    let mut escaped = String::new();
    for unit in text.chars().filter(|letter| !letter.is_control()).collect::<String>().encode_utf16() {
        match u8::try_from(unit) {
            Ok(ascii) if ascii.is_ascii() => escaped.push(char::from(ascii)),
            _ => {
                let _infallible = write!(escaped, "\\u{unit:04X}");
            }
        }
    }
    escaped
}

/// The nearest ratio of two 32-bit numbers, by continued fractions.
fn ratio(value: f64) -> io::Result<[u32; 2]> {
    let out_of_range = || {
        let message = format!("TIFF holds no spacing of {}: export another format", 1.0 / value);
        io::Error::new(io::ErrorKind::InvalidInput, message)
    };
    let (mut before, mut last, mut rest) = ([0_u64, 1], [1_u64, 0], value);
    loop {
        let whole = rest.floor();
        if whole > f64::from(u32::MAX) {
            break;
        }
        let next = [0, 1].map(|part| whole as u64 * last[part] + before[part]);
        if next.iter().any(|&part| part > u64::from(u32::MAX)) {
            break;
        }
        (before, last) = (last, next);
        if rest == whole || last[0] as f64 / last[1] as f64 == value {
            break;
        }
        rest = 1.0 / (rest - whole);
    }
    let [numerator, denominator] = last.map(|part| part as u32);
    if numerator == 0 || denominator == 0 { Err(out_of_range()) } else { Ok([numerator, denominator]) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_are_as_near_as_32_bits_allow() {
        assert_eq!(ratio(1.0 / 0.78125).expect("in range"), [32, 25]);
        assert_eq!(ratio(1.0).expect("in range"), [1, 1]);
        assert_eq!(ratio(1e6).expect("in range"), [1_000_000, 1]);
        for value in [1.0 / 3.0, std::f64::consts::PI, 1e-4, 12_345.678_9, 0.001_234] {
            let [numerator, denominator] = ratio(value).expect("in range");
            let found = f64::from(numerator) / f64::from(denominator);
            assert!((found / value - 1.0).abs() < 1e-12, "{value}: {numerator}/{denominator}");
        }
        assert!(ratio(1e10).is_err() && ratio(1e-11).is_err());
    }

    #[test]
    fn units_are_ascii() {
        assert_eq!(escaped("\u{b5}m\n"), "\\u00B5m");
    }
}
