//! An arena: slots with numbers that are taken and given back, and buckets that store them.
//!
//! A bucket of [`BUCKET`] slots is allocated when it is first needed, and its slots are recycled. All threads
//! share the slots. Each thread accesses them through its [`LocalFreeList`], which keeps some free slots for
//! that thread.

use crate::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use crate::sync::{Mutex, PoisonError};
use std::sync::OnceLock;

/// Slots in a bucket.
pub const BUCKET: usize = 1024;

/// The most free slots that a local free list keeps.
pub const MAX_LOCAL_FREE: usize = 2 * BUCKET;

/// Rows of the two-level directory, and buckets in a row.
const FAN: usize = 2048;

/// Marks the absence of a slot.
pub const NO_SLOT: u32 = u32::MAX;

/// An arena of slots in buckets of type `B`.
#[derive(Debug)]
pub struct Arena<B> {
    rows: Vec<OnceLock<Box<[OnceLock<B>]>>>,
    free: Mutex<Free>,
    live: AtomicUsize,
    peak: AtomicUsize,
}

#[derive(Debug, Default)]
struct Free {
    slots: Vec<u32>,
    buckets: usize,
}

/// Memory use of an arena.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ArenaUse {
    /// Entries that exist now.
    pub live_entries: usize,
    /// The most entries that existed at once, counted after each shaded batch.
    pub peak_entries: usize,
    /// Bytes allocated for entries. This number never shrinks.
    pub allocated_bytes: usize,
}

impl<B> Default for Arena<B> {
    fn default() -> Self {
        Self::new()
    }
}

impl<B> Arena<B> {
    /// The most slots of an arena, free slots in local free lists included.
    pub const MAX: usize = (FAN * FAN - 1) * BUCKET;

    /// The most paths in flight that surely find slots for `entries_each` entries each. Half of the slots are
    /// reserved for the threads' local free lists. Each keeps at most [`MAX_LOCAL_FREE`] slots and a bucket.
    pub const fn most_paths(entries_each: usize) -> usize {
        Self::MAX / 2 / if entries_each == 0 { 1 } else { entries_each }
    }

    /// An arena without slots.
    pub fn new() -> Self {
        const { assert!(Self::MAX <= NO_SLOT as usize) };
        Self {
            rows: std::iter::repeat_with(OnceLock::new).take(FAN).collect(),
            free: Mutex::default(),
            live: AtomicUsize::new(0),
            peak: AtomicUsize::new(0),
        }
    }

    /// A thread's access while it shades a batch.
    pub fn local_free_list(&self) -> LocalFreeList<'_, B> {
        LocalFreeList { arena: self, free: Vec::new(), balance: 0 }
    }

    /// The bucket of a taken slot, and the slot's index in the bucket.
    #[inline]
    pub fn at(&self, slot: u32) -> (&B, usize) {
        let (bucket, number) = (slot as usize / BUCKET, slot as usize % BUCKET);
        let row = self.rows[bucket / FAN].get().expect("a slot's row was made before the slot");
        (row[bucket % FAN].get().expect("a slot's bucket was made before the slot"), number)
    }

    /// Memory use so far, with `slot_bytes` bytes a slot.
    pub fn usage(&self, slot_bytes: usize) -> ArenaUse {
        let buckets = self.free.lock().unwrap_or_else(PoisonError::into_inner).buckets;
        ArenaUse {
            live_entries: self.live.load(Relaxed),
            peak_entries: self.peak.load(Relaxed),
            allocated_bytes: buckets * BUCKET * slot_bytes,
        }
    }

    /// Moves free slots to the list `own`. Allocates a bucket if there are no free slots.
    fn refill(&self, own: &mut Vec<u32>, make: impl FnOnce() -> B) {
        let mut free = self.free.lock().unwrap_or_else(PoisonError::into_inner);
        if free.slots.is_empty() {
            let bucket = free.buckets;
            assert!(
                (bucket + 1) * BUCKET <= Self::MAX,
                "the renderer has more paths in flight than it said there is room for"
            );
            let row = self.rows[bucket / FAN]
                .get_or_init(|| std::iter::repeat_with(OnceLock::new).take(FAN).collect());
            row[bucket % FAN].get_or_init(make);
            free.buckets += 1;
            let first = (bucket * BUCKET) as u32;
            free.slots.extend((first..first + BUCKET as u32).rev());
        }
        let keep = free.slots.len().saturating_sub(BUCKET);
        own.extend(free.slots.drain(keep..));
    }
}

/// One thread's access to [`Arena`].
#[derive(Debug)]
pub struct LocalFreeList<'a, B> {
    arena: &'a Arena<B>,
    free: Vec<u32>,
    /// Slots taken less slots given back since the arena's counters were last updated.
    balance: isize,
}

impl<B> LocalFreeList<'_, B> {
    /// Takes a slot. If no slot is free, `make` makes a bucket.
    #[inline]
    pub fn take(&mut self, make: impl FnOnce() -> B) -> u32 {
        if self.free.is_empty() {
            self.arena.refill(&mut self.free, make);
        }
        self.balance += 1;
        self.free.pop().expect("refilled above")
    }

    /// The slot that will be taken after `others` other slots, if none is given back before; `None` if not
    /// known.
    pub fn upcoming(&self, others: usize) -> Option<u32> {
        self.free.iter().rev().nth(others).copied()
    }

    /// Gives a slot back.
    #[inline]
    pub fn give_back(&mut self, slot: u32) {
        self.free.push(slot);
        if self.free.len() > MAX_LOCAL_FREE {
            let mut free = self.arena.free.lock().unwrap_or_else(PoisonError::into_inner);
            free.slots.extend(self.free.drain(BUCKET..));
        }
        self.balance -= 1;
    }
}

impl<B> Drop for LocalFreeList<'_, B> {
    fn drop(&mut self) {
        if !self.free.is_empty() {
            let mut free = self.arena.free.lock().unwrap_or_else(PoisonError::into_inner);
            free.slots.append(&mut self.free);
        }
        if self.balance != 0 {
            // The count wraps if another thread's returns are counted before this thread's takings.
            let before = self.arena.live.fetch_add(self.balance as usize, Relaxed);
            let live = before.wrapping_add(self.balance as usize);
            if live as isize > 0 {
                self.arena.peak.fetch_max(live, Relaxed);
            }
        }
    }
}
