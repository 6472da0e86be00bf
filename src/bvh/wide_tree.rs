//! The eight-wide tree.

use super::child_order::ChildOrder;
use super::huge_pages::Pages;
use super::leaf_block::{LeafBlock, LeafBlocks};
use crate::geom::Aabb;
use crate::lanes::Lanes;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, Ordering};

/// Children of a node.
pub const WIDTH: usize = 8;

/// A reference to a child, as it lies in a node: an inner node's index, or the place of a block with the number of its
/// triangles, or nothing. Blocks of a tree of placed trees stand for the members, by index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub struct Child(u32);

impl Child {
    /// The root of the tree.
    pub const ROOT: Self = Self(0);
    /// No child.
    pub const NONE: Self = Self(u32::MAX);
    /// The most inner nodes, and the most places for blocks, that a tree may have.
    pub const LIMIT: usize = (1 << 28) - 1;
    const LEAF: u32 = 1 << 31;

    /// An inner node.
    pub(super) fn node(index: usize) -> Self {
        assert!(index < Self::LIMIT);
        Self(index as u32)
    }

    /// A block of `triangles` ≥ 1.
    pub(super) fn block(index: usize, triangles: usize) -> Self {
        assert!(index < Self::LIMIT && (1..=super::BLOCK_TRIANGLES).contains(&triangles));
        Self(Self::LEAF | (triangles as u32 - 1) << 28 | index as u32)
    }

    /// The same block when all lie `by` places farther back.
    pub(super) fn behind(self, by: usize) -> Self {
        Self::block(self.index() + by, self.triangles())
    }

    /// Whether it is a block (of no consequence for [`Child::NONE`], whose box is never entered).
    pub fn is_block(self) -> bool {
        self.0 & Self::LEAF != 0
    }

    /// Index of the node or place of the block.
    pub fn index(self) -> usize {
        (self.0 & Self::LIMIT as u32) as usize
    }

    /// [`Child::index`] and [`Child::triangles`] of blocks, as they lie in nodes.
    #[inline(always)]
    pub(super) fn parts<L: Lanes>(l: L, children: L::I) -> (L::I, L::I) {
        let index = l.and_u32(children, l.splat_u32(Self::LIMIT as u32));
        let triangles = l.and_u32(l.shr_u32(children, 28), l.splat_u32(7));
        (index, l.add_u32(triangles, l.splat_u32(1)))
    }

    /// Number of triangles of a block.
    pub fn triangles(self) -> usize {
        (self.0 >> 28 & 7) as usize + 1
    }
}

/// An inner node: boxes and references of up to eight children. The later a slot, the sooner any hit is found in it,
/// wherever rays come from. Vacant slots are the first; their boxes are inverted, so that no ray enters them.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct WideNode {
    /// Faces as `[lower, upper][axis][slot]`.
    pub faces: [[[f32; WIDTH]; 3]; 2],
    /// What is in the slots.
    pub children: [Child; WIDTH],
    /// About front to back for rays whose directions have the sign bits 0 to 3 (x is bit 0), and back to front for the
    /// opposite ones, 7 to 4.
    pub front_to_back: [ChildOrder; 4],
}

const _: () = assert!(size_of::<WideNode>() == 256);

impl WideNode {
    /// A node without children.
    pub const VACANT: Self = Self {
        faces: [[[f32::INFINITY; WIDTH]; 3], [[f32::NEG_INFINITY; WIDTH]; 3]],
        children: [Child::NONE; WIDTH],
        front_to_back: [ChildOrder::FORWARD; 4],
    };

    /// Puts a child into a slot.
    pub(super) fn set(&mut self, slot: usize, bounds: Aabb, child: Child) {
        for axis in 0..3 {
            self.faces[0][axis][slot] = bounds.min[axis];
            self.faces[1][axis][slot] = bounds.max[axis];
        }
        self.children[slot] = child;
    }

    /// Puts the children of greater weights into later slots.
    pub(super) fn sort(&mut self, weights: &[f32; WIDTH]) {
        let from = *self;
        let turns = ChildOrder::ascending(weights);
        for turn in 0..WIDTH {
            let slot = (turns.slots >> (3 * turn) & 7) as usize;
            self.set(turn, from.bounds(slot), from.children[slot]);
        }
    }

