//! Parts of a tree that a traversal reads and prefetches.
//!
//! Unsafe code, because nodes and blocks are read without bounds checks. Invariant 4 (numbered as in `substream`):
//! children that a traversal visits are children of the tree's nodes, or its root. `Bvh` builds trees whose children
//! are in range, and vacant slots have inverted boxes, so no ray enters them.
#![allow(unsafe_code, reason = "the invariants above")]

use crate::bvh::{Child, Filter, LeafBlock, LeafBlocks, WideNode, WideTree};
use crate::lanes::Prefetch;
use crate::stream::Ray;
use std::hint;

/// A tree's nodes and leaf blocks, with the filter of its masked triangles.
#[derive(Clone, Copy)]
pub(crate) struct TreeView<'a> {
    nodes: &'a [WideNode],
    pub blocks: &'a LeafBlocks,
    pub filter: Option<&'a dyn Filter>,
    /// The cache that the tree's memory is prefetched into.
    prefetch: Prefetch,
}

impl<'a> TreeView<'a> {
    pub fn new(tree: &'a WideTree, filter: Option<&'a dyn Filter>) -> Self {
        Self {
            nodes: tree.nodes(),
            blocks: tree.blocks(),
            filter,
            prefetch: Prefetch::all_over(tree.bytes()),
        }
    }

    /// The node that a child is.
    ///
    /// # Safety
    /// Invariant 4, and the child is an inner node.
    #[inline(always)]
    pub unsafe fn node(&self, child: Child) -> &'a WideNode {
        // SAFETY: invariant 4.
        unsafe { self.nodes.get_unchecked(child.index()) }
    }

    /// The leaf block that a child is.
    ///
    /// # Safety
    /// Invariant 4, and the child is a block.
    #[inline(always)]
    pub unsafe fn block(&self, child: Child) -> LeafBlock<'a> {
        // SAFETY: invariant 4.
        unsafe { self.blocks.get_unchecked(child) }
    }

    /// True if a hit on a masked triangle counts.
    #[inline(always)]
    pub fn filter_accepts(&self, primitive: u32, u: f32, v: f32) -> bool {
        self.filter.is_none_or(|filter| filter.accepts(primitive, u, v))
    }

    /// Prefetches a node.
    #[inline(always)]
    pub fn prefetch_node(&self, child: Child) {
        let node = self.nodes.as_ptr().wrapping_add(child.index()).cast::<u8>();
        let line = |at| node.wrapping_add(at);
        self.prefetch.each([line(0), line(64), line(128), line(192)]);
    }

    /// Prefetches a leaf block and the ray that is to be tested with it.
    #[inline(always)]
    pub fn prefetch_block_and_ray(&self, child: Child, ray: *const Ray) {
        let [a, b, c, d] = self.block_lines(child);
        self.prefetch.each([a, b, c, d, ray.cast()]);
    }

    /// Prefetches a node or a leaf block.
    #[inline(always)]
    pub fn prefetch_child(&self, child: Child) {
        if child.is_block() {
            self.prefetch.each(self.block_lines(child));
        } else {
            self.prefetch_node(child);
        }
    }

    /// Prefetches a node or a leaf block into the nearest cache. There is no branch, which would be mispredicted where
    /// children are as often the one as the other. Four lines hold a node, and all but the largest blocks.
    #[inline(always)]
    pub fn prefetch_either(&self, child: Child) {
        let node = self.nodes.as_ptr().wrapping_add(child.index()).addr();
        let block = self.blocks.address(child).addr();
        let start = hint::select_unpredictable(child.is_block(), block, node);
        let line = |at| std::ptr::without_provenance::<u8>(start.wrapping_add(at));
        Prefetch::First.each([line(0), line(64), line(128), line(192)]);
    }

    /// Prefetches all children of a node.
    #[inline(always)]
    pub fn prefetch_children(&self, node: &WideNode) {
        for &child in &node.children {
            if child != Child::NONE {
                self.prefetch_child(child);
            }
        }
    }

    /// Addresses in the cache lines of a leaf block.
    #[inline(always)]
    fn block_lines(&self, child: Child) -> [*const u8; 4] {
        let block = self.blocks.address(child).cast::<u8>();
        let line = |at| block.wrapping_add(at);
        // The last is where large blocks continue; in smaller ones it lies in one of the first three lines.
        [line(0), line(64), line(128), line(24 * child.triangles())]
    }
}
