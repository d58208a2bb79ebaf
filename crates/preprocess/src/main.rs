//! `voxrole`: prepares volumes, and shows what is in a packed file.

mod cli;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    match cli::run(&cli::args::Cli::parse().command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // The alternate form is the whole chain of causes.
            eprintln!("voxrole: {error:#}");
            ExitCode::FAILURE
        }
    }
}