    /// Finds out in which order rays meet the children: by the middles of their boxes, as far as they lie in the direction of
    /// the octant.
    pub(super) fn face_rays(&mut self) {
        for octant in 0..4 {
            let mut keys = [0.0; WIDTH];
            for axis in 0..3 {
                let sign = if octant >> axis & 1 == 1 { -0.5 } else { 0.5 };
                let [low, high] = [self.faces[0][axis], self.faces[1][axis]];
                for slot in 0..WIDTH {
                    keys[slot] += sign * low[slot] + sign * high[slot];
                }
            }
            // The middle of a vacant slot is no number.
            let last = |key: f32| if key.is_nan() { f32::INFINITY } else { key };
            self.front_to_back[octant] = ChildOrder::ascending(&keys.map(last));
        }
    }

    /// The box around all children; vacant slots are inverted and add nothing.
    pub(super) fn all_bounds(&self) -> Aabb {
        let lowest = self.faces[0].map(|axis| axis.into_iter().fold(f32::INFINITY, f32::min));
        let highest = self.faces[1].map(|axis| axis.into_iter().fold(f32::NEG_INFINITY, f32::max));
        Aabb { min: lowest.into(), max: highest.into() }
    }

    /// The node when its inner children, and those that are blocks, lie so many places farther back.
    pub(super) fn moved(&self, nodes: usize, blocks: usize) -> Self {
        let there = self.children.map(|child| match child {
            Child::NONE => child,
            child if child.is_block() => child.behind(blocks),
            child => Child::node(child.index() + nodes),
        });
        Self { children: there, ..*self }
    }

    /// The children that are blocks.
    pub(super) fn block_children(&self) -> impl Iterator<Item = Child> {
        self.children.into_iter().filter(|&child| child != Child::NONE && child.is_block())
    }

    /// The box of a slot.
    pub fn bounds(&self, slot: usize) -> Aabb {
        let corner = |side: usize| Vec3::from_array(self.faces[side].map(|axis| axis[slot]));
        Aabb { min: corner(0), max: corner(1) }
    }
}

/// The eight-wide tree: node 0 is the root, always there.
#[derive(Clone, Debug)]
pub struct WideTree {
    pub(super) nodes: Pages<WideNode>,
    pub(super) blocks: LeafBlocks,
    pub(super) depth: usize,
}

impl WideTree {
    /// Inner nodes, the root first.
    pub fn nodes(&self) -> &[WideNode] {
        &self.nodes
    }

    /// Blocks of triangles.
    pub fn blocks(&self) -> &LeafBlocks {
        &self.blocks
    }

    /// Bytes that traversal goes about in.
    pub fn bytes(&self) -> usize {
        size_of_val(self.nodes()) + self.blocks.bytes()
    }

    /// All blocks, one node's after the other's; none of a tree of placed trees.
    pub fn each_block(&self) -> impl Iterator<Item = LeafBlock<'_>> {
        self.nodes.iter().flat_map(WideNode::block_children).map(|child| self.blocks.get(child))
    }

    /// The block of each of `count` triangles, whose places among these `place` says. On the current rayon pool.
    pub(super) fn places(&self, count: usize, place: impl Fn(u32) -> usize + Sync) -> Vec<Child> {
        let places: Vec<AtomicU32> =
            (0..count).into_par_iter().with_min_len(1 << 14).map(|_| AtomicU32::new(0)).collect();
        self.nodes.par_iter().with_min_len(1 << 8).flat_map_iter(WideNode::block_children).for_each(
            |child| {
                let block = self.blocks.get(child);
                for row in 0..block.len() {
                    places[place(block.primitive(row))].store(child.0, Ordering::Relaxed);
                }
            },
        );
        places.into_iter().map(|place| Child(place.into_inner())).collect()
    }

    /// Inner nodes on the longest way down.
    pub fn depth(&self) -> usize {
        self.depth
    }
}
