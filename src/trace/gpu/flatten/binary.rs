//! The binary tree as kernels read it.

use super::super::layout::BinaryNode;
use super::ChildBox;
use crate::bvh::FlatTree;
use crate::geom::{Aabb, MAX_COORDINATE};
use glam::Vec3;

/// Subtrees of at most this many triangles become leaves.
pub const LEAF_TRIANGLES: usize = 2;

/// A missing child: its box is inside out, with finite numbers, on which kernels may rely.
const ABSENT: ChildBox = (0, Aabb { min: Vec3::splat(MAX_COORDINATE), max: Vec3::splat(-MAX_COORDINATE) });

/// An inner node still to be appended.
struct Pending {
    /// Its index in the host's tree.
    index: usize,
    /// Its parent's index among the appended nodes, and whether it is the right child.
    parent: Option<(usize, bool)>,
    /// Inner nodes above it. A traversal may leave one child of each on its stack.
    above: usize,
}

/// Appends a tree; `leaf` appends a subtree of at most `most` leaves of the host's tree and returns its reference.
/// Returns the root's reference and the entries of a traversal's stack. The root is a node, even with fewer than two
/// children.
pub fn append_tree(
    binary: &FlatTree,
    most: usize,
    out: &mut Vec<BinaryNode>,
    mut leaf: impl FnMut(usize) -> u32,
) -> (u32, usize) {
    let nodes = binary.nodes();
    let start = out.len();
    let Some(root) = nodes.first() else {
        out.push(join(ABSENT, ABSENT));
        return (start as u32, 1);
    };
    if root.count as usize <= most {
        out.push(join((leaf(0), root.bounds()), ABSENT));
        return (start as u32, 1);
    }
    let mut stack = 0;
    let mut pending = vec![Pending { index: 0, parent: None, above: 0 }];
    while let Some(Pending { index, parent, above }) = pending.pop() {
        let node = out.len();
        match parent {
            Some((parent, true)) => out[parent].right = node as u32,
            Some((parent, false)) => out[parent].left = node as u32,
            None => {}
        }
        stack = stack.max(above + 1);
        let children = binary.children(index).map(|child| {
            let inner = nodes[child].count as usize > most;
            (if inner { 0 } else { leaf(child) }, nodes[child].bounds())
        });
        out.push(join(children[0], children[1]));
        let [left, right] = binary.children(index);
        for (index, is_right) in [(right, true), (left, false)] {
            if nodes[index].count as usize > most {
                pending.push(Pending { index, parent: Some((node, is_right)), above: above + 1 });
            }
        }
    }
    (start as u32, stack)
}

fn join(left: ChildBox, right: ChildBox) -> BinaryNode {
    BinaryNode {
        left_min: left.1.min.into(),
        left: left.0,
        left_max: left.1.max.into(),
        spare_0: 0,
        right_min: right.1.min.into(),
        right: right.0,
        right_max: right.1.max.into(),
        spare_1: 0,
    }
}
