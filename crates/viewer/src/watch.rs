//! A picture that is being drawn, seen from outside.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

/// How much of a picture is there, and whether it is still wanted.
#[derive(Debug, Default)]
pub struct Watch {
    is_given_up: AtomicBool,
    rows: AtomicU32,
}

impl Watch {
    /// The picture is no longer wanted.
    pub fn give_up(&self) {
        self.is_given_up.store(true, Ordering::Relaxed);
    }

    /// Whether the picture is no longer wanted.
    #[must_use]
    pub fn is_given_up(&self) -> bool {
        self.is_given_up.load(Ordering::Relaxed)
    }

    /// How many rows of it are there.
    #[must_use]
    pub fn rows(&self) -> u32 {
        self.rows.load(Ordering::Relaxed)
    }

    pub(crate) fn add_rows(&self, rows: u32) {
        self.rows.fetch_add(rows, Ordering::Relaxed);
    }
}
