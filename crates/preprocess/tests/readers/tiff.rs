//! TIFF stacks of all types of number, ImageJ's and OME's descriptions, and files that must be refused.

use std::fs;

use voxrole_pack::{ScalarType, Scalars};
use voxrole_preprocess::Grid;
use voxrole_preprocess::io::{ByteOrder, ReadOptions, StoredType, open_volume, read_volume};

use crate::samples::{DIMS, Files, bytes, numbers, stored_types, zlib};

const U16: StoredType = StoredType { scalar_type: ScalarType::U16, byte_order: ByteOrder::Little };

/// A file of the sample's numbers, one page for each slice.
#[derive(Clone)]
pub struct Tiff {
    pub stored: StoredType,
    pub description: String,
    pub deflate: bool,
    /// Pages that are written; further slices follow the last one.
    pub pages: usize,
    /// Values instead of what the page needs, by tag.
    pub instead: Vec<(u16, u32)>,
    /// Instead of the sample's numbers.
    pub data: Option<Vec<u8>>,
}

impl Tiff {
    pub fn new(stored: StoredType) -> Self {
        Self { stored, description: String::new(), deflate: false, pages: 5, instead: Vec::new(), data: None }
    }

    fn number<const N: usize>(&self, mut bytes: [u8; N]) -> [u8; N] {
        if self.stored.byte_order == ByteOrder::Big {
            bytes.reverse();
        }
        bytes
    }

    fn short(&self, value: u16) -> [u8; 2] {
        self.number(value.to_le_bytes())
    }

    fn long(&self, value: u32) -> [u8; 4] {
        self.number(value.to_le_bytes())
    }

    /// The data first, then the directories, each followed by its long values.
    pub fn file(&self) -> Vec<u8> {
        let data =
            self.data.clone().unwrap_or_else(|| bytes(&numbers(self.stored.scalar_type), self.stored.byte_order));
        let slice = 12 * self.stored.scalar_type.size_in_bytes();
        let mut file = if self.stored.byte_order == ByteOrder::Big { b"MM\0*".to_vec() } else { b"II*\0".to_vec() };
        file.extend([0; 4]);
        let mut strips = Vec::new();
        for plane in data.chunks(slice) {
            let plane = if self.deflate { zlib(plane) } else { plane.to_vec() };
            strips.push((file.len() as u32, plane.len() as u32));
            file.extend(plane);
        }
        let mut link = 4;
        for (page, &strip) in strips.iter().enumerate().take(self.pages) {
            file.resize(file.len().next_multiple_of(2), 0);
            let start = self.long(file.len() as u32);
            file[link..link + 4].copy_from_slice(&start);
            link = self.append_page(&mut file, strip, page == 0);
        }
        file
    }

    /// Appends a directory; where the link to the next one is.
    fn append_page(&self, file: &mut Vec<u8>, (offset, length): (u32, u32), is_first: bool) -> usize {
        let scalar_type = self.stored.scalar_type;
        let format = match scalar_type {
            ScalarType::U8 | ScalarType::U16 | ScalarType::U32 => 1,
            ScalarType::I8 | ScalarType::I16 | ScalarType::I32 => 2,
            ScalarType::F32 | ScalarType::F64 => 3,
        };
        let mut tags: Vec<(u16, u32)> = vec![
            (256, DIMS[0]),
            (257, DIMS[1]),
            (258, 8 * scalar_type.size_in_bytes() as u32),
            (259, if self.deflate { 8 } else { 1 }),
            (262, 1),
            (270, 0),
            (273, offset),
            (277, 1),
            (278, DIMS[1]),
            (279, length),
            (282, 2),
            (283, 4),
            (339, format),
        ];
        for (tag, value) in &self.instead {
            match tags.iter_mut().find(|(found, _)| found == tag) {
                Some((_, old)) => *old = *value,
                None => tags.push((*tag, *value)),
            }
        }
        tags.sort_unstable();
        tags.retain(|(tag, _)| *tag != 270 || (is_first && !self.description.is_empty()));
        let behind = file.len() + 2 + 12 * tags.len() + 4;
        let mut long_values = Vec::new();
        file.extend(self.short(tags.len() as u16));
        for (tag, value) in tags {
            let place = self.long((behind + long_values.len()) as u32);
            file.extend(self.short(tag));
            match tag {
                270 => {
                    file.extend(self.short(2));
                    file.extend(self.long(self.description.len() as u32 + 1));
                    file.extend(place);
                    long_values.extend(self.description.bytes().chain([0]));
                    long_values.resize(long_values.len().next_multiple_of(2), 0);
                }
                // Pixels per unit.
                282 | 283 => {
                    file.extend(self.short(5));
                    file.extend(self.long(1));
                    file.extend(place);
                    long_values.extend(self.long(value).into_iter().chain(self.long(8)));
                }
                _ => {
                    file.extend(self.short(4));
                    file.extend(self.long(1));
                    file.extend(self.long(value));
                }
            }
        }
        let link = file.len();
        file.extend([0; 4]);
        file.extend(long_values);
        link
    }

