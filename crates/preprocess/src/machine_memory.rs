//! How much memory there is.

use sysinfo::System;

use crate::{Error, Result};

/// Half of the memory that this machine, or the container that this runs in, has, in bytes.
///
/// # Errors
/// [`Error::Parameter`] where the operating system does not say.
pub fn half_of_memory() -> Result<u64> {
    let mut system = System::new()
        .map_err(|error| Error::Parameter(format!("finding out how much memory there is; give --memory: {error}")))?;
    system.refresh_memory();
    let limit = system.cgroup_limits().map_or(u64::MAX, |limits| limits.total_memory);
    Ok(system.total_memory().min(limit) / 2)
}
