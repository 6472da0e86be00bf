//! Two-level trees: a tree whose leaves are instances of other trees (TLAS over BLAS). Geometry that appears
//! many times is stored once.

use super::Bvh;
use super::child::{Child, WIDTH};
use super::huge_pages::HugePages;
use super::leaf_block::LeafBlocks;
use super::supports::{EIGHT, moved_bounds, negated};
use super::wide_tree::{WideNode, WideTree};
use crate::geom::{Aabb, Placement};
use crate::lanes::{LaneTask, Lanes, SimdLevel};
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
    /// The smallest box around the moved triangles, or one that is a few percent larger: see
    /// [`Bvh::move_instances`].
    pub bounds: Aabb,
}

impl TreeInstance {
    /// A tree moved by `placement`. Its primitive ids count from `first_primitive`.
    pub fn placed(tree: Arc<Bvh>, placement: Placement, first_primitive: u32) -> Self {
        let bounds = smallest_bounds(&tree, &placement);
        tree.make_diagonals(&placement);
        Self { tree, placement: Some(placement), first_primitive, bounds }
    }

    /// As [`TreeInstance::placed`], with a box that may be a few percent larger but takes nanoseconds.
    pub fn placed_roughly(tree: Arc<Bvh>, placement: Placement, first_primitive: u32) -> Self {
        let bounds = rough_bounds(&tree, &placement);
        tree.make_diagonals(&placement);
        Self { tree, placement: Some(placement), first_primitive, bounds }
    }

    /// A tree in world space, with its own primitive ids.
    pub fn in_world(tree: Arc<Bvh>) -> Self {
        Self { bounds: tree.bounds, tree, placement: None, first_primitive: 0 }
    }
}

/// The smallest box around the moved triangles of a tree. Moves few of them: a subtree whose moved box lies inside the
/// box found so far cannot enlarge it.
fn smallest_bounds(tree: &Bvh, placement: &Placement) -> Aabb {
    let (mut found, mut stack) = (Aabb::EMPTY, vec![(Child::ROOT, tree.bounds)]);
    while let Some((child, bounds)) = stack.pop() {
        if found.contains(&placement.bounds(&bounds)) {
            continue;
        }
        if child.is_block() {
            let block = tree.wide.blocks.get(child);
            let corners = (0..block.len()).flat_map(|row| block.corners(row));
            found = found.union(Aabb::around(corners.map(|corner| placement.point(corner))));
            continue;
        }
        let node = &tree.wide.nodes[child.index()];
        let slots = (0..WIDTH).filter(|&slot| node.children[slot] != Child::NONE);
        stack.extend(slots.map(|slot| (node.children[slot], node.bounds(slot))));
    }
    found
}

/// A box around the moved triangles of a tree.
fn rough_bounds(tree: &Bvh, placement: &Placement) -> Aabb {
    if tree.is_empty() { Aabb::EMPTY } else { moved_bounds(&[(tree, placement); EIGHT])[0] }
}

/// A face of an instance's box: what its coordinate is at most, in size, and which it is. The upper faces come first.
type Face = (f32, usize, usize);

/// The largest coordinate, in size, of the moved triangles of all instances, to the bit. Their boxes need not be the
/// smallest: where a box could have it, its tree is asked.
fn max_abs(instances: &[TreeInstance]) -> f32 {
    let reach = |bounds: &Aabb| bounds.max.max(-bounds.min).max_element();
    let mut farthest = 0;
    for (at, instance) in instances.iter().enumerate() {
        if reach(&instance.bounds) > reach(&instances[farthest].bounds) {
            farthest = at;
        }
    }
    let Some(first) = instances.get(farthest) else { return 0.0 };
    let exact = |&(bound, at, face): &Face| match (&instances[at].placement, face) {
        (None, _) => bound,
        (Some(placement), 0..3) => instances[at].tree.highest(placement.rows[face]),
        (Some(placement), _) => instances[at].tree.highest(negated(placement.rows[face - 3])),
    };
    // The face that reaches farthest excludes most others.
    let farthest_face =
        faces_beyond(&first.bounds, farthest, f32::NEG_INFINITY).max_by(|a, b| a.0.total_cmp(&b.0));
    let mut most = farthest_face.map_or(0.0, |face| exact(&face).max(0.0));
    let mut left: Vec<Face> = Vec::new();
    for (at, instance) in instances.iter().enumerate() {
        if reach(&instance.bounds) > most {
            left.extend(faces_beyond(&instance.bounds, at, most));
        }
    }
    left.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
    for face in &left {
        if face.0 > most {
            most = most.max(exact(face));
        }
    }
    most
}

