//! Compiles work for fused multiply-add, the operation of the canonical test. Without the instruction each fused
//! multiply-add is a call into the C library, which gives the same bits in three times the time: 160 against 48 ns for
//! a ray and its triangle. What `work` calls must be inlined into it.
//!
//! Unsafe code. Invariant:
//! 1. A function that enables instructions is called only where the processor has them.
#![allow(unsafe_code, reason = "the invariant above")]

/// Runs `work` with fused multiply-add instructions, if the processor has them.
pub(super) fn with_fma<T>(work: impl FnOnce() -> T) -> T {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("fma") && is_x86_feature_detected!("avx2") {
        // SAFETY: invariant 1.
        return unsafe { compiled_with_fma(work) };
    }
    work()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "fma,avx2")]
fn compiled_with_fma<T>(work: impl FnOnce() -> T) -> T {
    work()
}
