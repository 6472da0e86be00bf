//! Visits of nodes and leaf blocks by lists of rays, and their alternation with pairs.
//!
//! Unsafe code for rows, nodes and lists. Invariants 1 to 7 are those of `substream` and `child_lists`.
#![allow(unsafe_code, reason = "the invariants above")]

use super::child_lists::ChildLists;
use super::instance_space::Space;
use super::shaft::ShaftSlots;
use super::slabs::{Faces, Slabs};
use super::substream::{Entry, OctantStack, ROW_BYTES, SubStream, Visitor, Widths, prefetch_rows, ray_index};
use super::visit_order::VisitOrder;
use super::{leaf, ray_node_pairs};
use crate::bvh::WIDTH;
use crate::lanes::{LaneBits, Lanes, first_lanes};

/// Follows rays in lists of their ids, and in pairs where lists are short.
pub(super) struct RayVisitor<'a, W, E, S, const ANY: bool> {
    pub widths: Widths<W, E>,
    pub space: S,
    pub sub: &'a SubStream<'a>,
}

impl<W: Lanes, E: Lanes, S: Space, const ANY: bool> Visitor for RayVisitor<'_, W, E, S, ANY> {
    /// Pairs are visited first if there are enough of them: the lists below them profit from the hits.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn step(&self, octant: usize, stack: &mut OctantStack) -> bool {
        let Self { widths, space, sub } = *self;
        // SAFETY: the caller's contract.
        unsafe {
            if stack.has_block_batch() {
                leaf::test_pairs::<W, S, ANY>(widths.wide, space, sub, octant, stack);
            } else if stack.has_node_batch() {
                ray_node_pairs::visit_nodes(widths, space, sub, octant, stack);
            } else if let Some(entry) = stack.entries.pop() {
                self.visit(octant, stack, entry);
            } else if stack.candidates.len() > 0 {
                leaf::test_candidates::<W, S, ANY>(widths.wide, space, sub, octant, stack, 1);
            } else {
                return false;
            }
        }
        if stack.has_block_batch() {
            // Another octant takes its turn before these pairs are tested.
            leaf::prefetch_first_pairs(sub, stack);
        }
        true
    }
}

impl<W: Lanes, E: Lanes, S: Space, const ANY: bool> RayVisitor<'_, W, E, S, ANY> {
    /// Visits a node or a leaf block with the list of an entry.
    ///
    /// # Safety
    /// The invariants hold for the stack and the entry.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn visit(&self, octant: usize, stack: &mut OctantStack, mut entry: Entry) {
        let Self { widths, space, sub } = *self;
        if ANY && stack.done.wrapping_sub(entry.done_before) > entry.len / COMPACTION_SHARE {
            // SAFETY: invariants 1 and 2.
            entry.len = unsafe {
                let list = stack.arena.as_mut_ptr().add(entry.start as usize);
                compact(widths.wide, sub, list, entry.len)
            };
            if entry.len == 0 {
                return;
            }
        }
        // SAFETY: invariants 1 to 4.
        unsafe {
            if entry.child.is_block() {
                let block = sub.tree.block(entry.child);
                let list = stack.arena.as_mut_ptr().add(entry.start as usize);
                let len = entry.len as usize;
                let done = leaf::test_list::<W, E, S, ANY>(widths, space, sub, block, octant, list, len);
                stack.done = stack.done.wrapping_add(done);
            } else if ANY {
                let order = VisitOrder::LIKELY_FIRST;
                visit_node::<_, _, _, true>(widths, space, sub, order, octant, stack, entry);
            } else {
                let node = sub.tree.node(entry.child);
                let order = VisitOrder::front_to_back(node, space.order_octant(octant));
                visit_node::<_, _, _, true>(widths, space, sub, order, octant, stack, entry);
            }
        }
    }
}

/// A list of an any-hit query is compacted if more than one ray in this many may be done.
const COMPACTION_SHARE: u32 = 8;

/// Removes rays from a list that have become occluded since it was written, and returns its new length. The ids behind
/// its new end were in the list, so they serve as padding.
///
/// # Safety
/// `list` is a list of `len` ids (invariants 1 and 2).
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn compact<W: Lanes>(w: W, sub: &SubStream<'_>, list: *mut u32, len: u32) -> u32 {
    let (mut kept, mut at) = (0, 0);
    // SAFETY: invariants 1 and 2; what is written lies before what is read next.
    unsafe {
        let limits = sub.rows.cast_const().cast::<u32>().add(ROW_BYTES / 4 - 1);
        while at < len as usize {
            let ids = w.load_u32(list.add(at));
            let limit = w.from_bits(w.gather(limits, w.shr_u32(ids, 2)));
            let open = w.le(first_lanes::<W>(len as usize - at), w.splat(0.0), limit);
            w.append(list.add(kept), open, ids);
            kept += open.count_ones() as usize;
            at += W::LANES;
        }
    }
    kept as u32
}

