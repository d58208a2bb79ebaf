//! Command lines that ask for what cannot be: programs end with exit code 2, as for one that is not understood.

use std::path::Path;
use std::process::ExitCode;

use crate::Error;

/// The command line asks for what cannot be, whatever the files hold.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct UsageError(pub String);

impl From<Error> for UsageError {
    fn from(error: Error) -> Self {
        Self(error.to_string())
    }
}

/// The exit code of a program that an error ends: 2, which clap gives too, where it comes of the command line alone, else 1.
#[must_use]
pub fn exit_code(error: &anyhow::Error) -> ExitCode {
    if error.chain().any(|cause| cause.is::<UsageError>()) { ExitCode::from(2) } else { ExitCode::FAILURE }
}

/// Refuses with a message, where it is so.
///
/// # Errors
/// [`UsageError`] with that message.
pub fn refuse_if(is_so: bool, message: impl Into<String>) -> Result<(), UsageError> {
    if is_so { Err(UsageError(message.into())) } else { Ok(()) }
}

/// Refuses the name of an output that does not end as what is written.
///
/// # Errors
/// [`UsageError`] where its extension is another one.
pub fn check_extension(output: &Path, extension: &str) -> Result<(), UsageError> {
    let is_named = output.extension().is_some_and(|found| found.eq_ignore_ascii_case(extension));
    refuse_if(!is_named, format!("{}: what is written is {extension}; name it so", output.display()))
}

#[cfg(test)]
mod tests {
    use anyhow::Context;

    use super::*;

    #[test]
    fn causes_are_found_under_any_context() {
        let error = refuse_if(true, "no").context("a.vxr").context("drawing").expect_err("is refused");
        assert_eq!(exit_code(&error), ExitCode::from(2));
        assert_eq!(exit_code(&anyhow::anyhow!("no")), ExitCode::FAILURE);
    }
}
