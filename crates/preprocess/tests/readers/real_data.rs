//! Real volumes that others made. They are not part of the repository: the environment variable `VOXROLE_REAL_DATA`
//! names their folder, and without it these tests say so and pass.
//!
//! Expected placements were read from the same files with SimpleITK 2.5 (which uses the frame left-posterior-superior
//! as well), nibabel and pynrrd; hashes of the voxels come from numpy.

use std::env;
use std::path::PathBuf;

use voxrole_pack::{ScalarType, WorldFrame};
use voxrole_preprocess::Grid;
use voxrole_preprocess::io::{RawLayout, ReadOptions, read_volume};

const FOLDER_VARIABLE: &str = "VOXROLE_REAL_DATA";
const IDENTITY: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

struct Expected<'a> {
    scalar_type: ScalarType,
    dims: [u32; 3],
    spacing: [f64; 3],
    origin: [f64; 3],
    direction: [[f64; 3]; 3],
    frame: WorldFrame,
    unit: &'a str,
    slope: f64,
    sha256: &'a str,
}

impl Default for Expected<'_> {
    fn default() -> Self {
        Self {
            scalar_type: ScalarType::U8,
            dims: [0; 3],
            spacing: [1.0; 3],
            origin: [0.0; 3],
            direction: IDENTITY,
            frame: WorldFrame::Unspecified,
            unit: "",
            slope: 1.0,
            sha256: "",
        }
    }
}

fn path(file: &str) -> Option<PathBuf> {
    let folder = env::var_os(FOLDER_VARIABLE);
    if folder.is_none() {
        eprintln!("{file} was skipped: {FOLDER_VARIABLE} does not name a folder of real volumes");
    }
    Some(PathBuf::from(folder?).join(file))
}

fn read(file: &str, raw: Option<(&str, [u32; 3], [f64; 3])>) -> Option<Grid> {
    let path = path(file)?;
    let raw = raw.map(|(scalar, dims, spacing)| RawLayout {
        dims,
        scalar: Some(scalar.parse().expect("a type")),
        spacing,
        skip_bytes: 0,
    });
    let options = ReadOptions { raw, ..ReadOptions::default() };
    Some(read_volume(&path, &options).unwrap_or_else(|error| panic!("{error}")))
}

#[track_caller]
fn check(grid: Option<Grid>, expected: &Expected<'_>) {
    let Some(grid) = grid else { return };
    let geometry = &grid.geometry;
    // Decimals in the headers are exact to f32 or better.
    let close = |found: &[f64], expected: &[f64]| found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6);
    assert_eq!(grid.scalars.scalar_type(), expected.scalar_type);
    assert_eq!(geometry.dims, expected.dims);
    assert!(close(&geometry.spacing, &expected.spacing), "spacing {:?}", geometry.spacing);
    assert!(close(&geometry.origin, &expected.origin), "origin {:?}", geometry.origin);
    assert!(
        close(geometry.direction.as_flattened(), expected.direction.as_flattened()),
        "direction {:?}",
        geometry.direction
    );
    assert_eq!((geometry.frame, geometry.unit.as_str()), (expected.frame, expected.unit));
    assert!(close(&[grid.slope, grid.intercept], &[expected.slope, 0.0]), "slope {}", grid.slope);
    let sha256: String = grid.voxels_sha256().iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(sha256, expected.sha256);
}

#[test]
fn engine() {
    check(
        read("engine/engine.mhd", None),
        &Expected {
            dims: [256, 256, 128],
            sha256: "6106d7cbb7dce6fa9395130cc706cf0a675d9bf11e98cefd749654a7842e5924",
            ..Expected::default()
        },
    );
}

#[test]
fn tooth() {
    check(
        read("tooth/tooth.nhdr", None),
        &Expected {
            scalar_type: ScalarType::U16,
            dims: [103, 94, 161],
            sha256: "0149b5fa6dc38d5314bae74f2644b4f76b6da98129b0156a967960b450735a74",
            ..Expected::default()
        },
    );
}

#[test]
fn cthead() {
    let (dims, spacing) = ([256, 256, 113], [1.0, 1.0, 2.0]);
    check(
        read("cthead/cthead_256x256x113_u16be.raw.gz", Some(("u16be", dims, spacing))),
        &Expected {
            scalar_type: ScalarType::U16,
            dims,
            spacing,
            sha256: "8a378356d37fc55a977032375b1bd34298c0b137167dd0f05e025d66e0ae5d94",
            ..Expected::default()
        },
    );
}

#[test]
fn teapot() {
    let dims = [256, 256, 178];
    check(
        read("teapot/teapot_256x256x178_u8.raw.gz", Some(("u8", dims, [1.0; 3]))),
        &Expected {
            dims,
            sha256: "e7b67180fe2d813bda6e9900ab21ea1a9b89069fab074e77996022b9512fab1e",
            ..Expected::default()
        },
    );
}

#[test]
fn vismale() {
    let (dims, spacing) = ([128, 256, 256], [1.57774, 0.995861, 1.00797]);
    check(
        read("vismale/vismale_128x256x256_u8.raw.gz", Some(("u8", dims, spacing))),
        &Expected {
            dims,
            spacing,
            sha256: "3aa9da2a3338259e6952834935b64f81aac567bd7635cdbb85a8e59647a395ed",
            ..Expected::default()
        },
    );
}

#[test]
fn ch2() {
    check(
        read("ch2/ch2.nii.gz", None),
        &Expected {
            dims: [181, 217, 181],
            origin: [90.0, 125.0, -71.0],
            direction: [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]],
            frame: WorldFrame::LeftPosteriorSuperior,
            sha256: "38e1383cfd10824abc62dd61c9597f83ff899c82e2a84eb37737bdc83bfc9d7d",
            ..Expected::default()
        },
    );
}

