//! Loop entries of integrators in WGSL.

use crate::render::PathMemory;
use crate::shade::loop_stack::{LoopStack, Session};

/// Words of small entries.
const SMALL: usize = 16;

/// Words of large entries.
pub(super) const LARGE: usize = 64;

/// Words of an entry before what it keeps: the loop shader and the turn; the depth and the cone of rays that follow.
pub(super) const HEADER: usize = 2;

/// The loop stacks of an integrator in WGSL. One of the two is used.
#[derive(Debug, Default)]
pub struct LoopEntries {
    small: LoopStack<[u32; SMALL]>,
    large: LoopStack<[u32; LARGE]>,
}

impl PathMemory for LoopEntries {
    fn bytes(&self) -> usize {
        self.small.usage().allocated_bytes + self.large.usage().allocated_bytes
    }
}

impl LoopEntries {
    /// A thread's access, for entries of at most so many words.
    pub(super) fn session(&self, words: usize) -> EntrySession<'_> {
        assert!(words <= LARGE, "the loader limits entries");
        match words <= SMALL {
            true => EntrySession::Small(self.small.session()),
            false => EntrySession::Large(self.large.session()),
        }
    }

    /// The most paths in flight whose stacks surely fit.
    pub(super) fn most_paths(entries_each: usize) -> usize {
        LoopStack::<[u32; LARGE]>::most_paths(entries_each)
    }
}

/// A thread's access to the loop stacks while it shades a batch.
pub(super) enum EntrySession<'a> {
    Small(Session<'a, [u32; SMALL]>),
    Large(Session<'a, [u32; LARGE]>),
}

impl EntrySession<'_> {
    /// Pushes an entry; returns the new head.
    #[inline]
    pub fn push(&mut self, head: u32, entry: &[u32; LARGE]) -> u32 {
        match self {
            Self::Small(session) => {
                let mut small = [0; SMALL];
                small.copy_from_slice(&entry[..SMALL]);
                session.push(head, &small)
            }
            Self::Large(session) => session.push(head, entry),
        }
    }

    /// Pops an entry; returns the new head.
    #[inline]
    pub fn pop(&mut self, head: u32, entry: &mut [u32; LARGE]) -> Option<u32> {
        match self {
            Self::Small(session) => session.pop(head).map(|(small, head)| {
                entry[..SMALL].copy_from_slice(&small);
                head
            }),
            Self::Large(session) => session.pop(head).map(|(large, head)| {
                *entry = large;
                head
            }),
        }
    }
}
