//! `voxrole`: prepares volumes, and shows what is in a packed file.

mod cli;

use std::process::ExitCode;

use clap::Parser;
use voxrole_preprocess::console::tell;
use voxrole_preprocess::signals;
use voxrole_preprocess::usage::exit_code;

fn main() -> ExitCode {
    signals::catch(cli::say_interrupted);
    match cli::run(&cli::args::Cli::parse().command) {
        Ok(code) => code,
        Err(error) => {
            // The alternate form is the whole chain of causes.
            tell(format!("voxrole: {error:#}"));
            exit_code(&error)
        }
    }
}
