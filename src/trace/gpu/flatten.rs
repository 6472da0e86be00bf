//! The binary tree as the kernels read it.

use super::layout::{LAST, LEAF, LEAF_TRIANGLES, MASKED, Node, Triangle};
use crate::bvh::{Binary, Bvh};
use crate::geom::{Aabb, MAX_COORDINATE};
use glam::Vec3;

/// Nodes in depth-first order, the root first; triangles in leaf order.
#[derive(Debug, Default)]
pub(super) struct Flat {
    pub nodes: Vec<Node>,
    pub triangles: Vec<Triangle>,
    /// The most entries a traversal has on its stack.
    pub stack: usize,
}

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

/// Number of inner nodes that [`flatten`] makes; it makes a triangle of each of the tree's.
pub(super) fn node_count(binary: &Binary) -> usize {
    binary.nodes().iter().filter(|node| node.count as usize > LEAF_TRIANGLES).count().max(1)
}

/// Lays the tree out. Subtrees of at most [`LEAF_TRIANGLES`] become leaves.
pub(super) fn flatten(bvh: &Bvh, binary: &Binary) -> Flat {
    let mut flat = Flat {
        nodes: Vec::with_capacity(node_count(binary)),
        triangles: Vec::with_capacity(bvh.len()),
        stack: 0,
    };
    let nodes = binary.nodes();
    match nodes.first() {
        Some(root) if root.count as usize > LEAF_TRIANGLES => {}
        Some(_) => {
            let root = flat.child(bvh, binary, 0);
            flat.nodes.push(join(root, ABSENT));
            return flat;
        }
        None => {
            flat.nodes.push(join(ABSENT, ABSENT));
            return flat;
        }
    }
    let mut open = vec![Open { index: 0, parent: None, above: 0 }];
    while let Some(Open { index, parent, above }) = open.pop() {
        let place = flat.nodes.len();
        match parent {
            Some((parent, true)) => flat.nodes[parent].right = place as u32,
            Some((parent, false)) => flat.nodes[parent].left = place as u32,
            None => {}
        }
        flat.stack = flat.stack.max(above + 1);
        let [left, right] = binary.children(index);
        let node = join(flat.child(bvh, binary, left), flat.child(bvh, binary, right));
        flat.nodes.push(node);
        for (index, is_right) in [(right, true), (left, false)] {
            if nodes[index].count as usize > LEAF_TRIANGLES {
                open.push(Open { index, parent: Some((place, is_right)), above: above + 1 });
            }
        }
    }
    flat
}

impl Flat {
    /// How a parent refers to a node of the binary tree; lays out its triangles if it is a leaf here.
    fn child(&mut self, bvh: &Bvh, binary: &Binary, index: usize) -> Child {
        let nodes = binary.nodes();
        let node = &nodes[index];
        let count = node.count as usize;
        if count > LEAF_TRIANGLES {
            return (0, node.bounds());
        }
        let first = self.triangles.len() as u32;
        let below = nodes[index..index + 2 * count - 1].iter().filter(|node| node.is_leaf());
        self.triangles.extend(below.map(|leaf| record(bvh, leaf.index)));
        if let Some(last) = self.triangles.last_mut() {
            last.flags |= LAST;
        }
        (LEAF | first, node.bounds())
    }
}

fn join(left: Child, right: Child) -> Node {
    Node {
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

fn record(bvh: &Bvh, primitive: u32) -> Triangle {
    let [v0, v1, v2] = bvh.corners(primitive);
    let longest = (v1 - v0).abs().max((v2 - v1).abs()).max((v0 - v2).abs()).max_element();
    Triangle {
        v0: v0.into(),
        primitive,
        v1: v1.into(),
        flags: if bvh.is_masked(primitive) { MASKED } else { 0 },
        v2: v2.into(),
        // Rounded up past the subtraction's own error.
        extent: longest * (1.0 + 4.0 * f32::EPSILON),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn build(count: u32) -> Bvh {
        let positions: Vec<Vec3> = (0..count)
            .flat_map(|i| {
                let p = Vec3::new((i * 7 % 31) as f32, (i * 13 % 17) as f32, (i * 5 % 23) as f32);
                [p, p + Vec3::X, p + Vec3::Y * 2.0]
            })
            .collect();
        let triangles: Vec<_> = (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        Bvh::build(&positions, &triangles, |p| p % 3 == 0)
    }

    /// Walks the layout as the kernels do, all boxes hit, the left or the right child first; returns
    /// the primitives met and the greatest height of the stack.
    fn walk(flat: &Flat, right_first: bool) -> (Vec<u32>, usize) {
        let (mut met, mut stack, mut highest, mut reference) = (Vec::new(), Vec::new(), 0, 0_u32);
        loop {
            if reference & LEAF == 0 {
                let node = flat.nodes[reference as usize];
                let present = |r, min: [f32; 3], max: [f32; 3]| (min[0] <= max[0]).then_some(r);
                let left = present(node.left, node.left_min, node.left_max);
                let right = present(node.right, node.right_min, node.right_max);
                let (near, far) = if right_first { (right, left) } else { (left, right) };
                if let Some(next) = near.or(far) {
                    if near.is_some() && far.is_some() {
                        stack.extend(far);
                        highest = highest.max(stack.len());
                    }
                    reference = next;
                    continue;
                }
            } else {
                let first = (reference & !LEAF) as usize;
                for triangle in &flat.triangles[first..] {
                    met.push(triangle.primitive);
                    if triangle.flags & LAST != 0 {
                        break;
                    }
                }
            }
            match stack.pop() {
                Some(next) => reference = next,
                None => return (met, highest),
            }
        }
    }

    #[test]
    fn every_triangle_is_reached_once_and_the_stack_suffices() {
        for count in [0, 1, 2, 3, 50, 1000] {
            let bvh = build(count);
            let binary = bvh.binary();
            let flat = flatten(&bvh, &binary);
            assert_eq!((flat.nodes.len(), flat.triangles.len()), (node_count(&binary), bvh.len()));
            for right_first in [false, true] {
                let (mut met, highest) = walk(&flat, right_first);
                met.sort_unstable();
                assert_eq!(met, (0..count).collect::<Vec<_>>());
                assert!(highest <= flat.stack, "{highest} entries, {} promised", flat.stack);
            }
            for t in &flat.triangles {
                assert_eq!(t.flags & MASKED != 0, t.primitive % 3 == 0);
                assert_eq!([t.v0, t.v1, t.v2].map(Vec3::from), bvh.corners(t.primitive));
                assert!(t.extent > 2.0 && t.extent < 2.001);
            }
        }
    }

    #[test]
    fn boxes_hold_the_triangles_below() {
        let bvh = build(300);
        let flat = flatten(&bvh, &bvh.binary());
        let mut stack = vec![(0, Aabb { min: Vec3::NEG_INFINITY, max: Vec3::INFINITY })];
        while let Some((reference, bounds)) = stack.pop() {
            if reference & LEAF != 0 {
                let t = &flat.triangles[(reference & !LEAF) as usize];
                assert!(bounds.contains(&Aabb::around([t.v0, t.v1, t.v2].map(Vec3::from))));
                continue;
            }
            let node = flat.nodes[reference as usize];
            for (child, min, max) in
                [(node.left, node.left_min, node.left_max), (node.right, node.right_min, node.right_max)]
            {
                let inner = Aabb { min: min.into(), max: max.into() };
                assert!(bounds.contains(&inner));
                stack.push((child, inner));
            }
        }
    }
}
