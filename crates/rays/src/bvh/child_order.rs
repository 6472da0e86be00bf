//! The order in which rays visit the children of a wide node.

use super::child::WIDTH;
use crate::lanes::{Lanes, first_lanes, from_index, store_one};
use bytemuck::{Pod, Zeroable};

/// A permutation of a node's eight slots, stored in both directions. Each word holds eight numbers of three
/// bits, the first in the lowest bits: octal digits. The upper eight bits mean nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct ChildOrder {
    /// For each slot, when it is visited: 0 is first.
    pub ranks: u32,
    /// For each rank, the slot that has it.
    pub slots: u32,
}

impl ChildOrder {
    /// Slot 0 first, slot 7 last.
    pub const FORWARD: Self = Self { ranks: 0o7654_3210, slots: 0o7654_3210 };

    /// Orders the slots by ascending keys, as [`f32::total_cmp`] compares them. Of equal keys the lower slot
    /// comes first.
    #[inline(always)]
    pub(super) fn ascending(keys: &[f32; WIDTH]) -> Self {
        let keys: [i32; WIDTH] = from_index(|slot| {
            let bits = keys[slot].to_bits().cast_signed();
            bits ^ (bits >> 31 & i32::MAX)
        });
        // Counts smaller keys, without a branch: it would be mispredicted.
        let mut ranks_of_slots = [0_u32; WIDTH];
        for other in 0..WIDTH {
            for slot in 0..WIDTH {
                let (less, equal) = (keys[other] < keys[slot], keys[other] == keys[slot]);
                ranks_of_slots[slot] += u32::from(less) | (u32::from(equal) & u32::from(other < slot));
            }
        }
        let (mut ranks, mut slots) = (0, 0);
        for (slot, rank) in ranks_of_slots.iter().enumerate() {
            ranks |= rank << (3 * slot);
            slots |= (slot as u32) << (3 * rank);
        }
        Self { ranks, slots }
    }

    /// [`ChildOrder::ascending`] of keys in lanes, which are neither NaN nor -0.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn ascending_lanes<L: Lanes>(l: L, keys: L::F) -> Self {
        let (mut ranks, mut slots, of_slots) = (0, 0, store_one(l, keys));
        for (slot, key) in of_slots.into_iter().enumerate() {
            let key = l.splat(key);
            let up_to_slot = first_lanes::<L>(slot + 1);
            // Of equal keys those in higher slots are behind.
            let behind = l.lt(up_to_slot, key, keys) | l.le(first_lanes::<L>(WIDTH) ^ up_to_slot, key, keys);
            let rank = WIDTH as u32 - 1 - behind.count_ones();
            ranks |= rank << (3 * slot);
            slots |= (slot as u32) << (3 * rank);
        }
        Self { ranks, slots }
    }

    /// True if both words are permutations, each the inverse of the other.
    pub(super) fn is_permutation(self) -> bool {
        let digit = |digits: u32, at: u32| digits >> (3 * at) & 7;
        (0..WIDTH as u32).all(|slot| digit(self.slots, digit(self.ranks, slot)) == slot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::mix;
    use crate::lanes::{LaneTask, SimdLevel, load_one};

    struct InLanes([f32; WIDTH]);

    impl LaneTask for InLanes {
        type Output = ChildOrder;

        fn run<L: Lanes>(self, l: L) -> ChildOrder {
            ChildOrder::ascending_lanes(l, load_one(l, &self.0))
        }
    }

    #[test]
    fn orders_in_lanes_are_the_same() {
        for i in 0..5000 {
            // Few values, so that some are equal; at times vacant slots.
            let of_slot = |slot: u32| match mix(8 * i + slot) % 9 {
                8 => f32::INFINITY,
                value => value as f32 - 4.0,
            };
            let keys: [f32; WIDTH] = from_index(|slot| of_slot(slot as u32));
            let order = ChildOrder::ascending(&keys);
            assert_eq!(SimdLevel::run_eight(InLanes(keys)), order, "{keys:?}");
            assert!(order.is_permutation());
        }
    }

    #[test]
    fn ranks_ascend_with_keys_and_equal_keys_keep_their_order() {
        let (infinite, nan) = (f32::INFINITY, f32::NAN);
        assert_eq!(ChildOrder::ascending(&[0.0; WIDTH]), ChildOrder::FORWARD);
        assert_eq!(
            ChildOrder::ascending(&[-1.0, -0.0, 0.0, 0.0, 1.0, infinite, infinite, nan]),
            ChildOrder::FORWARD
        );
        let order = ChildOrder::ascending(&[3.0, infinite, -2.0, 3.0, infinite, -7.5, 0.0, 1e-40]);
        assert_eq!(order, ChildOrder { ranks: 0o3207_5164, slots: 0o4130_7625 });
        assert!(order.is_permutation());
        assert!(!ChildOrder { ranks: 0o3207_5165, ..order }.is_permutation());
        assert!(!ChildOrder { slots: 0o4130_7622, ..order }.is_permutation());
    }
}
