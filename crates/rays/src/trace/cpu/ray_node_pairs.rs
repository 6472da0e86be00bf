//! Visits of inner nodes by single rays, as ray-node pairs.
//!
//! A list that has become so short that lanes would remain empty ends, and its rays become pairs: a ray and the child
//! that it visits next. An octant has one stack of pairs for inner nodes and one for leaf blocks. Pairs are visited in
//! batches. A visit has no branch that depends on its result, so the processor works on many pairs at once and predicts
//! nothing; mispredicted branches are what short lists spend most time on.
//!
//! Unsafe code for rows, nodes and pairs. Invariants 1, 4 and 6 are those of `substream`.
#![allow(unsafe_code, reason = "the invariants above")]

use super::instance_space::Space;
use super::pair_stack::{NODE_BATCH, splat_id_pair};
use super::slabs::{Faces, Slabs};
use super::substream::{OctantStack, SubStream, Widths};
use crate::bvh::{Child, WIDTH};
use crate::lanes::{Lanes, both, first_lanes, load_eights, splat_eights};

/// Visits the topmost pairs with inner nodes: tests each ray against the eight boxes of its node and pushes a pair for
/// each child that it enters, the child in the last slot on top, where a hit is likeliest. So many pairs are pending
/// that an order from front to back would cost more than it saves.
///
/// # Safety
/// Invariants 1, 4 and 6 hold for the stack, whose pairs are of rays of `octant`.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) unsafe fn visit_nodes<W: Lanes, E: Lanes, S: Space>(
    widths: Widths<W, E>,
    space: S,
    sub: &SubStream<'_>,
    octant: usize,
    stack: &mut OctantStack,
) {
    let Widths { wide: w, eight: e } = widths;
    let OctantStack { node_pairs, block_pairs, moved, .. } = stack;
    let count = node_pairs.len().min(NODE_BATCH);
    node_pairs.reserve(NODE_BATCH * WIDTH);
    block_pairs.reserve(NODE_BATCH * WIDTH);
    let (ids, children) = node_pairs.pop(count);
    let first_pushed = node_pairs.len();
    // A copy of the batch, for new pairs are written over it.
    let (mut batch_ids, mut batch_children) = ([0; NODE_BATCH], [0; NODE_BATCH]);
    // SAFETY: invariant 6: a whole batch can be read beyond the stack's top.
    unsafe {
        for i in 0..NODE_BATCH {
            (batch_ids[i], batch_children[i]) = (*ids.add(i), *children.add(i));
        }
    }
    // One pair in each eight lanes.
    let step = W::LANES / WIDTH;
    for i in (0..count).step_by(step) {
        // If there is no second pair, the first stands in for it.
        let pair = [i, (i + step).min(count) - 1];
        let [first, second]: [Child; 2] = both(pair, |i| bytemuck::cast(batch_children[i]));
        // SAFETY: invariant 4 for nodes, 1 for rows.
        let (nodes, a, b) = unsafe {
            let row = |i: usize| &*sub.rows.byte_add(batch_ids[i] as usize).cast_const();
            ([sub.tree.node(first), sub.tree.node(second)], row(pair[0]), row(pair[1]))
        };
        let slabs = Slabs::new(
            w,
            splat_eights(w, [a.inverse, b.inverse]),
            splat_eights(w, [a.shift, b.shift]),
            w.splat_eights([a.slack, b.slack]),
        );
        let mut spare = [[[0.0; WIDTH]; 3]; 2];
        let of_pair = [(first.index(), nodes[0]), (second.index(), nodes[1])];
        let boxes = space.boxes_of_pair(e, of_pair, moved, &mut spare);
        let faces = [Faces::new(boxes[0], octant), Faces::new(boxes[1], octant)];
        let among = first_lanes::<W>(WIDTH * (count - i));
        let entered = among & slabs.enter_boxes(w, &faces, w.splat_eights([a.limit, b.limit]));
        let children = load_eights(w, both(nodes, |node| bytemuck::cast_ref(&node.children)));
        // The sign bit of a child says that it is a leaf block.
        let (blocks, children) = (w.signs(children), w.bits(children));
        let rays = splat_id_pair(w, both(pair, |i| batch_ids[i]));
        // SAFETY: invariant 6.
        unsafe {
            node_pairs.push_lanes(w, entered & !blocks, rays, children);
            block_pairs.push_lanes(w, entered & blocks, rays, children);
        }
    }
    for &child in node_pairs.children_from(first_pushed) {
        sub.tree.prefetch_node(bytemuck::cast(child));
    }
}
