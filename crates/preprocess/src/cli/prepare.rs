//! `voxrole prepare`.

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, anyhow};
use rayon::{ThreadPool, ThreadPoolBuilder};
use voxrole_pack::unfinished;
use voxrole_preprocess::Error;
use voxrole_preprocess::bilateral::RangeWeights;
use voxrole_preprocess::directional_derivative::EdgeOperator;
use voxrole_preprocess::io::open_volume;
use voxrole_preprocess::machine_memory::half_of_memory;
use voxrole_preprocess::prepare::prepare_file;
use voxrole_preprocess::report::Report;
use voxrole_preprocess::root_finder::RootFinder;
use voxrole_preprocess::settings::{Climb, Method, Settings, Smoothing, SmoothingSettings};
use voxrole_preprocess::usage::{UsageError, exit_code};

use super::args::{BilateralArg, ClimbArg, EdgeArg, MethodArg, PrepareArgs, RootArg, SmoothArg};
use super::batch::{self, Done, Outcome, Tally, Task};
use super::terminal::Terminal;

/// Prepares the volumes; those that fail are told of at once and in the exit code.
///
/// # Errors
/// When the command is refused, or the report cannot be written; with `--progress json` that is told as an event instead.
pub fn run(args: &PrepareArgs) -> anyhow::Result<ExitCode> {
    let terminal = Terminal::new(args.progress, args.inputs.len() > 1);
    match check_and_run(args, &terminal) {
        Err(error) if terminal.is_json() => {
            terminal.error(None, &error);
            Ok(exit_code(&error))
        }
        other => other,
    }
}

fn check_and_run(args: &PrepareArgs, terminal: &Terminal) -> anyhow::Result<ExitCode> {
    let settings = settings(args);
    settings.validate().map_err(UsageError::from)?;
    check_filter_options(args, &settings.smoothing)?;
    let tasks = batch::tasks(&args.inputs, &args.output)?;
    let into_folder = tasks.iter().any(|task| task.output != args.output);
    batch::check_outputs(&tasks, into_folder.then_some(args.output.as_path()), args.report.as_deref())?;
    let (pool, jobs) = pool(args, tasks.len())?;
    let memory = args.memory.map_or_else(half_of_memory, Ok)? / jobs as u64;
    // Says why an error speaks of less memory than was given.
    let share = if jobs > 1 { format!(" with 1/{jobs} of the memory") } else { String::new() };
    let before = args.report.as_deref().map(batch::reports_of).unwrap_or_default();
    let work = |task: &Task| {
        if args.skip_existing && task.output.exists() {
            // What cannot be opened was not finished by this program.
            let opened = super::open(&task.output).context(
                "--skip-existing finds this in place of a finished file: delete it to prepare the volume anew",
            );
            return opened.map(|_| Done::Skipped(batch::report_of(task, &before)));
        }
        pool.install(|| {
            let progress = terminal.progress(&task.input);
            let file = open_volume(&task.input, &args.raw.read_options())?;
            batch::check_files(&tasks, args.report.as_deref(), file.files())?;
            file.notes().iter().for_each(|note| terminal.note(&task.input, note));
            let report = prepare_file(file, &settings, memory, &task.output, &*progress);
            let report = report.map_err(|error| {
                let share = if matches!(error, Error::Parameter(_)) { share.as_str() } else { "" };
                anyhow::Error::from(error).context(format!("preparing {}{share}", task.input.display()))
            });
            report.map(|report| Done::prepared(report, task)).map_err(|error| with_way_on(error, &task.output))
        })
    };
    batch::begin(&tasks, args.report.as_deref(), &before);
    let outcomes = batch::run(&tasks, jobs, work, |task, outcome| {
        if let Err(error) = batch::note(task, outcome) {
            terminal.note(&task.input, &format!("{error:#}"));
        }
        match outcome {
            Ok(Done::Prepared(report)) => terminal.done(&task.input, &task.output, report),
            Ok(Done::Skipped(_)) => terminal.skipped(&task.input, &task.output),
            Err(error) => terminal.error(Some(&task.input), error),
        }
    });
    conclude(args, &tasks, &outcomes, terminal)
}

/// Says how to go on after an error that may go away, such as that of a full disk.
fn with_way_on(error: anyhow::Error, output: &Path) -> anyhow::Error {
    let unfinished = unfinished::path_of(output);
    let may_go_away =
        matches!(error.downcast_ref(), Some(Error::Io { .. } | Error::Pack(voxrole_pack::Error::Io { .. })));
    if !may_go_away || !unfinished.exists() {
        return error;
    }
    anyhow!("{error:#}; what is done is kept in {}: the same command goes on from there", unfinished.display())
}

