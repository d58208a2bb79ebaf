//! Pages of a TIFF file: what each holds, and where.

use std::fmt;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use ::tiff::decoder::Decoder;
use ::tiff::decoder::ifd::Value;
use ::tiff::tags::{ByteOrder as TiffByteOrder, Tag};
use ::tiff::{TiffError, TiffResult};
use voxrole_pack::ScalarType;

use super::super::payload;
use super::super::raw::{ByteOrder, StoredType};
use super::imagej;
use crate::{Error, Result};

/// Longest value of a tag, in bytes: descriptions of OME can be long.
const MAX_TAG_BYTES: usize = 64 << 20;
/// Longest piece of a page that is decoded at once.
const MAX_CHUNK_BYTES: usize = 1 << 30;

pub type FileDecoder = Decoder<BufReader<File>>;

/// What a page says of its numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageTags {
    pub width: u32,
    pub height: u32,
    pub scalar_type: ScalarType,
    pub byte_order: ByteOrder,
    /// Bits of a number, which are not those of `scalar_type` for half-precision floats.
    pub bits: u16,
    /// Numbers of a pixel.
    pub samples: u16,
    /// Whether each of a pixel's numbers is in a plane of its own.
    pub is_planar: bool,
    pub compression: u16,
    /// 0 where white is zero.
    pub photometric: u16,
}

impl fmt::Display for ImageTags {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { width, height, scalar_type, byte_order, bits, samples, is_planar, compression, photometric } = self;
        let order = match byte_order {
            ByteOrder::Little => "little",
            ByteOrder::Big => "big",
        };
        let planes = if *is_planar { ", in planes" } else { "" };
        write!(
            formatter,
            "{width} x {height} pixels of {samples} x {} ({bits} bits, {order} endian{planes}; compression {compression}, \
             photometric interpretation {photometric})",
            scalar_type.name()
        )
    }
}

impl ImageTags {
    /// Whether the page's bytes are its numbers.
    pub fn is_plain(&self) -> bool {
        self.compression == 1
            && self.samples == 1
            && self.photometric != 0
            && usize::from(self.bits) == 8 * self.scalar_type.size_in_bytes()
    }

    /// Bytes of a page of one number for each pixel.
    pub fn page_bytes(&self) -> u64 {
        u64::from(self.width) * u64::from(self.height) * self.scalar_type.size_in_bytes() as u64
    }

    pub fn stored_type(&self) -> StoredType {
        StoredType { scalar_type: self.scalar_type, byte_order: self.byte_order }
    }
}

/// The pages of a file that are alike.
pub struct Pages {
    /// Of all pages.
    pub tags: ImageTags,
    /// The first page's `ImageDescription`.
    pub description: String,
    /// Pixels per unit along x and y, as the first page gives them.
    pub resolution: [Option<f64>; 2],
    /// Index in the file and, if its bytes are in one run, first byte of each page.
    pages: Vec<(usize, Option<u64>)>,
    /// Planes that follow the only page without being pages, as ImageJ writes stacks above 4 GiB.
    extra_planes: usize,
}

impl Pages {
    /// Reads all pages' tags, thumbnails left out.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] for damaged pages, for numbers that are not read, and for pages of other sizes.
    pub fn read(path: &Path) -> Result<Self> {
        let mut decoder = open(path)?;
        let failed = |error| broken(path, error);
        let tags = image_tags(path, &mut decoder)?;
        let description = description(&mut decoder).map_err(failed)?;
        let resolution = [Tag::XResolution, Tag::YResolution].map(|tag| rational(&mut decoder, tag));
        let mut pages = Vec::new();
        for index in 0.. {
            if !is_thumbnail(&mut decoder).map_err(failed)? || index == 0 {
                let found = image_tags(path, &mut decoder)?;
                if found != tags {
                    let message = format!(
                        "page {index}: expected the first page's size and type, found {found} instead of {tags}"
                    );
                    return Err(Error::format(path, message));
                }
                pages.push((index, plain_offset(&mut decoder, &tags).map_err(failed)?));
            }
            if !decoder.more_images() {
                break;
            }
            decoder.next_image().map_err(failed)?;
        }
        let length = path.metadata().map_err(Error::io(path))?.len();
        let pages = Self { tags, description, resolution, pages, extra_planes: 0 };
        Ok(Self { extra_planes: pages.planes_behind(length), ..pages })
    }

