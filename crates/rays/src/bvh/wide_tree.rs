//! The eight-wide tree that rays traverse.

use super::child::{Child, WIDTH};
use super::child_order::ChildOrder;
use super::huge_pages::HugePages;
use super::leaf_block::{LeafBlock, LeafBlocks};
use crate::geom::Aabb;
use crate::lanes::{LaneTask, Lanes, SimdLevel, first_lanes, load};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, Ordering};

/// An inner node: the boxes and references of up to eight children, in 256 bytes.
///
/// Children are stored in ascending shadow order: the later the slot, the sooner an any-hit ray visits it,
/// wherever it comes from (see `shadow_order.rs`). Vacant slots come first; their boxes are inverted, so that
/// no ray enters them.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct WideNode {
    /// Box planes as `[lower, upper][axis][slot]`.
    pub faces: [[[f32; WIDTH]; 3]; 2],
    /// The child in each slot.
    pub children: [Child; WIDTH],
    /// The approximate front-to-back order for rays whose direction has the sign bits 0 to 3 (bit 0 is x).
    /// Read backwards it is the order for the opposite octants, 7 to 4.
    pub front_to_back: [ChildOrder; 4],
}

const _: () = assert!(size_of::<WideNode>() == 256);

impl WideNode {
    /// A node without children.
    pub const EMPTY: Self = Self {
        faces: [[[f32::INFINITY; WIDTH]; 3], [[f32::NEG_INFINITY; WIDTH]; 3]],
        children: [Child::NONE; WIDTH],
        front_to_back: [ChildOrder::FORWARD; 4],
    };

    /// Stores a child and its box in a slot.
    #[inline]
    pub(super) fn set(&mut self, slot: usize, bounds: Aabb, child: Child) {
        for axis in 0..3 {
            self.faces[0][axis][slot] = bounds.min[axis];
            self.faces[1][axis][slot] = bounds.max[axis];
        }
        self.children[slot] = child;
    }

    /// Sorts the children by ascending weights, which are given by slot.
    #[inline]
    pub(super) fn sort(&mut self, weights: &[f32; WIDTH]) {
        let unsorted = *self;
        let order = ChildOrder::ascending(weights);
        for rank in 0..WIDTH {
            let slot = (order.slots >> (3 * rank) & 7) as usize;
            self.set(rank, unsorted.bounds(slot), unsorted.children[slot]);
        }
    }

    /// Computes [`WideNode::front_to_back`] from the boxes: an octant's key is the box centre projected onto
    /// the octant's diagonal.
    pub(super) fn update_front_to_back(&mut self) {
        SimdLevel::run_eight(FrontToBack(self));
    }

