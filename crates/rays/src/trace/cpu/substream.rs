//! The data of a sub-stream: the rays that one traversal follows together, and their pending visits.
//!
//! Unsafe code, because rows, rays, answers, lists and nodes are accessed without bounds checks. The files of this
//! module share these invariants; a function whose safety rests on some of them is `unsafe` and names them.
//! 1. Ids are byte offsets of rows and rays: `ROW_BYTES * i` for ray `i` of the sub-stream. Every id in a list (padding
//!    included) and in a pair belongs to a ray of the sub-stream, and `rows`, `rays` and `answers` have an element for
//!    each.
//! 2. A list in an arena is followed by padding, at least up to the next multiple of [`MAX_LANES`] ids. Its ids ascend;
//!    shafts rely on that order, memory accesses do not.
//! 3. Before a list of `len` ids is visited, `OctantStack::entries` has room for nine more entries. The arena grows to
//!    hold eight lists of `len + MAX_LANES` ids beyond the list.
//! 4. Children in entries and in pairs are children of the tree's nodes or its root (see `tree_view`).
//! 5. In a candidate, the bits of the id below [`ROW_BYTES`] are the row of a triangle in the pair's leaf block.
//! 6. Both arrays of a `PairStack` hold its pairs and as much as was reserved beyond them (see `pair_stack`).
#![allow(unsafe_code, reason = "the invariants above")]

use super::moved_nodes::MovedNodes;
use super::pair_stack::{BLOCK_BATCH, MIN_BLOCK_PAIRS, MIN_NODE_PAIRS, PairStack};
use super::shaft::Shafts;
use super::tree_view::TreeView;
use crate::bvh::{Child, MASKED, PRIMITIVE, WIDTH};
use crate::lanes::{Lanes, Prefetch};
use crate::stream::{Hit, Ray};

/// The two vector widths of a traversal.
#[derive(Clone, Copy)]
pub(super) struct Widths<W, E> {
    /// The widest vectors: many rays against one box or triangle.
    pub wide: W,
    /// Vectors of eight lanes: one ray against the slots of a node or the triangles of a block.
    pub eight: E,
}

/// Data of a ray for the box tests. See [`crate::geom::CanonicalRay`], whose `near` and `far` are
/// `shift ∓ slack * |inverse|`.
///
/// A row is as small as the ray itself, which remains in the caller's memory: most visits are to inner nodes, and a
/// cache line of rows then serves two neighbours.
#[derive(Clone, Copy, Default)]
#[repr(C, align(32))]
pub(super) struct Row {
    pub inverse: [f32; 3],
    pub shift: [f32; 3],
    pub slack: f32,
    /// The nearest hit so far, at first `t_max`; negative for a ray that is done.
    pub limit: f32,
}

/// [`Row::limit`] of a ray that is done: among negative numbers the least by its bits that is not −0, so that hardly
/// any box is entered.
pub(super) const DONE: f32 = -f32::MIN_POSITIVE;

/// The unit of ids: bytes of a row, and of a ray.
pub(super) const ROW_BYTES: usize = 32;

const _: () = assert!(size_of::<Row>() == ROW_BYTES && size_of::<Ray>() == ROW_BYTES && WIDTH <= ROW_BYTES);

/// The index of a ray in its sub-stream, by its id.
#[inline(always)]
pub(super) fn ray_index(id: u32) -> usize {
    id as usize / ROW_BYTES
}

/// A pending visit: a list of rays and the child that they visit.
#[derive(Clone, Copy)]
pub(super) struct Entry {
    pub child: Child,
    /// Index of the list's start in the arena.
    pub start: u32,
    pub len: u32,
    /// [`OctantStack::done`] when the list was written.
    pub done_before: u32,
}

