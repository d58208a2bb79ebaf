//! Small volumes that VTK, tifffile and zarr-python wrote: `data/make.py` has the commands. All hold the same numbers.

use std::path::PathBuf;

use voxrole_pack::Scalars;
use voxrole_preprocess::Grid;
use voxrole_preprocess::io::{ReadOptions, read_volume};

pub fn path(name: &str) -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/readers/data")).join(name)
}

fn read(name: &str, options: &ReadOptions) -> Grid {
    read_volume(&path(name), options).unwrap_or_else(|error| panic!("{error}"))
}

/// The numbers of every sample, and `added` to each.
fn numbers(added: u16) -> Scalars {
    Scalars::U16((0..60).map(|n| n * 1000 + added).collect())
}

#[track_caller]
fn check(name: &str, options: &ReadOptions, spacing: [f64; 3], origin: [f64; 3], unit: &str, added: u16) {
    let grid = read(name, options);
    assert_eq!(grid.geometry.dims, [3, 4, 5], "{name}");
    let close = |found: [f64; 3], expected: [f64; 3]| found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9);
    assert!(close(grid.geometry.spacing, spacing), "{name}: spacing {:?}", grid.geometry.spacing);
    assert!(close(grid.geometry.origin, origin), "{name}: origin {:?}", grid.geometry.origin);
    assert_eq!(grid.geometry.unit, unit, "{name}");
    assert_eq!(grid.scalars, numbers(added), "{name}");
}

fn refused(name: &str, options: &ReadOptions, expected: &[&str]) {
    let message = read_volume(&path(name), options).expect_err(name).to_string();
    for part in expected.iter().chain(&["found"]) {
        assert!(message.contains(part), "{part:?} is not in: {message}");
    }
}

fn chosen(component: Option<usize>, time: Option<usize>) -> ReadOptions {
    ReadOptions { component, time, ..ReadOptions::default() }
}

#[test]
fn vtk() {
    for name in [
        "vtk_ascii_none",
        "vtk_binary_none",
        "vtk_binary_zlib",
        "vtk_binary_lz4",
        "vtk_appended_none",
        "vtk_appended_none_base64",
        "vtk_appended_zlib",
        "vtk_appended_zlib_base64",
        "vtk_appended_lz4",
        "vtk_appended_lz4_base64",
    ] {
        let name = format!("{name}.vti");
        // The extent begins at 2 along x, which is y of the world.
        check(&name, &ReadOptions::default(), [1.0, 2.0, 3.0], [10.0, 22.0, 30.0], "", 0);
        let direction = read(&name, &ReadOptions::default()).geometry.direction;
        assert_eq!(direction, [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]);
    }
    for name in ["vtk_binary_lzma.vti", "vtk_appended_lzma.vti", "vtk_appended_lzma_base64.vti"] {
        refused(name, &ReadOptions::default(), &[name, "vtkLZMADataCompressor", "vtkZLibDataCompressor"]);
    }
    refused("vtk_ascii_none.vti", &chosen(Some(1), None), &["--component 1"]);
    refused("vtk_ascii_none.vti", &chosen(None, Some(1)), &["time"]);
}

#[cfg(feature = "tiff")]
#[test]
fn tifffile() {
    let plain = ReadOptions::default();
    for name in ["plain", "bigtiff", "lzw", "deflate", "packbits", "strips", "tiles", "big_endian"] {
        check(&format!("tifffile_{name}.tif"), &plain, [1.0; 3], [0.0; 3], "", 0);
    }
    for name in ["imagej", "imagej_big_endian"] {
        check(&format!("tifffile_{name}.tif"), &plain, [1.0, 2.0, 3.0], [0.0; 3], "µm", 0);
    }
    check("tifffile.ome.tif", &plain, [1.0, 2.0, 3.0], [0.0; 3], "µm", 0);
    check("slices", &plain, [1.0; 3], [0.0; 3], "", 0);
    refused("tifffile_zstd.tif", &plain, &["tifffile_zstd.tif", "LZW, Deflate or PackBits"]);
    let half = read("tifffile_float16.tif", &plain);
    assert_eq!(half.scalars, Scalars::F32((0_u8..60).map(f32::from).collect()));
    let Scalars::U16(inverted) = read("tifffile_inverted.tif", &plain).scalars else { panic!("u16") };
    assert_eq!(inverted[1], u16::MAX - 1000);
}

