//! What programs say to whoever started them.

use std::fmt::Display;
use std::io::{self, ErrorKind, Write};

/// Writes a line to standard error. That nobody can read it any more, or a disk is full, ends no work.
pub fn tell(line: impl Display) {
    let _ = writeln!(io::stderr(), "{line}");
}

/// Writes to standard output, and takes it quietly when nobody reads on.
///
/// # Errors
/// Whatever else the operating system says, such as that a disk is full.
pub fn print(text: &str) -> io::Result<()> {
    match io::stdout().write_all(text.as_bytes()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        other => other,
    }
}
