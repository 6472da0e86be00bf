//! Rays that go on alone: a list that has become so short that lanes would stay empty ends, and its
//! rays become pairs of a ray and the child that it is to visit.
//!
//! Pairs of an octant lie on two stacks, one for nodes and one for blocks, and are taken several at
//! a time. What is done with one depends on no branch, so the processor works on all of them at once
//! and guesses nothing; that is what short lists cost most.
//!
//! Unsafe code for pairs, rows and nodes. The invariants are those of `substream`, and:
//! 5. The children of pairs are in range, as those of nodes are, and their ids are of rays of the
//!    sub-stream; candidates are pairs whose ids have a row of the block in the bits below [`super::substream::ROW_BYTES`].
//! 6. Both arrays of pairs hold `len` pairs and, after `reserve`, as many more as asked for.
#![allow(unsafe_code, reason = "the invariants above")]

use super::instance_space::Space;
use super::substream::{OctantStack, PADDING, SubStream, fetch_node, lanes_of};
use super::triangle::{Faces, Slabs};
use crate::bvh::{Child, WIDTH};
use crate::lanes::{Lanes, load_eights, splat_eights};

/// The longest lists that end, at nodes as at blocks.
pub(super) const SHORT: usize = 12;

/// Pairs of nodes that are visited in one go.
const NODES: usize = 32;

/// Pairs of blocks that are visited in one go.
pub(super) const BLOCKS: usize = 96;

/// Pairs of nodes and of blocks from which on lists have to wait for them: a few cost hardly less than these.
pub(super) const WORTH: [usize; 2] = [24, 48];

/// A stack of pairs.
#[derive(Default)]
pub(super) struct Pairs {
    ids: Vec<u32>,
    children: Vec<u32>,
    pub len: usize,
}

impl Pairs {
    /// Makes room for `more` pairs, and for what vectors write behind them.
    #[inline(always)]
    pub fn reserve(&mut self, more: usize) {
        if self.ids.len() < self.len + more + PADDING {
            self.grow(more);
        }
    }

    #[cold]
    #[inline(never)]
    fn grow(&mut self, more: usize) {
        let len = (self.len + more + PADDING).next_power_of_two();
        self.ids.resize(len, 0);
        self.children.resize(len, 0);
    }

    /// Where the ids and the children of pair `at` and those above it lie.
    #[inline(always)]
    pub fn at(&self, at: usize) -> (*const u32, *const u32) {
        (self.ids.as_ptr().wrapping_add(at), self.children.as_ptr().wrapping_add(at))
    }

    /// Pushes pairs of the first `len` ids of a list, at most `PADDING`, and one child.
    ///
    /// # Safety
    /// Invariant 6 with room for `PADDING`; `list` is a list.
    #[inline(always)]
    pub unsafe fn push_list<W: Lanes>(&mut self, w: W, list: *const u32, child: Child, len: usize) {
        for part in 0..PADDING / W::LANES {
            let at = part * W::LANES;
            // SAFETY: as the caller vouches.
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

    /// Pushes pairs of the lanes of a mask.
    ///
    /// # Safety
    /// Invariant 6 with room for `PADDING`.
    #[inline(always)]
    pub unsafe fn push_lanes<W: Lanes>(&mut self, w: W, mask: u32, ids: W::I, children: W::I) {
        // SAFETY: as the caller vouches.
        unsafe {
            w.append(self.ids.as_mut_ptr().add(self.len), mask, ids);
            w.append(self.children.as_mut_ptr().add(self.len), mask, children);
        }
        self.len += mask.count_ones() as usize;
    }
}

/// An id in each eight lanes.
#[inline(always)]
pub(super) fn ids_of_eights<L: Lanes>(l: L, ids: [u32; 2]) -> L::I {
    l.bits(l.splat_eights(ids.map(f32::from_bits)))
}

/// Visits the topmost pairs of nodes: tests each ray with the eight boxes of its node and pushes pairs
/// for those it enters, in the order of slots, the one where a hit is likeliest last. So many pairs are in the works that
/// an order from front to back would cost more than it saves.
#[inline(always)]
pub(super) fn visit<W: Lanes, E: Lanes, S: Space>(
    w: W,
    e: E,
    space: S,
    job: &SubStream<'_>,
    octant: usize,
    stack: &mut OctantStack,
) {
    let [nodes, blocks] = &mut stack.pairs;
    let count = nodes.len.min(NODES);
    nodes.len -= count;
    nodes.reserve(NODES * WIDTH);
    blocks.reserve(NODES * WIDTH);
    let nodes_before = nodes.len;
    // Those taken, apart: their place is pushed over.
    let (mut taken, mut at) = ([0; NODES], [0; NODES]);
    let (ids, children) = nodes.at(nodes.len);
    // SAFETY: invariants 5 and 6.
    unsafe {
        for i in 0..NODES {
            (taken[i], at[i]) = (*ids.add(i), *children.add(i));
        }
        // As many pairs at once as there are eights of lanes.
        let step = W::LANES / WIDTH;
        for i in (0..count).step_by(step) {
            // Behind the last pair it stands in for another.
            let two = [i, (i + step).min(count) - 1];
            let (first, second): (Child, Child) = (bytemuck::cast(at[two[0]]), bytemuck::cast(at[two[1]]));
            let visited = [job.nodes.get_unchecked(first.index()), job.nodes.get_unchecked(second.index())];
            let a = &*job.rows.byte_add(taken[two[0]] as usize).cast_const();
            let b = &*job.rows.byte_add(taken[two[1]] as usize).cast_const();
            let slabs = Slabs::new(
                w,
                splat_eights(w, [a.inverse, b.inverse]),
                splat_eights(w, [a.shift, b.shift]),
                w.splat_eights([a.slack, b.slack]),
            );
            let mut room = [[[[0.0; WIDTH]; 3]; 2]; 2];
            let [first, second] = &mut room;
            let faces = [
                Faces::of(space.boxes(e, visited[0], first), octant),
                Faces::of(space.boxes(e, visited[1], second), octant),
            ];
            let among = lanes_of::<W>(WIDTH * (count - i));
            let entered = among & slabs.enters_any(w, &faces, w.splat_eights([a.limit, b.limit]));
            let children = load_eights(w, visited.map(|node| bytemuck::cast_ref(&node.children)));
            let (leaves, children) = (w.signs(children), w.bits(children));
            let rays = ids_of_eights(w, two.map(|i| taken[i]));
            nodes.push_lanes(w, entered & !leaves, rays, children);
            blocks.push_lanes(w, entered & leaves, rays, children);
        }
    }
    for &child in &nodes.children[nodes_before..nodes.len] {
        fetch_node(job, bytemuck::cast(child));
    }
}
