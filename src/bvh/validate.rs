//! Does a tree keep its promises?

use super::{Bvh, Child, MAX_DEPTH, WIDTH};
use crate::geom::Aabb;

/// A promise that a tree breaks.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum BvhError {
    /// A child's box is not inside its parent's.
    #[error("{tree} node {node}: the box of child {child} leaves the node's box")]
    Box {
        /// Which of the trees.
        tree: &'static str,
        /// The parent.
        node: usize,
        /// The child or slot.
        child: usize,
    },
    /// A triangle leaves the box of its leaf.
    #[error("triangle {primitive} leaves the box of its leaf in the {tree} tree")]
    Triangle {
        /// Which of the trees.
        tree: &'static str,
        /// The triangle.
        primitive: u32,
    },
    /// A triangle is in no leaf or in several.
    #[error("triangle {primitive} is in {found} leaves of the {tree} tree, expected 1")]
    Occurrences {
        /// Which of the trees.
        tree: &'static str,
        /// The triangle.
        primitive: u32,
        /// In how many leaves it is.
        found: u32,
    },
    /// A node's turns are not those of eight slots.
    #[error("{tree} node {node}: the turns of its slots are no order")]
    Order {
        /// Which of the trees.
        tree: &'static str,
        /// The node.
        node: usize,
    },
    /// A tree is too deep for the traversal stacks.
    #[error("the {tree} tree is {found} nodes deep, allowed are {allowed}")]
    Depth {
        /// Which of the trees.
        tree: &'static str,
        /// Its depth.
        found: usize,
        /// The limit.
        allowed: usize,
    },
}

impl Bvh {
    /// Checks that both trees hold every triangle in exactly one leaf, that every box lies inside its
    /// parent's and around its triangles, that turns are orders, and that the depth is bounded.
    ///
    /// # Errors
    /// The first promise found broken.
    pub fn validate(&self) -> Result<(), BvhError> {
        if self.assembly.is_some() {
            return self.validate_members();
        }
        self.validate_binary()?;
        self.validate_wide()
    }

    /// Members' trees, and that the boxes above hold every moved triangle.
    fn validate_members(&self) -> Result<(), BvhError> {
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
                let member = &self.instances()[child.index()];
                for place in 0..member.tree.len() as u32 {
                    let primitive = member.first_primitive + member.tree.numbering.primitive(place);
                    self.validate_triangle(tree, primitive, &bounds)?;
                }
            }
        }
        self.instances().iter().try_for_each(|member| member.tree.validate())?;
        once_each(tree, &found)
    }

    fn validate_binary(&self) -> Result<(), BvhError> {
        let tree = "binary";
        let binary = self.to_flat_tree();
        let nodes = binary.nodes();
        let mut found = vec![0; self.len()];
        for (node, parent) in nodes.iter().enumerate() {
            if parent.is_leaf() {
                found[self.numbering.index(parent.index)] += 1;
                self.validate_triangle(tree, parent.index, &parent.bounds())?;
                continue;
            }
            for child in binary.children(node) {
                if !parent.bounds().contains(&nodes[child].bounds()) {
                    return Err(BvhError::Box { tree, node, child });
                }
            }
        }
        let depth = binary.depth();
        if depth > MAX_DEPTH {
            return Err(BvhError::Depth { tree, found: depth, allowed: MAX_DEPTH });
        }
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
            if !inner.front_to_back.iter().all(|turns| turns.is_order()) {
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
                    found[self.numbering.index(block.primitive(row))] += 1;
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
