//! Stacks of ray-node pairs: a ray's id and the child that the ray visits next.
//!
//! Unsafe code for pushing vectors of pairs. Invariant 6 (numbered as in `substream`): both arrays of a stack hold
//! `len` pairs, and after `reserve` have room for as many more as asked for and for [`MAX_LANES`] beyond them.
#![allow(unsafe_code, reason = "the invariants above")]

use crate::bvh::Child;
use crate::lanes::{LaneBits, Lanes, MAX_LANES, both};

/// Lists of at most this many rays end: their rays go on as pairs.
pub(super) const MAX_PAIRED_LIST: usize = 12;

/// Pairs with inner nodes that are visited at once.
pub(super) const NODE_BATCH: usize = 32;

/// Pairs with leaf blocks that are visited at once.
pub(super) const BLOCK_BATCH: usize = 96;

/// Pending pairs with inner nodes that are visited before further lists; fewer cost hardly less than this many.
pub(super) const MIN_NODE_PAIRS: usize = 24;

/// Pending pairs with leaf blocks that are visited before further lists.
pub(super) const MIN_BLOCK_PAIRS: usize = 48;

/// A stack of pairs.
#[derive(Default)]
pub(super) struct PairStack {
    ids: Vec<u32>,
    children: Vec<u32>,
    len: usize,
}

impl PairStack {
    #[inline(always)]
    pub fn len(&self) -> usize {
        self.len
    }

    #[inline]
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Makes room for `more` pairs and for a vector beyond them.
    #[inline(always)]
    pub fn reserve(&mut self, more: usize) {
        if self.ids.len() < self.len + more + MAX_LANES {
            self.grow(more);
        }
    }

    #[cold]
    #[inline(never)]
    fn grow(&mut self, more: usize) {
        let len = (self.len + more + MAX_LANES).next_power_of_two();
        self.ids.resize(len, 0);
        self.children.resize(len, 0);
    }

    /// Pops the topmost `count` pairs, of at least so many, and returns where their ids and children lie. They remain
    /// there until pairs are pushed.
    #[inline(always)]
    pub fn pop(&mut self, count: usize) -> (*const u32, *const u32) {
        self.len -= count;
        self.at(self.len)
    }

    /// Pointers to the ids and to the children of pair `at` and of those above it.
    #[inline(always)]
    pub fn at(&self, at: usize) -> (*const u32, *const u32) {
        (self.ids.as_ptr().wrapping_add(at), self.children.as_ptr().wrapping_add(at))
    }

    /// The children of the pairs from `at` to the top.
    #[inline(always)]
    pub fn children_from(&self, at: usize) -> &[u32] {
        &self.children[at..self.len]
    }

    /// Pushes pairs of one child and the first `len` ids of a list, at most [`MAX_LANES`].
    ///
    /// # Safety
    /// Invariant 6, with room for `MAX_LANES` pairs. `list` is good for reading `MAX_LANES` ids.
    #[inline(always)]
    pub unsafe fn push_list<W: Lanes>(&mut self, w: W, list: *const u32, child: Child, len: usize) {
        for part in 0..MAX_LANES / W::LANES {
            let at = part * W::LANES;
            // SAFETY: invariant 6 and the caller's contract.
            unsafe {
                w.store_u32(self.ids.as_mut_ptr().add(self.len + at), w.load_u32(list.add(at)));
                w.store_u32(
                    self.children.as_mut_ptr().add(self.len + at),
                    w.splat_u32(bytemuck::cast(child)),
                );
            }
        }
        self.len += len;
    }

    /// Pushes the pairs in the lanes of a mask.
    ///
    /// # Safety
    /// Invariant 6, with room for `MAX_LANES` pairs.
    #[inline(always)]
    pub unsafe fn push_lanes<W: Lanes>(&mut self, w: W, mask: LaneBits, ids: W::I, children: W::I) {
        // SAFETY: invariant 6.
        unsafe {
            w.append(self.ids.as_mut_ptr().add(self.len), mask, ids);
            w.append(self.children.as_mut_ptr().add(self.len), mask, children);
        }
        self.len += mask.count_ones() as usize;
    }
}

/// One id in the first eight lanes, the other in the next eight. With eight lanes only the first counts.
#[inline(always)]
pub(super) fn splat_id_pair<L: Lanes>(l: L, ids: [u32; 2]) -> L::I {
    l.bits(l.splat_eights(both(ids, f32::from_bits)))
}
