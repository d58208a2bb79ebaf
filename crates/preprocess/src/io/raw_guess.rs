//! What a file of bare numbers may hold: layouts that its size allows, the smoothest first.

use std::collections::BTreeMap;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use flate2::bufread::MultiGzDecoder;
use voxrole_pack::ScalarType;

use super::payload::{self, GZIP_MAGIC};
use super::raw::{ByteOrder, StoredType};
use crate::{Error, Result};

/// Parts of the content that are looked at, and their length.
const WINDOWS: u64 = 3;
const WINDOW_BYTES: u64 = 8 << 20;
/// Gzipped content up to this length is unpacked for a guess.
const MOST_UNPACKED: u64 = 2 << 30;
/// Pairs of voxels compared in each window.
const PAIRS: usize = 3000;
/// Layouts that are proposed.
const PROPOSALS: usize = 3;
/// Sides that a guessed volume may have, and how many times as long as another one in a slice may be.
const SIDES: std::ops::RangeInclusive<u64> = 16..=4096;
const MOST_SLICES: u64 = 1 << 14;
const MOST_ASPECT: u64 = 4;
/// A float beyond these, but for 0, is no measured value, but bytes of something else.
const LARGEST_FLOAT: f64 = 1e20;
const SMALLEST_FLOAT: f64 = 1e-30;
/// Types to try, the more common first: of equally smooth ones the first is proposed.
const TYPES: [&str; 13] =
    ["u8", "u16le", "u16be", "i16le", "i16be", "f32le", "f32be", "i32le", "u32le", "f64le", "f64be", "i32be", "u32be"];

/// The content of a file, unpacked where it is gzipped: its length, and parts of it.
struct Content {
    length: u64,
    windows: Vec<Vec<u8>>,
}

impl Content {
    /// The content behind `skip` bytes; `None` where it is too long to be unpacked for a guess, or damaged.
    fn read(path: &Path, skip: u64) -> Result<Option<Self>> {
        let length = match length(path)? {
            Some(length) if length > skip => length - skip,
            _ => return Ok(None),
        };
        let bytes = length.min(WINDOW_BYTES);
        // At whole numbers of every type.
        let starts = (0..WINDOWS).map(|window| skip + (length - bytes) * (2 * window + 1) / (2 * WINDOWS) / 8 * 8);
        let mut windows = Vec::new();
        let mut stream = stream(path)?;
        let mut position = 0;
        for start in starts {
            // Short content has one window only.
            if start < position {
                continue;
            }
            let mut window = Vec::new();
            stream.skip(start - position).map_err(Error::io(path))?;
            stream.reader().take(bytes).read_to_end(&mut window).map_err(Error::io(path))?;
            position = start + bytes;
            windows.push(window);
        }
        Ok(Some(Self { length, windows }))
    }
}

enum Stream {
    Plain(std::fs::File),
    Packed(Box<MultiGzDecoder<BufReader<std::fs::File>>>),
}

impl Stream {
    fn reader(&mut self) -> &mut dyn Read {
        match self {
            Self::Plain(file) => file,
            Self::Packed(decoder) => decoder,
        }
    }

    fn skip(&mut self, count: u64) -> std::io::Result<()> {
        match self {
            Self::Plain(file) => file.seek(SeekFrom::Current(count.cast_signed())).map(drop),
            Self::Packed(decoder) => std::io::copy(&mut decoder.take(count), &mut std::io::sink()).map(drop),
        }
    }
}

fn stream(path: &Path) -> Result<Stream> {
    let (mut file, _) = payload::open(path)?;
    let mut magic = [0; GZIP_MAGIC.len()];
    let is_packed = file.read_exact(&mut magic).is_ok() && magic == GZIP_MAGIC;
    file.rewind().map_err(Error::io(path))?;
    Ok(if is_packed {
        Stream::Packed(Box::new(MultiGzDecoder::new(BufReader::new(file))))
    } else {
        Stream::Plain(file)
    })
}