    /// Planes that ImageJ's description counts, and that a file of one page and of `length` bytes has behind it.
    fn planes_behind(&self, length: u64) -> usize {
        let planes =
            imagej::Description::parse(&self.description).and_then(|description| description.count("images", 1));
        let (Some(planes), [(_, Some(offset))]) = (planes, self.pages.as_slice()) else { return 0 };
        let end = (planes as u64).checked_mul(self.tags.page_bytes()).and_then(|bytes| bytes.checked_add(*offset));
        if end.is_some_and(|end| end <= length) { planes - 1 } else { 0 }
    }

    /// Count of planes.
    pub fn count(&self) -> usize {
        self.pages.len() + self.extra_planes
    }

    /// Index in the file of a plane's page.
    pub fn page(&self, plane: usize) -> usize {
        self.pages.get(plane).or(self.pages.last()).map_or(0, |(page, _)| *page)
    }

    /// First byte of a plane that is uncompressed and in one run.
    pub fn offset(&self, plane: usize) -> Option<u64> {
        match self.pages.get(plane) {
            Some((_, offset)) => *offset,
            None => self.pages.first()?.1?.checked_add((plane as u64).checked_mul(self.tags.page_bytes())?),
        }
    }
}

/// A decoder at the first page.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] when it is damaged.
pub fn open(path: &Path) -> Result<FileDecoder> {
    let (file, _) = payload::open(path)?;
    let mut limits = ::tiff::decoder::Limits::default();
    limits.ifd_value_size = MAX_TAG_BYTES;
    limits.decoding_buffer_size = MAX_CHUNK_BYTES;
    limits.intermediate_buffer_size = MAX_CHUNK_BYTES;
    let decoder = Decoder::new(BufReader::new(file)).map_err(|error| broken(path, error))?;
    Ok(decoder.with_limits(limits))
}

/// What an error of the decoder means.
pub fn broken(path: &Path, error: TiffError) -> Error {
    match error {
        TiffError::IoError(error) if error.kind() != std::io::ErrorKind::UnexpectedEof => Error::io(path)(error),
        TiffError::UnsupportedError(error) => Error::format(
            path,
            format!(
                "expected TIFF uncompressed or with LZW, Deflate or PackBits, found: {error}; save it again, for example with \
                 ImageJ/Fiji"
            ),
        ),
        TiffError::IoError(_) => {
            Error::format(path, "expected whole TIFF pages, found the file's end before: it is cut short")
        }
        error => Error::format(path, format!("expected whole TIFF pages, found: {error}")),
    }
}

fn unsigned(decoder: &mut FileDecoder, tag: Tag, default: u16) -> TiffResult<u16> {
    let values = decoder.find_tag_unsigned_vec::<u16>(tag)?.unwrap_or_default();
    Ok(values.first().copied().unwrap_or(default))
}

