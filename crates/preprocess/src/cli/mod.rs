//! The `voxrole` program: what was typed, checked, and run.

pub mod args;
mod export;
mod histogram;
mod info;
mod phantom;
mod prepare;
mod slice;
mod terminal;

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
    }
}

fn open(path: &Path) -> anyhow::Result<Reader> {
    Reader::open(path).with_context(|| path.display().to_string())
}

fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    atomic_file::write(path, bytes).with_context(|| format!("writing {}", path.display()))
}