    fn read(&self, options: &ReadOptions) -> voxrole_preprocess::Result<Grid> {
        read_volume(&Files::new([("a.tif", self.file())]).path(), options)
    }
}

/// ImageJ's description of the sample.
pub fn imagej(lines: &str) -> String {
    format!("ImageJ=1.54f\nimages=5\nslices=5\nunit=micron\nspacing=3.0\n{lines}")
}

#[test]
fn all_types_are_read_from_both_byte_orders() {
    for stored in stored_types() {
        for deflate in [false, true] {
            let grid = Tiff { deflate, ..Tiff::new(stored) }.read(&ReadOptions::default());
            let grid = grid.unwrap_or_else(|error| panic!("{stored} {deflate}: {error}"));
            assert_eq!(grid.scalars, numbers(stored.scalar_type), "{stored} {deflate}");
            assert_eq!((grid.geometry.dims, grid.geometry.spacing), (DIMS, [1.0; 3]));
        }
    }
}

#[test]
fn imagej_says_how_far_voxels_are_apart() {
    let grid =
        Tiff { description: imagej("loop=false\n"), ..Tiff::new(U16) }.read(&ReadOptions::default()).expect("good");
    assert_eq!((grid.geometry.spacing, grid.geometry.unit.as_str()), ([4.0, 2.0, 3.0], "µm"));
    // Signed numbers of 16 bits are stored with an offset.
    let description = imagej("cf=0\nc0=-32768.0\nc1=1.0\n");
    let grid = Tiff { description, ..Tiff::new(U16) }.read(&ReadOptions::default()).expect("good");
    assert_eq!((grid.slope, grid.intercept), (1.0, -32768.0));
}

#[test]
fn a_stack_behind_one_page_stays_where_it_is() {
    for byte_order in [ByteOrder::Little, ByteOrder::Big] {
        let stored = StoredType { byte_order, ..U16 };
        for pages in [1, 5] {
            let tiff = Tiff { pages, description: imagej(""), ..Tiff::new(stored) };
            let files = Files::new([("a.tif", tiff.file())]);
            let volume = open_volume(&files.path(), &ReadOptions::default()).expect("a good file");
            let volume = volume.stored(&files.path().join("no/such/folder")).expect("nothing is unpacked");
            let region = voxrole_preprocess::region::Region { start: [0, 0, 4], end: [3, 1, 5] };
            assert_eq!(volume.voxels.read(&region).expect("a region"), Scalars::U16(vec![48000, 49000, 50000]));
        }
    }
}

#[test]
fn a_time_of_a_stack_behind_one_page_is_chosen() {
    let description = "ImageJ=1.54f\nimages=5\nframes=5\n".to_owned();
    let tiff = Tiff { pages: 1, description, ..Tiff::new(U16) };
    let grid = tiff.read(&ReadOptions { time: Some(2), ..ReadOptions::default() }).expect("the third");
    assert_eq!(grid.geometry.dims, [3, 4, 1]);
    assert_eq!(grid.scalars, Scalars::U16((24..36).map(|n| n * 1000).collect()));
}

