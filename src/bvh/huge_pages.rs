//! Memory for trees, on huge pages where the system has them: traversal jumps about in them, and a
//! processor finds its way among few large pages faster than among many small ones.
//!
//! Unsafe code for a slice of memory that comes from the system. Invariants:
//! 1. `start` leads to `len` elements in `memory`, which stays where it is when its owner moves and is reached through
//!    this value alone. It is a multiple of 64.
//! 2. All of them are initialised, their type has no destructor (`Copy`), and it takes any bits (`Pod`).
#![allow(unsafe_code, reason = "the invariants above")]

use bytemuck::{Pod, Zeroable};
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
    memory: Memory,
}

/// Where elements lie: in pages of their own if they are many.
enum Memory {
    Heap(#[expect(dead_code, reason = "owned, and reached by `start`")] Vec<Line>),
    Mapped(MmapMut),
}

/// A cache line.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
struct Line([u8; 64]);

// SAFETY: it owns its elements as a `Vec` does (invariant 1).
unsafe impl<T: Copy + Send> Send for Pages<T> {}
// SAFETY: as above.
unsafe impl<T: Copy + Sync> Sync for Pages<T> {}

impl<T: Pod + Send> Pages<T> {
    /// All zero. The system clears large pieces when they are first written to, whichever thread does it.
    pub fn zeroed(len: usize) -> Self {
        const { assert!(align_of::<T>() <= align_of::<Line>()) };
        let layout = Layout::array::<T>(len).expect("fits the address space");
        if layout.size() < HUGE {
            let mut lines: Vec<Line> = bytemuck::zeroed_vec(layout.size().div_ceil(size_of::<Line>()));
            let start = NonNull::from(lines.as_mut_slice()).cast();
            return Self { start, len, memory: Memory::Heap(lines) };
        }
        // As much more as aligning it to huge pages may leave out.
        let map = MmapOptions::new().len(layout.size() + HUGE).map_anon();
        let Ok(mut map) = map else { handle_alloc_error(layout) };
        let before = map.as_ptr().align_offset(HUGE);
        // That the advice may fail is no matter.
        #[cfg(target_os = "linux")]
        let _ = map.advise_range(memmap2::Advice::HugePage, before, layout.size());
        let start = NonNull::from(&mut map[before..]).cast();
        Self { start, len, memory: Memory::Mapped(map) }
    }

    /// The same memory as elements of another type, as many as fit.
    pub fn cast<U: Pod>(self) -> Pages<U> {
        const { assert!(align_of::<U>() <= align_of::<Line>()) };
        let len = self.len * size_of::<T>() / size_of::<U>();
        Pages { start: self.start.cast(), len, memory: self.memory }
    }

    /// The first `len` elements; memory behind them goes back to the system.
    pub fn shortened(mut self, len: usize) -> Self {
        assert!(len <= self.len);
        let Memory::Mapped(map) = &mut self.memory else { return Self::of(&self[..len]) };
        #[cfg(target_os = "linux")]
        {
            let start = self.start.as_ptr().addr() - map.as_ptr().addr();
            let from = start + (len * size_of::<T>()).next_multiple_of(HUGE);
            let until = start + self.len * size_of::<T>();
            if from < until {
                // SAFETY: nobody reaches what lies behind the first `len` elements any more (invariant 1).
                let advice = unsafe {
                    map.unchecked_advise_range(memmap2::UncheckedAdvice::DontNeed, from, until - from)
                };
                // That it may fail is no matter.
                drop(advice);
            }
        }
        #[cfg(not(target_os = "linux"))]
        let _ = map;
        self.len = len;
        self
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

    #[test]
    fn the_same_memory_holds_elements_of_another_type_and_fewer_of_them() {
        for len in [0, 3, 1000, 600_000, 1_000_000] {
            let mut pages = Pages::<u64>::zeroed(len);
            pages.iter_mut().zip(0..).for_each(|(element, i)| *element = i);
            let halves = pages.cast::<u32>();
            assert_eq!(halves.len(), 2 * len);
            for kept in [2 * len, len, len / 3, 0] {
                let halves = halves.clone().shortened(kept);
                assert_eq!(halves.len(), kept);
                let element = |(i, &half): (usize, &u32)| half as usize == if i % 2 == 0 { i / 2 } else { 0 };
                assert!(halves.iter().enumerate().all(element));
            }
            let lines = halves.cast::<[u64; 8]>();
            assert_eq!(lines.len(), len / 8);
        }
    }
}
