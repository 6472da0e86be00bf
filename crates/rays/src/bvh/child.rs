//! A wide node's reference to one of its children.

use crate::lanes::Lanes;
use bytemuck::{Pod, Zeroable};

/// Number of children of a wide node.
pub const WIDTH: usize = 8;

/// The largest number of triangles in a leaf block. A [`Child`] stores their count in three bits.
pub const BLOCK_TRIANGLES: usize = 8;

/// A reference to a child, 32 bits as stored in a wide node: the index of an inner node, or the position of a
/// leaf block with its number of triangles, or nothing. In a tree over instances a leaf block stands for an
/// instance, and its position is the instance's index.
///
/// Bit 31 marks a leaf block, bits 28 to 30 hold its number of triangles less one, bits 0 to 27 the index or
/// position.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub struct Child(u32);

impl Child {
    /// The root of the tree.
    pub const ROOT: Self = Self(0);
    /// No child.
    pub const NONE: Self = Self(u32::MAX);
    /// The largest number of inner nodes, and of block positions, in a tree.
    pub const LIMIT: usize = (1 << 28) - 1;
    const LEAF: u32 = 1 << 31;

    /// An inner node.
    #[inline]
    pub(super) fn node(index: usize) -> Self {
        assert!(index < Self::LIMIT);
        Self(index as u32)
    }

    /// A leaf block of `triangles` ≥ 1 triangles.
    #[inline]
    pub(super) fn block(position: usize, triangles: usize) -> Self {
        assert!(position < Self::LIMIT && (1..=BLOCK_TRIANGLES).contains(&triangles));
        Self(Self::LEAF | (triangles as u32 - 1) << 28 | position as u32)
    }

    /// The same leaf block, `by` positions further on.
    #[inline]
    pub(super) fn offset(self, by: usize) -> Self {
        Self::block(self.index() + by, self.triangles())
    }

    /// True if this is a leaf block. Unspecified for [`Child::NONE`], whose box no ray enters.
    #[inline]
    pub fn is_block(self) -> bool {
        self.0 & Self::LEAF != 0
    }

    /// Index of the inner node, or position of the leaf block.
    #[inline]
    pub fn index(self) -> usize {
        (self.0 & Self::LIMIT as u32) as usize
    }

    /// Number of triangles of a leaf block, 1 to 8.
    #[inline]
    pub fn triangles(self) -> usize {
        (self.0 >> 28 & 7) as usize + 1
    }

    /// [`Child::index`] and [`Child::triangles`] in lanes, for children that are leaf blocks.
    #[inline(always)]
    pub(super) fn index_and_triangles<L: Lanes>(l: L, children: L::I) -> (L::I, L::I) {
        let index = l.and_u32(children, l.splat_u32(Self::LIMIT as u32));
        let triangles = l.and_u32(l.shr_u32(children, 28), l.splat_u32(7));
        (index, l.add_u32(triangles, l.splat_u32(1)))
    }

    /// The 32 bits.
    #[inline]
    pub(super) fn bits(self) -> u32 {
        self.0
    }

    /// The child whose bits these are.
    #[inline]
    pub(super) fn from_bits(bits: u32) -> Self {
        Self(bits)
    }
}
