//! `voxrole bench`.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context;
use clap::{Args, Subcommand};
use rayon::{ThreadPool, ThreadPoolBuilder};
use voxrole_pack::atomic_file;
use voxrole_preprocess::accuracy::{Drawing, Extent, Row, csv, drawings, measure, methods, suite, text_table};
use voxrole_preprocess::console::tell;
use voxrole_preprocess::plot::{chart_png, chart_svg};
use voxrole_preprocess::smoothing_study::{
    Study, StudyRow, parse_canny, placements, scenes, study_csv, study_drawings, study_table,
};

use super::bench_pack::PackArgs;

/// `bench`.
#[derive(Debug, Args)]
pub struct BenchArgs {
    /// What to measure.
    #[command(subcommand)]
    pub command: BenchCommand,
}

/// What `bench` measures.
#[derive(Debug, Subcommand)]
pub enum BenchCommand {
    /// Distance, gradient and time of every method on phantoms with exact truth: a table (CSV) and plots (PNG and SVG).
    Accuracy(AccuracyArgs),
    /// What smoothing does to the boundaries found under noise, thin layers included: a table (CSV) and plots (PNG and
    /// SVG).
    Smoothing(SmoothingArgs),
    /// How small a packed file is, and how fast it opens and unpacks beside a copy of its bytes.
    Pack(PackArgs),
}

/// `bench accuracy`.
#[derive(Debug, Args)]
pub struct AccuracyArgs {
    /// Folder to write into; made if there is none. Files of former runs are replaced.
    #[arg(short, long, value_name = "FOLDER")]
    pub output: PathBuf,
    /// Measure a few small volumes only: seconds.
    #[arg(long, conflicts_with = "full")]
    pub quick: bool,
    /// Measure every phantom with every blur, noise and type of number: hours.
    #[arg(long)]
    pub full: bool,
    /// How often each method runs; the fastest run counts.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub repeats: u16,
    /// Threads to use [default: all].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub threads: Option<u16>,
}

/// `bench smoothing`.
#[derive(Debug, Args)]
pub struct SmoothingArgs {
    /// Folder to write into; made if there is none. Files of former runs are replaced.
    #[arg(short, long, value_name = "FOLDER")]
    pub output: PathBuf,
    /// Measure a few small volumes only: seconds.
    #[arg(long)]
    pub quick: bool,
    /// How often each method runs; the fastest run counts.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub repeats: u16,
    /// Table of tests/peers/canny.py, whose figures are drawn beside the others.
    #[arg(long, value_name = "FILE.csv")]
    pub canny: Option<PathBuf>,
    /// Threads to use [default: all].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub threads: Option<u16>,
}

pub fn run(command: &BenchCommand) -> anyhow::Result<()> {
    match command {
        BenchCommand::Accuracy(args) => accuracy(args),
        BenchCommand::Smoothing(args) => smoothing(args),
        BenchCommand::Pack(args) => super::bench_pack::run(args),
    }
}

fn accuracy(args: &AccuracyArgs) -> anyhow::Result<()> {
    prepare_folder(&args.output, "accuracy.csv")?;
    let rows = pool(args.threads)?.install(|| measure_all(args))?;
    draw(&args.output, drawings(&rows))
}

fn smoothing(args: &SmoothingArgs) -> anyhow::Result<()> {
    let canny = match &args.canny {
        None => Vec::new(),
        Some(path) => {
            let named = || path.display().to_string();
            let text = fs::read_to_string(path).with_context(|| format!("reading {}", named()))?;
            parse_canny(&text).with_context(named)?
        }
    };
    prepare_folder(&args.output, "smoothing.csv")?;
    let rows = pool(args.threads)?.install(|| measure_smoothing(args))?;
    super::write(&args.output.join("smoothing.csv"), study_csv(&rows).as_bytes())?;
    draw(&args.output, study_drawings(&rows, &canny))
}

fn pool(threads: Option<u16>) -> anyhow::Result<ThreadPool> {
    let pool = ThreadPoolBuilder::new().num_threads(threads.map_or(0, usize::from));
    pool.build().context("starting threads")
}

fn draw(folder: &Path, drawings: Vec<Drawing>) -> anyhow::Result<()> {
    for Drawing { name, chart } in drawings {
        let named = || format!("drawing {name}");
        let path = |extension: &str| folder.join(&name).with_extension(extension);
        super::write(&path("png"), &chart_png(&chart).with_context(named)?)?;
        super::write(&path("svg"), chart_svg(&chart).with_context(named)?.as_bytes())?;
    }
    Ok(())
}

fn measure_smoothing(args: &SmoothingArgs) -> anyhow::Result<Vec<StudyRow>> {
    let (scenes, placements) = (scenes(args.quick), placements());
    let mut rows = Vec::new();
    for (index, scene) in scenes.iter().enumerate() {
        let start = Instant::now();
        let named = || format!("measuring {}", scene.case);
        let mut study = Study::new(&scene.case).with_context(named)?;
        for &noise in &scene.noises {
            let measured = study.measure(noise, &placements, args.repeats.into()).with_context(named)?;
            super::print(&(study_table(&measured) + "\n"))?;
            rows.extend(measured);
        }
        let seconds = start.elapsed().as_secs_f64();
        tell(format!("voxrole: {} of {}: {}: {seconds:.1} s", index + 1, scenes.len(), scene.case));
    }
    Ok(rows)
}

fn measure_all(args: &AccuracyArgs) -> anyhow::Result<Vec<Row>> {
    let extent = match (args.quick, args.full) {
        (true, _) => Extent::Quick,
        (_, true) => Extent::Full,
        _ => Extent::Standard,
    };
    let (cases, methods) = (suite(extent), methods());
    let mut rows = Vec::new();
    for (index, case) in cases.iter().enumerate() {
        let start = Instant::now();
        let measured = measure(case, &methods, args.repeats.into()).with_context(|| format!("measuring {case}"))?;
        let seconds = start.elapsed().as_secs_f64();
        tell(format!("voxrole: {} of {}: {case}: {seconds:.1} s", index + 1, cases.len()));
        super::print(&(text_table(case, &measured) + "\n"))?;
        rows.extend(measured);
        // After every case, so that an interrupted run leaves what it has measured.
        super::write(&args.output.join("accuracy.csv"), csv(&rows).as_bytes())?;
    }
    Ok(rows)
}

/// Makes the folder, and checks before any work is done that files can be written into it.
fn prepare_folder(folder: &Path, table: &str) -> anyhow::Result<()> {
    super::make_folder(folder)?;
    atomic_file::check_output(&folder.join(table), &[]).with_context(|| folder.display().to_string())
}