/// Length of a file's content, unpacked; `None` where that is too long or damaged.
fn length(path: &Path) -> Result<Option<u64>> {
    Ok(match stream(path)? {
        Stream::Plain(file) => Some(file.metadata().map_err(Error::io(path))?.len()),
        Stream::Packed(decoder) => {
            let unpacked = std::io::copy(&mut decoder.take(MOST_UNPACKED), &mut std::io::sink());
            unpacked.ok().filter(|&length| length < MOST_UNPACKED)
        }
    })
}

/// The type of the numbers of a file whose dimensions are known.
///
/// # Errors
/// [`Error::Format`] when its size fits no type, or several: with those, the smoothest first.
pub(super) fn stored_type(path: &Path, dims: [u32; 3], skip: u64) -> Result<StoredType> {
    let voxels = dims.iter().fold(1, |product: u64, &dim| product.saturating_mul(u64::from(dim)));
    let fail = |message: String| Err(Error::format(path, message));
    let Some(content) = Content::read(path, skip)? else {
        return fail(
            "expected --dtype, found content whose length cannot be told: give the type of its numbers".into(),
        );
    };
    let [x, y, z] = dims;
    let types: Vec<StoredType> = types()
        .filter(|stored| voxels.checked_mul(stored.scalar_type.size_in_bytes() as u64) == Some(content.length))
        .collect();
    match types.as_slice() {
        [one] => Ok(*one),
        [] => fail(format!(
            "expected 1, 2, 4 or 8 bytes for each of {x} x {y} x {z} voxels, found {} bytes; check --dims and --skip-bytes",
            content.length
        )),
        several => {
            let lags = [1, u64::from(x), u64::from(x) * u64::from(y)];
            let mut ranked: Vec<(f64, StoredType)> = several
                .iter()
                .map(|&stored| {
                    let mut roughness = Roughness::new(&content, stored);
                    let last = if roughness.has_better_twin() { f64::MAX } else { 0.0 };
                    (lags.iter().map(|&lag| roughness.at(lag)).sum::<f64>().max(last), stored)
                })
                .collect();
            ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
            let names: Vec<String> = ranked.iter().map(|(_, stored)| format!("--dtype {stored}")).collect();
            let bytes = content.length / voxels;
            fail(format!(
                "expected the type of the numbers, found {bytes} bytes for each; likeliest first: {}",
                names.join(", ")
            ))
        }
    }
}

fn types() -> impl Iterator<Item = StoredType> {
    TYPES.iter().filter_map(|name| name.parse().ok())
}

