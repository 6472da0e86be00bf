//! In which order the children of a node are visited.

use crate::bvh::{WIDTH, WideNode};

/// A turn for each slot.
#[derive(Clone, Copy)]
pub(super) struct Order {
    /// The turn of each slot, an octal digit each.
    ranks: u32,
    /// The slot of each turn, likewise.
    slots: u32,
    /// What the turns that slots are told of differ by: all bits where it is the other way round.
    mirror: usize,
}

impl Order {
    /// For any hit: where it is found soonest.
    pub const LIKELY_FIRST: Self = Self { ranks: 0o0123_4567, slots: 0o0123_4567, mirror: 0 };

    /// For nearest hits: about as rays of an octant meet them.
    #[inline(always)]
    pub fn front_to_back(node: &WideNode, octant: usize) -> Self {
        let (mirror, all) = if octant < 4 { (0, 0) } else { (WIDTH - 1, 0o7777_7777) };
        let turns = node.front_to_back[octant ^ mirror];
        Self { ranks: turns.ranks ^ all, slots: turns.slots, mirror }
    }

    /// The turn of a slot.
    #[inline(always)]
    pub fn turn(self, slot: usize) -> usize {
        (self.ranks >> (3 * slot)) as usize % WIDTH
    }

    /// The slot whose turn it is.
    #[inline(always)]
    pub fn slot(self, turn: usize) -> usize {
        (self.slots >> (3 * (turn ^ self.mirror))) as usize % WIDTH
    }
}
