//! What can go wrong with a packed file.

use std::io;

/// An error of the packed format. The file's name is added by whoever opened it.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused an operation.
    #[error("{action}")]
    Io {
        /// What was being done.
        action: String,
        /// What the operating system said.
        source: io::Error,
    },
    /// The bytes are not a packed file that this version reads, or are damaged.
    #[error("{0}")]
    Format(String),
    /// The caller asked for something that this file or this format does not have.
    #[error("{0}")]
    Parameter(String),
    /// A number in the file asks for more than [`crate::Limits`] allow.
    #[error("{what}: {found} is over the limit of {limit}; if the file is genuine, open it with wider limits")]
    LimitsExceeded {
        /// The number's meaning.
        what: &'static str,
        /// What the file says.
        found: u64,
        /// The most that is allowed.
        limit: u64,
    },
}

/// Result of this crate.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    pub(crate) fn io(action: impl Into<String>) -> impl FnOnce(io::Error) -> Self {
        let action = action.into();
        move |source| Self::Io { action, source }
    }
}

/// Reserves a vector's memory, or says that there is not enough.
///
/// # Errors
/// [`Error::Io`] with [`io::ErrorKind::OutOfMemory`] when the allocation fails.
pub fn vec_with_capacity<T>(len: usize, what: &str) -> Result<Vec<T>> {
    with_capacity(Vec::new(), len, what)
}

/// Empties a vector that was used before, and reserves more memory if it is too short.
///
/// # Errors
/// As [`vec_with_capacity`].
pub fn with_capacity<T>(mut vec: Vec<T>, len: usize, what: &str) -> Result<Vec<T>> {
    if vec.capacity() < len {
        // Its numbers need not be moved.
        vec = Vec::new();
    }
    vec.clear();
    vec.try_reserve_exact(len).map_err(|_| Error::Io {
        action: format!("allocating {len} values of {} bytes for {what}", size_of::<T>()),
        source: io::ErrorKind::OutOfMemory.into(),
    })?;
    Ok(vec)
}
