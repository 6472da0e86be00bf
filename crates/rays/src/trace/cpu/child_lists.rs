//! A visit's result: a list of rays for each child of a node, written side by side and pushed as pending visits.
//!
//! Unsafe code for lists and entries. Invariants 2, 3, 4 and 6 are those of `substream`, and:
//! 7. The lists of a node's children begin in the arena where [`ChildLists::start`] says, which has room for them.
#![allow(unsafe_code, reason = "the invariants above")]

use super::pair_stack::MAX_PAIRED_LIST;
use super::substream::{Entry, OctantStack};
use super::tree_view::TreeView;
use super::visit_order::VisitOrder;
use crate::bvh::{WIDTH, WideNode};
use crate::lanes::{Lanes, MAX_LANES};

/// Lists of a node's children that a visit writes: beyond the visiting list, each with room for all of its ids and
/// padding. The lowest list is that of the child that is visited last.
#[derive(Clone, Copy)]
pub(super) struct ChildLists {
    base: usize,
    stride: usize,
    order: VisitOrder,
}

impl ChildLists {
    /// The lists of a visit by `entry`; makes room for them.
    #[inline(always)]
    pub fn reserve(stack: &mut OctantStack, entry: Entry, order: VisitOrder) -> Self {
        let stride = entry.len as usize + MAX_LANES;
        let base = entry.start as usize + stride;
        stack.reserve(base + WIDTH * stride + MAX_LANES);
        Self { base, stride, order }
    }

    /// Index of the start of a slot's list in the arena.
    #[inline(always)]
    fn start(&self, slot: usize) -> usize {
        self.base + (WIDTH - 1 - self.order.rank(slot)) * self.stride
    }

    /// The ends of the lists, in an arena that starts at `ids`, while they are empty.
    #[inline(always)]
    pub fn ends(&self, ids: *mut u32) -> [*mut u32; WIDTH] {
        let mut ends = [ids; WIDTH];
        for (slot, end) in ends.iter_mut().enumerate() {
            *end = ids.wrapping_add(self.start(slot));
        }
        ends
    }

    /// Pads each list that is not empty and pushes its visit. Prefetches the children if `PREFETCH`. The rays of short
    /// lists become pairs instead if `PAIRS`.
    ///
    /// # Safety
    /// The lists end at `ends` (invariant 7), and invariants 3, 4 and 6 hold.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub unsafe fn push<W: Lanes, const PAIRS: bool, const PREFETCH: bool>(
        &self,
        w: W,
        tree: &TreeView<'_>,
        node: &WideNode,
        stack: &mut OctantStack,
        ends: &[*mut u32; WIDTH],
    ) {
        let ids = stack.arena.as_mut_ptr();
        let mut filled = 0;
        for (slot, &end) in ends.iter().enumerate() {
            let start = ids.wrapping_add(self.start(slot));
            filled |= u32::from(end != start) << self.order.rank(slot);
        }
        if PAIRS {
            stack.node_pairs.reserve(WIDTH * MAX_LANES);
            stack.block_pairs.reserve(WIDTH * MAX_LANES);
        }
        let entries = stack.entries.as_mut_ptr();
        let mut top = stack.entries.len();
        while filled != 0 {
            let rank = filled.ilog2();
            filled &= !(1 << rank);
            let slot = self.order.slot(rank as usize);
            let (child, start) = (node.children[slot], self.start(slot));
            // SAFETY: invariant 7 for the list, 3 for the entry, 6 for pairs.
            unsafe {
                let list = ids.add(start);
                let len = ends[slot].offset_from_unsigned(list);
                // Both an entry and pairs are written, which saves a branch: what is kept is decided by which stack
                // grows.
                let entry = Entry { child, start: start as u32, len: len as u32, done_before: stack.done };
                entries.add(top).write(entry);
                let paired = PAIRS && len <= MAX_PAIRED_LIST;
                top += usize::from(!paired);
                // The list is read before padding is written over its end: a read that overlaps several writes in
                // flight waits for them.
                if PAIRS {
                    let pairs = if child.is_block() { &mut stack.block_pairs } else { &mut stack.node_pairs };
                    pairs.push_list(w, list, child, if paired { len } else { 0 });
                }
                pad(w, ends[slot]);
            }
            if PREFETCH {
                tree.prefetch_child(child);
            }
        }
        // SAFETY: invariant 3; the entries up to `top` were written.
        unsafe { stack.entries.set_len(top) };
    }
}

/// Writes padding: the id of the sub-stream's first ray.
///
/// # Safety
/// `to` is good for writing `MAX_LANES` ids.
#[inline(always)]
unsafe fn pad<W: Lanes>(w: W, to: *mut u32) {
    for part in 0..MAX_LANES / W::LANES {
        // SAFETY: the caller's contract (invariant 7).
        unsafe { w.store_u32(to.add(part * W::LANES), w.splat_u32(0)) };
    }
}
