//! Memory for trees, on huge pages where the system has them: traversal jumps about in them, and a
//! processor finds its way among few large pages faster than among many small ones.
//!
//! Unsafe code, because memory is allocated by hand. Invariants:
//! 1. `start` is an allocation of `layout(len)` that this value alone owns; for a length of 0 it dangles.
//! 2. All `len` elements are initialised, and their type has no destructor (`Copy`).
#![allow(unsafe_code)]

use bytemuck::Pod;
use rayon::prelude::*;
use std::alloc::{Layout, alloc, dealloc, handle_alloc_error};
use std::mem::MaybeUninit;
use std::ops::{Deref, DerefMut};
use std::ptr::NonNull;

/// Size of a huge page.
const HUGE: usize = 2 << 20;

/// A slice that never grows.
pub(super) struct Pages<T: Copy> {
    start: NonNull<T>,
    len: usize,
}

// SAFETY: it owns its elements as a `Vec` does (invariant 1).
unsafe impl<T: Copy + Send> Send for Pages<T> {}
// SAFETY: as above.
unsafe impl<T: Copy + Sync> Sync for Pages<T> {}

/// What to allocate for `len` elements.
fn layout<T>(len: usize) -> Layout {
    let layout = Layout::array::<T>(len).expect("fits the address space");
    let align = if layout.size() >= HUGE { HUGE } else { layout.align() };
    layout.align_to(align).expect("a power of two").pad_to_align()
}

/// Bytes that one thread clears at a time.
const CLEAR: usize = 4 << 20;

impl<T: Pod + Send> Pages<T> {
    /// All zero; cleared on all threads, for the system hands out pages as they are first written to.
    pub fn zeroed(len: usize) -> Self {
        let layout = layout::<T>(len);
        if layout.size() == 0 {
            return Self { start: NonNull::dangling(), len };
        }
        // SAFETY: the size is not 0.
        let memory = unsafe { alloc(layout) };
        let Some(start) = NonNull::new(memory.cast::<T>()) else { handle_alloc_error(layout) };
        #[cfg(target_os = "linux")]
        if layout.size() >= HUGE {
            // SAFETY: the memory is ours and aligned to pages; that the advice may fail is no matter.
            unsafe { libc::madvise(memory.cast(), layout.size(), libc::MADV_HUGEPAGE) };
        }
        let clear = |piece: &mut [MaybeUninit<u8>]| piece.fill(MaybeUninit::new(0));
        // SAFETY: the memory is ours, and may be uninitialised in a slice of this type.
        let bytes = unsafe { std::slice::from_raw_parts_mut(memory.cast(), layout.size()) };
        if bytes.len() > CLEAR {
            bytes.par_chunks_mut(CLEAR).for_each(clear);
        } else {
            clear(bytes);
        }
        Self { start, len }
    }
}

impl<T: Copy> Drop for Pages<T> {
    fn drop(&mut self) {
        let layout = layout::<T>(self.len);
        if layout.size() > 0 {
            // SAFETY: invariant 1.
            unsafe { dealloc(self.start.as_ptr().cast(), layout) };
        }
    }
}

impl<T: Copy> Deref for Pages<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        // SAFETY: invariants 1 and 2.
        unsafe { std::slice::from_raw_parts(self.start.as_ptr(), self.len) }
    }
}

impl<T: Copy> DerefMut for Pages<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        // SAFETY: invariants 1 and 2.
        unsafe { std::slice::from_raw_parts_mut(self.start.as_ptr(), self.len) }
    }
}

impl<T: Pod + Send> Pages<T> {
    /// A copy of a slice.
    pub fn of(slice: &[T]) -> Self {
        let mut copy = Self::zeroed(slice.len());
        copy.copy_from_slice(slice);
        copy
    }
}

impl<T: Pod + Send> Clone for Pages<T> {
    fn clone(&self) -> Self {
        Self::of(self)
    }
}

impl<T: Copy + std::fmt::Debug> std::fmt::Debug for Pages<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_of_all_sizes_come_back_whole_and_aligned() {
        for len in [0, 1, 1000, 300_000, 600_000] {
            let numbers: Vec<u64> = (0..len).map(|i| i * i).collect();
            let mut pages = Pages::zeroed(len as usize);
            assert!(pages.iter().all(|&number| number == 0));
            pages.copy_from_slice(&numbers);
            let copy = pages.clone();
            drop(pages);
            assert_eq!(*copy, *numbers);
            assert!(len * 8 < HUGE as u64 || (copy.as_ptr() as usize).is_multiple_of(HUGE));
        }
    }
}
