//! The order in which a node's children are visited.

use crate::bvh::{WIDTH, WideNode};

/// A permutation of a node's slots: rank 0 is visited first. Rays of opposite octants read one stored
/// [`ChildOrder`](crate::bvh::ChildOrder) in opposite directions.
#[derive(Clone, Copy)]
pub(super) struct VisitOrder {
    /// The rank of each slot, one octal digit per slot.
    ranks: u32,
    /// The slot of each rank before mirroring, one octal digit per rank.
    slots: u32,
    /// XORed to a rank before `slots` is read: 7 if the stored order is reversed, else 0.
    mirror: usize,
}

impl VisitOrder {
    /// For any-hit queries: last slot first, in which some hit is likeliest.
    pub const LIKELY_FIRST: Self = Self { ranks: 0o0123_4567, slots: 0o0123_4567, mirror: 0 };

    /// For closest-hit queries: about front to back for rays of an octant.
    #[inline(always)]
    pub fn front_to_back(node: &WideNode, octant: usize) -> Self {
        let (mirror, all) = if octant < 4 { (0, 0) } else { (WIDTH - 1, 0o7777_7777) };
        let order = node.front_to_back[octant ^ mirror];
        Self { ranks: order.ranks ^ all, slots: order.slots, mirror }
    }

    /// The rank of a slot.
    #[inline(always)]
    pub fn rank(self, slot: usize) -> usize {
        (self.ranks >> (3 * slot)) as usize % WIDTH
    }

    /// The slot of a rank.
    #[inline(always)]
    pub fn slot(self, rank: usize) -> usize {
        (self.slots >> (3 * (rank ^ self.mirror))) as usize % WIDTH
    }
}