#[cfg(feature = "tiff")]
#[test]
fn channels_and_times_of_tifffile() {
    for name in ["tifffile_hyperstack.tif", "tifffile_tczyx.ome.tif"] {
        check(name, &chosen(Some(1), Some(1)), [1.0, 2.0, 3.0], [0.0; 3], "µm", 0);
        check(name, &chosen(Some(1), Some(0)), [1.0, 2.0, 3.0], [0.0; 3], "µm", 1);
        check(name, &chosen(Some(0), Some(1)), [1.0, 2.0, 3.0], [0.0; 3], "µm", 2);
        refused(name, &ReadOptions::default(), &[name, "2 channels", "--component"]);
        refused(name, &chosen(Some(0), None), &[name, "2 points of time", "--time"]);
        refused(name, &chosen(Some(0), Some(2)), &[name, "--time 2"]);
    }
    for name in ["tifffile_rgb.tif", "tifffile_planar.tif"] {
        check(name, &chosen(Some(0), None), [1.0; 3], [0.0; 3], "", 0);
        let green = read(name, &chosen(Some(1), None)).scalars;
        assert_eq!(green, Scalars::U16((0..60).map(|n| n * 500).collect()), "{name}");
        refused(name, &ReadOptions::default(), &[name, "3 samples per pixel", "--component"]);
    }
}

#[cfg(feature = "zarr")]
#[test]
fn zarr_python() {
    let plain = ReadOptions::default();
    for name in ["v3_plain", "v3_gzip", "v3_zstd", "v2_none", "v2_zlib", "v2_blosc", "v2_zstd"] {
        check(&format!("zarr/{name}"), &plain, [1.0; 3], [0.0; 3], "", 0);
    }
    for codec in ["lz4", "zstd", "zlib", "blosclz"] {
        for shuffle in ["noshuffle", "shuffle", "bitshuffle"] {
            let grid = read(&format!("zarr/v3_blosc_{codec}_{shuffle}"), &plain);
            assert_eq!(grid.geometry.dims, [24, 32, 10]);
            let Scalars::U16(found) = grid.scalars else { panic!("u16") };
            let expected = (0..10).flat_map(|k| {
                (0..32).flat_map(move |j| (0..24).map(move |i| ((k / 2 * 4 + j / 8) * 3 + i / 8) * 1000))
            });
            assert!(found.into_iter().eq(expected), "{codec} {shuffle}");
        }
    }
}

#[cfg(feature = "zarr")]
#[test]
fn ome_zarr() {
    for name in ["zarr/ome_0.4.zarr", "zarr/ome_0.5.zarr"] {
        check(name, &chosen(Some(1), Some(1)), [1.0, 2.0, 3.0], [10.0, 20.0, 30.0], "µm", 0);
        check(name, &chosen(Some(1), Some(0)), [1.0, 2.0, 3.0], [10.0, 20.0, 30.0], "µm", 1);
        // Chunks that are not there hold the fill value.
        assert_eq!(read(name, &chosen(Some(0), Some(0))).scalars, Scalars::U16(vec![0; 60]));
        refused(name, &ReadOptions::default(), &["2 points of time", "--time"]);
        refused(name, &chosen(None, Some(1)), &["2 channels", "--component"]);
        refused(name, &chosen(Some(2), Some(1)), &["--component 2"]);
    }
    refused("zarr", &ReadOptions::default(), &["folder"]);
}
