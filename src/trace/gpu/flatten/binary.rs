//! The binary tree as the kernels read it.

use super::super::layout::BinaryNode;
use crate::bvh::FlatTree;
use crate::geom::{Aabb, MAX_COORDINATE};
use glam::Vec3;

/// Subtrees of at most so many triangles become leaves.
pub const LEAF_TRIANGLES: usize = 2;

/// A child as its parent refers to it.
type Child = (u32, Aabb);

/// A child that is not there: its box is inside out (with finite numbers, which kernels may rely on).
const ABSENT: Child = (0, Aabb { min: Vec3::splat(MAX_COORDINATE), max: Vec3::splat(-MAX_COORDINATE) });

/// An inner node still to be laid out.
struct Open {
    /// Its index in the binary tree.
    index: usize,
    /// Its parent's place, and whether it is the right child.
    parent: Option<(usize, bool)>,
    /// Inner nodes above it: each may leave one child on the stack.
    above: usize,
}

/// Lays a tree out behind what there is; `leaf` lays out a subtree of at most `most` and gives the reference. Gives
/// the root's reference and the entries of the stack. The root is a node, even if it has fewer children than two.
pub fn lay(
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
    let mut open = vec![Open { index: 0, parent: None, above: 0 }];
    while let Some(Open { index, parent, above }) = open.pop() {
        let place = out.len();
        match parent {
            Some((parent, true)) => out[parent].right = place as u32,
            Some((parent, false)) => out[parent].left = place as u32,
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
                open.push(Open { index, parent: Some((place, is_right)), above: above + 1 });
            }
        }
    }
    (start as u32, stack)
}

fn join(left: Child, right: Child) -> BinaryNode {
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
