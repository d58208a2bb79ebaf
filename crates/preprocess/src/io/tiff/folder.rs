//! A folder of numbered files of one page each: a stack in the order of their numbers.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use super::image_tags::{ImageTags, Pages};
use crate::{Error, Result};

/// Whether `path` is a folder with TIFF files in it.
pub fn is_stack_folder(path: &Path) -> bool {
    fs::read_dir(path).is_ok_and(|entries| entries.flatten().any(|entry| is_tiff(&entry.path())))
}

fn is_tiff(path: &Path) -> bool {
    let extension = path.extension().and_then(OsStr::to_str);
    // macOS puts files of that name, with a dot before it, beside others on foreign disks.
    let is_hidden = path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
    extension.is_some_and(|found| ["tif", "tiff"].iter().any(|name| found.eq_ignore_ascii_case(name))) && !is_hidden
}

/// The pages of a file in a folder, which must be one, like the first file's.
///
/// # Errors
/// As [`Pages::read`]; [`Error::Format`] for other counts, sizes and types.
pub fn single_page(path: &Path, first: Option<(&PathBuf, &ImageTags)>) -> Result<Pages> {
    let pages = Pages::read(path)?;
    if pages.count() != 1 {
        let message =
            format!("expected one page in each file of a folder, found {}: give the file alone", pages.count());
        return Err(Error::format(path, message));
    }
    match first {
        Some((other, tags)) if *tags != pages.tags => {
            let message =
                format!("expected the size and type of {}, found {} instead of {tags}", other.display(), pages.tags);
            Err(Error::format(path, message))
        }
        _ => Ok(pages),
    }
}

/// The files of the longest numbered series in `folder`, by number; files of other names are passed over.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] when there is none, when more than one number differs, or numbers are missing.
pub fn numbered_files(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut series: BTreeMap<String, Vec<(Vec<u64>, PathBuf)>> = BTreeMap::new();
    for entry in fs::read_dir(folder).map_err(Error::io(folder))? {
        let path = entry.map_err(Error::io(folder))?.path();
        let Some(name) = path.file_stem().and_then(OsStr::to_str).filter(|_| is_tiff(&path)) else { continue };
        let (text, numbers) = text_and_numbers(name);
        if !numbers.is_empty() {
            series.entry(text).or_default().push((numbers, path));
        }
    }
    let fail = |message: String| Error::format(folder, message);
    let longest = series.into_values().max_by_key(Vec::len);
    let mut files =
        longest.ok_or_else(|| fail("expected TIFF files with numbers in their names, found none".into()))?;
    files.sort();
    let (first, path) = &files[0];
    let varies = |place: &usize| files.iter().any(|(numbers, _)| numbers[*place] != first[*place]);
    let varying: Vec<usize> = (0..first.len()).filter(varies).collect();
    let [place] = varying.as_slice() else {
        if files.len() == 1 {
            return Ok(vec![path.clone()]);
        }
        let message = format!(
            "expected file names that differ in one number, the slice's, found {} that differ, as in {}: put one channel or \
             time into a folder",
            varying.len(),
            path.display()
        );
        return Err(fail(message));
    };
    let number = |index: usize| files[index].0[*place];
    let step = number(1) - number(0);
    if let Some(index) = (1..files.len()).find(|&index| number(index) - number(index - 1) != step || step == 0) {
        let (before, found) = (number(index - 1), number(index));
        return Err(fail(format!("expected slices numbered in steps of {step}, found {found} behind {before}")));
    }
    Ok(files.into_iter().map(|(_, path)| path).collect())
}

/// A name's text with a mark for each number in it, and the numbers.
fn text_and_numbers(name: &str) -> (String, Vec<u64>) {
    let (mut text, mut numbers, mut rest) = (String::new(), Vec::new(), name);
    while let Some(start) = rest.find(|character: char| character.is_ascii_digit()) {
        let (before, behind) = rest.split_at(start);
        let end = behind.find(|character: char| !character.is_ascii_digit()).unwrap_or(behind.len());
        text.push_str(before);
        // A number that is too long is text.
        match behind[..end].parse() {
            Ok(number) => {
                text.push('\0');
                numbers.push(number);
            }
            Err(_) => text.push_str(&behind[..end]),
        }
        rest = &behind[end..];
    }
    text.push_str(rest);
    (text, numbers)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order(names: &[&str]) -> Result<Vec<String>> {
        let folder = tempfile::tempdir().expect("a folder");
        names.iter().for_each(|name| fs::write(folder.path().join(name), []).expect("written"));
        let files = numbered_files(folder.path())?;
        Ok(files.iter().map(|path| path.file_name().expect("a name").to_string_lossy().into_owned()).collect())
    }

    #[test]
    fn numbers_count_and_not_digits() {
        let names = ["a10.tif", "a9.tif", "a8.TIF", "mask.tif", "a7.png", ".a7.tif", "notes_1.tif"];
        assert_eq!(order(&names).expect("a series"), ["a8.TIF", "a9.tif", "a10.tif"]);
        assert_eq!(order(&["scan2_020.tif", "scan2_000.tiff", "scan2_010.tif"]).expect("steps").len(), 3);
        assert_eq!(order(&["one1.tif"]).expect("one"), ["one1.tif"]);
    }

    #[test]
    fn what_is_no_series_is_refused() {
        for (names, expected) in [
            (["a.tif", "b.tif", "c.tif", "d.tif"], "found none"),
            (["z0_c0.tif", "z0_c1.tif", "z1_c0.tif", "z1_c1.tif"], "found 2 that differ"),
            (["a1.tif", "a2.tif", "a4.tif", "a5.tif"], "found 4 behind 2"),
            (["a1.tif", "a01.tif", "a2.tif", "a3.tif"], "found"),
        ] {
            let message = order(&names).expect_err(expected).to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}
