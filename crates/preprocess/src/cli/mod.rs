//! The `voxrole` program: what was typed, checked, and run.

pub mod args;
mod bench;
mod export;
mod histogram;
mod info;
mod phantom;
mod prepare;
mod slice;
mod terminal;

use std::io::Write;
use std::path::Path;

use anyhow::Context;
use args::Command;
use voxrole_pack::{Reader, atomic_file};

/// Runs a command.
///
/// # Errors
/// Whatever stopped it; messages name the file.
pub fn run(command: &Command) -> anyhow::Result<()> {
    match command {
        Command::Prepare(args) => prepare::run(args),
        Command::Info(args) => info::run(args),
        Command::Verify(args) => info::verify(args),
        Command::Export(args) => export::run(args),
        Command::Histogram(args) => histogram::run(args),
        Command::Slice(args) => slice::run(args),
        Command::Phantom(args) => phantom::run(args),
        Command::Bench(args) => bench::run(&args.command),
    }
}

fn open(path: &Path) -> anyhow::Result<Reader> {
    Reader::open(path).with_context(|| path.display().to_string())
}

/// Checks before any work is done that an output can be written, is not the input, and is named as what it will be.
fn check_output(output: &Path, input: &Path, extension: Option<&str>) -> anyhow::Result<()> {
    let named = || output.display().to_string();
    if let Some(extension) = extension
        && !output.extension().is_some_and(|found| found.eq_ignore_ascii_case(extension))
    {
        anyhow::bail!("{}: what is written is {extension}; name it so", named());
    }
    atomic_file::check_output(output, &[input]).with_context(named)
}

/// Prints, and takes it quietly when nobody reads on.
fn print(text: &str) -> anyhow::Result<()> {
    match std::io::stdout().write_all(text.as_bytes()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(()),
    }
}

fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    atomic_file::write(path, bytes).with_context(|| format!("writing {}", path.display()))
}
