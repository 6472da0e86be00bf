//! Loop stacks (RA section 3.3): what a path left to do, kept outside the ray streams.
//!
//! A loop shader entry is pushed when a hit has more to do than its one continuation ray, and popped
//! when the path ends. Entries link to the one below; the index of the topmost, the *head*, travels
//! in the ray's payload. All paths of a job share one [`LoopStack`]; host threads reach it through a
//! [`Session`] each.
//!
//! # Memory
//! Entries live in buckets of [`BUCKET`] entries that are allocated when first needed and recycled
//! entry by entry. A shader that pushes at most `k` entries at a hit of depth `d < depth_limit`, and
//! whose entries resume at greater depths than their hits, has at most `k · depth_limit` entries per
//! camera path: from bottom to top of one stack the hits' depths never fall and no hit occurs twice.
//! So at most `k · depth_limit · rays in flight` entries are live, however many rays the recursion
//! visits, and allocated are at most the peak of those plus [`HOARD`] and one bucket per session.
//!
//! # Why there is no `unsafe`
//! An entry is stored as relaxed atomic words, which cost what plain moves do. The thread that pops
//! it received the head through the scheduler's lists, whose locks order the push before the pop, so
//! the words read are the words written.

use bytemuck::Pod;
use std::marker::PhantomData;
use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, OnceLock, PoisonError};

/// Entries in a bucket.
pub const BUCKET: usize = 1024;

/// The most free entries that a session keeps for itself.
pub const HOARD: usize = 2 * BUCKET;

/// Buckets in a row of the two-level directory, and rows.
const FAN: usize = 512;

/// The head of an empty stack.
pub const EMPTY: u32 = u32::MAX;

type Bucket = OnceLock<Box<[AtomicU32]>>;

/// Stacks of entries of type `T`, any number of them, in one recycled store.
#[derive(Debug)]
pub struct LoopStack<T> {
    rows: Vec<OnceLock<Box<[Bucket]>>>,
    free: Mutex<Free>,
    live: AtomicUsize,
    peak: AtomicUsize,
    entry: PhantomData<fn(T) -> T>,
}

#[derive(Debug, Default)]
struct Free {
    entries: Vec<u32>,
    buckets: usize,
}

/// What a [`LoopStack`] has used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LoopStackUse {
    /// Entries on stacks now.
    pub live_entries: usize,
    /// The most that were on stacks at once, counted whenever a session ends.
    pub peak_entries: usize,
    /// Bytes allocated for entries; never shrinks.
    pub allocated_bytes: usize,
}

impl<T: Pod> LoopStack<T> {
    /// The most entries that can be live: 2²⁸.
    pub const MAX_ENTRIES: usize = FAN * FAN * BUCKET;

    /// Words per entry: its own and the link to the entry below.
    const STRIDE: usize = size_of::<T>() / 4 + 1;

    /// A store without entries.
    pub fn new() -> Self {
        const { assert!(size_of::<T>().is_multiple_of(4) && align_of::<T>() <= 4) };
        Self {
            rows: std::iter::repeat_with(OnceLock::new).take(FAN).collect(),
            free: Mutex::default(),
            live: AtomicUsize::new(0),
            peak: AtomicUsize::new(0),
            entry: PhantomData,
        }
    }

    /// A thread's access, for as long as it shades a batch.
    pub fn session(&self) -> Session<'_, T> {
        Session { stack: self, free: Vec::new(), balance: 0 }
    }

    /// What has been used so far.
    pub fn usage(&self) -> LoopStackUse {
        let buckets = self.free.lock().unwrap_or_else(PoisonError::into_inner).buckets;
        LoopStackUse {
            live_entries: self.live.load(Relaxed),
            peak_entries: self.peak.load(Relaxed),
            allocated_bytes: buckets * BUCKET * Self::STRIDE * 4,
        }
    }

    fn words(&self, entry: u32) -> &[AtomicU32] {
        let (bucket, place) = (entry as usize / BUCKET, entry as usize % BUCKET);
        let row = self.rows[bucket / FAN].get().expect("an entry's row was made before the entry");
        let bucket = row[bucket % FAN].get().expect("an entry's bucket was made before the entry");
        &bucket[place * Self::STRIDE..(place + 1) * Self::STRIDE]
    }

    /// Moves free entries to a session's own, making a bucket when there are none.
    fn refill(&self, own: &mut Vec<u32>) {
        let mut free = self.free.lock().unwrap_or_else(PoisonError::into_inner);
        if free.entries.is_empty() {
            let bucket = free.buckets;
            assert!(
                bucket < FAN * FAN,
                "more than {} loop entries are live: lower the number of rays in flight or the depth limit",
                Self::MAX_ENTRIES
            );
            let row = self.rows[bucket / FAN]
                .get_or_init(|| std::iter::repeat_with(OnceLock::new).take(FAN).collect());
            row[bucket % FAN].get_or_init(|| {
                std::iter::repeat_with(AtomicU32::default).take(BUCKET * Self::STRIDE).collect()
            });
            free.buckets += 1;
            let first = (bucket * BUCKET) as u32;
            free.entries.extend((first..first + BUCKET as u32).rev());
        }
        let keep = free.entries.len().saturating_sub(BUCKET);
        own.extend(free.entries.drain(keep..));
    }
}

impl<T: Pod> Default for LoopStack<T> {
    fn default() -> Self {
        Self::new()
    }
}

