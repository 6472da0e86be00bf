//! Two-level trees: a tree whose leaves are instances of other trees (TLAS over BLAS). Geometry that appears
//! many times is stored once.

use super::Bvh;
use super::child::Child;
use super::huge_pages::HugePages;
use super::leaf_block::LeafBlocks;
use super::wide_tree::{WideNode, WideTree};
use crate::geom::{Aabb, Placement};
use rayon::prelude::*;
use std::sync::Arc;

/// A tree of triangles, placed in the world.
#[derive(Clone, Debug)]
pub struct TreeInstance {
    /// The tree, in its own space.
    pub tree: Arc<Bvh>,
    /// Moves the tree's corners into the world; `None` for a tree in world space.
    pub placement: Option<Placement>,
    /// Added to the tree's primitive ids.
    pub first_primitive: u32,
    /// The smallest box around the moved triangles.
    pub bounds: Aabb,
}

impl TreeInstance {
    /// A tree moved by `placement`. Its primitive ids count from `first_primitive`. Computes the box from all
    /// corners, on the current rayon pool.
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

    /// A tree in world space, with its own primitive ids.
    pub fn in_world(tree: Arc<Bvh>) -> Self {
        Self { bounds: tree.bounds, tree, placement: None, first_primitive: 0 }
    }
}

/// The instances of a two-level tree.
#[derive(Clone, Debug, Default)]
pub(super) struct Instances {
    pub all: Vec<TreeInstance>,
    /// First primitive id of each run of consecutive ids, ascending, with the index of its instance.
    runs: Vec<(u32, u32)>,
    /// Number of triangles of all instances.
    pub triangle_count: usize,
}

impl Bvh {
    /// The tree over instances. Those without triangles are left out.
    ///
    /// # Panics
    /// Unless each primitive id from 0 up to the number of triangles belongs to one instance. If an instance
    /// is itself a two-level tree.
    pub fn from_instances(instances: Vec<TreeInstance>) -> Self {
        let instances: Vec<TreeInstance> =
            instances.into_iter().filter(|instance| !instance.tree.is_empty()).collect();
        let corners: Vec<_> = instances.iter().flat_map(|i| [i.bounds.min, i.bounds.max]).collect();
        // One triangle for each instance, with the same box.
        let boxes: Vec<_> = (0..instances.len() as u32).map(|i| [2 * i, 2 * i + 1, 2 * i]).collect();
        let over_boxes = Self::build(&corners, &boxes, |_| false);
        let instances = Instances::new(instances);
        let wide = instances.tree_over(&over_boxes);
        Self { wide, triangle_blocks: Vec::new(), instances: Some(instances), ..over_boxes }
    }

    /// The instances of a two-level tree; none in a tree of triangles. In a two-level tree a child of
    /// [`Bvh::wide`] that is a leaf block stands for the instance with its index.
    pub fn instances(&self) -> &[TreeInstance] {
        self.instances.as_ref().map_or(&[], |instances| &instances.all)
    }
}

impl Instances {
    fn new(all: Vec<TreeInstance>) -> Self {
        let mut runs: Vec<(u32, u32)> = Vec::new();
        for (index, instance) in (0..).zip(&all) {
            assert!(instance.tree.instances().is_empty(), "two levels, not more");
            let starts = instance.tree.ids.run_starts();
            runs.extend(starts.map(|start| (instance.first_primitive + start, index)));
        }
        runs.sort_unstable();
        let triangle_count = all.iter().map(|instance| instance.tree.len()).sum();
        let instances = Self { all, runs, triangle_count };
        instances.check_ids();
        instances
    }

    /// Panics unless every id below the number of triangles belongs to one instance.
    fn check_ids(&self) {
        let mut next = 0;
        for (at, &(first, instance)) in self.runs.iter().enumerate() {
            let TreeInstance { tree, first_primitive, .. } = &self.all[instance as usize];
            assert_eq!(first, next, "primitive ids follow each other");
            let end = self.runs.get(at + 1).map_or(self.triangle_count as u32, |&(next, _)| next);
            let count = end.saturating_sub(first);
            let index = tree.ids.index(first - first_primitive);
            let last = tree.ids.index((first + count).max(1) - 1 - first_primitive);
            let is_whole = count > 0 && last + 1 == index + count as usize && last < tree.len();
            assert!(is_whole, "primitive ids follow each other");
            next = end;
        }
    }

    /// The instance that a primitive belongs to.
    pub fn owner(&self, primitive: u32) -> &TreeInstance {
        let run = self.runs.partition_point(|&(first, _)| first <= primitive) - 1;
        &self.all[self.runs[run].1 as usize]
    }

    /// The wide tree over the instances, from the tree over their boxes. Each of its leaf blocks becomes a
    /// node whose children are instances.
    fn tree_over(&self, boxes: &Bvh) -> WideTree {
        let inner_count = boxes.wide.nodes.len();
        let mut nodes = boxes.wide.nodes.to_vec();
        let mut blocks = Vec::new();
        for node in &mut nodes {
            for child in node.children.iter_mut().filter(|child| **child != Child::NONE && child.is_block()) {
                blocks.push(boxes.wide.blocks.get(*child));
                *child = Child::node(inner_count + blocks.len() - 1);
            }
        }
        for block in blocks {
            let mut node = WideNode::EMPTY;
            for row in 0..block.len() {
                let instance = block.primitive(row) as usize;
                node.set(row, self.all[instance].bounds, Child::block(instance, 1));
            }
            node.update_front_to_back();
            nodes.push(node);
        }
        WideTree {
            nodes: HugePages::from_slice(&nodes),
            blocks: LeafBlocks::empty(),
            depth: boxes.wide.depth + 1,
        }
    }
}
