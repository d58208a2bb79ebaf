//! Hints for the processor's caches.
//!
//! The one module of this crate with `unsafe` code: without these hints central differences take 1.24 times as long
//! (docs/benchmarks.md, “Speed”), because reading, computing and writing wait for each other.

/// Asks for the cache line of `samples[index]`, which may lie beyond the end; changes no result.
///
/// Does nothing on processors other than x86-64.
#[inline(always)]
#[cfg_attr(not(target_arch = "x86_64"), expect(unused_variables, reason = "no stable intrinsic"))]
pub(crate) fn prefetch(samples: &[f32], index: usize) {
    #[cfg(target_arch = "x86_64")]
    #[expect(unsafe_code, reason = "the intrinsic takes a pointer")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let line = samples.as_ptr().wrapping_add(index);
        // SAFETY: every x86-64 processor has the instruction, and it neither reads, writes nor faults, whatever the address.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(line.cast()) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs under Miri too: `cargo +nightly miri test -p voxrole-preprocess --lib prefetch`.
    #[test]
    fn any_index_will_do() {
        let samples = [1.0, 2.0];
        for index in [0, 1, 2, 1 << 20, usize::MAX] {
            prefetch(&samples, index);
            prefetch(&[], index);
        }
        assert_eq!(samples, [1.0, 2.0]);
    }
}
