//! Text headers of NRRD and MetaImage: lines of bounded length, and the fields on them.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Take};
use std::path::Path;
use std::str::FromStr;

use super::payload;
use crate::{Error, Result};

/// Longest header that is read: what is longer is no header.
const MAX_HEADER_BYTES: u64 = 1 << 20;
/// How much of a bad value an error shows, in characters.
const SHOWN_CHARACTERS: usize = 60;

/// The lines of a file's beginning.
pub(super) struct HeaderLines<'a> {
    path: &'a Path,
    reader: BufReader<Take<File>>,
    offset: u64,
}

impl<'a> HeaderLines<'a> {
    pub fn open(path: &'a Path) -> Result<Self> {
        let (file, _) = payload::open(path)?;
        Ok(Self { path, reader: BufReader::new(file.take(MAX_HEADER_BYTES)), offset: 0 })
    }

    /// The next line without its end, or `None` at the file's end. Bytes that are not UTF-8 are replaced.
    pub fn next_line(&mut self) -> Result<Option<String>> {
        let mut line = Vec::new();
        self.offset += self.reader.read_until(b'\n', &mut line).map_err(Error::io(self.path))? as u64;
        if self.offset == MAX_HEADER_BYTES && !line.ends_with(b"\n") {
            let message = format!("expected a header of at most {MAX_HEADER_BYTES} bytes, found no end of it");
            return Err(Error::format(self.path, message));
        }
        if line.is_empty() {
            return Ok(None);
        }
        let line = line.strip_suffix(b"\n").unwrap_or(&line);
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        Ok(Some(String::from_utf8_lossy(line).into_owned()))
    }

    /// Bytes of the lines given so far, ends included.
    pub fn offset(&self) -> u64 {
        self.offset
    }
}

/// A header's fields by name. Names are compared without regard to case and blanks.
pub(super) struct Fields<'a> {
    path: &'a Path,
    values: BTreeMap<String, String>,
}

fn key(name: &str) -> String {
    name.chars().filter(|character| !character.is_whitespace()).flat_map(char::to_lowercase).collect()
}

/// `text` in quotes, cut to a length that an error can show.
pub(super) fn shown(text: &str) -> String {
    match text.char_indices().nth(SHOWN_CHARACTERS) {
        None => format!("{text:?}"),
        Some((end, _)) => format!("{:?}...", &text[..end]),
    }
}

impl<'a> Fields<'a> {
    pub fn new(path: &'a Path) -> Self {
        Self { path, values: BTreeMap::new() }
    }

    /// Adds a field; the same field twice is refused, since one of them would be ignored.
    pub fn insert(&mut self, name: &str, value: &str) -> Result<()> {
        match self.values.insert(key(name), value.trim().to_owned()) {
            None => Ok(()),
            Some(_) => Err(self.fail(format!("expected the field {} once, found it twice", shown(name)))),
        }
    }

    /// The value of the first of `names` that the header has.
    pub fn get(&self, names: &[&str]) -> Option<&str> {
        names.iter().find_map(|name| self.values.get(&key(name))).map(String::as_str)
    }

    pub fn required(&self, name: &str) -> Result<&str> {
        self.get(&[name]).ok_or_else(|| self.fail(format!("expected a field `{name}`, found none")))
    }

    /// An error in this header.
    pub fn fail(&self, message: impl Into<String>) -> Error {
        Error::format(self.path, message)
    }

    /// An error in field `name`, whose value is not what was expected.
    pub fn unexpected(&self, name: &str, expected: &str, found: &str) -> Error {
        self.fail(format!("{name}: expected {expected}, found {}", shown(found)))
    }

    /// `text` as blank-separated numbers.
    pub fn numbers<T: FromStr>(&self, name: &str, text: &str) -> Result<Vec<T>> {
        text.split_whitespace()
            .map(|word| word.parse().map_err(|_| self.unexpected(name, expected_number::<T>(), word)))
            .collect()
    }

