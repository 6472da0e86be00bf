//! The binary tree in one array, for tracers that follow two children a node.

use super::binary_tree::{BinaryTree, Subtree};
use crate::geom::Aabb;
use bytemuck::{Pod, Zeroable};

/// A node of a [`FlatTree`], 32 bytes. The left child of node `i` is node `i + 1`. A subtree over `count`
/// primitives is the `2 * count - 1` nodes from its root on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct FlatNode {
    /// Lower corner of the box around the primitives below.
    pub min: [f32; 3],
    /// Index of the right child. For a leaf the primitive id, or in a tree over instances the index of an
    /// instance.
    pub index: u32,
    /// Upper corner of the box.
    pub max: [f32; 3],
    /// Number of primitives below; 1 for a leaf.
    pub count: u32,
}

impl FlatNode {
    /// True if the node is a leaf: one primitive.
    pub fn is_leaf(&self) -> bool {
        self.count == 1
    }

    /// The box.
    pub fn bounds(&self) -> Aabb {
        Aabb { min: self.min.into(), max: self.max.into() }
    }
}

/// A binary tree with one primitive a leaf, flattened in depth-first order as in PBRT. Empty if there are no
/// primitives.
#[derive(Clone, Debug, Default)]
pub struct FlatTree {
    nodes: Vec<FlatNode>,
}

impl FlatTree {
    /// Flattens a tree; `leaf_index` gives [`FlatNode::index`] of a leaf from its primitive.
    pub(super) fn of(tree: &BinaryTree, leaf_index: impl Fn(u32) -> u32) -> Self {
        let Some(root) = tree.root() else { return Self::default() };
        let mut nodes = vec![FlatNode::default(); 2 * root.count as usize - 1];
        flatten(tree, root, &mut nodes, 0);
        nodes.iter_mut().filter(|node| node.is_leaf()).for_each(|leaf| leaf.index = leaf_index(leaf.index));
        Self { nodes }
    }

    /// All nodes, the root first.
    pub fn nodes(&self) -> &[FlatNode] {
        &self.nodes
    }

    /// The indices of an inner node's two children.
    pub fn children(&self, node: usize) -> [usize; 2] {
        [node + 1, self.nodes[node].index as usize]
    }

    /// Number of nodes on the longest path from the root to a leaf; 0 for an empty tree.
    pub fn depth(&self) -> usize {
        let mut deepest = 0;
        let mut stack = Vec::from_iter((!self.nodes.is_empty()).then_some((0, 1)));
        while let Some((node, depth)) = stack.pop() {
            deepest = deepest.max(depth);
            if !self.nodes[node].is_leaf() {
                stack.extend(self.children(node).map(|child| (child, depth + 1)));
            }
        }
        deepest
    }
}

/// Writes a subtree to `nodes`; the first of them is node `start` of the tree.
fn flatten(tree: &BinaryTree, of: Subtree, nodes: &mut [FlatNode], start: u32) {
    let bounds = tree.bounds(of).to_aabb();
    let (root, below) = nodes.split_first_mut().expect("2 * count - 1 nodes");
    *root = FlatNode { min: bounds.min.into(), index: 0, max: bounds.max.into(), count: of.count };
    if of.count == 1 {
        root.index = tree.primitive(of);
        return;
    }
    let [left, right] = tree.inner.children(of);
    root.index = start + 2 * left.count;
    let (left_nodes, right_nodes) = below.split_at_mut(2 * left.count as usize - 1);
    flatten(tree, left, left_nodes, start + 1);
    flatten(tree, right, right_nodes, start + 2 * left.count);
}
