//! The places of an arena: numbers that are handed out and taken back, and the buckets behind them.
//!
//! Buckets of [`BUCKET`] places are made when first needed and recycled place by place. All threads share
//! the places; each reaches them through a [`LocalFreeList`] that keeps some free ones to itself.

use crate::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use crate::sync::{Mutex, PoisonError};
use std::sync::OnceLock;

/// Places in a bucket.
pub const BUCKET: usize = 1024;

/// The most free places that a hand keeps for itself.
pub const HOARD: usize = 2 * BUCKET;

/// Buckets in a row of the two-level directory, and rows.
const FAN: usize = 2048;

/// A number that is no place.
pub const NOWHERE: u32 = u32::MAX;

/// Places in buckets of type `B`.
#[derive(Debug)]
pub struct Arena<B> {
    rows: Vec<OnceLock<Box<[OnceLock<B>]>>>,
    free: Mutex<Free>,
    live: AtomicUsize,
    peak: AtomicUsize,
}

#[derive(Debug, Default)]
struct Free {
    places: Vec<u32>,
    buckets: usize,
}

/// What an arena has used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ArenaUse {
    /// Entries now.
    pub live_entries: usize,
    /// The most there were at once, counted whenever a batch has been shaded.
    pub peak_entries: usize,
    /// Bytes allocated for entries; never shrinks.
    pub allocated_bytes: usize,
}

impl<B> Default for Arena<B> {
    fn default() -> Self {
        Self::new()
    }
}

impl<B> Arena<B> {
    /// The most places there can be, the free ones that hands keep included.
    pub const MAX: usize = (FAN * FAN - 1) * BUCKET;

    /// The most paths in flight that are sure to find a place for so many entries each. Half of the
    /// places are left for the local free lists of the threads. Each keeps at most [`HOARD`] and a bucket.
    pub const fn most_paths(entries_each: usize) -> usize {
        Self::MAX / 2 / if entries_each == 0 { 1 } else { entries_each }
    }

    /// No places yet.
    pub fn new() -> Self {
        const { assert!(Self::MAX <= NOWHERE as usize) };
        Self {
            rows: std::iter::repeat_with(OnceLock::new).take(FAN).collect(),
            free: Mutex::default(),
            live: AtomicUsize::new(0),
            peak: AtomicUsize::new(0),
        }
    }

    /// A thread's access, for as long as it shades a batch.
    pub fn hand(&self) -> LocalFreeList<'_, B> {
        LocalFreeList { places: self, free: Vec::new(), balance: 0 }
    }

    /// The bucket of a place that is taken, and its number there.
    pub fn at(&self, place: u32) -> (&B, usize) {
        let (bucket, number) = (place as usize / BUCKET, place as usize % BUCKET);
        let row = self.rows[bucket / FAN].get().expect("a place's row was made before the place");
        (row[bucket % FAN].get().expect("a place's bucket was made before the place"), number)
    }

    /// What has been used so far, where each place takes so many bytes.
    pub fn usage(&self, place_bytes: usize) -> ArenaUse {
        let buckets = self.free.lock().unwrap_or_else(PoisonError::into_inner).buckets;
        ArenaUse {
            live_entries: self.live.load(Relaxed),
            peak_entries: self.peak.load(Relaxed),
            allocated_bytes: buckets * BUCKET * place_bytes,
        }
    }

    /// Moves free places to a hand's own, making a bucket when there are none.
    fn refill(&self, own: &mut Vec<u32>, make: impl FnOnce() -> B) {
        let mut free = self.free.lock().unwrap_or_else(PoisonError::into_inner);
        if free.places.is_empty() {
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
            free.places.extend((first..first + BUCKET as u32).rev());
        }
        let keep = free.places.len().saturating_sub(BUCKET);
        own.extend(free.places.drain(keep..));
    }
}

/// One thread's access to [`Arena`].
#[derive(Debug)]
pub struct LocalFreeList<'a, B> {
    places: &'a Arena<B>,
    free: Vec<u32>,
    /// Places taken less places given back since the counters were last told.
    balance: isize,
}

impl<B> LocalFreeList<'_, B> {
    /// Takes a place; `make` makes a bucket if there is no free place left.
    pub fn take(&mut self, make: impl FnOnce() -> B) -> u32 {
        if self.free.is_empty() {
            self.places.refill(&mut self.free, make);
        }
        self.balance += 1;
        self.free.pop().expect("refilled above")
    }

    /// The place that is taken after so many others, unless some are given back meanwhile; if known.
    pub fn upcoming(&self, others: usize) -> Option<u32> {
        self.free.iter().rev().nth(others).copied()
    }

    /// Gives a place back.
    pub fn give_back(&mut self, place: u32) {
        self.free.push(place);
        if self.free.len() > HOARD {
            let mut free = self.places.free.lock().unwrap_or_else(PoisonError::into_inner);
            free.places.extend(self.free.drain(BUCKET..));
        }
        self.balance -= 1;
    }
}

impl<B> Drop for LocalFreeList<'_, B> {
    fn drop(&mut self) {
        if !self.free.is_empty() {
            let mut free = self.places.free.lock().unwrap_or_else(PoisonError::into_inner);
            free.places.append(&mut self.free);
        }
        if self.balance != 0 {
            // Wraps back when another hand's returns are counted before this one's takings.
            let before = self.places.live.fetch_add(self.balance as usize, Relaxed);
            let live = before.wrapping_add(self.balance as usize);
            if live as isize > 0 {
                self.places.peak.fetch_max(live, Relaxed);
            }
        }
    }
}
