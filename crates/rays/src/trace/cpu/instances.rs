//! The traversal of a two-level tree: lists of rays visit the top-level nodes as in any tree, and each list that
//! reaches an instance is traced through the instance's tree before the next one.
//!
//! Unsafe code for visits. Invariants 1 to 7 are those of `substream` and `child_lists`. In the top-level tree a block
//! child is the index of an instance.
#![allow(unsafe_code, reason = "the invariants above")]

use super::instance_space::{InstanceSpace, Space, World};
use super::ray_lists::{RayVisitor, visit_node};
use super::substream::{Entry, OctantStack, SubStream, Visitor, Widths, entry_capacity};
use super::tree_view::TreeView;
use super::visit_order::VisitOrder;
use crate::bvh::{Child, TreeInstance};
use crate::lanes::{Lanes, MAX_LANES};

/// Makes all visits of the lists at the bottom of the arenas, which have `counts` ids. `local` is the stack for visits
/// of the instances' trees; it has none before and after.
///
/// # Safety
/// The invariants hold for the stacks and the lists. `instances` are those of the top-level tree that `top` is a view
/// of.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) unsafe fn traverse<W: Lanes, E: Lanes>(
    widths: Widths<W, E>,
    visits: &impl VisitInstance,
    top: &SubStream<'_>,
    instances: &[TreeInstance],
    stacks: &mut [OctantStack; 8],
    counts: &[usize; 8],
    local: &mut OctantStack,
) {
    let max_depth = instances.iter().map(|instance| instance.tree.wide().depth()).max().unwrap_or(0);
    local.entries.reserve(entry_capacity(max_depth));
    for octant in (0..8).filter(|&octant| counts[octant] > 0) {
        let stack = &mut stacks[octant];
        stack.push_root(counts[octant]);
        while let Some(entry) = stack.entries.pop() {
            if !entry.child.is_block() {
                // SAFETY: the caller's contract.
                unsafe {
                    let order = VisitOrder::front_to_back(top.tree.node(entry.child), octant);
                    visit_node::<_, _, _, false>(widths, World, top, order, octant, stack, entry);
                }
                continue;
            }
            let instance = &instances[entry.child.index()];
            let sub = SubStream { tree: TreeView::new(instance.tree.wide(), top.tree.filter), ..*top };
            copy_list(entry, stack, local);
            // SAFETY: the caller's contract; the copied list satisfies invariants 1 to 3.
            unsafe {
                match &instance.placement {
                    None => visits.visit_all(World, &sub, octant, local),
                    Some(placement) => {
                        local.moved.begin_visit();
                        let turned = instance.tree.turned(placement);
                        let space =
                            InstanceSpace::new(placement, instance.first_primitive, octant, turned.as_ref());
                        visits.visit_all(space, &sub, octant, local);
                    }
                }
            }
            stack.done = local.done;
        }
    }
}

/// Makes the list of an entry, with its padding, visit the root of an instance's tree.
fn copy_list(entry: Entry, stack: &OctantStack, local: &mut OctantStack) {
    let (start, len) = (entry.start as usize, entry.len as usize);
    local.reserve(len + 2 * MAX_LANES);
    local.arena[..len + MAX_LANES].copy_from_slice(&stack.arena[start..start + len + MAX_LANES]);
    local.done = stack.done;
    local.entries.push(Entry { child: Child::ROOT, start: 0, ..entry });
}

/// Visits the trees of instances.
pub(super) trait VisitInstance {
    /// Makes all pending visits of a stack in an instance's tree.
    ///
    /// # Safety
    /// The invariants hold for the stack.
    unsafe fn visit_all<S: Space>(
        &self,
        space: S,
        sub: &SubStream<'_>,
        octant: usize,
        stack: &mut OctantStack,
    );
}

/// Visits instances for nearest hits, or for any hit if `ANY`.
pub(super) struct HitVisits<W, E, const ANY: bool> {
    pub widths: Widths<W, E>,
}

impl<W: Lanes, E: Lanes, const ANY: bool> VisitInstance for HitVisits<W, E, ANY> {
    #[inline(always)]
    unsafe fn visit_all<S: Space>(
        &self,
        space: S,
        sub: &SubStream<'_>,
        octant: usize,
        stack: &mut OctantStack,
    ) {
        let visitor = RayVisitor::<W, E, S, ANY> { widths: self.widths, space, sub };
        // SAFETY: the caller's contract.
        while unsafe { visitor.step(octant, stack) } {}
    }
}