/// The pending visits of the rays of one octant.
#[derive(Default)]
pub(super) struct OctantStack {
    /// Lists of ids, one above the other.
    pub arena: Vec<u32>,
    pub entries: Vec<Entry>,
    /// Rays that visit inner nodes on their own.
    pub node_pairs: PairStack,
    /// Rays that visit leaf blocks on their own.
    pub block_pairs: PairStack,
    /// Triangles whose interior a ray's line passes through, to be tested further (invariant 5).
    pub candidates: PairStack,
    /// For pairs in the tree of an instance.
    pub moved: MovedNodes,
    /// Number of rays found occluded, in all sub-streams so far; wraps around.
    pub done: u32,
}

impl OctantStack {
    /// Makes room in the arena for `len` ids in all.
    #[inline(always)]
    pub fn reserve(&mut self, len: usize) {
        if self.arena.len() < len {
            self.grow(len);
        }
    }

    #[cold]
    #[inline(never)]
    fn grow(&mut self, len: usize) {
        assert!(len < u32::MAX as usize, "lists of {len} ids");
        self.arena.resize(len.next_power_of_two(), 0);
    }

    /// Drops all pending visits, which a filter that panicked may have left.
    #[inline]
    pub fn clear(&mut self) {
        let Self { entries, node_pairs, block_pairs, candidates, .. } = self;
        entries.clear();
        for pairs in [node_pairs, block_pairs, candidates] {
            pairs.clear();
        }
    }

    /// Pushes the visit of the root by the list of `len` ids at the bottom of the arena.
    #[inline]
    pub fn push_root(&mut self, len: usize) {
        self.entries.push(Entry { child: Child::ROOT, start: 0, len: len as u32, done_before: self.done });
    }

    /// True if pairs with inner nodes are visited before lists: if there are enough, or no lists.
    #[inline(always)]
    pub fn has_node_batch(&self) -> bool {
        self.node_pairs.len() >= if self.entries.is_empty() { 1 } else { MIN_NODE_PAIRS }
    }

    /// True if pairs with leaf blocks are visited next: if there are enough, and no nodes that could add more.
    #[inline(always)]
    pub fn has_block_batch(&self) -> bool {
        let len = self.block_pairs.len();
        let worth = len >= if self.entries.is_empty() { 1 } else { MIN_BLOCK_PAIRS };
        len >= BLOCK_BATCH || worth && !self.has_node_batch()
    }
}

/// Room for entries while a tree of this depth is visited: a visit pops one entry, pushes at most eight, and may write
/// one more beyond them.
#[inline(always)]
pub(super) fn entry_capacity(depth: usize) -> usize {
    (WIDTH - 1) * depth + WIDTH + 2
}

/// Place to which a traversal writes its answers, which are misses beforehand.
pub(super) enum Answers<'a> {
    /// Of closest-hit queries.
    Hits(&'a mut [Hit]),
    /// Of any-hit queries: 1 for an occluded ray, else 0.
    Occluded(&'a mut [u32]),
}

impl<'a> Answers<'a> {
    pub fn len(&self) -> usize {
        match self {
            Self::Hits(hits) => hits.len(),
            Self::Occluded(occluded) => occluded.len(),
        }
    }

    /// Sets the answer of a ray.
    #[inline(always)]
    pub fn set(&mut self, ray: usize, hit: Hit) {
        match self {
            Self::Hits(hits) => hits[ray] = hit,
            Self::Occluded(occluded) => occluded[ray] = u32::from(!hit.is_miss()),
        }
    }

    /// Splits off the answers of the first `count` rays.
    #[inline]
    pub fn split_first(&mut self, count: usize) -> Answers<'a> {
        match self {
            Self::Hits(hits) => {
                let (first, rest) = std::mem::take(hits).split_at_mut(count);
                *hits = rest;
                Answers::Hits(first)
            }
            Self::Occluded(occluded) => {
                let (first, rest) = std::mem::take(occluded).split_at_mut(count);
                *occluded = rest;
                Answers::Occluded(first)
            }
        }
    }
}