/// Tests a list against the boxes of a node and pushes a list for each child that some ray enters. The rays of short
/// lists become pairs if `PAIRS`.
///
/// # Safety
/// The invariants hold for the stack and the entry, whose child is an inner node.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) unsafe fn visit_node<W: Lanes, E: Lanes, S: Space, const PAIRS: bool>(
    widths: Widths<W, E>,
    space: S,
    sub: &SubStream<'_>,
    order: VisitOrder,
    octant: usize,
    stack: &mut OctantStack,
    entry: Entry,
) {
    let Widths { wide: w, eight: e } = widths;
    let len = entry.len as usize;
    let lists = ChildLists::reserve(stack, entry, order);
    let ids = stack.arena.as_mut_ptr();
    let mut ends = lists.ends(ids);
    // SAFETY: invariant 4 for the node; 1 and 2 for the list and its rows; 7 for the children's lists, to which only
    // ids of the list are written; 3 and 6 for pushing.
    unsafe {
        let node = sub.tree.node(entry.child);
        let list = ids.add(entry.start as usize);
        let mut buffer = [[[0.0; WIDTH]; 3]; 2];
        let faces = Faces::new(space.boxes(e, entry.child.index(), node, &mut buffer), octant);
        debug_assert!(std::slice::from_raw_parts(list, len).is_sorted());
        let (first, last) = (ray_index(*list), ray_index(*list.add(len - 1)));
        if let Some(shafts) = ShaftSlots::new(e, sub.shafts, first, last, len, &faces, octant) {
            let boxes = faces.widened(e, shafts.widening, octant);
            // Widened boxes have the near faces first.
            let faces = Faces::new(&boxes, 0);
            // A copy that is indexed by slot, so that the other branch can keep the ends in registers.
            let mut slot_ends = ends;
            for at in (0..len).step_by(W::LANES) {
                let last = len.min(at + W::LANES) - 1;
                let mut slots = shafts.of_rays(ray_index(*list.add(at)), ray_index(*list.add(last)));
                if slots == 0 {
                    continue;
                }
                let rays = ListVector::load::<false>(w, sub, list, at, len);
                while slots != 0 {
                    let slot = slots.trailing_zeros() as usize % WIDTH;
                    slots &= slots - 1;
                    rays.append_entering(w, &faces, slot, &mut slot_ends[slot]);
                }
            }
            ends = slot_ends;
        } else {
            for at in (0..len).step_by(W::LANES) {
                let rays = ListVector::load::<true>(w, sub, list, at, len);
                for (slot, end) in ends.iter_mut().enumerate() {
                    rays.append_entering(w, &faces, slot, end);
                }
            }
        }
        lists.push::<W, PAIRS, true>(w, &sub.tree, node, stack, &ends);
    }
}

/// The rays of one vector of ids in a list.
pub(super) struct ListVector<W: Lanes> {
    among: LaneBits,
    ids: W::I,
    slabs: Slabs<W>,
    limit: W::F,
}

impl<W: Lanes> ListVector<W> {
    /// The rays from `at` on, with slack if `SLACK`, else for boxes that are widened. Prefetches the next vector's
    /// rows.
    ///
    /// # Safety
    /// `list` is a list of `len` ids, more than `at` (invariants 1 and 2).
    #[cfg_attr(not(unoptimised), inline(always))]
    pub unsafe fn load<const SLACK: bool>(
        w: W,
        sub: &SubStream<'_>,
        list: *const u32,
        at: usize,
        len: usize,
    ) -> Self {
        // SAFETY: invariants 1 and 2.
        unsafe {
            let [ix, iy, iz, sx, sy, sz, slack, limit] = w.rows(sub.rows.cast(), list.add(at));
            if at + W::LANES < len {
                prefetch_rows(w, sub.rows.cast_const(), list.add(at + W::LANES));
            }
            let (inverse, shift) = ([ix, iy, iz], [sx, sy, sz]);
            let slabs = if SLACK {
                Slabs::new(w, inverse, shift, slack)
            } else {
                Slabs::without_slack(inverse, shift)
            };
            Self { among: first_lanes::<W>(len - at), ids: w.load_u32(list.add(at)), slabs, limit }
        }
    }

    /// Appends the ids of the rays that enter the box of a slot.
    ///
    /// # Safety
    /// `end` is good for writing an id for each lane (invariant 7).
    #[inline(always)]
    pub unsafe fn append_entering(&self, w: W, faces: &Faces<'_>, slot: usize, end: &mut *mut u32) {
        let inside = self.slabs.enter_box(w, self.among, faces, slot, self.limit);
        // SAFETY: invariant 7.
        unsafe {
            w.append(*end, inside, self.ids);
            *end = end.add(inside.count_ones() as usize);
        }
    }
}
