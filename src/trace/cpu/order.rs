//! In which order the children of a node are visited.

use crate::bvh::{WIDTH, WideNode};
use crate::lanes::{Lanes, eight_ids};

/// A turn for each slot.
#[derive(Clone, Copy)]
pub(super) struct Order {
    /// The turn of each slot, an octal digit each.
    of_slots: u32,
    /// The slot of each turn, likewise.
    slots: u32,
    /// What the turns that slots are told of differ by: all bits where it is the other way round.
    mirror: usize,
}

impl Order {
    /// For any hit: where it is found soonest.
    pub const LIKELY_FIRST: Self = Self { of_slots: 0o0123_4567, slots: 0o0123_4567, mirror: 0 };

    /// For nearest hits: about as rays of an octant meet them.
    #[inline(always)]
    pub fn front_to_back(node: &WideNode, octant: usize) -> Self {
        let (mirror, all) = if octant < 4 { (0, 0) } else { (WIDTH - 1, 0o7777_7777) };
        let turns = node.front_to_back[octant ^ mirror];
        Self { of_slots: turns.of_slots ^ all, slots: turns.slots, mirror }
    }

    /// The turn of a slot.
    #[inline(always)]
    pub fn turn(self, slot: usize) -> usize {
        (self.of_slots >> (3 * slot)) as usize % WIDTH
    }

    /// The slot whose turn it is.
    #[inline(always)]
    pub fn slot(self, turn: usize) -> usize {
        (self.slots >> (3 * (turn ^ self.mirror))) as usize % WIDTH
    }
}

/// What [`Order::front_to_back`] makes of a node's children in lanes, the last turn first.
#[derive(Clone, Copy)]
pub(super) struct BackToFront<E: Lanes> {
    pair: usize,
    shifts: E::I,
}

impl<E: Lanes> BackToFront<E> {
    #[inline(always)]
    pub fn new(e: E, octant: usize) -> Self {
        let mirror = if octant < 4 { 0 } else { WIDTH - 1 };
        let shifts = if octant < 4 { &[21, 18, 15, 12, 9, 6, 3, 0] } else { &[0, 3, 6, 9, 12, 15, 18, 21] };
        Self { pair: octant ^ mirror, shifts: eight_ids(e, shifts) }
    }

    /// The slot of each lane, in its lowest three bits.
    #[inline(always)]
    pub fn slots(self, e: E, node: &WideNode) -> E::I {
        e.shr_each(e.splat_id(node.front_to_back[self.pair].slots), self.shifts)
    }
}
