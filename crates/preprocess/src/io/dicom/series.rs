//! Finds the files of one series.

use std::fs;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::image::{Image, Series};
use super::parser::parse;
use crate::io::read_options::ReadOptions;
use crate::{Error, Result};

/// Most series that a message lists.
const MOST_LISTED: usize = 8;

/// The images of a series, at least one, and what is worth telling of them.
pub(super) struct Found {
    pub images: Vec<Image>,
    pub notes: Vec<String>,
}

/// One file of images: its series, and what it says, or why that cannot be used.
struct File {
    series: Series,
    image: Result<Image>,
}

/// Reads the headers of the series in the folder `path`, or of the one that the file `path` belongs to.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] when there is no image or more than one series to choose from, and for images that cannot
/// be slices of a volume.
pub(super) fn find(path: &Path, options: &ReadOptions) -> Result<Found> {
    if path.is_dir() {
        let (files, skipped) = scan(path, path)?;
        return choose(path, files, skipped, options.series.as_deref());
    }
    if options.series.is_some() {
        return Err(Error::format(
            path,
            "expected a folder for --series, found a file, which says itself of which series it is",
        ));
    }
    let Some(file) = read(path)? else {
        let message =
            "expected a DICOM image, found a DICOM file without one: name a file with an image, or its folder";
        return Err(Error::format(path, message));
    };
    let image = file.image?;
    if image.frames.len() > 1 || file.series.uid.is_empty() {
        return Ok(Found { images: vec![image], notes: Vec::new() });
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let (files, _) = scan(folder, path)?;
    let (own, others): (Vec<File>, Vec<File>) =
        files.into_iter().partition(|other| other.series.uid == file.series.uid);
    let mut notes = Vec::new();
    if own.len() > 1 {
        let others =
            if others.is_empty() { String::new() } else { format!(", {} images of others left", others.len()) };
        notes.push(format!("read with the {} other images of its series{others}", own.len() - 1));
    }
    Ok(Found { images: own.into_iter().map(|file| file.image).collect::<Result<_>>()?, notes })
}

/// Reads the headers of all images in a folder, in the order of their names; with the count of the other files.
fn scan(folder: &Path, named: &Path) -> Result<(Vec<File>, usize)> {
    let mut paths: Vec<PathBuf> = Vec::new();
    let (mut folders, mut others) = (Vec::new(), 0);
    for entry in fs::read_dir(folder).map_err(Error::io(folder))? {
        let path = entry.map_err(Error::io(folder))?.path();
        match path.metadata() {
            Ok(metadata) if metadata.is_file() => paths.push(path),
            Ok(metadata) if metadata.is_dir() => folders.push(path),
            // Links to nowhere, pipes, devices.
            _ => others += 1,
        }
    }
    paths.sort();
    folders.sort();
    let files: Vec<Option<File>> = paths.par_iter().map(|path| read(path)).collect::<Result<_>>()?;
    let count = files.len() + others;
    let files: Vec<File> = files.into_iter().flatten().collect();
    if files.is_empty() {
        let below = match folders.as_slice() {
            [] => String::new(),
            [one] => format!("; name the folder in it, {}", one.display()),
            [first, rest @ ..] => {
                format!("; name one of the {} folders in it, such as {}", rest.len() + 1, first.display())
            }
        };
        return Err(Error::format(
            named,
            format!(
                "expected a folder that is a Zarr store, or of TIFF slices of one size with numbers in their names, or of DICOM \
                 images, found no DICOM image in {count} files{below}"
            ),
        ));
    }
    Ok((files, count))
}

/// One file; `None` where it is no DICOM file or holds no image.
fn read(path: &Path) -> Result<Option<File>> {
    let Some(mut parsed) = parse(path)? else { return Ok(None) };
    let Some(pixels) = parsed.pixels.take() else { return Ok(None) };
    Ok(Some(File { series: Series::new(&parsed.attributes), image: Image::new(path, &parsed, pixels) }))
}

/// The series that `wanted` names, or the only one.
fn choose(folder: &Path, files: Vec<File>, scanned: usize, wanted: Option<&str>) -> Result<Found> {
    let mut all: Vec<(Series, usize)> = Vec::new();
    for file in &files {
        match all.iter_mut().find(|(series, _)| series.uid == file.series.uid) {
            Some((_, count)) => *count += 1,
            None => all.push((file.series.clone(), 1)),
        }
    }
    all.sort_by_key(|(series, _)| (series.number.parse().unwrap_or(i64::MAX), series.uid.clone()));
    let matches =
        |series: &Series| wanted.is_none_or(|wanted| [&series.uid, &series.number].contains(&&wanted.to_owned()));
    let chosen: Vec<&Series> = all.iter().map(|(series, _)| series).filter(|series| matches(series)).collect();
    let uid = match chosen.as_slice() {
        [one] => one.uid.clone(),
        several => {
            let found = match (several.len(), wanted) {
                (0, Some(wanted)) => format!("expected the series {wanted:?}, found others"),
                (count, Some(wanted)) => format!("expected one series {wanted:?}, found {count}"),
                (count, None) => format!("expected one series, found {count}"),
            };
            return Err(Error::format(folder, format!("{found}; choose by --series: {}", listed(&all))));
        }
    };
    let skipped = scanned - files.len();
    let others = all.len() - 1;
    let images: Vec<Image> =
        files.into_iter().filter(|file| file.series.uid == uid).map(|file| file.image).collect::<Result<_>>()?;
    let mut notes = Vec::new();
    if skipped > 0 {
        notes.push(format!("read {} images, skipped {skipped} files that are none", images.len()));
    }
    if others > 0 {
        notes.push(format!("left {others} other series"));
    }
    Ok(Found { images, notes })
}

/// How to choose each series, and what it is.
fn listed(all: &[(Series, usize)]) -> String {
    let entry = |(series, count): &(Series, usize)| {
        let is_own =
            |number: &str| !number.is_empty() && all.iter().filter(|(other, _)| other.number == number).count() == 1;
        let name = if is_own(&series.number) { &series.number } else { &series.uid };
        let words = [series.modality.as_str(), series.description.as_str()];
        let words: Vec<&str> = words.into_iter().filter(|word| !word.is_empty()).collect();
        format!("{name} ({}{}{count} images)", words.join(" "), if words.is_empty() { "" } else { ", " })
    };
    let mut entries: Vec<String> = all.iter().take(MOST_LISTED).map(entry).collect();
    if all.len() > MOST_LISTED {
        entries.push(format!("and {} more", all.len() - MOST_LISTED));
    }
    entries.join(", ")
}
