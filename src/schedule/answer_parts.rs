//! The answers of a query: one vector, which threads write in parts.
//!
//! Unsafe code, since several threads write into the same vector, and since its memory is not written before.
//! Invariants:
//! 1. `memory` is that of a vector with `capacity` elements, to which no one else has a reference.
//! 2. Part `i` is the elements from `i * part_len` on. It is used by whoever holds the lock of its state alone, and not
//!    at all once that is [`State::Taken`].
//! 3. The first `former` elements hold values, and all elements of a part whose state is [`State::Used`].
//! 4. A vector that is taken consists of the used parts before the first one that is not; elements have no `drop`.
#![allow(unsafe_code, reason = "the invariants above")]

use crate::memory::huge_vectors;
use std::mem::{ManuallyDrop, MaybeUninit};
use std::ops::{Deref, DerefMut};
use std::slice;
use std::sync::atomic::{AtomicPtr, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// State of a part.
#[derive(Clone, Copy, PartialEq, Eq)]
enum State {
    /// No one has used it.
    New,
    Used,
    /// It belongs to a vector that has been taken.
    Taken,
}

/// A vector in parts of one length; the last one may be shorter. The thread that uses a part first makes its memory:
/// the operating system provides the pages of large memory at the first write, which takes one thread longer than many
/// threads take to trace rays.
pub(super) struct AnswerParts<A> {
    memory: AtomicPtr<A>,
    capacity: usize,
    /// Elements that the vector had before.
    former: usize,
    len: usize,
    part_len: usize,
    states: Box<[Mutex<State>]>,
}

/// A part, which no one else has.
pub(super) struct Part<'a, A> {
    elements: &'a mut [A],
    _state: MutexGuard<'a, State>,
}

impl<A: Copy + Default + Send + Sync> AnswerParts<A> {
    /// So many, none of them written, in parts of `part_len`, which is at least 1: in a vector's memory if that
    /// suffices.
    pub fn new(memory: Vec<A>, len: usize, part_len: usize) -> Self {
        let suffices = memory.capacity() >= len;
        let memory = if suffices { memory } else { huge_vectors::with_capacity(len) };
        let mut vector = ManuallyDrop::new(memory);
        let states = (0..len.div_ceil(part_len)).map(|_| Mutex::new(State::New)).collect();
        let (memory, capacity) = (AtomicPtr::new(vector.as_mut_ptr()), vector.capacity());
        Self { memory, capacity, former: vector.len(), len, part_len, states }
    }

    pub fn parts(&self) -> usize {
        self.states.len()
    }

    /// A part, as it was left; at first what the memory had there, or default answers. Waits for whoever else has it.
    ///
    /// # Panics
    /// If the vector has been taken.
    pub fn part(&self, part: usize) -> Part<'_, A> {
        let mut state = lock(&self.states[part]);
        assert!(*state != State::Taken, "the answers have been taken");
        let first = part * self.part_len;
        let len = self.part_len.min(self.len - first);
        // SAFETY: invariants 1 and 2; the part ends before `len`, which is at most `capacity`.
        let places: &mut [MaybeUninit<A>] =
            unsafe { slice::from_raw_parts_mut(self.memory.load(Relaxed).add(first).cast(), len) };
        if *state == State::New {
            for place in places.iter_mut().skip(self.former.saturating_sub(first)) {
                place.write(A::default());
            }
            *state = State::Used;
        }
        // SAFETY: invariant 3.
        Part { elements: unsafe { places.assume_init_mut() }, _state: state }
    }

    /// The answers of the parts that have been used, up to the first that has not. `None` if there are no parts, and at
    /// a second call.
    pub fn take(&self) -> Option<Vec<A>> {
        let mut states: Vec<_> = self.states.iter().map(lock).collect();
        if states.first().is_none_or(|state| **state == State::Taken) {
            return None;
        }
        let parts = states.iter().take_while(|state| ***state == State::Used).count();
        states.iter_mut().for_each(|state| **state = State::Taken);
        // SAFETY: invariants 1 and 4: it is taken once.
        Some(unsafe { self.vector((parts * self.part_len).min(self.len)) })
    }
}

impl<A> AnswerParts<A> {
    /// The vector, with so many elements.
    ///
    /// # Safety
    /// Invariants 1 and 4; it is never called again.
    unsafe fn vector(&self, len: usize) -> Vec<A> {
        // SAFETY: the caller's.
        unsafe { Vec::from_raw_parts(self.memory.load(Relaxed), len, self.capacity) }
    }
}

impl<A> Drop for AnswerParts<A> {
    fn drop(&mut self) {
        if self.states.first().is_none_or(|state| *lock(state) != State::Taken) {
            // SAFETY: invariants 1 and 4, for none of the parts.
            drop(unsafe { self.vector(0) });
        }
    }
}

fn lock(state: &Mutex<State>) -> MutexGuard<'_, State> {
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<A> Deref for Part<'_, A> {
    type Target = [A];

    fn deref(&self) -> &[A] {
        self.elements
    }
}

impl<A> DerefMut for Part<'_, A> {
    fn deref_mut(&mut self) -> &mut [A] {
        self.elements
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::panic::{AssertUnwindSafe, catch_unwind};

    #[test]
    fn parts_are_one_vector_whoever_writes_them() {
        let answers = AnswerParts::<u32>::new(Vec::new(), 1000, 64);
        assert_eq!(answers.parts(), 16);
        std::thread::scope(|scope| {
            for thread in 0..4 {
                let answers = &answers;
                scope.spawn(move || {
                    for part in (thread..16).step_by(4) {
                        assert_eq!(answers.part(part)[0], 0, "a default answer");
                        for (place, answer) in answers.part(part).iter_mut().enumerate() {
                            *answer = (64 * part + place) as u32;
                        }
                    }
                });
            }
        });
        assert_eq!(answers.take(), Some((0..1000).collect()));
        assert_eq!(answers.take(), None);
        assert!(catch_unwind(AssertUnwindSafe(|| drop(answers.part(3)))).is_err());
    }

    #[test]
    fn elements_beyond_the_former_ones_are_default_answers() {
        let mut memory = Vec::with_capacity(100);
        memory.extend([9; 6]);
        let answers = AnswerParts::<u32>::new(memory, 10, 4);
        let parts: Vec<u32> = (0..3).flat_map(|part| answers.part(part).to_vec()).collect();
        assert_eq!(parts, [9, 9, 9, 9, 9, 9, 0, 0, 0, 0]);
    }

    #[test]
    fn answers_end_before_the_first_part_that_no_one_has_used() {
        let answers = AnswerParts::<u32>::new(vec![9; 100], 10, 4);
        answers.part(0).fill(7);
        answers.part(2).fill(8);
        assert_eq!(answers.take(), Some(vec![7; 4]));
        drop(AnswerParts::<u32>::new(Vec::new(), 10, 4));
        assert_eq!(AnswerParts::<u32>::new(Vec::new(), 0, 4).take(), None);
    }
}