/// Options that may describe a file without header, likeliest first; none where nothing fits.
pub(super) fn proposals(path: &Path) -> Vec<String> {
    // Whatever is wrong with the file is told without proposals.
    let Ok(Some(content)) = Content::read(path, 0) else { return Vec::new() };
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let named = named_types(&name);
    let mut found: Vec<(f64, String)> = Vec::new();
    for stored in types().filter(|stored| named.is_empty() || named.contains(stored)) {
        let mut roughness = Roughness::new(&content, stored);
        if named.is_empty() && roughness.has_better_twin() {
            continue;
        }
        let mut best: Option<(f64, [u64; 3], u64)> = None;
        for (dims, skip) in candidates(&name, content.length, stored.scalar_type.size_in_bytes() as u64) {
            let [x, y, _] = dims;
            let rough = roughness.at(1) + roughness.at(x) + roughness.at(x * y);
            if best.is_none_or(|(least, ..)| rough < least) {
                best = Some((rough, dims, skip));
            }
        }
        if let Some((rough, [x, y, z], skip)) = best.filter(|(rough, ..)| rough.is_finite()) {
            let skip = if skip > 0 { format!(" --skip-bytes {skip}") } else { String::new() };
            found.push((rough, format!("--dims {x},{y},{z} --dtype {stored}{skip}")));
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found.into_iter().take(PROPOSALS).map(|(_, options)| options).collect()
}

/// The types that a file's name speaks of.
fn named_types(name: &str) -> Vec<StoredType> {
    let words = name.split(|letter: char| !letter.is_ascii_alphanumeric());
    let mut found = Vec::new();
    for word in words {
        let (word, orders) = match (word.strip_suffix("le"), word.strip_suffix("be")) {
            (Some(word), None) if !word.is_empty() && word != "doub" => (word, vec![ByteOrder::Little]),
            (None, Some(word)) => (word, vec![ByteOrder::Big]),
            _ => (word, vec![ByteOrder::Little, ByteOrder::Big]),
        };
        let scalar_type = match word {
            "uint8" | "uchar" | "byte" | "8bit" => Some(ScalarType::U8),
            "int8" | "char" => Some(ScalarType::I8),
            "uint16" | "ushort" => Some(ScalarType::U16),
            "int16" | "short" => Some(ScalarType::I16),
            "uint32" | "uint" => Some(ScalarType::U32),
            "int32" | "int" => Some(ScalarType::I32),
            "float32" | "float" => Some(ScalarType::F32),
            "float64" | "double" => Some(ScalarType::F64),
            other => ScalarType::from_name(other),
        };
        if let Some(scalar_type) = scalar_type {
            found.extend(orders.into_iter().map(|byte_order| StoredType { scalar_type, byte_order }));
        }
    }
    found
}

/// Dimensions that fit a file of `length` bytes with numbers of `size`, and the bytes in front of them: those in its name if
/// there are any, else all in which sides are neither very long nor very short.
fn candidates(name: &str, length: u64, size: u64) -> Vec<([u64; 3], u64)> {
    // Not the digits of a type or version such as u8 or v2.
    let is_own = |before: &str| before.ends_with('x') || !before.ends_with(|letter: char| letter.is_alphanumeric());
    let digits = name.match_indices(|letter: char| letter.is_ascii_digit()).map(|(at, _)| at);
    let numbers: Vec<u64> = digits
        .filter(|&at| is_own(&name[..at]))
        .filter_map(|at| name[at..].split(|letter: char| !letter.is_ascii_digit()).next()?.parse().ok())
        .collect();
    let bytes = |dims: &[u64; 3]| dims.iter().try_fold(size, |product, dim| product.checked_mul(*dim));
    let named: Vec<([u64; 3], u64)> = numbers
        .windows(3)
        .filter_map(|three| <[u64; 3]>::try_from(three).ok())
        .filter_map(|dims| Some((dims, length.checked_sub(bytes(&dims).filter(|&bytes| bytes > 0)?)?)))
        // A header is shorter than what it describes.
        .filter(|(_, skip)| *skip < length / 2)
        .collect();
    if let Some(exact) = named.iter().find(|(_, skip)| *skip == 0) {
        return vec![*exact];
    }
    if !named.is_empty() {
        return named;
    }
    let voxels = length / size;
    if !length.is_multiple_of(size) {
        return Vec::new();
    }
    let divisors: Vec<u64> = SIDES.filter(|side| voxels.is_multiple_of(*side)).collect();
    let mut all = Vec::new();
    for &x in &divisors {
        for &y in divisors.iter().filter(|&&y| x <= MOST_ASPECT * y && y <= MOST_ASPECT * x) {
            let slices = voxels / (x * y);
            if voxels.is_multiple_of(x * y) && (*SIDES.start()..=MOST_SLICES).contains(&slices) {
                all.push(([x, y, slices], 0));
            }
        }
    }
    all
}

/// By how much voxels differ that lie so many voxels apart in a file, relative to any two voxels.
struct Roughness<'a> {
    content: &'a Content,
    stored: StoredType,
    spread: f64,
    known: BTreeMap<u64, f64>,
}

impl<'a> Roughness<'a> {
    fn new(content: &'a Content, stored: StoredType) -> Self {
        let mut roughness = Self { content, stored, spread: 1.0, known: BTreeMap::new() };
        // Voxels as far apart as a third of a window have little to do with each other.
        let far =
            [3, 5, 7].map(|part| content.windows[0].len() as u64 / stored.scalar_type.size_in_bytes() as u64 / part);
        roughness.spread = far.iter().map(|&lag| roughness.difference(lag)).sum::<f64>() / 3.0;
        roughness
    }

    /// Whether the same bits make better numbers with or without a sign, or as floats.
    fn has_better_twin(&self) -> bool {
        let twin = |scalar_type| {
            let stored = StoredType { scalar_type, ..self.stored };
            Self { stored, known: BTreeMap::new(), ..*self }.difference(1)
        };
        let own = self.difference(1);
        // Without a sign unless it makes a difference; whole numbers are nearly always strange as floats.
        match self.stored.scalar_type {
            ScalarType::U16 => twin(ScalarType::I16) < own,
            ScalarType::I16 => twin(ScalarType::U16) <= own,
            ScalarType::U32 => twin(ScalarType::I32) < own || twin(ScalarType::F32).is_finite(),
            ScalarType::I32 => twin(ScalarType::U32) <= own || twin(ScalarType::F32).is_finite(),
            _ => false,
        }
    }

    /// Between neighbours at this distance; 1 where nothing can be told, infinite where these are no numbers.
    fn at(&mut self, lag: u64) -> f64 {
        if let Some(&known) = self.known.get(&lag) {
            return known;
        }
        let difference = self.difference(lag);
        let relative = if self.spread > 0.0 && difference.is_finite() { difference / self.spread } else { difference };
        let roughness = if relative.is_nan() { 1.0 } else { relative };
        self.known.insert(lag, roughness);
        roughness
    }

    /// The mean difference of voxels `lag` apart; NaN where none are that far apart, infinite where these are no numbers.
    fn difference(&self, lag: u64) -> f64 {
        let size = self.stored.scalar_type.size_in_bytes();
        let (mut sum, mut count) = (0.0, 0);
        for window in &self.content.windows {
            let voxels = window.len() / size;
            let Some(pairs) = usize::try_from(lag).ok().and_then(|lag| voxels.checked_sub(lag)) else { continue };
            // An odd step, so that no row or column is looked at only.
            for first in (0..pairs).step_by((pairs / PAIRS) | 1) {
                let [a, b] =
                    [first, first + lag as usize].map(|voxel| number(&window[voxel * size..][..size], self.stored));
                let is_odd = |value: f64| value != 0.0 && !(SMALLEST_FLOAT..=LARGEST_FLOAT).contains(&value.abs());
                if is_odd(a) || is_odd(b) {
                    return f64::INFINITY;
                }
                sum += (a - b).abs();
                count += 1;
            }
        }
        sum / f64::from(count)
    }
}

fn number(bytes: &[u8], stored: StoredType) -> f64 {
    let mut eight = [0; 8];
    eight[..bytes.len()].copy_from_slice(bytes);
    if stored.byte_order == ByteOrder::Big {
        eight[..bytes.len()].reverse();
    }
    let whole = u64::from_le_bytes(eight);
    match stored.scalar_type {
        ScalarType::U8 | ScalarType::U16 | ScalarType::U32 => whole as f64,
        ScalarType::I8 => f64::from(whole as u8 as i8),
        ScalarType::I16 => f64::from(whole as u16 as i16),
        ScalarType::I32 => f64::from(whole as u32 as i32),
        ScalarType::F32 => f64::from(f32::from_bits(whole as u32)),
        ScalarType::F64 => f64::from_bits(whole),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_speak_of_types_and_sizes() {
        let types = |name: &str| named_types(name).iter().map(StoredType::to_string).collect::<Vec<_>>();
        assert_eq!(types("head_128x256x256_u16be.raw"), ["u16be"]);
        assert_eq!(types("aneurism_256x256x256_uint8.raw"), ["u8", "u8"]);
        assert_eq!(types("field-float.bin"), ["f32le", "f32be"]);
        assert_eq!(types("double.raw"), ["f64le", "f64be"]);
        assert_eq!(types("table.raw"), [""; 0]);
        assert_eq!(candidates("head_12x34x56_u8.raw", 12 * 34 * 56, 1), [([12, 34, 56], 0)]);
        assert_eq!(candidates("s1_12_34_56.raw", 2 * 12 * 34 * 56 + 100, 2), [([12, 34, 56], 100)]);
    }

    #[test]
    fn sizes_are_the_factors_of_the_length() {
        let all = candidates("ct.raw", 64 * 64 * 32, 1);
        assert!(all.contains(&([64, 64, 32], 0)) && all.contains(&([32, 64, 64], 0)));
        assert!(all.iter().all(|(dims, _)| dims.iter().product::<u64>() == 64 * 64 * 32));
        assert!(candidates("ct.raw", 9973, 1).is_empty());
        assert!(candidates("ct.raw", 64 * 64 * 32 + 1, 2).is_empty());
    }
}
