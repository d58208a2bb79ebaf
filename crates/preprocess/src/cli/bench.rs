//! `voxrole bench`.

use std::fs;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, bail, ensure};
use rayon::ThreadPoolBuilder;
use voxrole_pack::atomic_file;
use voxrole_preprocess::accuracy::{Extent, Row, csv, drawings, measure, methods, suite, text_table};
use voxrole_preprocess::plot::{chart_png, chart_svg};

use super::args::{AccuracyArgs, BenchCommand};

pub fn run(command: &BenchCommand) -> anyhow::Result<()> {
    match command {
        BenchCommand::Accuracy(args) => accuracy(args),
    }
}

fn accuracy(args: &AccuracyArgs) -> anyhow::Result<()> {
    prepare_folder(&args.output)?;
    let mut pool = ThreadPoolBuilder::new();
    if let Some(threads) = args.threads {
        pool = pool.num_threads(threads.into());
    }
    let rows = pool.build().context("starting threads")?.install(|| measure_all(args))?;
    for drawing in drawings(&rows) {
        let named = || format!("drawing {}", drawing.name);
        let path = |extension: &str| args.output.join(drawing.name).with_extension(extension);
        super::write(&path("png"), &chart_png(&drawing.chart).with_context(named)?)?;
        super::write(&path("svg"), chart_svg(&drawing.chart).with_context(named)?.as_bytes())?;
    }
    Ok(())
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
        eprintln!("voxrole: {} of {}: {case}: {seconds:.1} s", index + 1, cases.len());
        super::print(&(text_table(case, &measured) + "\n"))?;
        rows.extend(measured);
        // After every case, so that an interrupted run leaves what it has measured.
        super::write(&args.output.join("accuracy.csv"), csv(&rows).as_bytes())?;
    }
    Ok(rows)
}

/// Makes the folder, and checks before any work is done that files can be written into it.
fn prepare_folder(folder: &Path) -> anyhow::Result<()> {
    let named = || folder.display().to_string();
    if folder.exists() {
        ensure!(folder.is_dir(), "{}: a file is in the way of the folder to write into", named());
    } else if let Err(error) = fs::create_dir(folder) {
        match folder.parent() {
            Some(parent) if !parent.as_os_str().is_empty() && !parent.is_dir() => {
                bail!("{}: there is no folder {} to make it in", named(), parent.display())
            }
            _ => return Err(error).with_context(|| format!("making the folder {}", named())),
        }
    }
    atomic_file::check_output(&folder.join("accuracy.csv"), &[]).with_context(named)
}
