//! `voxrole-view`: a window on packed voxel roles, or a picture of them.

use std::path::Path;
use std::process::ExitCode;

use clap::Parser;
use voxrole_preprocess::console::tell;
use voxrole_preprocess::signals;
use voxrole_preprocess::usage::exit_code;
use voxrole_viewer::args::{Cli, Command};
use voxrole_viewer::{bench, demo, headless};

fn main() -> ExitCode {
    signals::catch(|| tell("voxrole-view: interrupted; what was not finished is not written"));
    let cli = Cli::parse();
    let result = match (&cli.command, &cli.file) {
        (Some(Command::Render(arguments)), _) => headless::render(arguments),
        (Some(Command::Bench(arguments)), _) => bench::run(arguments),
        (Some(Command::Demo(arguments)), _) => demo::run(arguments),
        (None, Some(file)) => open_window(file, &cli),
        (None, None) => Ok(()),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // The alternate form is the whole chain of causes.
            tell(format!("voxrole-view: {error:#}"));
            exit_code(&error)
        }
    }
}

#[cfg(feature = "window")]
fn open_window(file: &Path, cli: &Cli) -> anyhow::Result<()> {
    voxrole_viewer::app::run(file, cli.session.as_deref(), (cli.device, cli.memory), &cli.raw.read_options())
}

#[cfg(not(feature = "window"))]
fn open_window(file: &Path, _: &Cli) -> anyhow::Result<()> {
    let file = file.display();
    anyhow::bail!(
        "{file}: this program was built without its window: build it without `--no-default-features`, or draw a picture \
         with `voxrole-view render {file} -o OUT.png`"
    )
}
