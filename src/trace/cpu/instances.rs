//! The traversal of a tree of placed trees: lists of rays go down the tree over members as down any other, and each
//! list that reaches a member goes through that member's tree to the end.
//!
//! Unsafe code for lists. The invariants are those of `substream`; a block child of a node above is a member's index,
//! which `Bvh::from_instances` made.
#![allow(unsafe_code, reason = "the invariants above")]

use super::instance_space::{Own, Space, World};
use super::substream::{Entry, Loose, OctantStack, PADDING, SubStream, Visit, entries_of, inner};
use super::visit_order::Order;
use crate::bvh::{Child, TreeInstance};
use crate::lanes::{Lanes, Prefetch};

/// Visits everything with the lists at the bottom of the arenas, of `counts` lengths. `below` is empty before and
/// after.
#[inline(always)]
pub(super) fn traverse<W: Lanes, E: Lanes, const ANY: bool>(
    (w, e): (W, E),
    top: &SubStream<'_>,
    members: &[TreeInstance],
    stacks: &mut [OctantStack; 8],
    counts: &[usize; 8],
    below: &mut OctantStack,
) {
    let deepest = members.iter().map(|member| member.tree.wide().depth()).max().unwrap_or(0);
    below.entries.reserve(entries_of(deepest));
    for octant in (0..8).filter(|&octant| counts[octant] > 0) {
        let stack = &mut stacks[octant];
        stack.entries.push(Entry {
            child: Child::ROOT,
            start: 0,
            len: counts[octant] as u32,
            mark: stack.done,
        });
        while let Some(entry) = stack.entries.pop() {
            if !entry.child.is_block() {
                let order = Order::front_to_back(&top.nodes[entry.child.index()], octant);
                inner::<_, _, _, false>(w, e, World, top, order, octant, stack, entry);
                continue;
            }
            let member = &members[entry.child.index()];
            let wide = member.tree.wide();
            let (nodes, blocks) = (wide.nodes(), wide.blocks());
            let job = SubStream { nodes, blocks, prefetch: Prefetch::all_over(wide.bytes()), ..*top };
            let len = entry.len as usize;
            below.reserve(len + 2 * PADDING);
            let start = entry.start as usize;
            below.ids[..len + PADDING].copy_from_slice(&stack.ids[start..start + len + PADDING]);
            below.done = stack.done;
            below.entries.push(Entry { child: Child::ROOT, start: 0, ..entry });
            match &member.placement {
                None => through::<_, _, _, ANY>(w, e, World, &job, octant, below),
                Some(placement) => {
                    let own = Own::new(placement, member.first_primitive, octant);
                    through::<_, _, _, ANY>(w, e, own, &job, octant, below);
                }
            }
            stack.done = below.done;
        }
    }
}

/// Makes all visits that are pending.
#[inline(always)]
fn through<W: Lanes, E: Lanes, S: Space, const ANY: bool>(
    w: W,
    e: E,
    space: S,
    job: &SubStream<'_>,
    octant: usize,
    stack: &mut OctantStack,
) {
    let loose = Loose::<W, E, S, ANY> { w, e, space, job };
    while loose.step(octant, stack) {}
}