/// The threads, and how many volumes they prepare at a time.
fn pool(args: &PrepareArgs, volumes: usize) -> anyhow::Result<(ThreadPool, usize)> {
    let jobs = usize::from(args.jobs).min(volumes);
    // A thread that waits for others may begin another volume on top of what it waits for.
    let pool = ThreadPoolBuilder::new().stack_size(jobs * STACK_BYTES);
    let pool = pool.num_threads(args.threads.map_or(0, usize::from)).build().context("starting threads")?;
    let jobs = jobs.min(pool.current_num_threads());
    Ok((pool, jobs))
}

/// Stack of a thread for each volume that may be on it.
const STACK_BYTES: usize = 2 << 20;

/// Says what came of all, and writes the report.
fn conclude(args: &PrepareArgs, tasks: &[Task], outcomes: &[Outcome], terminal: &Terminal) -> anyhow::Result<ExitCode> {
    let summary = match (tasks, outcomes) {
        ([_], [Err(_)]) => String::new(),
        ([task], [Ok(Done::Prepared(report))]) => summary(report, task),
        _ => batch::table(tasks, outcomes),
    };
    let mut entries: Vec<_> = tasks.iter().zip(outcomes).map(|(task, outcome)| batch::entry(task, outcome)).collect();
    let report = match outcomes {
        [Err(_)] => None,
        [_] => entries.pop(),
        _ => Some(entries.into()),
    };
    // First what is asked for by name: printing may fail.
    if let Some((path, report)) = args.report.as_ref().zip(report) {
        super::write_json(path, &report)?;
    }
    super::print(&summary)?;
    let tally = Tally::new(outcomes);
    if tasks.len() > 1 {
        terminal.summary(&tally);
    }
    Ok(if tally.failed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
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
        root_finder: args.root.map(|root| match root {
            RootArg::Bisection => RootFinder::Bisection,
            RootArg::Chandrupatla => RootFinder::Chandrupatla,
            RootArg::Cubic => RootFinder::Cubic,
        }),
        operator: match args.edge {
            EdgeArg::SecondDerivative => EdgeOperator::SecondDerivative,
            EdgeArg::Plus => EdgeOperator::Plus,
        },
        keep_derivatives: args.keep.is_some(),
        precision: args.precision,
        levels: args.levels,
        skip: !args.no_skip,
        ..settings
    }
}

/// An option that would do nothing is a mistake.
fn check_filter_options(args: &PrepareArgs, smoothing: &SmoothingSettings) -> Result<(), UsageError> {
    let given = |option: &'static str, is_given: bool| is_given.then_some(option);
    let range = given("--range-sigma", args.range_sigma.is_some()).or(given("--bilateral", args.bilateral.is_some()));
    let any =
        range.or(given("--spatial-sigma", args.spatial_sigma.is_some())).or(given("--radius", args.radius.is_some()));
    match (smoothing.placement, any, range) {
        (Smoothing::None, Some(option), _) => {
            Err(UsageError(format!("{option} does nothing without smoothing: choose one with --smooth")))
        }
        (Smoothing::GaussianValue, _, Some(option)) => {
            Err(UsageError(format!("{option} does nothing with --smooth gaussian-value")))
        }
        _ => Ok(()),
    }
}

fn summary(report: &Report, task: &Task) -> String {
    let counts = &report.counts;
    let share = |part: u64| 100.0 * part as f64 / counts.voxels as f64;
    let [x, y, z] = report.dims;
    let mut lines =
        vec![format!("{}: {x}x{y}x{z} voxels, {:.2} s on {} threads", report.input, report.seconds, report.threads)];
    if report.blocks > 1 {
        lines.push(format!("  {} blocks, {} of them finished by an earlier run", report.blocks, report.blocks_before));
    }
    if let Some(choice) = &report.choice {
        lines.push(format!("  {}, {}: {}", choice.kernel, choice.reconstruction, choice.reason));
    }
    lines.push(format!(
        "  {} voxels have a boundary ({:.1} %), {} have none, {} are masked",
        counts.hits,
        share(counts.hits),
        counts.misses,
        counts.masked
    ));
    lines.push(format!(
        "  {} voxels traced with {} samples, {} skipped, {} with no gradient above the noise",
        counts.traced, counts.samples, counts.skipped, counts.flat
    ));
    lines.push(format!(
        "  {}: {} bytes, {:.2} per voxel",
        task.output.display(),
        report.file_bytes,
        report.file_bytes as f64 / counts.voxels as f64
    ));
    lines.join("\n") + "\n"
}
