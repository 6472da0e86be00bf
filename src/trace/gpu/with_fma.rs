//! Work compiled for fused multiply-add, which the canonical test is made of. Without the
//! instruction each one is a call into the C library, which gives the same bits three times slower
//! (160 against 48 ns for a ray and its triangle). What `work` calls has to be inlined into it.
//!
//! Invariant 1: a function that enables instructions is called only where the processor has them.
#![allow(unsafe_code, reason = "the invariants above")]

/// Runs `work` with fused multiply-add instructions, if the processor has them.
pub(super) fn fused<T>(work: impl FnOnce() -> T) -> T {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("fma") && is_x86_feature_detected!("avx2") {
        // SAFETY: invariant 1.
        return unsafe { with_fma(work) };
    }
    work()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "fma,avx2")]
fn with_fma<T>(work: impl FnOnce() -> T) -> T {
    work()
}
