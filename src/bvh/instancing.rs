//! Two levels: a tree whose leaves are trees, each placed in the world, so that geometry shown many times is there
//! once.

use super::huge_pages::Pages;
use super::leaf_block::LeafBlocks;
use super::{Bvh, Child, WideNode, WideTree};
use crate::geom::{Aabb, Placement};
use rayon::prelude::*;
use std::sync::Arc;

/// A tree placed in the world.
#[derive(Clone, Debug)]
pub struct TreeInstance {
    /// The tree, in its own space.
    pub tree: Arc<Bvh>,
    /// Moves its corners into the world; `None` for a tree that is there already.
    pub placement: Option<Placement>,
    /// What is added to its primitive ids.
    pub first_primitive: u32,
    /// The smallest box around its moved triangles.
    pub bounds: Aabb,
}

impl TreeInstance {
    /// A tree, moved by `placement`, whose primitives are `first_primitive` and the following.
    pub fn placed(tree: Arc<Bvh>, placement: Placement, first_primitive: u32) -> Self {
        let nodes = tree.wide.nodes.par_iter().with_min_len(1 << 6);
        let bounds = nodes
            .map(|node| {
                let blocks = node.block_children().map(|child| tree.wide.blocks.get(child));
                let triangles = blocks.flat_map(|block| (0..block.len()).map(move |row| block.corners(row)));
                Aabb::around(triangles.flatten().map(|corner| placement.point(corner)))
            })
            .reduce(|| Aabb::EMPTY, Aabb::union);
        Self { tree, placement: Some(placement), first_primitive, bounds }
    }

    /// A tree that stands in the world, with its own primitive ids.
    pub fn in_world(tree: Arc<Bvh>) -> Self {
        Self { bounds: tree.bounds, tree, placement: None, first_primitive: 0 }
    }
}

/// The members of a two-level tree. Empty for a tree of triangles.
#[derive(Clone, Debug, Default)]
pub(super) struct InstanceTree {
    pub members: Vec<TreeInstance>,
    /// Who has the primitives from an id on.
    spans: Vec<(u32, u32)>,
    pub triangles: usize,
}

impl InstanceTree {
    /// The member that has a primitive.
    pub fn owner(&self, primitive: u32) -> &TreeInstance {
        let span = self.spans.partition_point(|&(first, _)| first <= primitive) - 1;
        &self.members[self.spans[span].1 as usize]
    }
}

impl Bvh {
    /// Puts trees together: a tree over them. Every primitive id is of one member, and all together are
    /// consecutive from 0. The trees must be of triangles.
    ///
    /// # Panics
    /// If ids are missing or given twice, or a member is itself an assembly.
    pub fn from_instances(members: Vec<TreeInstance>) -> Self {
        let members: Vec<TreeInstance> =
            members.into_iter().filter(|member| !member.tree.is_empty()).collect();
        let corners: Vec<_> = members.iter().flat_map(|m| [m.bounds.min, m.bounds.max]).collect();
        // A triangle with the box of each member.
        let boxes: Vec<_> = (0..members.len() as u32).map(|i| [2 * i, 2 * i + 1, 2 * i]).collect();
        let over = Self::build(&corners, &boxes, |_| false);
        let assembly = InstanceTree::new(members);
        Self { wide: assembly.top(&over), places: Vec::new(), assembly: Some(assembly), ..over }
    }

    /// The trees that this one is put together of; none when it is a tree of triangles. The leaves of
    /// [`Bvh::wide`] are then members: a child that is a block is one, by index.
    pub fn instances(&self) -> &[TreeInstance] {
        self.assembly.as_ref().map_or(&[], |assembly| &assembly.members)
    }
}

impl InstanceTree {
    fn new(members: Vec<TreeInstance>) -> Self {
        let mut spans: Vec<(u32, u32)> = Vec::new();
        for (index, member) in (0..).zip(&members) {
            assert!(member.tree.instances().is_empty(), "two levels, not more");
            let runs = member.tree.numbering.starts();
            spans.extend(runs.map(|start| (member.first_primitive + start, index)));
        }
        spans.sort_unstable();
        let triangles = members.iter().map(|member| member.tree.len()).sum();
        let assembly = Self { members, spans, triangles };
        assembly.check_ids();
        assembly
    }

    /// Panics unless every id up to the number of triangles has one owner.
    fn check_ids(&self) {
        let mut next = 0;
        for (at, &(first, member)) in self.spans.iter().enumerate() {
            let member = &self.members[member as usize];
            assert_eq!(first, next, "primitive ids follow each other");
            let until = self.spans.get(at + 1).map_or(self.triangles as u32, |&(next, _)| next);
            let count = until.saturating_sub(first);
            let place = member.tree.numbering.index(first - member.first_primitive);
            let last = member.tree.numbering.index((first + count).max(1) - 1 - member.first_primitive);
            let whole = count > 0 && last + 1 == place + count as usize && last < member.tree.len();
            assert!(whole, "primitive ids follow each other");
            next = until;
        }
    }

    /// The tree over members: that over their boxes, each block turned into a node.
    fn top(&self, over: &Bvh) -> WideTree {
        let inner = over.wide.nodes.len();
        let mut nodes = over.wide.nodes.to_vec();
        let mut blocks = Vec::new();
        for node in &mut nodes {
            for child in node.children.iter_mut().filter(|child| **child != Child::NONE && child.is_block()) {
                blocks.push(over.wide.blocks.get(*child));
                *child = Child::node(inner + blocks.len() - 1);
            }
        }
        for block in blocks {
            let members: Vec<u32> = (0..block.len()).map(|row| block.primitive(row)).collect();
            let boxes: Vec<Aabb> = members.iter().map(|&m| self.members[m as usize].bounds).collect();
            let mut node = WideNode::VACANT;
            for (slot, (member, bounds)) in members.iter().zip(boxes).enumerate() {
                node.set(slot, bounds, Child::block(*member as usize, 1));
            }
            node.face_rays();
            nodes.push(node);
        }
        WideTree { nodes: Pages::of(&nodes), blocks: LeafBlocks::none(), depth: over.wide.depth + 1 }
    }
}
