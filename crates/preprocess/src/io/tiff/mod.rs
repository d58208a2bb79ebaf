//! Reader of TIFF stacks: files of many pages, with the descriptions of ImageJ and OME, and folders of numbered files
//! (TIFF 6.0; ImageJ's `ij.io.TiffDecoder`; <https://docs.openmicroscopy.org/ome-model/latest/ome-tiff/>).

mod folder;
mod image_tags;
mod imagej;
mod ome;
mod planes;
mod stack;

use std::path::{Path, PathBuf};

pub(super) use folder::is_stack_folder;
use image_tags::{ImageTags, Pages};
use planes::{Plane, Planes};
use stack::Stack;

use super::payload::{Encoding, Payload, Start};
use super::pick::Picks;
use super::placement::Placement;
use super::read_options::ReadOptions;
use super::volume_file::{Numbers, VolumeFile};
use crate::{Error, Result};

/// More than any of the methods of compression makes of a byte: what a file claims beyond that is not in it.
const MAX_RATIO: u64 = 2000;

/// Whether a file that begins with `start` is TIFF or BigTIFF, of either byte order.
pub(super) fn is_header(start: &[u8]) -> bool {
    [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"].iter().any(|magic| start.starts_with(*magic))
}

/// Reads the stack in one file.
///
/// # Errors
/// As [`super::open_volume`].
pub(super) fn read(path: &Path, options: &ReadOptions) -> Result<VolumeFile> {
    let pages = Pages::read(path)?;
    let stack = Stack::of(path, &pages)?;
    let tags = &pages.tags;
    let samples = usize::from(tags.samples);
    let fail = |message: String| Error::format(path, message);
    let what = if samples > 1 { "samples per pixel (as in a colour picture)" } else { "channels" };
    let component = options.component_of(stack.channels * samples, what).map_err(fail)?;
    let time = options.time_of(stack.times).map_err(fail)?;
    let planes: Vec<Plane> = (0..stack.slices)
        .map(|slice| {
            let plane = stack.plane([component / samples, slice, time]);
            Plane { file: 0, page: pages.page(plane), offset: pages.offset(plane) }
        })
        .collect();
    Ok(volume(path, vec![path.to_owned()], tags, planes, component % samples, &stack)?
        .with_notes(notes(&stack, options)))
}

/// Reads a folder that [`is_stack_folder`].
///
/// # Errors
/// As [`super::open_volume`].
pub(super) fn read_folder(folder: &Path, options: &ReadOptions) -> Result<VolumeFile> {
    let files = folder::numbered_files(folder)?;
    let first = folder::single_page(&files[0], None)?;
    let mut planes = Vec::new();
    for (file, path) in files.iter().enumerate() {
        let pages = folder::single_page(path, Some((&files[0], &first.tags)))?;
        planes.push(Plane { file, page: 0, offset: pages.offset(0) });
    }
    let described = Stack::of(&files[0], &first)?;
    let stack = Stack { slices: planes.len(), ..described };
    let fail = |message: String| Error::format(&files[0], message);
    let component = options.component_of(usize::from(first.tags.samples), "samples per pixel").map_err(fail)?;
    options.time_of(1).map_err(fail)?;
    Ok(volume(folder, files, &first.tags, planes, component, &stack)?.with_notes(notes(&stack, options)))
}

fn notes(stack: &Stack, options: &ReadOptions) -> Vec<String> {
    let is_calibrated = stack.spacing != [1.0; 3] || !stack.unit.is_empty();
    if is_calibrated { Vec::new() } else { options.note_on_spacing() }
}

fn volume(
    path: &Path,
    files: Vec<PathBuf>,
    tags: &ImageTags,
    planes: Vec<Plane>,
    sample: usize,
    stack: &Stack,
) -> Result<VolumeFile> {
    let slices =
        u32::try_from(planes.len()).map_err(|_| Error::format(path, "expected a stack, found too many slices"))?;
    let dims = [tags.width, tags.height, slices];
    let placement = Placement { unit: stack.unit.clone(), ..Placement::axis_aligned(dims, stack.spacing) };
    let geometry = placement.geometry(path)?;
    check_size(path, &files, geometry.voxel_count() as u64 * tags.scalar_type.size_in_bytes() as u64)?;
    let plain = if tags.is_plain() { run_of_planes(&planes, tags.page_bytes()) } else { None };
    let numbers = match plain {
        Some(offset) => Numbers::Payload(Payload {
            path: files[0].clone(),
            start: Start::Section(offset),
            encoding: Encoding::Plain,
            decoded_skip: 0,
            dims,
            stored: tags.stored_type(),
            picks: Picks::default(),
            hint: "the file is cut short, or its description counts more slices than it has",
        }),
        None => Numbers::Slabs(Box::new(Planes { files, planes, tags: tags.clone(), sample })),
    };
    VolumeFile::new(path, geometry, numbers, stack.slope, stack.intercept)
}

/// The first byte of planes that follow each other in one file.
fn run_of_planes(planes: &[Plane], page_bytes: u64) -> Option<u64> {
    let first = planes.first()?.offset?;
    let follows = |(index, plane): (usize, &Plane)| {
        plane.file == 0 && plane.offset == (index as u64).checked_mul(page_bytes).and_then(|run| run.checked_add(first))
    };
    planes.iter().enumerate().all(follows).then_some(first)
}

/// Makes sure that files are long enough for what they claim to hold.
fn check_size(path: &Path, files: &[PathBuf], expected: u64) -> Result<()> {
    let mut found: u64 = 0;
    for file in files {
        found = found.saturating_add(file.metadata().map_err(Error::io(file))?.len());
    }
    if expected / MAX_RATIO > found {
        return Err(Error::format(
            path,
            format!("expected {expected} bytes of voxels, found only {found} compressed ones"),
        ));
    }
    Ok(())
}