/// The faces of an instance's box that reach farther than `most`.
fn faces_beyond(bounds: &Aabb, at: usize, most: f32) -> impl Iterator<Item = Face> {
    let [high, low] = [bounds.max, -bounds.min];
    let faces = [high.x, high.y, high.z, low.x, low.y, low.z].into_iter().zip(0..);
    faces.filter(move |(bound, _)| *bound > most).map(move |(bound, face)| (bound, at, face))
}

/// Factor by which the cost of the tree over instances may grow before it is built anew.
const MAX_COST_GROWTH: f32 = 1.5;

/// The instances of a two-level tree.
#[derive(Clone, Debug, Default)]
pub(super) struct Instances {
    pub all: Vec<TreeInstance>,
    /// First primitive id of each run of consecutive ids, ascending, with the index of its instance.
    runs: Vec<(u32, u32)>,
    /// Number of triangles of all instances.
    pub triangle_count: usize,
    /// [`cost_over_instances`] when the tree over them was built.
    built_cost: f32,
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
        let mut instances = Instances::new(instances);
        let wide = instances.tree_over(&over_boxes);
        instances.built_cost = cost_over_instances(&wide);
        let max_abs = max_abs(&instances.all);
        Self { max_abs, wide, triangle_blocks: Vec::new(), instances: Some(instances), ..over_boxes }
    }

    /// Moves the instances of a two-level tree, one placement each in the order of [`Bvh::instances`]; `None` for one
    /// in world space. Hits are to the bit those of a tree that is built over the moved instances.
    ///
    /// Refits the tree over the instances; builds it anew where its cost has grown by half. Their boxes may be a few
    /// percent larger than the smallest ones: so a move does not walk through the instances' trees.
    ///
    /// # Panics
    /// If there is not one placement for each instance.
    pub fn move_instances<P: Into<Option<Placement>>>(&mut self, placements: impl IntoIterator<Item = P>) {
        let mut placements = placements.into_iter();
        let Some(instances) = &mut self.instances else {
            assert!(placements.next().is_none(), "a tree of triangles has no instances");
            return;
        };
        for instance in &mut instances.all {
            instance.placement = placements.next().expect("one placement per instance").into();
            if let Some(placement) = &instance.placement {
                instance.tree.make_diagonals(placement);
            }
        }
        assert!(placements.next().is_none(), "one placement per instance");
        SimdLevel::run_eight(RoughBounds { instances: &mut instances.all });
        let nodes = &mut self.wide.nodes;
        SimdLevel::run_eight(Refit { nodes, instances: &instances.all });
        self.bounds = nodes[0].union_of_children();
        self.max_abs = max_abs(&instances.all);
        if cost_over_instances(&self.wide) > MAX_COST_GROWTH * instances.built_cost {
            *self = Self::from_instances(std::mem::take(&mut instances.all));
        }
    }

    /// Puts a tree in place of that of an instance, such as one that was refitted. The boxes above are wrong until
    /// [`Bvh::move_instances`] has been called.
    ///
    /// # Panics
    /// If there is no such instance, or the tree has other primitive ids or instances of its own.
    pub fn set_tree(&mut self, instance: usize, tree: Arc<Self>) {
        let instances = self.instances.as_mut().expect("a two-level tree");
        let own = &mut instances.all[instance].tree;
        let is_alike = tree.len() == own.len() && tree.ids == own.ids && tree.instances.is_none();
        assert!(is_alike, "a tree of the same primitive ids");
        *own = tree;
    }

    /// The instances of a two-level tree; none in a tree of triangles. In a two-level tree a child of
    /// [`Bvh::wide`] that is a leaf block stands for the instance with its index.
    #[inline]
    pub fn instances(&self) -> &[TreeInstance] {
        self.instances.as_ref().map_or(&[], |instances| &instances.all)
    }

    /// The motion of the instance that a primitive belongs to; `None` for one in world space.
    pub(crate) fn placement_of(&self, primitive: u32) -> Option<&Placement> {
        self.instances.as_ref()?.owner(primitive).placement.as_ref()
    }
}

/// Sets the boxes of instances that have been moved. A task, since it computes by eights.
struct RoughBounds<'a> {
    instances: &'a mut [TreeInstance],
}

