//! The whole run: from a grid to a packed file.

use std::path::Path;

use crate::boundary::Tracer;
use crate::directional_derivative::derivatives;
use crate::noise::noise_sigma;
use crate::packing::Prepared;
use crate::progress::Progress;
use crate::report::{Counts, Report, Stopwatch};
use crate::roles::Roles;
use crate::settings::Settings;
use crate::smoothing::{RangeSigmas, gradient_noise, smooth_derivatives, smooth_value};
use crate::working_field::WorkingField;
use crate::zero_crossing::CellDistances;
use crate::{Grid, Result};

/// Computes the voxel roles of `grid` and writes them to `path`, which appears only when complete.
///
/// Runs on the current rayon thread pool. The file's bytes depend on the grid and the settings alone, not on the number
/// of threads nor on [`Settings::skip`].
///
/// # Errors
/// [`crate::Error::Parameter`] for settings or a volume that cannot be used, [`crate::Error::Pack`] when memory runs out
/// or writing fails.
///
/// ```
/// use voxrole_pack::{GridGeometry, Scalars};
/// use voxrole_preprocess::settings::{Method, Settings};
/// use voxrole_preprocess::{Grid, prepare, progress::Silent};
///
/// let geometry = GridGeometry::axis_aligned([8, 8, 8], [1.0; 3]);
/// let values = (0..512).map(|voxel| if voxel % 8 < 4 { 10 } else { 200 }).collect();
/// let grid = Grid::new("step", geometry, Scalars::U8(values))?;
/// let folder = std::env::temp_dir().join(format!("voxrole-doc-{}", std::process::id()));
/// std::fs::create_dir_all(&folder)?;
/// let report = prepare(&grid, &Settings::new(Method::Fast), &folder.join("step.vxr"), &Silent)?;
/// assert_eq!(report.counts.hits, 128); // the two voxels on either side of the step have a gradient
/// # std::fs::remove_dir_all(&folder)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn prepare(grid: &Grid, settings: &Settings, path: &Path, progress: &dyn Progress) -> Result<Report> {
    let mut watch = Stopwatch::new();
    let (prepared, counts) = compute_roles(grid, settings, progress, &mut watch)?;
    progress.begin("packing", 1);
    let file_bytes = prepared.write(path)?;
    progress.step();
    watch.lap("packing");
    let [low, high] = grid.scalars.finite_range().unwrap_or_default();
    let range_in_working = (high - low) * grid.slope.abs() / prepared.field.value_scale;
    Ok(Report {
        input: grid.name.clone(),
        dims: grid.geometry.dims,
        threads: rayon::current_num_threads(),
        seconds: watch.total(),
        stages: watch.into_stages(),
        noise_share: f64::from(prepared.noise) / range_in_working.max(f64::MIN_POSITIVE),
        range_sigma: prepared.range_sigmas,
        counts,
        file_bytes,
    })
}

/// Computes the roles without writing them.
///
/// # Errors
/// As [`prepare`], but for writing.
pub fn compute_roles<'a>(
    grid: &'a Grid,
    settings: &'a Settings,
    progress: &dyn Progress,
    watch: &mut Stopwatch,
) -> Result<(Prepared<'a>, Counts)> {
    settings.validate()?;
    let smoothing = &settings.smoothing;
    let mut range_sigmas = RangeSigmas::new();

    progress.begin("smoothing and derivatives", 1);
    let mut field = WorkingField::new(grid)?;
    watch.lap("conversion");
    let noise = noise_sigma(&field);
    watch.lap("noise estimate");
    smooth_value(&mut field, noise, smoothing, &mut range_sigmas);
    watch.lap("value smoothing");
    let mut derivatives = derivatives(&field);
    watch.lap("derivatives");
    smooth_derivatives(&mut derivatives, field.spacing, noise, smoothing, &mut range_sigmas);
    watch.lap("derivative smoothing");
    let cells = CellDistances::new(&derivatives.second_derivative);
    watch.lap("zero-crossing cells");
    progress.step();

    let floor = settings.noise_floor as f32 * gradient_noise(noise, smoothing);
    let tracer = Tracer::new(&field, &derivatives, &cells, floor, settings);
    let roles = Roles::new(&tracer, field.dims(), progress)?;
    watch.lap("rays");
    let counts = Counts {
        voxels: roles.distance.len() as u64,
        masked: roles.masked,
        flat: roles.work.flat,
        skipped: roles.work.skipped,
        traced: roles.work.traced,
        samples: roles.work.samples,
        hits: roles.hits,
        misses: roles.misses(),
        cells: cells.cells.len() as u64,
        mixed_cells: cells.mixed_count(),
    };
    Ok((Prepared { grid, settings, field, derivatives, roles, noise, range_sigmas }, counts))
}
