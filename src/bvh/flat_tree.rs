//! The binary tree.

use super::sah::{Subtree, Tree};
use crate::geom::Aabb;
use bytemuck::{Pod, Zeroable};

/// A node of the binary tree: 32 bytes. The left child of node `i` is node `i + 1`; a subtree over
/// `count` primitives is the `2 * count - 1` nodes from its root on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct FlatNode {
    /// Lowest corner of the box around the primitives below.
    pub min: [f32; 3],
    /// Index of the right child; of the primitive, or of the member, for a leaf.
    pub index: u32,
    /// Highest corner of the box.
    pub max: [f32; 3],
    /// Number of primitives below; 1 for a leaf.
    pub count: u32,
}

impl FlatNode {
    /// Whether the node is one primitive.
    pub fn is_leaf(&self) -> bool {
        self.count == 1
    }

    /// The box.
    pub fn bounds(&self) -> Aabb {
        Aabb { min: self.min.into(), max: self.max.into() }
    }
}

/// A binary tree with one primitive a leaf, in depth-first order. Empty when there are no primitives.
#[derive(Clone, Debug, Default)]
pub struct FlatTree {
    nodes: Vec<FlatNode>,
}

impl FlatTree {
    /// `index` gives the index of a leaf for a reference of the tree.
    pub(super) fn of(tree: &Tree, index: impl Fn(u32) -> u32) -> Self {
        let Some(root) = tree.root() else { return Self::default() };
        let mut nodes = vec![FlatNode::default(); 2 * root.count as usize - 1];
        fill(tree, root, &mut nodes, 0);
        nodes.iter_mut().filter(|node| node.is_leaf()).for_each(|leaf| leaf.index = index(leaf.index));
        Self { nodes }
    }

    /// All nodes, the root first.
    pub fn nodes(&self) -> &[FlatNode] {
        &self.nodes
    }

    /// The two children of an inner node.
    pub fn children(&self, node: usize) -> [usize; 2] {
        [node + 1, self.nodes[node].index as usize]
    }

    /// Nodes on the longest way from the root to a leaf; 0 for an empty tree.
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

/// Writes a subtree into `nodes`, whose first is node `at` of the tree.
fn fill(tree: &Tree, of: Subtree, nodes: &mut [FlatNode], at: u32) {
    let bounds = tree.bounds(of).to_aabb();
    let (root, below) = nodes.split_first_mut().expect("2 * count - 1 nodes");
    *root = FlatNode { min: bounds.min.into(), index: 0, max: bounds.max.into(), count: of.count };
    if of.count == 1 {
        root.index = tree.primitive(of);
        return;
    }
    let [left, right] = tree.branches.children(of);
    root.index = at + 2 * left.count;
    let (left_nodes, right_nodes) = below.split_at_mut(2 * left.count as usize - 1);
    fill(tree, left, left_nodes, at + 1);
    fill(tree, right, right_nodes, at + 2 * left.count);
}
