//! Memory for trees, on huge pages where the system has them: traversal jumps about in them, and a
//! processor finds its way among few large pages faster than among many small ones.
//!
//! Unsafe code for a slice of memory that comes from the system. Invariants:
//! 1. `start` leads to `len` elements in `memory`, which stays where it is when its owner moves and is reached through
//!    this value alone.
//! 2. All of them are initialised, and their type has no destructor (`Copy`).
#![allow(unsafe_code)]

use bytemuck::Pod;
use memmap2::{MmapMut, MmapOptions};
use std::alloc::{Layout, handle_alloc_error};
use std::ops::{Deref, DerefMut};
use std::ptr::NonNull;

/// Size of a huge page.
const HUGE: usize = 2 << 20;

/// A slice that never grows.
pub(super) struct Pages<T: Copy> {
    start: NonNull<T>,
    len: usize,
    /// What owns the elements.
    _memory: Memory<T>,
}

/// Where elements lie: in pages of their own if they are many.
enum Memory<T> {
    Heap(#[expect(dead_code, reason = "owned, and reached by `start`")] Vec<T>),
    Mapped(#[expect(dead_code, reason = "owned, and reached by `start`")] MmapMut),
}

// SAFETY: it owns its elements as a `Vec` does (invariant 1).
unsafe impl<T: Copy + Send> Send for Pages<T> {}
// SAFETY: as above.
unsafe impl<T: Copy + Sync> Sync for Pages<T> {}

impl<T: Pod + Send> Pages<T> {
    /// All zero. The system clears large pieces when they are first written to, whichever thread does it.
    pub fn zeroed(len: usize) -> Self {
        const { assert!(align_of::<T>() <= HUGE) };
        let layout = Layout::array::<T>(len).expect("fits the address space");
        if layout.size() < HUGE {
            let mut elements = bytemuck::zeroed_vec(len);
            let start = NonNull::from(elements.as_mut_slice()).cast();
            return Self { start, len, _memory: Memory::Heap(elements) };
        }
        // As much more as aligning it to huge pages may leave out.
        let map = MmapOptions::new().len(layout.size() + HUGE).map_anon();
        let Ok(mut map) = map else { handle_alloc_error(layout) };
        let before = map.as_ptr().align_offset(HUGE);
        // That the advice may fail is no matter.
        #[cfg(target_os = "linux")]
        let _ = map.advise_range(memmap2::Advice::HugePage, before, layout.size());
        let start = NonNull::from(&mut map[before..]).cast();
        Self { start, len, _memory: Memory::Mapped(map) }
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