    /// [`WideNode::update_front_to_back`] in a task.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn update_front_to_back_in<L: Lanes>(&mut self, l: L) {
        let half = l.splat(0.5);
        let (low, high) = (load(l, &self.faces[0]), load(l, &self.faces[1]));
        let centre = |axis: usize| l.add(l.mul(half, low[axis]), l.mul(half, high[axis]));
        let [x, y, z] = [centre(0), centre(1), centre(2)];
        // The centre of a vacant slot's box is NaN; vacant slots are the last.
        let (among, infinity) = (l.eq(first_lanes::<L>(WIDTH), x, x), l.splat(f32::INFINITY));
        for octant in 0..4 {
            let signed = |axis: usize, key: L::F| if octant >> axis & 1 == 1 { l.neg(key) } else { key };
            let key = l.add(l.add(signed(0, x), signed(1, y)), signed(2, z));
            self.front_to_back[octant] = ChildOrder::ascending_lanes(l, l.select(among, key, infinity));
        }
    }

    /// The union of the children's boxes. The inverted boxes of vacant slots add nothing.
    #[inline]
    pub(super) fn union_of_children(&self) -> Aabb {
        let mut bounds = Aabb::EMPTY;
        for slot in 0..WIDTH {
            bounds = bounds.union(self.bounds(slot));
        }
        bounds
    }

    /// [`WideNode::union_of_children`] in a task.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn union_in<L: Lanes>(&self, l: L) -> Aabb {
        let [x, y, z] = load(l, &self.faces[0]);
        let min = Vec3::new(l.lowest(x), l.lowest(y), l.lowest(z));
        let [x, y, z] = load(l, &self.faces[1]);
        Aabb { min, max: Vec3::new(l.highest(x), l.highest(y), l.highest(z)) }
    }

    /// The same node with its references to inner nodes raised by `nodes`, and those to leaf blocks by
    /// `blocks`.
    pub(super) fn with_offsets(&self, nodes: usize, blocks: usize) -> Self {
        let mut moved = *self;
        for child in &mut moved.children {
            *child = match *child {
                Child::NONE => Child::NONE,
                child if child.is_block() => child.offset(blocks),
                child => Child::node(child.index() + nodes),
            };
        }
        moved
    }

    /// The children that are leaf blocks.
    #[doc(hidden)]
    pub fn block_children(&self) -> impl Iterator<Item = Child> {
        self.children.into_iter().filter(|&child| child != Child::NONE && child.is_block())
    }

    /// The box of the child in a slot.
    #[inline]
    pub fn bounds(&self, slot: usize) -> Aabb {
        let corner = |[x, y, z]: &[[f32; WIDTH]; 3]| Vec3::new(x[slot], y[slot], z[slot]);
        Aabb { min: corner(&self.faces[0]), max: corner(&self.faces[1]) }
    }
}

/// Updates the orders of a node.
struct FrontToBack<'a>(&'a mut WideNode);

impl LaneTask for FrontToBack<'_> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) {
        self.0.update_front_to_back_in(l);
    }
}

/// The eight-wide tree: inner nodes and leaf blocks. Node 0 is the root and always exists. Children come
/// after their parents.
#[derive(Clone, Debug)]
pub struct WideTree {
    pub(super) nodes: HugePages<WideNode>,
    pub(super) blocks: LeafBlocks,
    pub(super) depth: usize,
}

impl WideTree {
    /// The inner nodes, the root first.
    #[inline]
    pub fn nodes(&self) -> &[WideNode] {
        &self.nodes
    }

    /// The leaf blocks.
    #[inline]
    pub fn blocks(&self) -> &LeafBlocks {
        &self.blocks
    }

    /// Bytes on the heap: inner nodes and leaf blocks.
    pub fn bytes(&self) -> usize {
        size_of_val(self.nodes()) + self.blocks.bytes()
    }

    /// All leaf blocks, in the order of their parents; none in a tree over instances.
    pub fn each_block(&self) -> impl Iterator<Item = LeafBlock<'_>> {
        self.nodes.iter().flat_map(WideNode::block_children).map(|child| self.blocks.get(child))
    }

    /// The leaf block that holds each of `count` triangles; `index` maps primitive ids to `0..count`. Runs on
    /// the current rayon pool.
    pub(super) fn blocks_of_triangles(
        &self,
        count: usize,
        index: impl Fn(u32) -> usize + Sync,
    ) -> Vec<Child> {
        let blocks: Vec<AtomicU32> =
            (0..count).into_par_iter().with_min_len(1 << 14).map(|_| AtomicU32::new(0)).collect();
        self.nodes.par_iter().with_min_len(1 << 8).flat_map_iter(WideNode::block_children).for_each(
            |child| {
                let block = self.blocks.get(child);
                for row in 0..block.len() {
                    blocks[index(block.primitive(row))].store(child.bits(), Ordering::Relaxed);
                }
            },
        );
        blocks.into_iter().map(|bits| Child::from_bits(bits.into_inner())).collect()
    }

    /// Number of inner nodes on the longest path from the root.
    #[inline]
    pub fn depth(&self) -> usize {
        self.depth
    }
}
