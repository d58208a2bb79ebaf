//! The whole run: from a grid to a packed file.

use std::path::Path;

use voxrole_pack::Scalars;

use crate::automatic::{LEAST_BLUR, choose};
use crate::blur::edge_statistics;
use crate::boundary::{GradientFloor, Tracer};
use crate::bspline::{Coefficients, Degree, Evaluator};
use crate::differentiation::{Gradient, GradientSource, Kernel, differentiate, spline_through};
use crate::directional_derivative::Derivatives;
use crate::noise::{noise_sigma, smoothed_noise_sigma};
use crate::noise_gain::{GradientNoise, NoiseGain};
use crate::packing::Prepared;
use crate::progress::Progress;
use crate::reconstruction::{Reconstruction, Smooth};
use crate::report::{Counts, Report, Stopwatch};
use crate::roles::Roles;
use crate::sampler::Sampler;
use crate::settings::{Automatic, Settings};
use crate::smoothing::{RangeSigmas, sigma_on_noise, smooth_derivatives, smooth_value};
use crate::working_field::{WorkingField, voxels};
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
    let range_in_working =
        prepared.stored_range.map_or(0.0, |[low, high]| (high - low) * grid.slope.abs() / prepared.field.value_scale);
    let noise_share = f64::from(prepared.noise) / range_in_working.max(f64::MIN_POSITIVE);
    let (choice, warning) = (prepared.choice.clone(), prepared.warning.clone());
    let range_sigma = prepared.range_sigmas.clone();
    let file_bytes = prepared.write(path)?;
    progress.step();
    watch.lap("packing");
    Ok(Report {
        input: grid.name.clone(),
        dims: grid.geometry.dims,
        threads: rayon::current_num_threads(),
        seconds: watch.total(),
        stages: watch.into_stages(),
        noise_share,
        range_sigma,
        choice,
        warning,
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
    settings: &Settings,
    progress: &dyn Progress,
    watch: &mut Stopwatch,
) -> Result<(Prepared<'a>, Counts)> {
    settings.validate()?;
    let mut settings = *settings;
    let mut range_sigmas = RangeSigmas::new();

    progress.begin("smoothing and derivatives", 1);
    let mut field = WorkingField::new(grid)?;
    watch.lap("conversion");
    let noise = noise_sigma(&field).max(quantisation_noise(grid, &field));
    watch.lap("noise estimate");
    let choice = if settings.automatic == Automatic::default() {
        None
    } else {
        let choice = choose(&field, noise, &mut settings)?;
        watch.lap("choice of method");
        Some(choice)
    };
    let smoothing = &settings.smoothing;
    smooth_value(&mut field, smoothing, &mut range_sigmas);
    watch.lap("value smoothing");
    let sigmas: Vec<f32> = sigma_on_noise(smoothing).into_iter().collect();
    let gain = NoiseGain::new(settings.kernel, &sigmas, field.spacing)?;
    let (mut derivatives, source) = differentiate(&mut field, settings.kernel, settings.operator)?;
    watch.lap("derivatives");
    smooth_derivatives(&mut derivatives, field.spacing, noise, gain, smoothing, &mut range_sigmas);
    watch.lap("derivative smoothing");
    let cells = CellDistances::new(&derivatives.second_derivative);
    watch.lap("zero-crossing cells");
    let splines = DerivativeSplines::new(&derivatives, settings.reconstruction)?;
    watch.lap("reconstruction");
    progress.step();

    let kernel_sigma = if let Kernel::Gaussian(sigma) = settings.kernel { Some(sigma as f32) } else { None };
    let smoothed: Vec<f32> = sigmas.iter().copied().chain(kernel_sigma).collect();
    // What noise is left is seen best where it is left.
    let left = if smoothed.is_empty() { noise } else { noise.max(smoothed_noise_sigma(&field, &smoothed)) };
    let gradient_noise = GradientNoise::new(settings.kernel, &sigmas, field.spacing, field.dims(), left)?;
    let floor = GradientFloor::new(gradient_noise, settings.noise_floor as f32);
    let smooth = splines.smooth(&field, &source, &settings);
    let gradient = Gradient::new(&field, &source);
    let tracer = Tracer::new(&field, &derivatives, &cells, gradient, smooth, &floor, &settings);
    let roles = Roles::new(&tracer, field.dims(), progress)?;
    watch.lap("rays");
    let warning = under_sampling(&tracer, &source, &field, &settings);
    watch.lap("check of blur");
    let counts = Counts {
        voxels: roles.distance.len() as u64,
        masked: roles.masked,
        flat: roles.work.flat,
        skipped: roles.work.skipped,
        traced: roles.work.traced,
        samples: roles.work.samples,
        evaluations: roles.work.evaluations,
        hits: roles.hits,
        misses: roles.misses(),
        cells: cells.cells.len() as u64,
        mixed_cells: cells.mixed_count(),
    };
    let stored_range = grid.scalars.finite_range();
    let prepared =
        Prepared { grid, stored_range, settings, choice, warning, field, derivatives, roles, noise, range_sigmas };
    Ok((prepared, counts))
}

/// Says so where a spline is fitted to edges that are too sharp for it.
fn under_sampling(
    tracer: &Tracer<'_>,
    source: &GradientSource,
    field: &WorkingField,
    settings: &Settings,
) -> Option<String> {
    let GradientSource::Spline(coefficients) = source else { return None };
    let spline = Evaluator::new(coefficients, field.spacing);
    let blur = edge_statistics(tracer, &spline, field.dims())?.samples_across(field.spacing, 0.0);
    (blur < LEAST_BLUR).then(|| {
        format!(
            "boundaries blurred by {blur:.2} samples are under-sampled for --derivative {}: it rings beside them and finds \
             boundaries that are none; --method auto or fast do not",
            settings.kernel
        )
    })
}

/// Standard deviation of the rounding of values to whole numbers, in working units: a uniform distribution's. 0 for
/// floats.
fn quantisation_noise(grid: &Grid, field: &WorkingField) -> f32 {
    match grid.scalars {
        Scalars::F32(_) | Scalars::F64(_) => 0.0,
        _ => (grid.slope.abs() / field.value_scale / 12.0_f64.sqrt()) as f32,
    }
}

/// Splines through the derivatives, where the reconstruction asks for them.
struct DerivativeSplines(Option<[Coefficients; 2]>);

impl DerivativeSplines {
    fn new(derivatives: &Derivatives, reconstruction: Reconstruction) -> Result<Self> {
        let degree = match reconstruction {
            Reconstruction::Linear | Reconstruction::Exact => return Ok(Self(None)),
            Reconstruction::Cubic => Degree::Cubic,
            Reconstruction::Quintic => Degree::Quintic,
        };
        Ok(Self(Some([
            spline_through(&derivatives.second_derivative, degree)?,
            spline_through(&derivatives.gradient_magnitude, degree)?,
        ])))
    }

    fn smooth<'a>(
        &'a self,
        field: &'a WorkingField,
        source: &'a GradientSource,
        settings: &Settings,
    ) -> Option<Smooth<'a>> {
        let evaluator = |coefficients| Evaluator::new(coefficients, field.spacing);
        match (&self.0, source) {
            (Some([second_derivative, gradient_magnitude]), _) => Some(Smooth::Fields {
                second_derivative: evaluator(second_derivative),
                gradient_magnitude: evaluator(gradient_magnitude),
                values: (Sampler::new(field.dims()), voxels(&field.values)),
            }),
            (None, GradientSource::Spline(value)) if settings.reconstruction == Reconstruction::Exact => {
                Some(Smooth::Exact { value: evaluator(value), operator: settings.operator })
            }
            _ => None,
        }
    }
}
