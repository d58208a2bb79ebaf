//! DICOM series: what they are read as, and which are refused.

use std::fs;

use voxrole_pack::{Scalars, WorldFrame};
use voxrole_preprocess::Grid;
use voxrole_preprocess::io::{ReadOptions, open_volume, read_volume};

use crate::dicom_samples::{
    BIG_ENDIAN, COLUMNS, EXPLICIT, Elements, Folder, IMPLICIT, JPEG_LOSSLESS, RLE, ROWS, Value, decimals, file, jpeg,
    number, rle, slice, text, with,
};

const POSITION: u32 = 0x0020_0032;
const ORIENTATION: u32 = 0x0020_0037;
const SERIES_UID: u32 = 0x0020_000e;
const SERIES_NUMBER: u32 = 0x0020_0011;
const PHOTOMETRIC: u32 = 0x0028_0004;
const FRAMES: u32 = 0x0028_0008;
const BITS_STORED: u32 = 0x0028_0101;
const HIGH_BIT: u32 = 0x0028_0102;
const SIGNED: u32 = 0x0028_0103;
const PADDING: u32 = 0x0028_0120;
const INTERCEPT: u32 = 0x0028_1052;
const SLOPE: u32 = 0x0028_1053;
const PIXELS: u32 = 0x7fe0_0010;

fn numbers(k: usize) -> Vec<u16> {
    (0..COLUMNS * ROWS).map(|pixel| number(k, pixel)).collect()
}

fn expected(slices: usize) -> Vec<u16> {
    (0..slices).flat_map(numbers).collect()
}

#[track_caller]
fn read(folder: &Folder) -> Grid {
    read_volume(folder.path(), &ReadOptions::default()).unwrap_or_else(|error| panic!("{error}"))
}

#[track_caller]
fn refused(folder: &Folder, options: &ReadOptions, expected: &[&str]) {
    let message = read_volume(folder.path(), options).expect_err(expected[0]).to_string();
    for part in expected.iter().chain(&["expected", "found"]) {
        assert!(message.contains(part), "{part:?} is not in: {message}");
    }
    assert!(message.len() < 700, "too long to read: {message}");
}

fn resample() -> ReadOptions {
    ReadOptions { resample: true, ..ReadOptions::default() }
}