fn image_tags(path: &Path, decoder: &mut FileDecoder) -> Result<ImageTags> {
    let failed = |error| broken(path, error);
    let (width, height) = decoder.dimensions().map_err(failed)?;
    let mut value = |tag, default| unsigned(decoder, tag, default).map_err(failed);
    let (bits, format) = (value(Tag::BitsPerSample, 1)?, value(Tag::SampleFormat, 1)?);
    let samples = value(Tag::SamplesPerPixel, 1)?;
    let is_planar = value(Tag::PlanarConfiguration, 1)? == 2;
    let (compression, photometric) = (value(Tag::Compression, 1)?, value(Tag::PhotometricInterpretation, 1)?);
    let scalar_type = match (format, bits) {
        (1 | 4, 8) => ScalarType::U8,
        (1 | 4, 16) => ScalarType::U16,
        (1 | 4, 32) => ScalarType::U32,
        (2, 8) => ScalarType::I8,
        (2, 16) => ScalarType::I16,
        (2, 32) => ScalarType::I32,
        (3, 16 | 32) => ScalarType::F32,
        (3, 64) => ScalarType::F64,
        _ => {
            let kind = match format {
                1 => "unsigned integers",
                2 => "signed integers",
                3 => "floats",
                _ => "numbers of no known kind",
            };
            let message =
                format!("expected integers of 8, 16 or 32 bits or floats of 16, 32 or 64, found {kind} of {bits} bits");
            return Err(Error::format(path, message));
        }
    };
    if samples == 0 || width == 0 || height == 0 {
        return Err(Error::format(
            path,
            format!("expected pages with pixels, found {width} x {height} of {samples} samples"),
        ));
    }
    let byte_order = match decoder.byte_order() {
        TiffByteOrder::LittleEndian => ByteOrder::Little,
        TiffByteOrder::BigEndian => ByteOrder::Big,
    };
    Ok(ImageTags { width, height, scalar_type, byte_order, bits, samples, is_planar, compression, photometric })
}

/// The description as text; bytes that are not UTF-8 are replaced.
fn description(decoder: &mut FileDecoder) -> TiffResult<String> {
    let mut ifd = decoder.image_ifd();
    let Some(entry) = ifd.find_entry(Tag::ImageDescription) else { return Ok(String::new()) };
    let length = usize::try_from(entry.count()).ok().filter(|&length| length <= MAX_TAG_BYTES);
    let mut bytes = vec![0; length.ok_or(TiffError::LimitsExceeded)?];
    let found = ifd.find_tag_bytes(Tag::ImageDescription, &mut bytes, 0)?.unwrap_or(0);
    bytes.truncate(found);
    let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
    // ImageJ may write the micro sign in Latin-1.
    Ok(String::from_utf8(bytes[..end].to_vec())
        .unwrap_or_else(|_| bytes[..end].iter().map(|&byte| char::from(byte)).collect()))
}

/// A positive rational number.
fn rational(decoder: &mut FileDecoder, tag: Tag) -> Option<f64> {
    let value = match decoder.find_tag(tag).ok()?? {
        Value::Rational(numerator, denominator) => f64::from(numerator) / f64::from(denominator),
        other => other.into_f64().ok()?,
    };
    (value.is_finite() && value > 0.0).then_some(value)
}

/// Whether the page is a smaller version of another one.
fn is_thumbnail(decoder: &mut FileDecoder) -> TiffResult<bool> {
    Ok(decoder.find_tag_unsigned::<u32>(Tag::NewSubfileType)?.unwrap_or(0) & 1 == 1)
}

/// The first byte of a page whose strips follow each other, uncompressed.
fn plain_offset(decoder: &mut FileDecoder, tags: &ImageTags) -> TiffResult<Option<u64>> {
    if !tags.is_plain() {
        return Ok(None);
    }
    let offsets = decoder.find_tag_unsigned_vec::<u64>(Tag::StripOffsets)?.unwrap_or_default();
    let counts = decoder.find_tag_unsigned_vec::<u64>(Tag::StripByteCounts)?.unwrap_or_default();
    let Some(&first) = offsets.first() else { return Ok(None) };
    let mut end = Some(first);
    for (&offset, &count) in offsets.iter().zip(&counts) {
        end = end.filter(|&end| end == offset).and_then(|end| end.checked_add(count));
    }
    let is_run = offsets.len() == counts.len() && end.is_some_and(|end| end - first == tags.page_bytes());
    Ok(is_run.then_some(first))
}