    /// The first present one of `names` as exactly `N` blank-separated numbers.
    pub fn array<T: FromStr, const N: usize>(&self, names: &[&str]) -> Result<Option<[T; N]>> {
        let Some((name, text)) = names.iter().find_map(|name| Some((*name, self.get(&[name])?))) else {
            return Ok(None);
        };
        let numbers = self.numbers(name, text)?;
        let array = numbers.try_into().map_err(|_| self.unexpected(name, &format!("{N} numbers"), text))?;
        Ok(Some(array))
    }

    /// A field of one number.
    pub fn number<T: FromStr>(&self, name: &str) -> Result<Option<T>> {
        Ok(self.array::<T, 1>(&[name])?.map(|[number]| number))
    }

    /// Sizes as dimensions: every axis has at least one voxel and at most 2³² − 1.
    pub fn dims(&self, name: &str, sizes: [u64; 3]) -> Result<[u32; 3]> {
        let mut dims = [0; 3];
        for (dim, size) in dims.iter_mut().zip(sizes) {
            *dim = u32::try_from(size)
                .ok()
                .filter(|&dim| dim > 0)
                .ok_or_else(|| self.unexpected(name, "axes of 1 to 4294967295 voxels", &size.to_string()))?;
        }
        Ok(dims)
    }

    /// The path of a data file that the header names, which must exist.
    pub fn data_file(&self, name: &str, value: &str) -> Result<std::path::PathBuf> {
        let data = self.path.parent().unwrap_or(Path::new("")).join(value);
        match data.metadata() {
            Ok(_) => Ok(data),
            Err(error) => Err(self.fail(format!(
                "expected the data in {}, found: {error}; `{name}` names that file",
                shown(&data.to_string_lossy())
            ))),
        }
    }
}

/// What a word that is no `T` should have been.
fn expected_number<T: FromStr>() -> &'static str {
    match ("1.5".parse::<T>().is_ok(), "-1".parse::<T>().is_ok()) {
        (true, _) => "a number",
        (false, true) => "a whole number",
        (false, false) => "a whole number from 0 up",
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    fn file(bytes: &[u8]) -> tempfile::NamedTempFile {
        let mut file = tempfile::NamedTempFile::new().expect("a temporary file");
        file.write_all(bytes).expect("written");
        file
    }

    #[test]
    fn lines_end_with_or_without_carriage_return() {
        let file = file(b"one\r\ntwo\n\nfour");
        let mut lines = HeaderLines::open(file.path()).expect("opened");
        let mut next = || lines.next_line().expect("readable");
        assert_eq!(
            [next(), next(), next(), next(), next()],
            [Some("one".into()), Some("two".into()), Some(String::new()), Some("four".into()), None]
        );
        assert_eq!(lines.offset(), 14);
    }

    #[test]
    fn an_endless_line_is_refused() {
        let file = file(&vec![b'x'; MAX_HEADER_BYTES as usize + 10]);
        let error = HeaderLines::open(file.path()).expect("opened").next_line().expect_err("too long");
        assert!(error.to_string().contains("at most 1048576 bytes"), "{error}");
    }

    #[test]
    fn fields_are_found_whatever_their_spelling() {
        let mut fields = Fields::new(Path::new("a.nhdr"));
        fields.insert("Byte Skip", " 12 ").expect("new");
        assert_eq!(fields.number::<i64>("byteskip").expect("a number"), Some(12));
        assert!(fields.insert("byteskip", "13").expect_err("twice").to_string().contains("a.nhdr"));
        assert!(fields.array::<f64, 3>(&["byte skip"]).expect_err("one number").to_string().contains("3 numbers"));
    }

    #[test]
    fn wrong_numbers_say_what_was_expected() {
        let fields = Fields::new(Path::new("a.nhdr"));
        let message = |error: Error| error.to_string();
        assert!(
            message(fields.numbers::<u64>("sizes", "3 -4").expect_err("negative"))
                .contains("a whole number from 0 up, found \"-4\"")
        );
        assert!(
            message(fields.numbers::<f64>("spacings", "1,5").expect_err("comma")).contains("a number, found \"1,5\"")
        );
        assert!(message(fields.dims("sizes", [1, 0, 1]).expect_err("empty")).contains("found \"0\""));
        assert!(message(fields.dims("sizes", [1, 1 << 32, 1]).expect_err("huge")).contains("4294967296"));
        assert!(shown(&"y".repeat(1000)).len() < 100);
    }
}
