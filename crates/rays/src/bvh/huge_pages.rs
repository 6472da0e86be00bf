//! Memory for trees, on huge pages where the system has them. Traversal visits nodes in a scattered order,
//! and a processor translates addresses in few large pages faster than in many small ones.
//!
//! Contains unsafe code, for a slice of memory that comes from the system. Invariants:
//! 1. `start` points to `len` elements inside `memory`. Their address does not change when the owner moves,
//!    and they are reached through this value only. The address is a multiple of 64.
//! 2. All elements are initialised, and their type has no destructor (`Copy`) and accepts any bits (`Pod`).
#![allow(unsafe_code, reason = "the invariants above")]

use bytemuck::{Pod, Zeroable};
use memmap2::{MmapMut, MmapOptions};
use std::alloc::{Layout, handle_alloc_error};
use std::ops::{Deref, DerefMut};
use std::ptr::NonNull;

/// Size of a huge page in bytes.
const HUGE: usize = 2 << 20;

/// A boxed slice, aligned to 64 bytes or, from 2 MiB on, to huge pages.
pub(super) struct HugePages<T: Copy> {
    start: NonNull<T>,
    len: usize,
    /// Owns the elements.
    memory: Memory,
}

/// Memory of the elements: from [`HUGE`] bytes on, in an anonymous mapping.
enum Memory {
    Heap(#[expect(dead_code, reason = "owns the elements, which are reached through `start`")] Vec<Line>),
    Mapped(MmapMut),
}

/// A cache line, the unit of heap allocations.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
struct Line([u8; 64]);

// SAFETY: it owns its elements as a `Vec` does (invariant 1).
unsafe impl<T: Copy + Send> Send for HugePages<T> {}
// SAFETY: invariant 1.
unsafe impl<T: Copy + Sync> Sync for HugePages<T> {}

impl<T: Pod + Send> HugePages<T> {
    /// `len` zeroed elements. The system clears the pages of a mapping when they are first written, on the
    /// thread that writes.
    pub fn zeroed(len: usize) -> Self {
        const { assert!(align_of::<T>() <= align_of::<Line>()) };
        let layout = Layout::array::<T>(len).expect("fits the address space");
        if layout.size() < HUGE {
            let mut lines: Vec<Line> = bytemuck::zeroed_vec(layout.size().div_ceil(size_of::<Line>()));
            let start = NonNull::from(lines.as_mut_slice()).cast();
            return Self { start, len, memory: Memory::Heap(lines) };
        }
        // Aligning the start to a huge page may skip up to `HUGE` bytes.
        let map = MmapOptions::new().len(layout.size() + HUGE).map_anon();
        let Ok(mut map) = map else { handle_alloc_error(layout) };
        let before = map.as_ptr().align_offset(HUGE);
        // The advice is optional: without it the pages are small.
        #[cfg(target_os = "linux")]
        let _ = map.advise_range(memmap2::Advice::HugePage, before, layout.size());
        let start = NonNull::from(&mut map[before..]).cast();
        Self { start, len, memory: Memory::Mapped(map) }
    }

    /// Reinterprets the memory as elements of another type, as many as fit.
    pub fn cast<U: Pod>(self) -> HugePages<U> {
        const { assert!(align_of::<U>() <= align_of::<Line>()) };
        let len = self.len * size_of::<T>() / size_of::<U>();
        HugePages { start: self.start.cast(), len, memory: self.memory }
    }

    /// Keeps the first `len` elements and returns the memory of the others to the system.
    ///
    /// # Panics
    /// If there are fewer.
    pub fn truncated(mut self, len: usize) -> Self {
        assert!(len <= self.len);
        let Memory::Mapped(map) = &mut self.memory else { return Self::from_slice(&self[..len]) };
        #[cfg(target_os = "linux")]
        {
            let start = self.start.as_ptr().addr() - map.as_ptr().addr();
            let from = start + (len * size_of::<T>()).next_multiple_of(HUGE);
            let until = start + self.len * size_of::<T>();
            if from < until {
                // SAFETY: the elements after the first `len` can no longer be reached (invariant 1).
                let advice = unsafe {
                    map.unchecked_advise_range(memmap2::UncheckedAdvice::DontNeed, from, until - from)
                };
                // The advice is optional: without it the memory stays resident.
                drop(advice);
            }
        }
        #[cfg(not(target_os = "linux"))]
        let _ = map;
        self.len = len;
        self
    }
}

impl<T: Copy> Deref for HugePages<T> {
    type Target = [T];

    #[inline]
    fn deref(&self) -> &[T] {
        // SAFETY: invariants 1 and 2.
        unsafe { std::slice::from_raw_parts(self.start.as_ptr(), self.len) }
    }
}

impl<T: Copy> DerefMut for HugePages<T> {
    #[inline]
    fn deref_mut(&mut self) -> &mut [T] {
        // SAFETY: invariants 1 and 2.
        unsafe { std::slice::from_raw_parts_mut(self.start.as_ptr(), self.len) }
    }
}

impl<T: Pod + Send> HugePages<T> {
    /// Copies a slice.
    pub fn from_slice(slice: &[T]) -> Self {
        let mut copy = Self::zeroed(slice.len());
        copy.copy_from_slice(slice);
        copy
    }
}

impl<T: Pod + Send> Clone for HugePages<T> {
    fn clone(&self) -> Self {
        Self::from_slice(self)
    }
}

impl<T: Copy + std::fmt::Debug> std::fmt::Debug for HugePages<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_of_all_sizes_are_copied_whole_and_aligned() {
        for len in [0, 1, 1000, 300_000, 600_000] {
            let numbers: Vec<u64> = (0..len).map(|i| i * i).collect();
            let mut pages = HugePages::zeroed(len as usize);
            assert!(pages.iter().all(|&number| number == 0));
            pages.copy_from_slice(&numbers);
            let copy = pages.clone();
            drop(pages);
            assert_eq!(*copy, *numbers);
            assert!(len * 8 < HUGE as u64 || (copy.as_ptr() as usize).is_multiple_of(HUGE));
        }
    }

    #[test]
    fn memory_can_be_cast_to_another_type_and_truncated() {
        for len in [0, 3, 1000, 600_000, 1_000_000] {
            let mut pages = HugePages::<u64>::zeroed(len);
            pages.iter_mut().zip(0..).for_each(|(element, i)| *element = i);
            let halves = pages.cast::<u32>();
            assert_eq!(halves.len(), 2 * len);
            for kept in [2 * len, len, len / 3, 0] {
                let halves = halves.clone().truncated(kept);
                assert_eq!(halves.len(), kept);
                let element = |(i, &half): (usize, &u32)| half as usize == if i % 2 == 0 { i / 2 } else { 0 };
                assert!(halves.iter().enumerate().all(element));
            }
            let lines = halves.cast::<[u64; 8]>();
            assert_eq!(lines.len(), len / 8);
        }
    }
}