#[test]
fn slices_are_ordered_by_position() {
    let folder = Folder::of_slices((0..5).map(|k| slice(k, 100.0 - 2.5 * (4 - k) as f64)));
    fs::write(folder.file("notes.txt"), "no image").expect("written");
    let directory = with(slice(0, 0.0), []).into_iter().filter(|(tag, _)| *tag != PIXELS).collect();
    fs::write(folder.file("DICOMDIR"), file(EXPLICIT, &directory)).expect("written");
    fs::create_dir(folder.file("more")).expect("a folder");
    let grid = read(&folder);
    assert_eq!(grid.scalars, Scalars::U16(expected(5)));
    let geometry = &grid.geometry;
    assert_eq!((geometry.dims, geometry.spacing), ([4, 3, 5], [0.5, 0.75, 2.5]));
    assert_eq!((geometry.origin, geometry.unit.as_str()), ([-10.0, 20.0, 90.0], "mm"));
    assert_eq!(geometry.direction, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    assert_eq!((geometry.frame, grid.slope, grid.intercept), (WorldFrame::LeftPosteriorSuperior, 1.0, 0.0));
    let volume = open_volume(folder.path(), &ReadOptions::default()).expect("a series");
    assert_eq!(
        (volume.files().len(), volume.notes()),
        (5, &["read 5 images, skipped 2 files that are none".into()][..])
    );
    // One of its files stands for the series.
    let one = read_volume(&folder.file("I30"), &ReadOptions::default()).expect("a series");
    assert_eq!((one.scalars, one.geometry), (grid.scalars, grid.geometry));
}

#[test]
fn sagittal_slices_keep_the_patient_s_frame() {
    let oblique = |k: usize, x: f64| {
        with(slice(k, 0.0), [(POSITION, decimals(&[x, 5.0, 7.0])), (ORIENTATION, text("0\\1\\0\\0\\0\\-1"))])
    };
    let grid = read(&Folder::of_slices([oblique(0, 30.0), oblique(1, 28.0), oblique(2, 26.0)]));
    assert_eq!(grid.scalars, Scalars::U16(expected(3)));
    assert_eq!(grid.geometry.direction, [[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]]);
    assert_eq!((grid.geometry.origin, grid.geometry.spacing), ([30.0, 5.0, 7.0], [0.5, 0.75, 2.0]));
}

#[test]
fn every_transfer_syntax_gives_the_same_numbers() {
    let twelve = |k: usize| numbers(k);
    for syntax in [IMPLICIT, EXPLICIT, BIG_ENDIAN, RLE, JPEG_LOSSLESS] {
        let pixels = |k: usize| match syntax {
            RLE => Value::Pieces(Vec::new(), vec![rle(&twelve(k))]),
            JPEG_LOSSLESS => Value::Pieces(vec![0; 4], vec![jpeg(&twelve(k), COLUMNS, 12)]),
            _ => slice(k, 0.0)[&PIXELS].clone(),
        };
        let slices = [0, 1, 2].map(|k| file(syntax, &with(slice(k, k as f64), [(PIXELS, pixels(k))])));
        let [a, b, c] = slices;
        let grid = read(&Folder::new([("c", c), ("a", a), ("b", b)]));
        assert_eq!(grid.scalars, Scalars::U16(expected(3)), "{syntax}");
    }
}

#[test]
fn jpeg_of_all_bits_and_in_pieces() {
    let numbers: Vec<u16> = (0..12).map(|n| if n % 3 == 0 { 65535 - n } else { n * 5000 }).collect();
    let packed = jpeg(&numbers, COLUMNS, 16);
    let (first, second) = packed.split_at(30);
    let pixels = Value::Pieces(Vec::new(), vec![first.to_vec(), second.to_vec()]);
    let elements =
        with(slice(0, 0.0), [(PIXELS, pixels), (BITS_STORED, Value::Short(16)), (HIGH_BIT, Value::Short(15))]);
    let grid = read(&Folder::new([("a", file(JPEG_LOSSLESS, &elements))]));
    assert_eq!(grid.scalars, Scalars::U16(numbers));
}

#[test]
fn hounsfield_units_are_whole_numbers_of_16_bits() {
    let rescaled = |k: usize, slope: f64, intercept: f64| {
        with(slice(k, k as f64), [(SLOPE, decimals(&[slope])), (INTERCEPT, decimals(&[intercept]))])
    };
    let units = |offset: i16| expected(2).iter().map(|&number| number as i16 + offset).collect::<Vec<_>>();
    let grid = read(&Folder::of_slices([rescaled(0, 1.0, -1024.0), rescaled(1, 1.0, -1024.0)]));
    assert_eq!((&grid.scalars, grid.slope, grid.intercept), (&Scalars::I16(units(-1024)), 1.0, 0.0));
    // Anything else stays as it is stored, and is mapped.
    let grid = read(&Folder::of_slices([rescaled(0, 2.0, 0.5), rescaled(1, 2.0, 0.5)]));
    assert_eq!((&grid.scalars, grid.slope, grid.intercept), (&Scalars::U16(expected(2)), 2.0, 0.5));
    let sixteen = [(BITS_STORED, Value::Short(16)), (HIGH_BIT, Value::Short(15))];
    let grid = read(&Folder::of_slices([0, 1].map(|k| with(rescaled(k, 1.0, -1024.0), sixteen.clone()))));
    assert_eq!((&grid.scalars, grid.slope, grid.intercept), (&Scalars::U16(expected(2)), 1.0, -1024.0));
    // Slices of their own slopes are floats.
    let grid = read(&Folder::of_slices([rescaled(0, 1.0, 0.0), rescaled(1, 0.25, 3.0)]));
    let values =
        |k: usize, slope: f32, intercept: f32| numbers(k).into_iter().map(move |n| slope * f32::from(n) + intercept);
    let values = values(0, 1.0, 0.0).chain(values(1, 0.25, 3.0)).collect();
    assert_eq!((grid.scalars, grid.slope, grid.intercept), (Scalars::F32(values), 1.0, 0.0));
}

#[test]
fn signed_numbers_and_foreign_bits() {
    // −1 and 2047 in twelve bits, with something else in the other four.
    let words = [0x0fff_u16, 0xa7ff, 0xf800];
    let pixels = (0..12).flat_map(|pixel| words[pixel % 3].to_le_bytes()).collect();
    let elements = with(slice(0, 0.0), [(PIXELS, Value::Pixels(pixels)), (SIGNED, Value::Short(1))]);
    let grid = read(&Folder::of_slices([with(elements, [(PHOTOMETRIC, Value::Text(b"CS", "MONOCHROME1".into()))])]));
    assert_eq!(grid.scalars, Scalars::I16((0..12).map(|pixel| [-1, 2047, -2048][pixel % 3]).collect()));
}

#[test]
fn frames_of_one_file_have_positions_of_their_own() {
    let group = |z: f64| {
        let position = Elements::from([(POSITION, decimals(&[1.0, 2.0, z]))]);
        Elements::from([(0x0020_9113, Value::Items(vec![position]))])
    };
    let shared = Elements::from([
        (0x0020_9116, Value::Items(vec![Elements::from([(ORIENTATION, text("1\\0\\0\\0\\1\\0"))])])),
        (0x0028_9110, Value::Items(vec![Elements::from([(0x0028_0030, text("2\\2"))])])),
        (0x0028_9145, Value::Items(vec![Elements::from([(SLOPE, text("1")), (INTERCEPT, text("-5"))])])),
    ]);
    // The second frame lies lowest.
    let heights = [4.0, 0.0, 2.0];
    let data: Vec<u8> = [2, 0, 1].iter().flat_map(|&k| numbers(k)).flat_map(u16::to_le_bytes).collect();
    let mut elements = with(
        slice(0, 0.0),
        [
            (FRAMES, Value::Text(b"IS", "3".into())),
            (0x5200_9229, Value::Items(vec![shared])),
            (0x5200_9230, Value::Items(heights.map(group).to_vec())),
            (PIXELS, Value::Pixels(data)),
        ],
    );
    [POSITION, ORIENTATION, 0x0028_0030].iter().for_each(|tag| drop(elements.remove(tag)));
    let packed = [2, 0, 1].map(|k| rle(&numbers(k)));
    let halves = packed[0].split_at(88);
    let pieces = vec![halves.0.to_vec(), halves.1.to_vec()];
    for (syntax, pixels) in [
        (EXPLICIT, None),
        (IMPLICIT, None),
        (RLE, Some(Value::Pieces(Vec::new(), packed.to_vec()))),
        // The first frame in two pieces.
        (RLE, Some(Value::Pieces(offsets_of(&pieces, &packed), [pieces.clone(), packed[1..].to_vec()].concat()))),
    ] {
        let elements = with(elements.clone(), pixels.map(|pixels| (PIXELS, pixels)));
        let folder = Folder::new([("all", file(syntax, &elements))]);
        for path in [folder.path().to_owned(), folder.file("all")] {
            let grid = read_volume(&path, &ReadOptions::default()).unwrap_or_else(|error| panic!("{error}"));
            let units = expected(3).iter().map(|&number| number as i16 - 5).collect();
            assert_eq!(grid.scalars, Scalars::I16(units), "{syntax}");
            assert_eq!((grid.geometry.spacing, grid.geometry.origin), ([2.0; 3], [1.0, 2.0, 0.0]));
        }
    }
    elements.remove(&0x5200_9230);
    refused(&Folder::of_slices([elements]), &ReadOptions::default(), &["each of the 3 frames", "dcm2niix"]);
}

/// Where frames begin among pieces, the first frame having those in `first`.
fn offsets_of(first: &[Vec<u8>], frames: &[Vec<u8>]) -> Vec<u8> {
    let bytes = |pieces: &[Vec<u8>]| pieces.iter().map(|piece| piece.len() as u32 + 8).sum::<u32>();
    let second = bytes(first);
    [0, second, second + bytes(&frames[1..2])].iter().flat_map(|offset| offset.to_le_bytes()).collect()
}

#[test]
fn one_of_several_series_has_to_be_chosen() {
    let other = |k: usize, z: f64, number: &str| {
        let uid = Value::Text(b"UI", format!("9.{number}"));
        with(slice(k, z), [(SERIES_UID, uid), (SERIES_NUMBER, Value::Text(b"IS", number.into()))])
    };
    let folder = Folder::of_slices([slice(0, 0.0), other(1, 0.0, "8"), other(2, 1.0, "8"), other(3, 0.0, "9")]);
    let parts = ["found 3; choose by --series: 7 (CT sample, 1 images), 8 (CT sample, 2 images)", "9 (CT"];
    refused(&folder, &ReadOptions::default(), &parts);
    let chosen = |series: &str| ReadOptions { series: Some(series.into()), ..ReadOptions::default() };
    for series in ["8", "9.8"] {
        let grid = read_volume(folder.path(), &chosen(series)).expect(series);
        assert_eq!(grid.scalars, Scalars::U16([numbers(1), numbers(2)].concat()));
    }
    refused(&folder, &chosen("6"), &["\"6\"", "choose by --series"]);
    // A file says itself of which series it is.
    let name = fs::read_dir(folder.path()).expect("lists").next().expect("a file").expect("an entry").path();
    assert!(read_volume(&name, &ReadOptions::default()).is_ok());
    assert!(read_volume(&name, &chosen("8")).expect_err("no effect").to_string().contains("--series"));
}

#[test]
fn stacks_that_make_no_grid() {
    let moved = |k: usize, x: f64, y: f64, z: f64| with(slice(k, 0.0), [(POSITION, decimals(&[x, y, z]))]);
    let at = |heights: &[f64]| Folder::of_slices(heights.iter().enumerate().map(|(k, z)| slice(k, *z)));
    let default = ReadOptions::default();
    refused(&at(&[0.0, 2.0, 2.001, 4.0]), &default, &["one slice at each place", "1 of 4", "at 2.001 mm"]);
    refused(&at(&[0.0, 0.0]), &default, &["one slice at each place"]);
    refused(
        &at(&[0.0, 2.0, 4.0, 10.0, 12.0]),
        &default,
        &["2 slices are missing", "behind slice 3 at 4.000 mm", "--resample"],
    );
    refused(
        &at(&[0.0, 2.0, 4.1, 6.0, 8.0]),
        &default,
        &["distances of 1.900 to 2.100 mm", "mostly 2.000", "--resample"],
    );
    let tilted = Folder::of_slices((0..4).map(|k| moved(k, 0.0, 0.5 * k as f64, 2.0 * k as f64)));
    refused(&tilted, &default, &["gantry tilt of 14.0 degrees", "--resample"]);
    let beside = Folder::of_slices([0.0, 0.3, 0.0, 0.0].iter().enumerate().map(|(k, x)| moved(k, *x, 0.0, k as f64)));
    refused(&beside, &default, &["pixels beside the line", "--resample"]);
    // What rounding does is no tilt, and no unevenness.
    read(&Folder::of_slices(
        (0..4).map(|k| moved(k, 0.001 * (k % 2) as f64, 0.0, 0.7 * k as f64 + 0.01 * (k % 2) as f64)),
    ));
    let even = at(&[0.0, 2.0, 4.0]);
    refused(&even, &resample(), &["--resample", "leave it out"]);
    refused(&even, &ReadOptions { time: Some(0), ..ReadOptions::default() }, &["--time"]);
}

#[test]
fn images_that_are_no_slices() {
    let changed = |tag: u32, value: Value| Folder::of_slices([slice(0, 0.0), with(slice(1, 1.0), [(tag, value)])]);
    let words = |words: &str| Value::Text(b"CS", words.into());
    let big = Value::Pixels(vec![0; COLUMNS * ROWS * 2 + 2]);
    for (tag, value, expected) in [
        (0x0028_0010, Value::Short(6), "pixels"),
        (ORIENTATION, text("0\\1\\0\\1\\0\\0"), "the orientation ["),
        (ORIENTATION, text("1\\0\\0\\1\\0\\0"), "unit vectors at right angles"),
        (0x0028_0030, text("0.75\\0.6"), "a pixel spacing of ["),
        (0x0028_0030, text("0\\1"), "positive lengths"),
        (0x0028_0030, text("1"), "PixelSpacing: expected 2 numbers"),
        (POSITION, text("1\\2\\nan"), "ImagePositionPatient: expected 3 numbers"),
        (POSITION, text(""), "no place in a volume"),
        (0x0028_0002, Value::Short(3), "convert colours first"),
        (PHOTOMETRIC, words("PALETTE COLOR"), "PALETTE COLOR"),
        (0x0028_0100, Value::Short(1), "8, 16 or 32"),
        (BITS_STORED, Value::Short(17), "17 up to bit 11"),
        (HIGH_BIT, Value::Short(16), "up to bit 16"),
        (BITS_STORED, Value::Short(0), "found 0 up"),
        (SIGNED, Value::Short(2), "PixelRepresentation"),
        (SLOPE, text("0"), "RescaleSlope"),
        (FRAMES, text("-1"), "NumberOfFrames"),
        (FRAMES, text("1e300"), "NumberOfFrames"),
        (0x0028_3000, Value::Items(vec![slice(0, 0.0)]), "ModalityLUTSequence"),
        (PIXELS, big, "expected 24 bytes of pixels (1 x 4 x 3 pixels of 2 bytes), found 26"),
    ] {
        refused(&changed(tag, value), &ReadOptions::default(), &[expected]);
    }
    let mut sized = with(slice(1, 1.0), [(0x0028_0011, Value::Short(2)), (0x0028_0010, Value::Short(6))]);
    refused(&Folder::of_slices([slice(0, 0.0), sized.clone()]), &ReadOptions::default(), &["an image of "]);
    sized.remove(&PIXELS);
    refused(&Folder::of_slices([sized]), &ReadOptions::default(), &["no DICOM image in 1 files"]);
}

#[test]
fn transfer_syntaxes_that_are_not_read_are_named() {
    for (syntax, name) in [
        ("1.2.840.10008.1.2.4.90", "JPEG 2000 lossless"),
        ("1.2.840.10008.1.2.4.80", "JPEG-LS lossless"),
        ("1.2.840.10008.1.2.1.99", "deflated"),
        ("1.2.3.4", "unknown"),
    ] {
        let elements = with(slice(0, 0.0), [(PIXELS, Value::Pieces(Vec::new(), vec![vec![0; 20]]))]);
        let folder = Folder::new([("a", file(syntax, &elements))]);
        refused(&folder, &ReadOptions::default(), &[syntax, name, "gdcmconv --raw"]);
    }
}

#[test]
fn damaged_files_are_named() {
    let good = file(EXPLICIT, &slice(0, 0.0));
    for length in [200, good.len() - 1] {
        let folder = Folder::new([("cut", good[..length].to_vec())]);
        refused(&folder, &ReadOptions::default(), &["cut", "damaged DICOM file at byte"]);
    }
    let wrong = |packed: Vec<u8>, syntax| {
        Folder::new([("bad", file(syntax, &with(slice(0, 0.0), [(PIXELS, Value::Pieces(Vec::new(), vec![packed]))])))])
    };
    let packed = jpeg(&numbers(0), COLUMNS, 12);
    let mut small = packed.clone();
    small[8] = 9;
    refused(&wrong(small, JPEG_LOSSLESS), &ReadOptions::default(), &["bad", "frame 1: JPEG: expected 4 x 3", "4 x 9"]);
    refused(&wrong(packed[..20].to_vec(), JPEG_LOSSLESS), &ReadOptions::default(), &["bad", "JPEG"]);
    refused(&wrong(rle(&numbers(0))[..70].to_vec(), RLE), &ReadOptions::default(), &["bad", "run-length"]);
    // A length that claims 4 GiB takes no memory.
    let mut bomb = good[..160].to_vec();
    bomb.extend([9, 0, 0x10, 0x10, b'O', b'B', 0, 0, 0xf0, 0xff, 0xff, 0xff, 1, 2, 3]);
    refused(&Folder::new([("bomb", bomb)]), &ReadOptions::default(), &["bomb", "further bytes, found 3"]);
    let mut packed = rle(&[0; 12]);
    packed.truncate(80);
    let huge = [(0x0028_0010, Value::Short(65535)), (0x0028_0011, Value::Short(65535))];
    let elements = with(with(slice(0, 0.0), [(PIXELS, Value::Pieces(Vec::new(), vec![packed]))]), huge);
    refused(&Folder::new([("huge", file(RLE, &elements))]), &ReadOptions::default(), &["huge", "too few"]);
}

/// A field that linear interpolation meets exactly.
fn linear([x, y, z]: [f64; 3]) -> f64 {
    1000.0 + 20.0 * x - 8.0 * y + 12.0 * z
}

#[test]
fn tilted_and_uneven_slices_are_resampled_when_asked() {
    // Rows are 0.5 apart and columns 0.75: shifts of 0.75 and 0.375 are one and half a pixel.
    let places = [[0.0, 0.0, 0.0], [0.0, 0.75, 2.0], [0.0, 1.125, 3.0], [0.0, 2.25, 6.0], [0.0, 3.0, 8.0]];
    let slices = places.map(|place| {
        let value = |pixel: usize| {
            let offset = [0.5 * (pixel % COLUMNS) as f64, 0.75 * (pixel / COLUMNS) as f64, 0.0];
            (linear([0, 1, 2].map(|axis| place[axis] + offset[axis])) as u16).to_le_bytes()
        };
        let pixels = Value::Pixels((0..COLUMNS * ROWS).flat_map(value).collect());
        with(slice(0, 0.0), [(POSITION, decimals(&place)), (PIXELS, pixels)])
    });
    let folder = Folder::of_slices(slices);
    let volume = open_volume(folder.path(), &resample()).unwrap_or_else(|error| panic!("{error}"));
    let note = volume.notes().join(" ");
    assert!(note.contains("5 slices of 4 x 3 became 5 of 4 x 7, 2.000 mm apart"), "{note}");
    let grid = volume.load().expect("resampled");
    assert_eq!((grid.geometry.dims, grid.geometry.spacing), ([4, 7, 5], [0.5, 0.75, 2.0]));
    assert_eq!(grid.geometry.origin, [0.0; 3]);
    let (mut inside, mut off) = (0, 0.0_f64);
    for k in 0..5 {
        for j in 0..7 {
            for i in 0..4 {
                let value = grid.physical((k * 7 + j) * 4 + i);
                let place = [0.5 * i as f64, 0.75 * j as f64, 2.0 * k as f64];
                if value.is_finite() {
                    inside += 1;
                    off = off.max((value - linear(place)).abs());
                }
            }
        }
    }
    // Stored numbers are cut to whole ones: by less than 1.
    assert!(off <= 1.0, "{off}");
    // Three rows of each slice that was measured; of the one between, those that both its neighbours have: one and a half
    // pixels apart, they share one.
    assert_eq!(inside, 4 * (3 + 3 + 1 + 3 + 3));
}

#[test]
fn padding_is_not_interpolated() {
    let slices = [0.0, 1.0, 3.0].map(|z| {
        let mut numbers = numbers(1);
        numbers[5] = 4000;
        let pixels = Value::Pixels(numbers.iter().flat_map(|number| number.to_le_bytes()).collect());
        with(slice(1, z), [(PADDING, Value::Short(4000)), (PIXELS, pixels)])
    });
    let grid = read_volume(Folder::of_slices(slices).path(), &resample()).expect("uneven");
    let Scalars::F32(values) = grid.scalars else { panic!("floats") };
    for (voxel, value) in values.iter().enumerate() {
        let expected = f32::from(number(1, voxel % 12));
        assert!(if voxel % 12 == 5 { value.is_nan() } else { *value == expected }, "{voxel}: {value}");
    }
}
