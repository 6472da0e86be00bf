//! A BVH2 as the kernels read it.

use super::layout::{LAST, LEAF, MASKED, Node, Triangle};
use crate::geom::MAX_COORDINATE;
use glam::Vec3;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;

/// Nodes in depth-first order, the root first; triangles in leaf order.
#[derive(Debug)]
pub(super) struct Flat {
    pub nodes: Vec<Node>,
    pub triangles: Vec<Triangle>,
    /// The most entries a traversal has on its stack.
    pub stack: usize,
}

/// How many nodes and triangles [`flatten`] makes.
pub(super) fn counts(bvh2: &Bvh2) -> (usize, usize) {
    let inner = bvh2.nodes.iter().filter(|node| !node.is_leaf()).count();
    let triangles = bvh2.nodes.iter().map(|node| node.prim_count as usize).sum();
    (inner.max(1), triangles)
}

/// The reference and box of a child that is not there: nothing is inside.
const ABSENT: (u32, [f32; 3], [f32; 3]) = (0, [MAX_COORDINATE; 3], [-MAX_COORDINATE; 3]);

/// Lays the tree out. `corners` gives a primitive's vertices, `masked` whether alpha decides.
///
/// # Panics
/// If the tree is not one: a child out of range, or reached twice.
pub(super) fn flatten(
    bvh2: &Bvh2,
    corners: impl Fn(u32) -> [Vec3; 3],
    masked: impl Fn(u32) -> bool,
) -> Flat {
    let (inner, leaves) = counts(bvh2);
    let mut flat =
        Flat { nodes: Vec::with_capacity(inner), triangles: Vec::with_capacity(leaves), stack: 0 };
    let mut leaf = |node: &Bvh2Node, triangles: &mut Vec<Triangle>| -> u32 {
        let first = triangles.len() as u32;
        assert!(first < LEAF, "more triangles than references");
        let range = node.first_index as usize..(node.first_index + node.prim_count) as usize;
        triangles.extend(bvh2.primitive_indices[range].iter().map(|&primitive| {
            let flags = if masked(primitive) { MASKED } else { 0 };
            record(primitive, corners(primitive), flags)
        }));
        if let Some(last) = triangles.last_mut() {
            last.flags |= LAST;
        }
        LEAF | first
    };
    let bounds = |node: &Bvh2Node| -> ([f32; 3], [f32; 3]) { (node.aabb().min.into(), node.aabb().max.into()) };

    let Some(root) = bvh2.nodes.first() else {
        flat.nodes.push(join(ABSENT, ABSENT));
        return flat;
    };
    if root.is_leaf() {
        let (min, max) = bounds(root);
        let reference = leaf(root, &mut flat.triangles);
        flat.nodes.push(join((reference, min, max), ABSENT));
        return flat;
    }

    // Inner nodes still to be laid out: which, where its parent refers to it, and how many stack
    // entries a traversal may hold when it arrives there.
    let mut open = vec![(0_u32, None::<(usize, bool)>, 0_usize)];
    while let Some((index, parent, entries)) = open.pop() {
        let place = flat.nodes.len();
        assert!(place < inner, "a node is reached twice");
        match parent {
            Some((parent, true)) => flat.nodes[parent].right = place as u32,
            Some((parent, false)) => flat.nodes[parent].left = place as u32,
            None => {}
        }
        // Whichever child is farther waits on the stack while the other is visited.
        flat.stack = flat.stack.max(entries + 1);
        let first = bvh2.nodes[index as usize].first_index;
        let mut child = |index: u32| {
            let node = &bvh2.nodes[index as usize];
            let (min, max) = bounds(node);
            (if node.is_leaf() { leaf(node, &mut flat.triangles) } else { 0 }, min, max)
        };
        let (left, right) = (child(first), child(first + 1));
        flat.nodes.push(join(left, right));
        for (index, is_right) in [(first + 1, true), (first, false)] {
            if !bvh2.nodes[index as usize].is_leaf() {
                open.push((index, Some((place, is_right)), entries + 1));
            }
        }
    }
    flat
}

fn join(left: (u32, [f32; 3], [f32; 3]), right: (u32, [f32; 3], [f32; 3])) -> Node {
    Node {
        left_min: left.1,
        left: left.0,
        left_max: left.2,
        spare_0: 0,
        right_min: right.1,
        right: right.0,
        right_max: right.2,
        spare_1: 0,
    }
}

fn record(primitive: u32, [v0, v1, v2]: [Vec3; 3], flags: u32) -> Triangle {
    let longest = (v1 - v0).abs().max((v2 - v1).abs()).max((v0 - v2).abs()).max_element();
    Triangle {
        v0: v0.into(),
        primitive,
        v1: v1.into(),
        flags,
        v2: v2.into(),
        // Rounded up past the subtraction's own error.
        extent: longest * (1.0 + 4.0 * f32::EPSILON),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use obvhs::BvhBuildParams;
    use obvhs::bvh2::builder::build_bvh2_from_tris;
    use std::time::Duration;

    fn soup(count: u32) -> Vec<[Vec3; 3]> {
        (0..count)
            .map(|i| {
                let p = Vec3::new((i * 7 % 31) as f32, (i * 13 % 17) as f32, (i * 5 % 23) as f32);
                [p, p + Vec3::X, p + Vec3::Y * 2.0]
            })
            .collect()
    }

    fn build(corners: &[[Vec3; 3]]) -> Bvh2 {
        let triangles: Vec<_> = corners
            .iter()
            .map(|&[a, b, c]| obvhs::triangle::Triangle { v0: a.into(), v1: b.into(), v2: c.into() })
            .collect();
        build_bvh2_from_tris(&triangles, BvhBuildParams::medium_build(), &mut Duration::default())
    }

    /// Walks the layout as the kernels do, all boxes hit, the left or the right child first; returns
    /// the primitives met and the greatest height of the stack.
    fn walk(flat: &Flat, right_first: bool) -> (Vec<u32>, usize) {
        let (mut met, mut stack, mut highest, mut reference) = (Vec::new(), Vec::new(), 0, 0_u32);
        loop {
            if reference & LEAF == 0 {
                let node = flat.nodes[reference as usize];
                let present =
                    |r, min: [f32; 3], max: [f32; 3]| (min[0] <= max[0]).then_some(r);
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
            let corners = soup(count);
            let bvh2 = build(&corners);
            let flat = flatten(&bvh2, |p| corners[p as usize], |p| p % 3 == 0);
            assert_eq!((flat.nodes.len(), flat.triangles.len()), counts(&bvh2));
            for right_first in [false, true] {
                let (mut met, highest) = walk(&flat, right_first);
                met.sort_unstable();
                assert_eq!(met, (0..count).collect::<Vec<_>>());
                assert!(highest <= flat.stack, "{highest} entries, {} promised", flat.stack);
            }
            for t in &flat.triangles {
                assert_eq!(t.flags & MASKED != 0, t.primitive % 3 == 0);
                assert_eq!([t.v0, t.v1, t.v2], corners[t.primitive as usize].map(Vec3::to_array));
                assert!(t.extent > 2.0 && t.extent < 2.001);
            }
        }
    }

    #[test]
    #[should_panic(expected = "reached twice")]
    fn a_graph_that_is_no_tree_is_refused() {
        let corners = soup(50);
        let mut bvh2 = build(&corners);
        let inner = bvh2.nodes.iter().rposition(|n| !n.is_leaf()).expect("an inner node");
        bvh2.nodes[inner].first_index = bvh2.nodes[0].first_index;
        flatten(&bvh2, |p| corners[p as usize], |_| false);
    }
}
