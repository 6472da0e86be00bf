//! Checks the invariants of a tree.

use super::Bvh;
use super::binary_tree::MAX_DEPTH;
use super::child::{Child, WIDTH};
use crate::geom::Aabb;

/// An invariant that a tree violates.
#[derive(Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BvhError {
    /// A child's box is not inside its parent's.
    #[error("{tree} node {node}: the box of child {child} leaves the node's box")]
    Box {
        /// The tree: "wide", or "top" for the tree over instances.
        tree: &'static str,
        /// The parent.
        node: usize,
        /// The child or slot.
        child: usize,
    },
    /// A triangle is not inside the box of its leaf.
    #[error("triangle {primitive} leaves the box of its leaf in the {tree} tree")]
    Triangle {
        /// The tree: "wide", or "top" for the tree over instances.
        tree: &'static str,
        /// The triangle.
        primitive: u32,
    },
    /// A triangle is in no leaf or in several.
    #[error("triangle {primitive} is in {found} leaves of the {tree} tree, expected 1")]
    Occurrences {
        /// The tree: "wide", or "top" for the tree over instances.
        tree: &'static str,
        /// The triangle.
        primitive: u32,
        /// Number of leaves that hold it.
        found: u32,
    },
    /// A front-to-back order of a node is not a permutation of its eight slots.
    #[error("{tree} node {node}: the order of its slots is not a permutation")]
    Order {
        /// The tree: "wide", or "top" for the tree over instances.
        tree: &'static str,
        /// The node.
        node: usize,
    },
    /// A tree is too deep for the traversal stacks.
    #[error("the {tree} tree is {found} nodes deep, allowed are {allowed}")]
    Depth {
        /// The tree: "wide", or "top" for the tree over instances.
        tree: &'static str,
        /// Its depth.
        found: usize,
        /// The limit.
        allowed: usize,
    },
}

impl Bvh {
    /// Checks that the tree holds every triangle in exactly one leaf, that every box lies inside its parent's
    /// and around its triangles, that the front-to-back orders are permutations, and that the depth is at most
    /// [`MAX_DEPTH`]. In a tree over instances the instances' trees are checked, too.
    ///
    /// # Errors
    /// The first violation found.
    pub fn validate(&self) -> Result<(), BvhError> {
        if self.instances.is_some() {
            return self.validate_instances();
        }
        self.validate_wide()
    }

    /// Checks the instances' trees, and that the boxes above them hold every moved triangle.
    fn validate_instances(&self) -> Result<(), BvhError> {
        let tree = "top";
        let everything = Aabb { min: glam::Vec3::NEG_INFINITY, max: glam::Vec3::INFINITY };
        let mut found = vec![0; self.instances().len()];
        let mut stack = vec![(0, everything)];
        while let Some((node, outer)) = stack.pop() {
            let inner = &self.wide.nodes()[node];
            for slot in (0..WIDTH).filter(|&slot| inner.children[slot] != Child::NONE) {
                let (child, bounds) = (inner.children[slot], inner.bounds(slot));
                if !outer.contains(&bounds) {
                    return Err(BvhError::Box { tree, node, child: slot });
                }
                if !child.is_block() {
                    stack.push((child.index(), bounds));
                    continue;
                }
                found[child.index()] += 1;
                let instance = &self.instances()[child.index()];
                for index in 0..instance.tree.len() as u32 {
                    let primitive = instance.first_primitive + instance.tree.ids.primitive(index);
                    self.validate_triangle(tree, primitive, &bounds)?;
                }
            }
        }
        self.instances().iter().try_for_each(|instance| instance.tree.validate())?;
        once_each(tree, &found)
    }

    fn validate_wide(&self) -> Result<(), BvhError> {
        let tree = "wide";
        let everything = Aabb { min: glam::Vec3::NEG_INFINITY, max: glam::Vec3::INFINITY };
        let mut found = vec![0; self.len()];
        let mut stack = vec![(0, everything, 1)];
        let mut deepest = 0;
        while let Some((node, outer, depth)) = stack.pop() {
            deepest = deepest.max(depth);
            let inner = &self.wide.nodes()[node];
            if !inner.front_to_back.iter().all(|order| order.is_permutation()) {
                return Err(BvhError::Order { tree, node });
            }
            for slot in (0..WIDTH).filter(|&slot| inner.children[slot] != Child::NONE) {
                let (child, bounds) = (inner.children[slot], inner.bounds(slot));
                if !outer.contains(&bounds) {
                    return Err(BvhError::Box { tree, node, child: slot });
                }
                if !child.is_block() {
                    stack.push((child.index(), bounds, depth + 1));
                    continue;
                }
                let block = self.wide.blocks().get(child);
                for row in 0..child.triangles() {
                    found[self.ids.index(block.primitive(row))] += 1;
                    self.validate_triangle(tree, block.primitive(row), &bounds)?;
                }
            }
        }
        if deepest != self.wide.depth() || deepest > MAX_DEPTH {
            return Err(BvhError::Depth { tree, found: deepest, allowed: self.wide.depth().min(MAX_DEPTH) });
        }
        once_each(tree, &found)
    }

    fn validate_triangle(&self, tree: &'static str, primitive: u32, leaf: &Aabb) -> Result<(), BvhError> {
        let inside = leaf.contains(&Aabb::around(self.corners(primitive)));
        if inside { Ok(()) } else { Err(BvhError::Triangle { tree, primitive }) }
    }
}

fn once_each(tree: &'static str, found: &[u32]) -> Result<(), BvhError> {
    match found.iter().position(|&n| n != 1) {
        Some(i) => Err(BvhError::Occurrences { tree, primitive: i as u32, found: found[i] }),
        None => Ok(()),
    }
}
