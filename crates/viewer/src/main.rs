//! `voxrole-view`: a window on packed voxel roles, or a picture of them.

use std::process::ExitCode;

use clap::Parser;
use voxrole_viewer::args::{Cli, Command};
use voxrole_viewer::{app, demo, headless};

fn main() -> ExitCode {
    let cli = Cli::parse();
    let result = match (&cli.command, &cli.file) {
        (Some(Command::Render(arguments)), _) => headless::render(arguments),
        (Some(Command::Demo(arguments)), _) => demo::run(arguments),
        (None, Some(file)) => app::run(file, cli.raw.layout().as_ref()),
        (None, None) => Ok(()),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // The alternate form is the whole chain of causes.
            eprintln!("voxrole-view: {error:#}");
            ExitCode::FAILURE
        }
    }
}
