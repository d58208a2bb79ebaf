//! Which vector instructions the processor has.
//!
//! Kernels are compiled for each level and give the same bits on all of them: nothing is fused or reordered by level.

use std::sync::OnceLock;

use fearless_simd::Level;

/// The best level of this processor.
#[must_use]
pub fn level() -> Level {
    static LEVEL: OnceLock<Level> = OnceLock::new();
    *LEVEL.get_or_init(Level::new)
}
