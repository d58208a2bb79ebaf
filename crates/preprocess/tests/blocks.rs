//! Volumes prepared block by block: the same bytes, however they are cut, stopped and gone on with.

use std::fs;
use std::panic::{RefUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use voxrole_pack::{GridGeometry, Reader, Scalars};
use voxrole_preprocess::bilateral::RangeWeights;
use voxrole_preprocess::differentiation::Kernel;
use voxrole_preprocess::prepare::prepare_source;
use voxrole_preprocess::progress::{Progress, Silent};
use voxrole_preprocess::reconstruction::Reconstruction;
use voxrole_preprocess::report::Report;
use voxrole_preprocess::settings::{Method, Settings, Smoothing, SmoothingSettings};
use voxrole_preprocess::source::Source;
use voxrole_preprocess::{Grid, prepare};

const MIB: u64 = 1 << 20;

/// Two balls with a little noise, in a volume of several bricks along each axis; with a few bad voxels if so wished.
fn volume(dims: [u32; 3], spacing: [f64; 3], bad: bool) -> Grid {
    let geometry = GridGeometry::axis_aligned(dims, spacing);
    let [nx, ny, _] = dims.map(|dim| dim as usize);
    let ball = |place: [f64; 3], centre: [f64; 3], radius: f64, blur: f64| {
        let squares: f64 = (0..3).map(|axis| ((place[axis] - centre[axis]) * spacing[axis]).powi(2)).sum();
        0.5 + 0.5 * libm::erf((radius - squares.sqrt()) / blur)
    };
    let value = |voxel: usize| {
        if bad && [70_001, 70_002, 200_123].contains(&voxel) {
            return f32::NAN;
        }
        let place = [voxel % nx, voxel / nx % ny, voxel / (nx * ny)].map(|index| index as f64);
        let noise = (voxel as u32).wrapping_mul(2_654_435_761) as f64 / f64::from(u32::MAX) - 0.5;
        let centre = dims.map(|dim| f64::from(dim) * 0.45);
        (ball(place, centre, 17.0, 1.7) - 0.4 * ball(place, [20.0, 30.0, 40.0], 12.0, 1.2) + 0.01 * noise) as f32
    };
    let values = (0..geometry.voxel_count()).map(value).collect();
    Grid::new("balls", geometry, Scalars::F32(values)).expect("a grid")
}

fn at_once(grid: &Grid, settings: &Settings, folder: &Path) -> (Vec<u8>, Report) {
    let path = folder.join("whole.vxr");
    let report = prepare(grid, settings, &path, &Silent).expect("prepares");
    (fs::read(path).expect("written"), report)
}

fn in_blocks(grid: &Grid, settings: &Settings, memory: u64, path: &Path) -> voxrole_preprocess::Result<Report> {
    let own = grid.geometry.voxel_count() as u64 * 4;
    prepare_source(Source::from(grid), settings, own + memory, path, &Silent)
}

/// The least memory with which a volume can be prepared, as the program says it: the smallest blocks.
fn least_memory(grid: &Grid, settings: &Settings, path: &Path) -> u64 {
    let message = in_blocks(grid, settings, MIB, path).expect_err("too little").to_string();
    let least = |message: &str| {
        let (_, rest) = message.split_once("takes ").expect("says how much is needed");
        let mib =
            rest.trim_start_matches("at least ").split_whitespace().next().and_then(|mib| mib.parse::<u64>().ok());
        mib.expect("a number") * MIB
    };
    // What is known before the first look may not be enough.
    match in_blocks(grid, settings, least(&message), path) {
        Err(error) => least(&error.to_string()),
        Ok(_) => {
            fs::remove_file(path).expect("there");
            least(&message)
        }
    }
}

fn all_settings() -> Vec<Settings> {
    let smoothed = |method: Method, placement: Smoothing| Settings {
        smoothing: SmoothingSettings::new(placement),
        ..Settings::new(method)
    };
    let mut exact_weights = smoothed(Method::Fast, Smoothing::BilateralValue);
    exact_weights.smoothing.range_weights = RangeWeights::Exact;
    vec![
        Settings::new(Method::Auto),
        Settings { keep_derivatives: true, ..Settings::new(Method::Fast) },
        Settings { skip: false, ..Settings::new(Method::Fast) },
        Settings { d_max: 4.0, ..Settings::new(Method::Accurate) },
        Settings::new(Method::Auto),
        Settings { d_max: 4.0, ..Settings::new(Method::Paper) },
        Settings {
            d_max: 3.0,
            kernel: Kernel::Central4,
            reconstruction: Reconstruction::Cubic,
            ..Settings::new(Method::Fast)
        },
        Settings {
            d_max: 3.0,
            kernel: Kernel::Gaussian(1.2),
            reconstruction: Reconstruction::Linear,
            ..Settings::new(Method::Accurate)
        },
        Settings { d_max: 5.0, ..smoothed(Method::Accurate, Smoothing::GaussianValue) },
        Settings { d_max: 5.0, ..smoothed(Method::Fast, Smoothing::BilateralValue) },
        Settings { d_max: 5.0, ..exact_weights },
    ]
}

#[test]
fn blocks_give_the_same_bytes() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("blocks.vxr");
    let round = volume([70, 40, 97], [1.0; 3], false);
    let uneven = volume([64, 99, 50], [1.0, 0.8, 1.7], true);
    for (settings, grid) in all_settings().into_iter().zip([&round, &uneven].into_iter().cycle()) {
        let (expected, whole) = at_once(grid, &settings, folder.path());
        assert_eq!(whole.blocks, 1);
        let memory = least_memory(grid, &settings, &path);
        let report = in_blocks(grid, &settings, memory, &path).expect("prepares");
        assert!(report.blocks > 1, "{} blocks, {settings:?}", report.blocks);
        assert_eq!(report.counts, whole.counts);
        assert!(fs::read(&path).expect("written") == expected, "{settings:?}");
    }
}

