//! Loop stacks (RA section 3.3) keep the unfinished work of paths outside the ray streams.
//!
//! A hit that has more to do than its one continuation ray pushes a loop entry. The entry is popped when the
//! path ends. Each entry links to the one below. The index of the topmost entry, the *head*, travels in the
//! ray's payload. All paths of a job share one [`LoopStack`]. Each host thread accesses it through its own
//! [`Session`].
//!
//! # Memory
//! Entries are stored in the recycled buckets of [`super::arena`]. Assume a shader that pushes at most `k`
//! entries at a hit of depth `d < depth_limit`, and whose entries resume at greater depths than their hits.
//! It has at most `k · depth_limit` entries per camera path: from bottom to top of one stack the hits' depths
//! never fall, and no hit occurs twice. So at most `k · depth_limit · rays in flight` entries are live,
//! however many rays the recursion visits. The arena allocates at most the peak of live entries plus, for
//! each session, [`super::arena::MAX_LOCAL_FREE`] entries and one bucket. The renderer tells the scheduler
//! how many paths it has memory for ([`crate::schedule::Renderer::most_in_flight`]). Beyond that number
//! spawning waits, and nothing is dropped.
//!
//! # Why there is no `unsafe`
//! An entry is stored as relaxed atomic words, which cost the same as plain moves. The thread that pops an
//! entry got the head through the scheduler's lists. Their locks order the push before the pop, so the words
//! read are the words written.

use super::arena::{Arena, ArenaUse, BUCKET, LocalFreeList, NO_SLOT};
use bytemuck::Pod;
use std::marker::PhantomData;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// The head of an empty stack.
pub const EMPTY: u32 = NO_SLOT;

type Bucket = Box<[AtomicU32]>;

/// Any number of stacks of entries of type `T`, in one arena.
///
/// ```
/// use raystream::shade::loop_stack::{EMPTY, LoopStack};
///
/// let stacks = LoopStack::<[f32; 4]>::new();
/// let mut session = stacks.session();
/// // A path's stack is a number, which travels in its ray's payload.
/// let first = session.push(EMPTY, &[1.0; 4]);
/// let second = session.push(first, &[2.0; 4]);
/// assert_eq!(session.pop(second), Some(([2.0; 4], first)));
/// assert_eq!(session.pop(first), Some(([1.0; 4], EMPTY)));
/// assert_eq!(session.pop(EMPTY), None);
/// ```
#[derive(Debug)]
pub struct LoopStack<T> {
    slots: Arena<Bucket>,
    entry: PhantomData<fn(T) -> T>,
}

impl<T: Pod> LoopStack<T> {
    /// Words per entry: those of `T`, and the link to the entry below.
    const STRIDE: usize = size_of::<T>() / 4 + 1;

    /// The most paths in flight whose stacks surely fit, with `entries_each` entries on each.
    pub const fn most_paths(entries_each: usize) -> usize {
        Arena::<Bucket>::most_paths(entries_each)
    }

    /// Stacks without entries.
    pub fn new() -> Self {
        const { assert!(size_of::<T>().is_multiple_of(4) && align_of::<T>() <= 4) };
        Self { slots: Arena::new(), entry: PhantomData }
    }

    /// A thread's access while it shades a batch.
    pub fn session(&self) -> Session<'_, T> {
        Session { stack: self, free: self.slots.local_free_list() }
    }

    /// Memory use so far.
    pub fn usage(&self) -> ArenaUse {
        self.slots.usage(4 * Self::STRIDE)
    }

    #[inline]
    fn words(&self, entry: u32) -> &[AtomicU32] {
        let (bucket, number) = self.slots.at(entry);
        &bucket[number * Self::STRIDE..(number + 1) * Self::STRIDE]
    }

    fn bucket() -> Bucket {
        std::iter::repeat_with(AtomicU32::default).take(BUCKET * Self::STRIDE).collect()
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
    free: LocalFreeList<'a, Bucket>,
}

impl<T: Pod> Session<'_, T> {
    /// Pushes `entry` on the stack whose head is `head`. Returns the new head.
    #[inline]
    pub fn push(&mut self, head: u32, entry: &T) -> u32 {
        let index = self.free.take(LoopStack::<T>::bucket);
        let (link, words) = self.stack.words(index).split_first().expect("an entry has at least its link");
        link.store(head, Relaxed);
        let (numbers, _) = bytemuck::bytes_of(entry).as_chunks::<4>();
        for (place, &number) in numbers.iter().enumerate() {
            words[place].store(u32::from_ne_bytes(number), Relaxed);
        }
        index
    }

    /// Pops the topmost entry of the stack whose head is `head`. Returns it and the new head; `None` if the
    /// stack is empty.
    #[inline]
    pub fn pop(&mut self, head: u32) -> Option<(T, u32)> {
        if head == EMPTY {
            return None;
        }
        let (link, words) = self.stack.words(head).split_first().expect("an entry has at least its link");
        let mut entry = T::zeroed();
        let (numbers, _) = bytemuck::bytes_of_mut(&mut entry).as_chunks_mut::<4>();
        for (place, number) in numbers.iter_mut().enumerate() {
            *number = words[place].load(Relaxed).to_ne_bytes();
        }
        let below = link.load(Relaxed);
        self.free.give_back(head);
        Some((entry, below))
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
    fn many_stacks_in_one_arena_are_independent() {
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
        // In each round, each thread pops entries that another thread pushed, as heads move between threads
        // in ray streams.
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
