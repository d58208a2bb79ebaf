//! The `voxrole` program: what was typed, checked, and run.

pub mod args;
mod batch;
mod bench;
mod bench_pack;
mod export;
mod histogram;
mod info;
mod phantom;
mod prepare;
mod progress_lines;
mod slice;
mod terminal;

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, bail, ensure};
use args::Command;
use serde::Serialize;
use voxrole_pack::{Reader, atomic_file};
use voxrole_preprocess::console;
use voxrole_preprocess::usage::{check_extension, refuse_if};

/// Runs a command; a failure that was already told is in the exit code only.
///
/// # Errors
/// Whatever stopped it; messages name the file.
pub fn run(command: &Command) -> anyhow::Result<ExitCode> {
    match command {
        Command::Prepare(args) => return prepare::run(args),
        Command::Info(args) => info::run(args),
        Command::Verify(args) => info::verify(args),
        Command::Export(args) => export::run(args),
        Command::Histogram(args) => histogram::run(args),
        Command::Slice(args) => slice::run(args),
        Command::Phantom(args) => phantom::run(args),
        Command::Bench(args) => bench::run(&args.command),
    }
    .map(|()| ExitCode::SUCCESS)
}

/// Says what an interrupt left, and of several volumes which are done.
pub fn say_interrupted() {
    let table = batch::table_so_far();
    let kept = voxrole_pack::unfinished::kept();
    terminal::say_last(if !kept.is_empty() {
        "interrupted"
    } else if batch::is_preparing() && table.is_none() {
        "interrupted; nothing is kept: a run goes on where it goes block by block, as it does with less --memory, and has \
         finished some"
    } else {
        "interrupted; nothing is kept of what was being done"
    });
    for path in kept {
        let path = path.display();
        terminal::say_last(&format!("what is done is kept in {path}: the same command goes on from there"));
    }
    if let Some(table) = table {
        // Whatever standard output is, the program ends.
        let _ = print(&table);
        if let Err(error) = batch::write_report() {
            terminal::say_last(&format!("{error:#}"));
        }
        terminal::say_last("the same command with --skip-existing leaves out the volumes that are done");
    }
}

fn open(path: &Path) -> anyhow::Result<Reader> {
    let is_unfinished = path.extension().is_some_and(|extension| extension == "unfinished");
    Reader::open(path).with_context(|| {
        let what = if is_unfinished {
            ": what a run keeps that is not complete; the same command goes on from there"
        } else {
            ""
        };
        format!("{}{what}", path.display())
    })
}

/// Checks before any work is done that an output can be written, is none of the inputs, and is named as what it will be.
fn check_output(output: &Path, inputs: &[&Path], extension: Option<&str>) -> anyhow::Result<()> {
    let named = || output.display().to_string();
    let is_standard = output.as_os_str() == "-";
    refuse_if(is_standard, "-: what is written is a file, not standard output; name it")?;
    extension.map_or(Ok(()), |extension| check_extension(output, extension))?;
    if let Some(input) = inputs.iter().find(|input| is_inside(output, input)) {
        bail!("{}: lies in the folder {}, which is an input; write it elsewhere", named(), input.display());
    }
    atomic_file::check_output(output, inputs).with_context(named)
}

/// Whether two outputs, which need not exist, would be one file.
fn is_same_file(a: &Path, b: &Path) -> bool {
    // There, file systems do not tell capital letters from small ones.
    let ignores_case = cfg!(any(windows, target_os = "macos"));
    let place = |path: &Path| {
        let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let folder = parent.canonicalize().unwrap_or_else(|_| parent.to_owned());
        let place = folder.join(path.file_name().unwrap_or_default());
        if ignores_case { place.to_string_lossy().to_lowercase().into() } else { place }
    };
    place(a) == place(b)
}

/// Whether `output`, which need not exist, lies in `folder`.
fn is_inside(output: &Path, folder: &Path) -> bool {
    let parent = output.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let (Ok(parent), Ok(folder)) = (parent.canonicalize(), folder.canonicalize()) else { return false };
    folder.is_dir() && parent.starts_with(folder)
}

/// Makes a folder to write into, unless there is one; returns whether it was made.
fn make_folder(folder: &Path) -> anyhow::Result<bool> {
    let named = || folder.display().to_string();
    if folder.exists() {
        ensure!(folder.is_dir(), "{}: a file is in the way of the folder to write into", named());
        return Ok(false);
    }
    match (std::fs::create_dir(folder), folder.parent()) {
        (Ok(()), _) => Ok(true),
        (Err(_), Some(parent)) if !parent.as_os_str().is_empty() && !parent.is_dir() => {
            bail!("{}: there is no folder {} to make it in", named(), parent.display())
        }
        (Err(error), _) => Err(error).with_context(|| format!("making the folder {}", named())),
    }
}

fn print(text: &str) -> anyhow::Result<()> {
    console::print(text).context("writing to standard output")
}

fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    atomic_file::write(path, bytes).with_context(|| format!("writing {}", path.display()))
}

fn write_json(path: &Path, value: &impl Serialize) -> anyhow::Result<()> {
    let mut json = serde_json::to_vec_pretty(value)?;
    json.push(b'\n');
    write(path, &json)
}