#[test]
fn threads_do_not_matter_to_blocks() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("blocks.vxr");
    let grid = volume([70, 40, 97], [1.0; 3], false);
    let settings = Settings::new(Method::Fast);
    let (expected, _) = at_once(&grid, &settings, folder.path());
    let memory = least_memory(&grid, &settings, &path);
    for threads in [1, 2, 7] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| in_blocks(&grid, &settings, memory, &path)).expect("prepares");
        assert!(fs::read(&path).expect("written") == expected, "{threads} threads");
    }
    assert!(Reader::open(&path).expect("opens").verify().is_ok());
    assert_eq!(fs::read_dir(folder.path()).expect("lists").count(), 2, "nothing else is left");
}

/// Stops a run where it is.
struct Stop {
    after: AtomicU64,
}

impl Progress for Stop {
    fn begin(&self, _: &'static str, _: u64) {}

    fn step(&self) {
        let left = self.after.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1));
        assert!(left.is_ok(), "stopped by the test");
    }
}

#[test]
fn a_stopped_run_goes_on_where_it_was() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("blocks.vxr");
    let grid = volume([70, 40, 97], [1.0; 3], false);
    let settings = Settings::new(Method::Fast);
    let (expected, whole) = at_once(&grid, &settings, folder.path());
    let memory = least_memory(&grid, &settings, &path) + grid.geometry.voxel_count() as u64 * 4;
    let run = |settings: &Settings, progress: &(dyn Progress + RefUnwindSafe)| {
        catch_unwind(|| prepare_source(Source::from(&grid), settings, memory, &path, progress))
    };
    // Stopped again and again, ever later.
    let mut before = 0;
    for after in [0, 40, 60, 90, 120] {
        assert!(run(&settings, &Stop { after: after.into() }).is_err(), "stopped");
        assert!(!path.exists());
    }
    for wanted in [1, 2] {
        // The same task finds what was done; another one leaves it alone.
        let report = run(&settings, &Silent).expect("not stopped").expect("prepares");
        assert!(fs::read(&path).expect("written") == expected);
        assert_eq!(report.counts, whole.counts);
        before = before.max(report.blocks_before);
        assert!(wanted == 2 || (1..report.blocks).contains(&before), "{before} of {} blocks", report.blocks);
        fs::remove_file(&path).expect("there");
        assert!(run(&settings, &Stop { after: 60.into() }).is_err(), "stopped");
        let other = Settings { d_max: 14.0, ..settings };
        let refused = run(&other, &Silent).expect("not stopped").expect_err("work would be lost").to_string();
        assert!(refused.contains("blocks.vxr.unfinished: holds"), "{refused}");
    }
    // Nor is it lost where everything would fit into memory by now.
    let other = Settings { d_max: 14.0, ..settings };
    let refused = prepare(&grid, &other, &path, &Silent).expect_err("work would be lost").to_string();
    assert!(refused.contains("blocks.vxr.unfinished: holds"), "{refused}");
    // The blocks of less memory will do.
    let more = memory + 8 * MIB;
    let report = prepare_source(Source::from(&grid), &settings, more, &path, &Silent).expect("prepares");
    assert!(report.blocks_before > 0, "{report:?}");
    assert!(fs::read(&path).expect("written") == expected);
    assert_eq!(fs::read_dir(folder.path()).expect("lists").count(), 2, "nothing else is left");
}