#[test]
fn mr_gd() {
    let grid = read("mr_gd/MR_Gd.nii.gz", None);
    if let Some(grid) = &grid {
        let [low, high] = grid.scalars.finite_range().expect("numbers");
        assert_eq!((low, high), (0.0, 255.0));
        assert!((grid.slope * high - 1_652.999_947_071_075_4).abs() < 1e-9, "{}", grid.slope * high);
    }
    check(
        grid,
        &Expected {
            dims: [176, 188, 144],
            spacing: [0.976562, 0.976562, 1.0026],
            origin: [85.712646484375, 112.45329284667969, -56.81804656982422],
            direction: [
                [-0.9997157271848907, 0.02152197806901205, 0.010260081831096229],
                [-0.022533586020175488, -0.9934959667166994, -0.1116154184],
                [0.007791164701858494, -0.11181488472919063, 0.9936985102663617],
            ],
            frame: WorldFrame::LeftPosteriorSuperior,
            unit: "mm",
            slope: 6.4823527336120605,
            sha256: "67c86a5785f62c204164bb9b68978edb8de931045d16ab517a1ad02b9fbd604f",
            ..Expected::default()
        },
    );
}

#[test]
fn brain1() {
    check(
        read("brain1/brain1_image.nrrd", None),
        &Expected {
            scalar_type: ScalarType::I16,
            dims: [256, 256, 25],
            spacing: [0.78125, 0.78125, 6.5],
            origin: [-99.609375, 99.609375, -78.0],
            direction: [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]],
            frame: WorldFrame::LeftPosteriorSuperior,
            sha256: "cb06e37c791479070b5adbc2c5d69614acd43d39996405e98b55ec7ede0ecfad",
            ..Expected::default()
        },
    );
}

#[test]
fn walnut() {
    let dims = [128, 96, 114];
    check(
        read("walnut/walnut.raw", Some(("u16", dims, [1.0; 3]))),
        &Expected {
            scalar_type: ScalarType::U16,
            dims,
            sha256: "83e5e0a9d0216620b73ed4ad00c2a43989cb53c2a0ae51019daaa4dd51945ce2",
            ..Expected::default()
        },
    );
}

#[test]
fn isabel() {
    check(
        read("isabel/isabel_30.vti", None),
        &Expected {
            scalar_type: ScalarType::F64,
            dims: [125, 125, 25],
            spacing: [4.008_032_128_6, 4.008_032_128_6, 4.040_816_326_6],
            sha256: "73845e5d45623790f5aec43d59c096eda9bab5ce9cb5db437b45aa39918f796a",
            ..Expected::default()
        },
    );
}

#[test]
fn hydrogen() {
    check(
        read("hydrogen/hydrogen.vti", None),
        &Expected {
            scalar_type: ScalarType::F32,
            dims: [64, 64, 64],
            sha256: "789756a94c4e8b43d04f7f89455f568d2fdb8dcb2d2170b75e078edc1b56d0b2",
            ..Expected::default()
        },
    );
}

#[cfg(feature = "tiff")]
#[test]
fn flybrain() {
    check(
        read("flybrain/flybrain.tif", None),
        &Expected {
            dims: [256, 256, 57],
            spacing: [2.675_521, 2.675_521, 3.947_368],
            unit: "\u{b5}m",
            sha256: "b0948ec5156b72bef7f7492374a1ac504b88b84676cd61e72a8b8f17f3cca9f9",
            ..Expected::default()
        },
    );
}

#[test]
fn walnut_by_its_description() {
    let dims = [128, 96, 114];
    check(
        read("walnut/walnut.vvd", None),
        &Expected {
            scalar_type: ScalarType::U16,
            dims,
            spacing: [0.015625; 3],
            origin: [-1.0, -0.75, -0.890625],
            sha256: "83e5e0a9d0216620b73ed4ad00c2a43989cb53c2a0ae51019daaa4dd51945ce2",
            ..Expected::default()
        },
    );
}

#[test]
fn ct_phantom_dicom() {
    for file in ["ct_phantom_dicom", "ct_phantom_dicom/I100"] {
        check(
            read(file, None),
            &Expected {
                scalar_type: ScalarType::I16,
                dims: [512, 512, 28],
                spacing: [0.451171875, 0.451171875, 5.0],
                origin: [-115.5, -1.85, 696.21],
                frame: WorldFrame::LeftPosteriorSuperior,
                unit: "mm",
                sha256: "84d520219d26b899f28881aae841accdbbd021a5bbb6943d6155bb10a7593078",
                ..Expected::default()
            },
        );
    }
}

#[test]
fn ct_tilt_dicom_is_refused_or_resampled() {
    let Some(path) = path("ct_tilt_dicom") else { return };
    let message = read_volume(&path, &ReadOptions::default()).expect_err("tilted and uneven").to_string();
    for part in
        ["distances of 1.081 to 6.999 mm between slices (mostly 4.002)", "a gantry tilt of 18.5 degrees", "--resample"]
    {
        assert!(message.contains(part), "{message}");
    }
    let options = ReadOptions { resample: true, ..ReadOptions::default() };
    let grid = read_volume(&path, &options).unwrap_or_else(|error| panic!("{error}"));
    // The stack leans by 48.3 mm, or 99 pixels, over its 144.1 mm; slices are as far apart as most are.
    assert_eq!(grid.geometry.dims, [512, 611, 37]);
    let [x, y, z] = grid.geometry.spacing;
    assert!(x == y && (z - 144.094 / 36.0).abs() < 1e-3, "{z}");
}
