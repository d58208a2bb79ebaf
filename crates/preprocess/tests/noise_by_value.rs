//! Noise that depends on the value: what is noise finds no boundary, and no boundary is lost.

use std::fs;

use voxrole_pack::{GridGeometry, Scalars};
use voxrole_preprocess::phantom::NoiseKind;
use voxrole_preprocess::prepare::{compute_roles, prepare_source};
use voxrole_preprocess::progress::Silent;
use voxrole_preprocess::report::Stopwatch;
use voxrole_preprocess::settings::{Method, Settings};
use voxrole_preprocess::source::Source;
use voxrole_preprocess::{Grid, prepare};

const DIMS: [usize; 3] = [96, 64, 64];
/// Where the wall is along x.
const WALL: f64 = 41.3;

/// A wall blurred by 1.2 voxels between two materials. The darker one's noise is white, the brighter one's three times as
/// strong and smoothed along each axis by (1, 4, 1)/6.
fn wall(seed: u64) -> Grid {
    let [nx, ny, nz] = DIMS;
    let white: Vec<f64> =
        (0..nx * ny * nz).map(|voxel| NoiseKind::Gaussian.apply(0.0, 1.0, seed, voxel as u64)).collect();
    let mut smooth = white.clone();
    for (stride, len) in [(1, nx), (nx, ny), (nx * ny, nz)] {
        let before = smooth.clone();
        for (voxel, value) in smooth.iter_mut().enumerate() {
            let at = voxel / stride % len;
            let [below, above] = [voxel - stride * usize::from(at > 0), voxel + stride * usize::from(at + 1 < len)];
            *value = (before[below] + 4.0 * before[voxel] + before[above]) / 18.0_f64.sqrt();
        }
    }
    let value = |voxel: usize| {
        let share = 0.5 + 0.5 * libm::erf(((voxel % nx) as f64 - WALL) / (1.2 * 2.0_f64.sqrt()));
        (share + 0.004 * ((1.0 - share) * white[voxel] + share * 3.0 * smooth[voxel])) as f32
    };
    let geometry = GridGeometry::axis_aligned(DIMS.map(|dim| dim as u32), [1.0; 3]);
    Grid::new("wall", geometry, Scalars::F32((0..nx * ny * nz).map(value).collect())).expect("a grid")
}

/// Voxels of the noisy material with a boundary that is not the wall, and of those at the wall the ones without it.
fn wrong_and_lost(grid: &Grid, settings: &Settings) -> [usize; 2] {
    let (prepared, _) = compute_roles(grid, settings, &Silent, &mut Stopwatch::new()).expect("prepares");
    let mut counts = [0; 2];
    for (voxel, &distance) in prepared.roles.distance.iter().enumerate() {
        let depth = (voxel % DIMS[0]) as f64 - WALL;
        let is_wall = (f64::from(distance) - depth).abs() < 0.5;
        counts[0] += usize::from(depth > 2.0 && distance.is_finite() && (f64::from(distance) - depth).abs() > 1.5);
        counts[1] += usize::from(depth.abs() < 2.0 && !is_wall);
    }
    counts
}

#[test]
fn a_noisy_material_has_no_boundaries_and_its_wall_is_whole() {
    for seed in 0..3 {
        let grid = wall(seed);
        for method in [Method::Auto, Method::Fast, Method::Accurate] {
            let settings = Settings::new(method);
            let [wrong, lost] = wrong_and_lost(&grid, &settings);
            let off = Settings { noise_floor: 0.0, ..settings };
            let [all, lost_anyway] = wrong_and_lost(&grid, &off);
            // Four deviations of one component are exceeded by one voxel in a thousand, and its neighbours climb there too.
            let noisy = (DIMS[0] - WALL as usize) * DIMS[1] * DIMS[2];
            assert!(2 * all > noisy, "{method} {seed}: without a floor noise is everywhere, not {all} of {noisy}");
            assert!(wrong * 300 < noisy, "{method} {seed}: {wrong} of {noisy}");
            // The wall is where it is without a floor.
            assert_eq!(lost, lost_anyway, "{method} {seed}");
        }
    }
}

#[test]
fn it_is_reported_and_the_same_for_blocks() {
    let folder = tempfile::tempdir().expect("a folder");
    let grid = wall(7);
    let settings = Settings { d_max: 3.0, ..Settings::new(Method::Auto) };
    let [whole, parts] = ["whole.vxr", "parts.vxr"].map(|name| folder.path().join(name));
    let report = prepare(&grid, &settings, &whole, &Silent).expect("prepares");
    assert!(!report.noise_by_value.is_empty() && report.noise_by_value.iter().all(|noisy| noisy.from > 0.8));
    let parameters = voxrole_pack::Reader::open(&whole).expect("opens").header().parameters.clone();
    assert!(parameters.iter().any(|parameter| parameter.name == "gradient noise"), "{parameters:?}");
    let memory = (24..400).step_by(8).map(|mib| mib << 20).find(|&memory| {
        prepare_source(Source::from(&grid), &settings, memory, &parts, &Silent).is_ok_and(|report| report.blocks > 1)
    });
    assert!(memory.is_some(), "no memory makes blocks");
    assert_eq!(fs::read(&whole).expect("written"), fs::read(&parts).expect("written"));
    // Without a floor nothing of it is there.
    let off = Settings { noise_floor: 0.0, ..settings };
    assert!(prepare(&grid, &off, &whole, &Silent).expect("prepares").noise_by_value.is_empty());
}
