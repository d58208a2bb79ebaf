//! `voxrole`: prepares volumes, and shows what is in a packed file.

mod cli;

use std::process::ExitCode;
#[cfg(unix)]
use std::sync::Arc;

use clap::Parser;
use voxrole_preprocess::console::tell;
use voxrole_preprocess::usage::exit_code;

fn main() -> ExitCode {
    // 130 is what shells give for an interrupt. Without a handler temporary files and folders would merely stay.
    let _ = ctrlc::set_handler(|| {
        voxrole_pack::atomic_file::remove_unfinished();
        voxrole_preprocess::atomic_folder::remove_unfinished();
        cli::say_interrupted();
        std::process::exit(130);
    });
    #[cfg(unix)]
    // Told by a signal, which would end the program, writers would not come to say what is kept. It cannot fail: a signal that can
    // be caught is caught.
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::default());
    match cli::run(&cli::args::Cli::parse().command) {
        Ok(code) => code,
        Err(error) => {
            // The alternate form is the whole chain of causes.
            tell(format!("voxrole: {error:#}"));
            exit_code(&error)
        }
    }
}
