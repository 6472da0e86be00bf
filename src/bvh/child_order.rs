//! In which order rays meet the children of a node.

use super::wide_tree::WIDTH;
use bytemuck::{Pod, Zeroable};

/// An order of the slots of a node, read in both directions. What counts is three bits for each, the first lowest: the
/// octal digits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct ChildOrder {
    /// The turn of each slot.
    pub ranks: u32,
    /// The slot of each turn.
    pub slots: u32,
}

impl ChildOrder {
    /// Slot after slot.
    pub const FORWARD: Self = Self { ranks: 0o7654_3210, slots: 0o7654_3210 };

    /// The least key first, in the order of [`f32::total_cmp`], of equals the first slot.
    pub(super) fn ascending(keys: &[f32; WIDTH]) -> Self {
        let keys = keys.map(|key| {
            let bits = key.to_bits().cast_signed();
            bits ^ (bits >> 31 & i32::MAX)
        });
        // Without a branch, which would be guessed wrong.
        let mut turns = [0; WIDTH];
        for other in 0..WIDTH {
            for slot in 0..WIDTH {
                let before = if other < slot { keys[other] <= keys[slot] } else { keys[other] < keys[slot] };
                turns[slot] += u32::from(before);
            }
        }
        let (mut ranks, mut slots) = (0, 0);
        for (slot, turn) in (0..).zip(turns) {
            ranks |= turn << (3 * slot);
            slots |= slot << (3 * turn);
        }
        Self { ranks, slots }
    }

    /// Whether these are turns, each of one slot.
    pub(super) fn is_order(self) -> bool {
        let digit = |digits: u32, at: u32| digits >> (3 * at) & 7;
        (0..WIDTH as u32).all(|slot| digit(self.slots, digit(self.ranks, slot)) == slot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_go_up_with_keys_and_equals_stay_in_their_order() {
        let (infinite, nan) = (f32::INFINITY, f32::NAN);
        assert_eq!(ChildOrder::ascending(&[0.0; WIDTH]), ChildOrder::FORWARD);
        assert_eq!(
            ChildOrder::ascending(&[-1.0, -0.0, 0.0, 0.0, 1.0, infinite, infinite, nan]),
            ChildOrder::FORWARD
        );
        let turns = ChildOrder::ascending(&[3.0, infinite, -2.0, 3.0, infinite, -7.5, 0.0, 1e-40]);
        assert_eq!(turns, ChildOrder { ranks: 0o3207_5164, slots: 0o4130_7625 });
        assert!(turns.is_order());
        assert!(!ChildOrder { ranks: 0o3207_5165, ..turns }.is_order());
        assert!(!ChildOrder { slots: 0o4130_7622, ..turns }.is_order());
    }
}