impl LaneTask for RoughBounds<'_> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, _: L) {
        for instances in self.instances.chunks_mut(EIGHT) {
            let placed = |at: usize| {
                let TreeInstance { tree, placement, .. } = instances.get(at)?;
                Some((&**tree, placement.as_ref()?))
            };
            let moved = (0..instances.len()).find_map(placed).map(|first| {
                let mut trees = [first; EIGHT];
                for (at, tree) in trees.iter_mut().enumerate() {
                    *tree = placed(at).unwrap_or(first);
                }
                moved_bounds(&trees)
            });
            let moved = moved.unwrap_or([Aabb::EMPTY; EIGHT]);
            for (instance, moved) in instances.iter_mut().zip(moved) {
                instance.bounds = if instance.placement.is_some() { moved } else { instance.tree.bounds };
            }
        }
    }
}

/// Fits the boxes of a tree over instances to those of the instances. A task, since the order of a node's children is
/// computed by eights.
struct Refit<'a> {
    nodes: &'a mut [WideNode],
    instances: &'a [TreeInstance],
}

impl LaneTask for Refit<'_> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) {
        let Self { nodes, instances } = self;
        // Children come after their parents.
        for at in (0..nodes.len()).rev() {
            for slot in 0..WIDTH {
                let child = nodes[at].children[slot];
                if child == Child::NONE {
                    continue;
                }
                let bounds = if child.is_block() {
                    instances[child.index()].bounds
                } else {
                    nodes[child.index()].union_in(l)
                };
                nodes[at].set(slot, bounds, child);
            }
            nodes[at].update_front_to_back_in(l);
        }
    }
}

/// The sum of the surfaces of all boxes over instances by the surface of the whole: what a random line expects to
/// visit.
fn cost_over_instances(wide: &WideTree) -> f32 {
    let whole = wide.nodes()[0].union_of_children().half_area();
    let mut sum = 0.0;
    for node in wide.nodes() {
        let mut of_node = 0.0;
        for slot in 0..WIDTH {
            // Those of vacant slots are empty.
            of_node += node.bounds(slot).half_area();
        }
        sum += of_node;
    }
    if whole > 0.0 { sum / whole } else { 0.0 }
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
        let instances = Self { all, runs, triangle_count, built_cost: 0.0 };
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

    /// The wide tree over the instances, from the tree over their boxes. Instances of a leaf block take vacant slots of
    /// the node above, the smallest block first; a block for which there are too few becomes a node.
    fn tree_over(&self, boxes: &Bvh) -> WideTree {
        let inner_count = boxes.wide.nodes.len();
        let mut nodes = boxes.wide.nodes.to_vec();
        let mut blocks = Vec::new();
        for node in &mut nodes {
            let children = node.children;
            let mut vacant: Vec<usize> = (0..WIDTH).filter(|&slot| children[slot] == Child::NONE).collect();
            let is_block = |slot: &usize| children[*slot] != Child::NONE && children[*slot].is_block();
            let block_of = |slot| (slot, boxes.wide.blocks.get(children[slot]));
            let mut of_blocks: Vec<_> = (0..WIDTH).filter(is_block).map(block_of).collect();
            of_blocks.sort_by_key(|(_, block)| block.len());
            for (slot, block) in of_blocks {
                if block.len() > vacant.len() + 1 {
                    blocks.push(block);
                    node.children[slot] = Child::node(inner_count + blocks.len() - 1);
                    continue;
                }
                let places = std::iter::once(slot).chain(vacant.drain(..block.len() - 1));
                for (row, slot) in places.enumerate() {
                    self.set(node, slot, block.primitive(row));
                }
            }
            node.update_front_to_back();
        }
        let depth = boxes.wide.depth + usize::from(!blocks.is_empty());
        for block in blocks {
            let mut node = WideNode::EMPTY;
            for row in 0..block.len() {
                self.set(&mut node, row, block.primitive(row));
            }
            node.update_front_to_back();
            nodes.push(node);
        }
        WideTree { nodes: HugePages::from_slice(&nodes), blocks: LeafBlocks::empty(), depth }
    }

    /// Puts an instance into a slot of a node.
    fn set(&self, node: &mut WideNode, slot: usize, instance: u32) {
        let index = instance as usize;
        node.set(slot, self.all[index].bounds, Child::block(index, 1));
    }
}
