//! Where boundaries are on coarse levels: on every second voxel as it is, beside roles recomputed on averaged values.

use voxrole_pack::{GridGeometry, Reader, Scalars};
use voxrole_preprocess::phantom::{Phantom, PhantomSettings};
use voxrole_preprocess::progress::Silent;
use voxrole_preprocess::settings::{Method, Settings};
use voxrole_preprocess::{Grid, prepare};

/// Errors of voxels within one of their own level's voxels of the true boundary.
#[derive(Debug)]
struct Errors {
    /// Of the distance, in the level's voxels.
    rms: f64,
    largest: f64,
    /// Of the gradient magnitude at the hit, as a share of the true one: the mean.
    bias: f64,
    hits: usize,
}

fn errors(
    phantom: &PhantomSettings,
    geometry: &GridGeometry,
    distance: &[Option<f32>],
    gradient: &[Option<f32>],
) -> Errors {
    let boundary = &Phantom::Ball.scene(phantom).expect("a scene").boundaries[0];
    let exact = boundary.gradient_magnitude();
    let [nx, ny, _] = geometry.dims_usize();
    let world_from_index = geometry.world_from_index();
    let unit = geometry.smallest_spacing();
    let mut found = Errors { rms: 0.0, largest: 0.0, bias: 0.0, hits: 0 };
    for (voxel, (distance, gradient)) in distance.iter().zip(gradient).enumerate() {
        let index = [voxel % nx, voxel / nx % ny, voxel / (nx * ny)].map(|place| place as f64);
        let truth = boundary.signed_distance(world_from_index.transform_point3(index.into()));
        let (Some(distance), Some(gradient)) = (distance, gradient) else { continue };
        if truth.abs() <= unit {
            let error = (f64::from(*distance) - truth).abs() / unit;
            found.rms += error * error;
            found.largest = found.largest.max(error);
            found.bias += f64::from(*gradient) / exact - 1.0;
            found.hits += 1;
        }
    }
    found.rms = (found.rms / found.hits as f64).sqrt();
    found.bias /= found.hits as f64;
    found
}

fn errors_of_level(phantom: &PhantomSettings, reader: &Reader, level: usize) -> Errors {
    let distances = reader.distance_quantization().expect("is there");
    let gradients = reader.hit_gradient_quantization().expect("is there");
    let distance: Vec<_> = reader.read_distance(level).expect("reads").iter().map(|&d| distances.decode(d)).collect();
    let gradient: Vec<_> =
        reader.read_hit_gradient(level).expect("reads").iter().map(|&g| gradients.decode(g)).collect();
    errors(phantom, &reader.geometry(level).expect("is there"), &distance, &gradient)
}

/// Every second voxel of values that were averaged with weights 1, 2, 1 along each axis.
fn averaged(grid: &Grid) -> Grid {
    let dims = grid.geometry.dims_usize();
    let mut values: Vec<f32> = (0..grid.scalars.len()).map(|voxel| grid.physical(voxel) as f32).collect();
    let strides = [1, dims[0], dims[0] * dims[1]];
    for (axis, stride) in strides.into_iter().enumerate() {
        let before = values.clone();
        for (voxel, value) in values.iter_mut().enumerate() {
            let place = voxel / stride % dims[axis];
            let low = if place > 0 { voxel - stride } else { voxel };
            let high = if place + 1 < dims[axis] { voxel + stride } else { voxel };
            *value = 0.25 * before[low] + 0.5 * before[voxel] + 0.25 * before[high];
        }
    }
    let geometry = grid.geometry.at_level(1);
    let rows = (0..dims[2]).step_by(2).flat_map(|k| (0..dims[1]).step_by(2).map(move |j| (k * dims[1] + j) * dims[0]));
    let every: Vec<f32> = rows.flat_map(|start| values[start..start + dims[0]].iter().step_by(2).copied()).collect();
    Grid::new("averaged", geometry, Scalars::F32(every)).expect("a grid")
}

#[test]
fn boundaries_stay_where_they_are() {
    let folder = tempfile::tempdir().expect("a folder");
    let phantom = PhantomSettings::default();
    let settings = Settings { levels: Some(3), ..Settings::new(Method::Fast) };
    let mut grid = Phantom::Ball.generate(&phantom).expect("a phantom");
    let path = folder.path().join("ball.vxr");
    prepare(&grid, &settings, &path, &Silent).expect("prepares");
    let reader = Reader::open(&path).expect("opens");
    for level in 1..reader.levels() {
        let kept = errors_of_level(&phantom, &reader, level);
        grid = averaged(&grid);
        let recomputed = folder.path().join(format!("{level}.vxr"));
        prepare(&grid, &settings, &recomputed, &Silent).expect("prepares");
        let recomputed = errors_of_level(&phantom, &Reader::open(&recomputed).expect("opens"), 0);
        eprintln!("level {level}: every second voxel {kept:?}\n         recomputed {recomputed:?}");
        assert!(kept.hits > 100 && kept.rms <= 0.02 && kept.largest <= 0.05, "level {level}: {kept:?}");
        assert!(kept.rms < recomputed.rms && kept.bias.abs() < recomputed.bias.abs(), "level {level}: {recomputed:?}");
    }
}
