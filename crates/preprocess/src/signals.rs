//! What signals do to a program.

#[cfg(unix)]
use std::sync::Arc;

use voxrole_pack::atomic_file;

use crate::atomic_folder;

/// Has an interrupt remove what is unfinished, say so by `say`, and end the program with the exit code 130, which shells give
/// for one; and a limit of file sizes be an error of whoever writes.
pub fn catch(say: impl Fn() + Send + 'static) {
    // Without a handler temporary files and folders would merely stay.
    let _ = ctrlc::set_handler(move || {
        atomic_file::remove_unfinished();
        atomic_folder::remove_unfinished();
        say();
        std::process::exit(130);
    });
    #[cfg(unix)]
    // Told by a signal, which would end the program, writers would not come to say what is kept. It cannot fail: a signal that can
    // be caught is caught.
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::default());
}
