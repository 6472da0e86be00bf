//! The command line of raystream.
//!
//! This file alone changes the process's environment and its allocator. Invariants:
//! 1. `main` changes the environment before any thread is made, so no thread reads the environment meanwhile.
//! 2. `main` sets up the C library's allocator before any thread is made.
//! 3. [`EndingAllocator`] hands every call to the system's allocator as it is, under the contract that its own caller
//!    keeps, and returns what that returns.
#![allow(unsafe_code, reason = "the invariants above")]

use raystream::memory::huge_vectors::ask_for_huge_pages;
use std::alloc::{GlobalAlloc, Layout, System};
use std::io::Write;

fn main() -> std::process::ExitCode {
    // Mesa's device-selection layer asks for a display server to order the GPUs by, and complains on stderr
    // where there is none. raystream orders adapters itself.
    if std::env::var_os("NODEVICE_SELECT").is_none() {
        // SAFETY: invariant 1.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
    set_mapping_threshold();
    raystream_cli::run()
}

/// The size from which an allocation is mapped by itself, and goes back to the system when it is freed. glibc raises
/// its own threshold to 32 MiB while it runs; the films of a service's jobs then lie in its heaps, between smaller
/// allocations, are set to zero in full, and the process grows (`docs/lab/scheduling.md`).
#[cfg(all(target_os = "linux", target_env = "gnu"))]
fn set_mapping_threshold() {
    const BYTES: libc::c_int = 1 << 20;
    // SAFETY: invariant 2.
    let is_set = unsafe { libc::mallopt(libc::M_MMAP_THRESHOLD, BYTES) };
    debug_assert_eq!(is_set, 1, "glibc takes any threshold below 32 MiB");
}

/// Other allocators have no such threshold.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
fn set_mapping_threshold() {}

/// The system's allocator, with huge pages for what is large: a large scene takes 4 to 8 % longer until its first ray
/// without. Ends the process with one line where there is no memory; Rust would abort it.
struct EndingAllocator;

#[global_allocator]
static ALLOCATOR: EndingAllocator = EndingAllocator;

// SAFETY: invariant 3.
unsafe impl GlobalAlloc for EndingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: invariant 3.
        given(unsafe { System.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: invariant 3.
        given(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: invariant 3.
        given(unsafe { System.realloc(pointer, layout, size) }, size)
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: invariant 3.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// Memory that the system has given. Ends the process if it has not.
#[inline]
fn given(pointer: *mut u8, bytes: usize) -> *mut u8 {
    if pointer.is_null() {
        end(bytes);
    }
    ask_for_huge_pages(pointer, bytes);
    pointer
}

#[cold]
fn end(bytes: usize) -> ! {
    // Standard error has no buffer, so this takes no memory.
    let told = writeln!(
        std::io::stderr(),
        "error: out of memory: the system does not give {bytes} bytes; set a limit below what there is (--memory)"
    );
    drop(told);
    std::process::exit(2)
}
