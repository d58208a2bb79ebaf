//! `voxrole prepare`.

use anyhow::{Context, bail, ensure};
use rayon::ThreadPoolBuilder;
use sysinfo::System;
use voxrole_preprocess::bilateral::RangeWeights;
use voxrole_preprocess::directional_derivative::EdgeOperator;
use voxrole_preprocess::io::open_volume;
use voxrole_preprocess::prepare::prepare_file;
use voxrole_preprocess::report::Report;
use voxrole_preprocess::root_finder::RootFinder;
use voxrole_preprocess::settings::{Climb, Method, Settings, Smoothing, SmoothingSettings};

use super::args::{BilateralArg, ClimbArg, EdgeArg, MethodArg, PrepareArgs, RootArg, SmoothArg};
use super::terminal::TerminalProgress;

pub fn run(args: &PrepareArgs) -> anyhow::Result<()> {
    let settings = settings(args);
    settings.validate()?;
    check_filter_options(args, &settings.smoothing)?;
    super::check_output(&args.output, &args.input, None)?;
    if let Some(report) = &args.report {
        super::check_output(report, &args.input, None)?;
        ensure!(report != &args.output, "{}: two outputs cannot be one file", report.display());
    }
    let mut pool = ThreadPoolBuilder::new();
    if let Some(threads) = args.threads {
        pool = pool.num_threads(threads.into());
    }
    let report = pool.build().context("starting threads")?.install(|| read_and_prepare(args, &settings))?;
    summarise(&report, args);
    if let Some(warning) = &report.warning {
        eprintln!("voxrole: warning: {warning}");
    }
    if let Some(path) = &args.report {
        super::write(path, &serde_json::to_vec_pretty(&report)?)?;
    }
    Ok(())
}

fn read_and_prepare(args: &PrepareArgs, settings: &Settings) -> anyhow::Result<Report> {
    let progress = TerminalProgress::new();
    let file = open_volume(&args.input, args.raw.layout().as_ref())?;
    let memory = args.memory.map_or_else(half_of_memory, Ok)?;
    let result = prepare_file(file, settings, memory, &args.output, &progress);
    progress.finish();
    result.with_context(|| format!("preparing {}", args.input.display()))
}

/// Half of the memory that this machine, or the container that this runs in, has.
fn half_of_memory() -> anyhow::Result<u64> {
    let mut system = System::new().context("finding out how much memory there is; give --memory")?;
    system.refresh_memory();
    let limit = system.cgroup_limits().map_or(u64::MAX, |limits| limits.total_memory);
    Ok(system.total_memory().min(limit) / 2)
}

fn settings(args: &PrepareArgs) -> Settings {
    let mut settings = Settings::new(match args.method {
        MethodArg::Auto => Method::Auto,
        MethodArg::Accurate => Method::Accurate,
        MethodArg::Fast => Method::Fast,
        MethodArg::Paper => Method::Paper,
    });
    if let Some(smooth) = args.smooth {
        settings.smoothing = SmoothingSettings::new(match smooth {
            SmoothArg::None => Smoothing::None,
            SmoothArg::BilateralDerivatives => Smoothing::BilateralDerivatives,
            SmoothArg::BilateralValue => Smoothing::BilateralValue,
            SmoothArg::GaussianValue => Smoothing::GaussianValue,
        });
    }
    if let Some(kernel) = args.derivative {
        settings.kernel = kernel;
    }
    if let Some(reconstruction) = args.reconstruction {
        settings.reconstruction = reconstruction;
    }
    let automatic = &mut settings.automatic;
    // What is set by hand stays as it is set.
    automatic.smoothing &= args.smooth.is_none();
    automatic.kernel &= args.derivative.is_none();
    automatic.reconstruction &= args.reconstruction.is_none();
    let smoothing = &mut settings.smoothing;
    let wider = args.spatial_sigma.map_or(1.0, |sigma| (sigma / smoothing.spatial_sigma).clamp(1.0, 1e3));
    smoothing.spatial_sigma = args.spatial_sigma.unwrap_or(smoothing.spatial_sigma);
    smoothing.range_sigma = args.range_sigma;
    smoothing.radius = args.radius.unwrap_or((smoothing.radius as f64 * wider).ceil() as usize);
    if let Some(weights) = args.bilateral {
        smoothing.range_weights = match weights {
            BilateralArg::Fast => RangeWeights::Fast,
            BilateralArg::Exact => RangeWeights::Exact,
        };
    }
    if let Some(climb) = args.climb {
        settings.climb = match climb {
            ClimbArg::Literal => Climb::Literal,
            ClimbArg::Release => Climb::Release,
        };
    }
    settings.noise_floor = args.noise_floor.unwrap_or(settings.noise_floor);
    Settings {
        step: args.step,
        d_max: args.dmax,
        root_finder: match args.root {
            RootArg::Bisection => RootFinder::Bisection,
            RootArg::Itp => RootFinder::Itp,
            RootArg::Cubic => RootFinder::Cubic,
        },
        operator: match args.edge {
            EdgeArg::SecondDerivative => EdgeOperator::SecondDerivative,
            EdgeArg::Plus => EdgeOperator::Plus,
        },
        keep_derivatives: args.keep.is_some(),
        skip: !args.no_skip,
        ..settings
    }
}

/// An option that would do nothing is a mistake.
fn check_filter_options(args: &PrepareArgs, smoothing: &SmoothingSettings) -> anyhow::Result<()> {
    let given = |option: &'static str, is_given: bool| is_given.then_some(option);
    let range = given("--range-sigma", args.range_sigma.is_some()).or(given("--bilateral", args.bilateral.is_some()));
    let any =
        range.or(given("--spatial-sigma", args.spatial_sigma.is_some())).or(given("--radius", args.radius.is_some()));
    match (smoothing.placement, any, range) {
        (Smoothing::None, Some(option), _) => {
            bail!("{option} does nothing without smoothing: choose one with --smooth")
        }
        (Smoothing::GaussianValue, _, Some(option)) => bail!("{option} does nothing with --smooth gaussian-value"),
        _ => Ok(()),
    }
}

fn summarise(report: &Report, args: &PrepareArgs) {
    let counts = &report.counts;
    let share = |part: u64| 100.0 * part as f64 / counts.voxels as f64;
    let [x, y, z] = report.dims;
    println!("{}: {x}x{y}x{z} voxels, {:.2} s on {} threads", report.input, report.seconds, report.threads);
    if let Some(choice) = &report.choice {
        println!("  {}, {}: {}", choice.kernel, choice.reconstruction, choice.reason);
    }
    println!(
        "  {} voxels have a boundary ({:.1} %), {} have none, {} are masked",
        counts.hits,
        share(counts.hits),
        counts.misses,
        counts.masked
    );
    println!(
        "  {} voxels traced with {} samples, {} skipped, {} with no gradient above the noise",
        counts.traced, counts.samples, counts.skipped, counts.flat
    );
    println!(
        "  {}: {} bytes, {:.2} per voxel",
        args.output.display(),
        report.file_bytes,
        report.file_bytes as f64 / counts.voxels as f64
    );
}
