//! The binary trees as the kernels read them.

use super::layout::{EXTENT_MARGIN, LAST, LEAF, LEAF_TRIANGLES, MASKED, Member, Node, Triangle};
use crate::bvh::{Binary, Bvh};
use crate::geom::{Aabb, MAX_COORDINATE, Placement};
use glam::Vec3;
use std::collections::HashMap;
use std::sync::Arc;

/// A scene's trees: one of triangles; or one over members, and theirs.
pub(super) struct Trees<'a> {
    bvh: &'a Bvh,
    top: Binary,
    /// The trees of members, each once.
    below: Vec<(&'a Bvh, Binary)>,
    /// Which of them each member has.
    trees: Vec<usize>,
}

/// Nodes in depth-first order, the root first; triangles in leaf order. Members' trees follow each other.
#[derive(Debug, Default)]
pub(super) struct Flat {
    pub nodes: Vec<Node>,
    pub triangles: Vec<Triangle>,
    pub members: Vec<Member>,
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

/// Number of inner nodes when subtrees of at most `most` become leaves.
fn inner_nodes(binary: &Binary, most: usize) -> usize {
    binary.nodes().iter().filter(|node| node.count as usize > most).count()
}

impl<'a> Trees<'a> {
    pub fn of(bvh: &'a Bvh) -> Self {
        let (mut below, mut trees, mut places) = (Vec::new(), Vec::new(), HashMap::new());
        for member in bvh.members() {
            let place = places.entry(Arc::as_ptr(&member.tree)).or_insert_with(|| {
                below.push((&*member.tree, member.tree.binary()));
                below.len() - 1
            });
            trees.push(*place);
        }
        Self { bvh, top: bvh.binary(), below, trees }
    }

    /// The most that the top makes a leaf of.
    fn top_leaf(&self) -> usize {
        if self.below.is_empty() { LEAF_TRIANGLES } else { 1 }
    }

    /// Number of nodes that [`Trees::flatten`] makes.
    pub fn nodes(&self) -> usize {
        let below = self.below.iter().map(|(_, binary)| inner_nodes(binary, LEAF_TRIANGLES));
        inner_nodes(&self.top, self.top_leaf()).max(1) + below.sum::<usize>()
    }

    /// Number of triangles that it makes.
    pub fn triangles(&self) -> usize {
        match self.below[..] {
            [] => self.bvh.len(),
            ref below => below.iter().map(|(tree, _)| tree.len()).sum(),
        }
    }

    /// Lays the trees out. Subtrees of at most [`LEAF_TRIANGLES`] become leaves, and so does each member above.
    pub fn flatten(&self) -> Flat {
        let mut flat = Flat {
            nodes: Vec::with_capacity(self.nodes()),
            triangles: Vec::with_capacity(self.triangles()),
            ..Flat::default()
        };
        let member = |_: &mut Flat, index: usize| LEAF | self.top.nodes()[index].index;
        let root = match self.below[..] {
            [] => flat.lay(&self.top, LEAF_TRIANGLES, triangle_leaf(self.bvh, &self.top)),
            _ => flat.lay(&self.top, 1, member),
        };
        // The root is a node, even if it has fewer children than two.
        match root {
            Some((reference, bounds)) if reference & LEAF != 0 => {
                flat.nodes.push(join((reference, bounds), ABSENT));
            }
            Some(_) => {}
            None => flat.nodes.push(join(ABSENT, ABSENT)),
        }
        let above = flat.stack;
        let roots: Vec<u32> = self
            .below
            .iter()
            .map(|(tree, binary)| {
                let root = flat.lay(binary, LEAF_TRIANGLES, triangle_leaf(tree, binary));
                root.expect("members have triangles").0
            })
            .collect();
        if !roots.is_empty() {
            flat.stack += above;
        }
        flat.members.extend(self.bvh.members().iter().zip(&self.trees).map(|(member, &tree)| {
            let rows = member.placement.unwrap_or(Placement::HERE).rows;
            let column = |i: usize| rows.map(|row| row[i]);
            Member {
                x: column(0),
                root: roots[tree],
                y: column(1),
                first: member.first,
                z: column(2),
                spare_0: 0,
                shift: column(3),
                spare_1: 0,
            }
        }));
        flat
    }
}

/// Lays out the triangles of a subtree of a tree.
fn triangle_leaf(bvh: &Bvh, binary: &Binary) -> impl Fn(&mut Flat, usize) -> u32 {
    |flat, index| {
        let first = flat.triangles.len() as u32;
        let nodes = binary.nodes();
        let below = &nodes[index..index + 2 * nodes[index].count as usize - 1];
        flat.triangles.extend(below.iter().filter(|node| node.is_leaf()).map(|leaf| record(bvh, leaf.index)));
        if let Some(last) = flat.triangles.last_mut() {
            last.flags |= LAST;
        }
        LEAF | first
    }
}

impl Flat {
    /// Lays a tree out behind what there is; `leaf` lays out a subtree of at most `most` and gives the reference. The
    /// answer is the root as a parent would refer to it.
    fn lay(&mut self, binary: &Binary, most: usize, leaf: impl Fn(&mut Self, usize) -> u32) -> Option<Child> {
        let nodes = binary.nodes();
        let root = nodes.first()?;
        if root.count as usize <= most {
            return Some((leaf(self, 0), root.bounds()));
        }
        let start = self.nodes.len();
        let mut open = vec![Open { index: 0, parent: None, above: 0 }];
        while let Some(Open { index, parent, above }) = open.pop() {
            let place = self.nodes.len();
            match parent {
                Some((parent, true)) => self.nodes[parent].right = place as u32,
                Some((parent, false)) => self.nodes[parent].left = place as u32,
                None => {}
            }
            self.stack = self.stack.max(above + 1);
            let children = binary.children(index).map(|child| {
                let inner = nodes[child].count as usize > most;
                (if inner { 0 } else { leaf(self, child) }, nodes[child].bounds())
            });
            self.nodes.push(join(children[0], children[1]));
            let [left, right] = binary.children(index);
            for (index, is_right) in [(right, true), (left, false)] {
                if nodes[index].count as usize > most {
                    open.push(Open { index, parent: Some((place, is_right)), above: above + 1 });
                }
            }
        }
        Some((start as u32, root.bounds()))
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
        extent: longest * EXTENT_MARGIN,
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
            let trees = Trees::of(&bvh);
            let flat = trees.flatten();
            assert_eq!((flat.nodes.len(), flat.triangles.len()), (trees.nodes(), bvh.len()));
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
        let flat = Trees::of(&bvh).flatten();
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
