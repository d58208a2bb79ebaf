//! OME's description of a stack: XML in the first page (<https://docs.openmicroscopy.org/ome-model/latest/>).

use std::path::Path;

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use super::super::header::Fields;
use super::super::units::length_in_picometres;
use super::super::xml;
use super::image_tags::Pages;
use super::stack::Stack;
use crate::{Error, Result};

/// Whether a description is OME's.
pub fn is_description(text: &str) -> bool {
    let text = text.trim_start();
    (text.starts_with("<?xml") || text.starts_with("<OME")) && text.contains("<OME")
}

/// What the description says of the first page's file.
///
/// # Errors
/// [`Error::Format`] for several images, for planes in other files, and for descriptions that do not fit the pages.
pub fn stack(path: &Path, pages: &Pages) -> Result<Stack> {
    Image::parse(path, &pages.description)?.stack(pages)
}

/// The one image of a description.
struct Image<'a> {
    path: &'a Path,
    /// Attributes of `Pixels`.
    pixels: Fields<'a>,
    /// Attributes of each `TiffData`.
    data: Vec<Fields<'a>>,
    /// Other files that planes are said to be in.
    other_file: Option<String>,
}

impl<'a> Image<'a> {
    fn parse(path: &'a Path, text: &str) -> Result<Self> {
        let fail = |message: String| Error::format(path, message);
        let mut reader = Reader::from_str(text);
        let (mut pixels, mut data, mut other_file) = (Vec::new(), Vec::new(), None);
        loop {
            let decoder = reader.decoder();
            let mut open = |element: &BytesStart<'_>| -> Result<()> {
                match element.local_name().as_ref() {
                    b"Pixels" => pixels.push(xml::attributes(path, element, decoder)?),
                    b"TiffData" => data.push(xml::attributes(path, element, decoder)?),
                    b"UUID" => {
                        let fields = xml::attributes(path, element, decoder)?;
                        let named = fields.get(&["FileName"]).filter(|name| path.file_name() != Some(name.as_ref()));
                        other_file = other_file.take().or(named.map(str::to_owned));
                    }
                    _ => {}
                }
                Ok(())
            };
            match reader.read_event() {
                Ok(Event::Start(element) | Event::Empty(element)) => open(&element)?,
                Ok(Event::DocType(_)) => {
                    return Err(fail("expected OME's XML, found a document type declaration in it".into()));
                }
                Ok(Event::Eof) => break,
                Ok(_) => {}
                Err(error) => return Err(fail(format!("expected OME's XML, found: {error}"))),
            }
        }
        let count = pixels.len();
        match <[Fields<'a>; 1]>::try_from(pixels) {
            Ok([pixels]) => Ok(Self { path, pixels, data, other_file }),
            Err(_) => {
                Err(fail(format!("expected one image in OME's description, found {count}: save one of them by itself")))
            }
        }
    }

    fn stack(&self, pages: &Pages) -> Result<Stack> {
        let size = |name| -> Result<usize> {
            let found = self.pixels.number::<usize>(name)?.filter(|&size| size > 0);
            found.ok_or_else(|| {
                self.pixels.fail(format!("expected `{name}` from 1 up in OME's description, found none"))
            })
        };
        for (name, expected) in [("SizeX", pages.tags.width), ("SizeY", pages.tags.height)] {
            let found = size(name)?;
            if u32::try_from(found) != Ok(expected) {
                return Err(self.pixels.unexpected(name, &format!("the pages' {expected}"), &found.to_string()));
            }
        }
        // Numbers of one pixel count as channels.
        let samples = usize::from(pages.tags.samples);
        let (all_channels, slices, times) = (size("SizeC")?, size("SizeZ")?, size("SizeT")?);
        let channels = (all_channels / samples).max(1);
        let count = channels.saturating_mul(slices).saturating_mul(times);
        if count > pages.count() || all_channels != channels * samples {
            let found = pages.count();
            let elsewhere = self
                .other_file
                .as_ref()
                .map(|file| format!("; others are in {file}: join them first"))
                .unwrap_or_default();
            return Err(self.pixels.fail(format!(
                "expected {count} pages by OME's description ({all_channels} channels, {slices} slices, {times} times), found \
                 {found} of {samples} samples{elsewhere}"
            )));
        }
        let (spacing, unit) = self.spacing()?;
        let mut stack = Stack { spacing, unit, ..Stack::in_order(channels, slices, times) };
        stack.planes = self.planes(pages, [channels, slices, times])?;
        Ok(stack)
    }

    /// The page of each plane, channels fastest, then slices: by `TiffData`, or as `DimensionOrder` says.
    fn planes(&self, pages: &Pages, sizes: [usize; 3]) -> Result<Vec<usize>> {
        let order = self.pixels.required("DimensionOrder")?;
        // Axes of a plane's number, the fastest first: 0 for C, 1 for Z, 2 for T.
        let axes: Vec<usize> =
            order.strip_prefix("XY").unwrap_or("").chars().filter_map(|axis| "CZT".find(axis)).collect();
        let mut sorted = axes.clone();
        sorted.sort_unstable();
        if sorted != [0, 1, 2] || order.len() != 5 {
            return Err(self.pixels.unexpected("DimensionOrder", "XY and then C, Z and T in some order", order));
        }
        let count: usize = sizes.iter().product();
        let mut planes: Vec<Option<usize>> = vec![None; count];
        // The place among `planes` of a plane that is the `index`-th in the file's order.
        let place = |mut index: usize| {
            let mut at = [0; 3];
            for &axis in &axes {
                at[axis] = index % sizes[axis];
                index /= sizes[axis];
            }
            (at[2] * sizes[1] + at[1]) * sizes[0] + at[0]
        };
        let whole = [Fields::new(self.path)];
        for data in if self.data.is_empty() { &whole } else { self.data.as_slice() } {
            let number = |name| data.number::<usize>(name);
            let first_page = number("IFD")?;
            let all = if first_page.is_some() { 1 } else { count };
            let length = number("PlaneCount")?.unwrap_or(all).min(count);
            let first =
                [number("FirstC")?.unwrap_or(0), number("FirstZ")?.unwrap_or(0), number("FirstT")?.unwrap_or(0)];
            if first.iter().zip(sizes).any(|(first, size)| *first >= size) {
                return Err(data.fail(format!(
                    "expected planes of OME's description, found a first one at {first:?} of {sizes:?}"
                )));
            }
            let (start, _) =
                axes.iter().fold((0, 1), |(start, step), &axis| (start + first[axis] * step, step * sizes[axis]));
            for index in 0..length.min(count - start) {
                planes[place(start + index)] = Some(first_page.unwrap_or(0).saturating_add(index));
            }
        }
        let known = planes.into_iter().map(|page| page.filter(|&page| page < pages.count()));
        known
            .collect::<Option<_>>()
            .ok_or_else(|| self.pixels.fail("expected a page for each plane of OME's description, found none for some"))
    }

    /// Spacing in the unit of x.
    fn spacing(&self) -> Result<([f64; 3], String)> {
        let mut spacing = [1.0; 3];
        let unit_of = |name: &str| self.pixels.get(&[name]).unwrap_or("\u{b5}m").to_owned();
        let units = ["PhysicalSizeXUnit", "PhysicalSizeYUnit", "PhysicalSizeZUnit"].map(unit_of);
        for (axis, name) in ["PhysicalSizeX", "PhysicalSizeY", "PhysicalSizeZ"].into_iter().enumerate() {
            let Some(size) = self.pixels.number::<f64>(name)? else { continue };
            let factor = match (length_in_picometres(&units[axis]), length_in_picometres(&units[0])) {
                _ if units[axis] == units[0] => 1.0,
                (Some(own), Some(first)) => own / first,
                _ => return Err(self.pixels.unexpected(name, &format!("the unit {}", units[0]), &units[axis])),
            };
            spacing[axis] = size * factor;
        }
        let is_known = self.pixels.get(&["PhysicalSizeX"]).is_some() && length_in_picometres(&units[0]).is_some();
        Ok((spacing, if is_known { units[0].clone() } else { String::new() }))
    }
}