/// One thread's access to a [`LoopStack`].
#[derive(Debug)]
pub struct Session<'a, T: Pod> {
    stack: &'a LoopStack<T>,
    free: Vec<u32>,
    /// Pushes less pops since the stack's counters were last told.
    balance: isize,
}

impl<T: Pod> Session<'_, T> {
    /// Puts `entry` on the stack whose head is `head`; returns the new head.
    pub fn push(&mut self, head: u32, entry: &T) -> u32 {
        if self.free.is_empty() {
            self.stack.refill(&mut self.free);
        }
        let index = self.free.pop().expect("refilled above");
        let (link, words) = self.stack.words(index).split_first().expect("an entry has at least its link");
        link.store(head, Relaxed);
        for (word, bytes) in words.iter().zip(bytemuck::bytes_of(entry).chunks_exact(4)) {
            word.store(u32::from_ne_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]), Relaxed);
        }
        self.balance += 1;
        index
    }

    /// Takes the topmost entry off the stack whose head is `head`, if there is one; returns it and
    /// the new head.
    pub fn pop(&mut self, head: u32) -> Option<(T, u32)> {
        if head == EMPTY {
            return None;
        }
        let (link, words) = self.stack.words(head).split_first().expect("an entry has at least its link");
        let mut entry = T::zeroed();
        for (bytes, word) in bytemuck::bytes_of_mut(&mut entry).chunks_exact_mut(4).zip(words) {
            bytes.copy_from_slice(&word.load(Relaxed).to_ne_bytes());
        }
        let below = link.load(Relaxed);
        self.free.push(head);
        if self.free.len() > HOARD {
            let mut free = self.stack.free.lock().unwrap_or_else(PoisonError::into_inner);
            free.entries.extend(self.free.drain(BUCKET..));
        }
        self.balance -= 1;
        Some((entry, below))
    }
}

impl<T: Pod> Drop for Session<'_, T> {
    fn drop(&mut self) {
        if !self.free.is_empty() {
            let mut free = self.stack.free.lock().unwrap_or_else(PoisonError::into_inner);
            free.entries.append(&mut self.free);
        }
        if self.balance != 0 {
            // Wraps back when another session's pops are counted before this one's pushes.
            let before = self.stack.live.fetch_add(self.balance as usize, Relaxed);
            let live = before.wrapping_add(self.balance as usize);
            if live as isize > 0 {
                self.stack.peak.fetch_max(live, Relaxed);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::mix;

    type Entry = [u32; 5];

    fn entry(path: u32, level: u32) -> Entry {
        std::array::from_fn(|i| mix(path ^ mix(level ^ mix(i as u32))))
    }

    #[test]
    fn many_stacks_in_one_store_stay_apart() {
        let stack = LoopStack::<Entry>::new();
        let mut paths: Vec<(u32, u32)> = vec![(EMPTY, 0); 5000];
        let mut most = 0usize;
        for round in 0..40u32 {
            let mut session = stack.session();
            for (id, path) in paths.iter_mut().enumerate() {
                let id = id as u32;
                if !mix(id ^ mix(round)).is_multiple_of(3) {
                    path.0 = session.push(path.0, &entry(id, path.1));
                    path.1 += 1;
                } else if let Some((popped, below)) = session.pop(path.0) {
                    path.1 -= 1;
                    assert_eq!(popped, entry(id, path.1));
                    path.0 = below;
                } else {
                    assert_eq!(path.1, 0);
                }
            }
            drop(session);
            let live = paths.iter().map(|p| p.1 as usize).sum();
            most = most.max(live);
            assert_eq!(stack.usage().live_entries, live);
        }
        let used = stack.usage();
        assert_eq!(used.peak_entries, most);
        assert!(used.allocated_bytes <= (most + BUCKET) * 24, "{used:?} for {most} entries");
    }

    #[test]
    fn entries_are_recycled() {
        let stack = LoopStack::<Entry>::new();
        for path in 0..100_000 {
            let mut session = stack.session();
            let mut head = EMPTY;
            for level in 0..8 {
                head = session.push(head, &entry(path, level));
            }
            for level in (0..8).rev() {
                let (popped, below) = session.pop(head).expect("eight were pushed");
                assert_eq!(popped, entry(path, level));
                head = below;
            }
            assert!(session.pop(head).is_none());
        }
        assert_eq!(stack.usage().allocated_bytes, BUCKET * 24);
    }

    #[test]
    fn threads_share_the_store() {
        let stack = LoopStack::<Entry>::new();
        // Each round, each thread pops what another pushed: heads change hands as in ray streams.
        let mut heads: Vec<Vec<u32>> = vec![vec![EMPTY; 3000]; 4];
        for round in 0..12u32 {
            std::thread::scope(|scope| {
                for (part, heads) in heads.iter_mut().enumerate() {
                    let stack = &stack;
                    scope.spawn(move || {
                        let mut session = stack.session();
                        for (i, head) in heads.iter_mut().enumerate() {
                            let id = (part * 3000 + i) as u32;
                            *head = if round < 6 {
                                session.push(*head, &entry(id, round))
                            } else {
                                let (popped, below) = session.pop(*head).expect("pushed six");
                                assert_eq!(popped, entry(id, 11 - round));
                                below
                            };
                        }
                    });
                }
            });
            assert_eq!(stack.usage().live_entries, 12_000 * (6 - (round as i32 - 5).abs()) as usize);
        }
        assert!(heads.iter().flatten().all(|&head| head == EMPTY));
    }
}