#[test]
fn bad_files_are_refused() {
    let of = |instead: &[(u16, u32)]| Tiff { instead: instead.to_vec(), ..Tiff::new(U16) };
    let described = |description: &str, pages| Tiff { description: description.into(), pages, ..Tiff::new(U16) };
    let ome = |pixels: &str, inside: &str| {
        described(&format!("<?xml version=\"1.0\"?><OME><Image><Pixels {pixels}>{inside}</Pixels></Image></OME>"), 5)
    };
    let good = "SizeX=\"3\" SizeY=\"4\" SizeZ=\"5\" SizeC=\"1\" SizeT=\"1\" DimensionOrder=\"XYZCT\"";
    assert!(ome(good, "").read(&ReadOptions::default()).is_ok());
    for (tiff, expected) in [
        (of(&[(256, 0)]), "found"),
        (of(&[(256, u32::MAX), (257, u32::MAX)]), "found"),
        (of(&[(256, 65535), (257, 65535), (278, 65535)]), "found"),
        (of(&[(258, 64)]), "64 bits"),
        (of(&[(258, 12)]), "12 bits"),
        (of(&[(259, 7)]), "LZW, Deflate or PackBits"),
        (of(&[(259, 50000)]), "LZW, Deflate or PackBits"),
        (of(&[(277, 0)]), "found"),
        (of(&[(277, 60000)]), "found"),
        (of(&[(278, 0)]), "found"),
        (of(&[(273, u32::MAX)]), "found"),
        (of(&[(279, u32::MAX)]), "found"),
        (of(&[(339, 5)]), "no known kind"),
        (described(&imagej("").replace("slices=5", "slices=4"), 5), "5 pages by ImageJ's description"),
        (described(&imagej("").replace("images=5", "images=0"), 5), "count of images"),
        (described(&imagej("").replace('5', "4000000000"), 1), "pages by ImageJ's description"),
        (described(&imagej(""), 3), "found 3"),
        (ome(&good.replace("SizeZ=\"5\"", "SizeZ=\"6\""), ""), "6 pages by OME's description"),
        (ome(&good.replace("SizeZ=\"5\"", "SizeZ=\"18446744073709551615\""), ""), "by OME's description"),
        (ome(&good.replace("SizeX=\"3\"", "SizeX=\"30\""), ""), "SizeX"),
        (ome(&good.replace("XYZCT", "XYZZT"), ""), "DimensionOrder"),
        (ome(good, "<TiffData IFD=\"9\" FirstZ=\"0\"/>"), "a page for each plane"),
        (ome(good, "<TiffData FirstZ=\"5\"/>"), "a first one"),
        (ome(&format!("{good} PhysicalSizeX=\"0\""), ""), "not a positive length"),
        (ome(&format!("{good} PhysicalSizeY=\"1\" PhysicalSizeYUnit=\"pixel\""), ""), "the unit"),
        (described("<OME><!DOCTYPE a [<!ENTITY b \"c\">]></OME>", 5), "document type"),
        (described("<OME><Image></Pixels></OME>", 5), "OME's XML"),
        (described("<OME></OME>", 5), "one image"),
    ] {
        let message = tiff.read(&ReadOptions::default()).expect_err(expected).to_string();
        for part in [expected, "a.tif", "expected", "found"] {
            assert!(message.contains(part), "{part:?} is not in: {message}");
        }
        assert!(message.len() < 1000, "too long to read: {message}");
    }
}

#[test]
fn bombs_and_cut_files_are_refused() {
    // Pages that claim 4 GiB each, of which hardly anything is there.
    let huge = [(256, 65535), (257, 32768), (278, 32768)];
    let bomb = Tiff { deflate: true, instead: huge.to_vec(), ..Tiff::new(U16) };
    let message = bomb.read(&ReadOptions::default()).expect_err("a bomb").to_string();
    assert!(message.contains("bytes of voxels"), "{message}");
    for deflate in [false, true] {
        let file = Tiff { deflate, ..Tiff::new(U16) }.file();
        // The last thing in the file is a resolution of the last page.
        for length in (0..file.len() - 16).step_by(7) {
            let files = Files::new([("a.tif", file[..length].to_vec())]);
            assert!(read_volume(&files.path(), &ReadOptions::default()).is_err(), "{length} of {}", file.len());
        }
    }
}

#[test]
fn a_folder_of_unlike_files_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let page = |pages| Tiff { pages, ..Tiff::new(U16) }.file();
    let write = |name: &str, bytes: &[u8]| fs::write(folder.path().join(name), bytes).expect("written");
    let message = || read_volume(folder.path(), &ReadOptions::default()).expect_err("refused").to_string();
    write("notes.txt", b"of the microscope");
    assert!(message().contains("no DICOM image in 1 files"), "{}", message());
    write("a1.tif", &page(1));
    write("a2.tif", &page(2));
    assert!(message().contains("a2.tif") && message().contains("one page"), "{}", message());
    write("a2.tif", &Tiff { pages: 1, ..Tiff::new(StoredType { scalar_type: ScalarType::U8, ..U16 }) }.file());
    assert!(message().contains("a2.tif") && message().contains("size and type"), "{}", message());
    write("a2.tif", b"II*\0");
    assert!(message().contains("a2.tif"), "{}", message());
    write("a2.tif", &page(1));
    let grid = read_volume(folder.path(), &ReadOptions::default()).expect("two slices");
    assert_eq!(grid.geometry.dims, [3, 4, 2]);
}