/// [`Answers`] that are accessed by ray id, without bounds checks.
#[derive(Clone, Copy)]
pub(super) enum AnswerPointer {
    Hits(*mut Hit),
    Occluded(*mut u32),
}

impl From<Answers<'_>> for AnswerPointer {
    fn from(answers: Answers<'_>) -> Self {
        match answers {
            Answers::Hits(hits) => Self::Hits(hits.as_mut_ptr()),
            Answers::Occluded(occluded) => Self::Occluded(occluded.as_mut_ptr()),
        }
    }
}

/// The rays of a sub-stream on their way through a tree. They are accessed by id (invariant 1).
#[derive(Clone, Copy)]
pub(super) struct SubStream<'a> {
    pub tree: TreeView<'a>,
    /// A row per ray.
    pub rows: *mut Row,
    pub rays: *const Ray,
    pub shafts: &'a Shafts,
    /// An answer per ray.
    pub answers: AnswerPointer,
}

impl SubStream<'_> {
    /// Records a candidate that passed the triangle test, unless a tie, a nearer hit of the same ray or the filter
    /// rejects it. Returns whether it was recorded.
    ///
    /// # Safety
    /// Invariant 1 for `id`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub unsafe fn offer<const ANY: bool>(&self, id: u32, stored: u32, t: f32, u: f32, v: f32) -> bool {
        let primitive = stored & PRIMITIVE;
        if let AnswerPointer::Hits(hits) = self.answers
            && !ANY
        {
            let index = ray_index(id);
            // SAFETY: invariant 1.
            let (row, hit) = unsafe { (&*self.rows.add(index).cast_const(), &*hits.add(index).cast_const()) };
            // The row has the distance of the hit, so that the hit is read only if there is a tie.
            if !(t < row.limit || t == row.limit && primitive < hit.primitive) {
                return false;
            }
        }
        if stored & MASKED != 0 && !self.tree.filter_accepts(primitive, u, v) {
            return false;
        }
        // SAFETY: invariant 1.
        unsafe { self.record::<ANY>(id, Hit { t, u, v, primitive }) };
        true
    }

    /// Makes a hit the answer of a ray.
    ///
    /// # Safety
    /// Invariant 1 for `id`.
    #[inline(always)]
    pub unsafe fn record<const ANY: bool>(&self, id: u32, hit: Hit) {
        let index = ray_index(id);
        // SAFETY: invariant 1.
        unsafe {
            (*self.rows.add(index)).limit = if ANY { DONE } else { hit.t };
            match self.answers {
                AnswerPointer::Occluded(occluded) => *occluded.add(index) = 1,
                AnswerPointer::Hits(hits) => *hits.add(index) = hit,
            }
        }
    }
}

/// Prefetches the rows, or rays, of the ids in the next vector of a list. They have often left the nearest caches, and
/// testing the vector before gives them time to arrive.
///
/// # Safety
/// `list` is good for reading an id for each lane.
#[inline(always)]
pub(super) unsafe fn prefetch_rows<L: Lanes, T>(_: L, rows: *const T, list: *const u32) {
    const { assert!(size_of::<T>() == ROW_BYTES) };
    for part in 0..L::LANES / WIDTH {
        let mut addresses = [rows; WIDTH];
        for (lane, address) in addresses.iter_mut().enumerate() {
            // SAFETY: the caller's contract (invariant 2).
            *address = rows.wrapping_byte_add(unsafe { *list.add(part * WIDTH + lane) } as usize);
        }
        Prefetch::First.each(addresses);
    }
}

/// Visitor of the pending lists and pairs of an octant.
pub(super) trait Visitor {
    /// Makes the next visits of an octant; `false` if none were pending.
    ///
    /// # Safety
    /// The invariants hold for the stack.
    unsafe fn step(&self, octant: usize, stack: &mut OctantStack) -> bool;
}
