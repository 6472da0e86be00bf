//! Large vectors on huge pages: the operating system clears 2 MiB at a time where it would clear 4 KiB.
//!
//! Unsafe code, for advice to the system. Invariants:
//! 1. The advice changes nothing that a program can see, whatever memory it is about.
#![allow(unsafe_code, reason = "the invariant above")]

use std::collections::TryReserveError;

/// Memory of fewer bytes stays as it is: it may have no huge page within it.
const LEAST_BYTES: usize = 4 << 20;

/// An empty vector with room for so many elements.
pub fn with_capacity<T>(len: usize) -> Vec<T> {
    let mut vector = Vec::with_capacity(len);
    advise(&mut vector);
    vector
}

/// Makes room for more elements.
///
/// # Errors
/// If there is not enough memory.
pub fn grow<T>(vector: &mut Vec<T>, more: usize) -> Result<(), TryReserveError> {
    if more > vector.capacity() - vector.len() {
        vector.try_reserve(more)?;
        advise(vector);
    }
    Ok(())
}

/// Makes room for more elements, and no others, if there is enough memory.
pub fn reserve_huge<T>(vector: &mut Vec<T>, more: usize) {
    if more > vector.capacity() - vector.len() && vector.try_reserve_exact(more).is_ok() {
        advise(vector);
    }
}

/// Asks for huge pages in the memory of a large vector.
fn advise<T>(vector: &mut Vec<T>) {
    let bytes = vector.capacity() * size_of::<T>();
    ask_for_huge_pages(vector.as_mut_ptr().cast(), bytes);
}

/// Asks for huge pages in new memory, if that is large. Where the system has none, nothing changes.
#[inline]
pub fn ask_for_huge_pages(start: *mut u8, bytes: usize) {
    if bytes >= LEAST_BYTES {
        ask(start, bytes);
    }
}

fn ask(start: *mut u8, bytes: usize) {
    #[cfg(target_os = "linux")]
    {
        /// The smallest page of any system.
        const PAGE: usize = 4096;
        let skipped = start.align_offset(PAGE);
        // SAFETY: invariant 1. Where pages are larger the system refuses, which does not matter.
        unsafe { libc::madvise(start.wrapping_add(skipped).cast(), bytes - skipped, libc::MADV_HUGEPAGE) };
    }
    #[cfg(not(target_os = "linux"))]
    let _ = (start, bytes);
}
