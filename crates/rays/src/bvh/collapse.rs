//! Collapses the binary tree into the eight-wide one, as planned (`collapse_plan.rs`). The top of the tree is
//! collapsed node by node, and the subtrees below it in parallel, each into memory of its own. Then all are
//! moved together.

use super::binary_tree::{BinaryTree, InnerNodes, Subtree};
use super::child::{BLOCK_TRIANGLES, Child, WIDTH};
use super::huge_pages::HugePages;
use super::indexed_mesh::IndexedMesh;
use super::leaf_block::LeafBlocks;
use super::leaf_packing::{BlockTriangles, LeafPacker, LeafPacking, concatenate};
use super::reference::Reference;
use super::shadow_order::SubtreeStats;
use super::wide_tree::{WideNode, WideTree};
use crate::geom::Aabb;
use rayon::prelude::*;

/// The largest number of primitives in a subtree that one thread collapses. It does not depend on the number
/// of threads, so neither does the layout.
const SUBTREE_LEN: u32 = 1 << 14;

/// Collapses a tree. Also returns the leaf block that holds each triangle. Leaf blocks take the memory of the
/// tree's references, which are mostly larger. Runs on the current rayon pool.
pub(super) fn collapse(tree: BinaryTree, mesh: &IndexedMesh<'_>) -> (WideTree, Vec<Child>) {
    let Some(root) = tree.root() else {
        let mut nodes = HugePages::zeroed(1);
        nodes[0] = WideNode::EMPTY;
        return (WideTree { nodes, blocks: LeafBlocks::empty(), depth: 1 }, Vec::new());
    };
    let top = Top::new(&tree.inner, root);
    let mut top_packer = LeafPacker::new(0, &mut []);
    let top_block = |&of: &Subtree| pack_block(&tree.inner, mesh, of, &tree.primitives(of), &mut top_packer);
    let top_blocks: Vec<CollapsedChild> = top.blocks.iter().map(top_block).collect();
    let BinaryTree { mut references, inner } = tree;
    let collapse_one = |(of, references)| collapse_subtree(&inner, mesh, of, references);
    let (subtrees, mut packings): (Vec<CollapsedSubtree>, Vec<LeafPacking>) =
        top.split_references(&mut references).into_par_iter().map(collapse_one).unzip();
    // The top's blocks are the last packing.
    packings.push(top_packer.finish());
    let mut starts = Vec::with_capacity(subtrees.len());
    let mut count = top.nodes.len();
    for subtree in &subtrees {
        starts.push(count);
        count += subtree.nodes.len();
    }
    assert!(count <= Child::LIMIT, "references to children have 28 bits");

    let mut nodes = HugePages::zeroed(count);
    let (top_nodes, mut free_nodes) = nodes.split_at_mut(top.nodes.len());
    let mut stats_by_slot = Vec::with_capacity(top.nodes.len());
    for (node, children) in top_nodes.iter_mut().zip(&top.nodes) {
        let collapsed = |(of, place): &(Subtree, TopChild)| match *place {
            TopChild::Node(index) => {
                CollapsedChild::node(index, inner.bounds(*of).to_aabb(), SubtreeStats::default())
            }
            TopChild::Block(index) => top_blocks[index],
            TopChild::Subtree => {
                let index = top.subtree_index(*of);
                CollapsedChild::node(starts[index], inner.bounds(*of).to_aabb(), subtrees[index].stats)
            }
        };
        let stats;
        (*node, stats) = wide_node(children.iter().map(collapsed));
        stats_by_slot.push(stats);
    }
    sort_children(top_nodes, &stats_by_slot);
    let (blocks, block_positions) = concatenate(references.cast(), &packings);
    for node in top_nodes.iter_mut() {
        *node = node.with_offsets(0, block_positions[subtrees.len()]);
    }
    let mut depth = top.depth;
    let mut copies = Vec::with_capacity(subtrees.len());
    for (i, subtree) in subtrees.iter().enumerate() {
        let target;
        (target, free_nodes) = free_nodes.split_at_mut(subtree.nodes.len());
        copies.push((subtree, starts[i], block_positions[i], target));
        let (_, depth_above) = top.subtrees[i];
        depth = depth.max(depth_above + subtree.depth);
    }
    copies.into_par_iter().for_each(|(subtree, node_start, block_start, target)| {
        for (to, node) in target.iter_mut().zip(&subtree.nodes) {
            *to = node.with_offsets(node_start, block_start);
        }
    });
    let wide = WideTree { nodes, blocks, depth };
    let triangle_blocks = wide.blocks_of_triangles(root.count as usize, |primitive| primitive as usize);
    (wide, triangle_blocks)
}

/// The statistics of a node's children by slot. Those of inner nodes of the same range are not filled in.
type StatsBySlot = [SubtreeStats; WIDTH];

/// Sorts the children of all `nodes` into shadow order, from the last to the first: children come after their
/// parents. Returns the statistics of the first node.
fn sort_children(nodes: &mut [WideNode], stats_by_slot: &[StatsBySlot]) -> SubtreeStats {
    let mut stats = vec![SubtreeStats::default(); nodes.len()];
    for at in (0..nodes.len()).rev() {
        stats[at] = SubtreeStats::sort_children(&mut nodes[at], |slot, child| match child.index() {
            index if !child.is_block() && index < stats.len() => stats[index],
            _ => stats_by_slot[at][slot],
        });
    }
    stats.first().copied().unwrap_or_default()
}

/// The children that the plan gives to the wide node of a subtree.
fn planned_children(inner: &InnerNodes, of: Subtree) -> PlannedChildren {
    let mut children = PlannedChildren { subtrees: [of; WIDTH], len: 0 };
    let mut take = |subtree| {
        children.subtrees[children.len] = subtree;
        children.len += 1;
    };
    if inner.is_block(of) {
        // Only the root of a tree can be a block: it becomes the only child.
        take(of);
    } else {
        inner.gather(of, WIDTH, &mut take);
    }
    children
}

/// At most eight subtrees.
struct PlannedChildren {
    subtrees: [Subtree; WIDTH],
    len: usize,
}

impl std::ops::Deref for PlannedChildren {
    type Target = [Subtree];

    fn deref(&self) -> &[Subtree] {
        &self.subtrees[..self.len]
    }
}

/// The top of the tree: the wide nodes whose roots are reinserted nodes or hold more than [`SUBTREE_LEN`]
/// primitives, and what lies directly below them.
struct Top {
    /// The children of each node.
    nodes: Vec<Vec<(Subtree, TopChild)>>,
    /// The leaf blocks.
    blocks: Vec<Subtree>,
    /// The subtrees that are collapsed in parallel, in the order of their references, each with the number of
    /// nodes above it.
    subtrees: Vec<(Subtree, usize)>,
    depth: usize,
}

/// Kind of a top node's child.
enum TopChild {
    /// A top node, by index.
    Node(usize),
    /// A leaf block, by index.
    Block(usize),
    /// A subtree that is collapsed in parallel.
    Subtree,
}

impl Top {
    fn new(inner: &InnerNodes, root: Subtree) -> Self {
        let mut top = Self { nodes: Vec::new(), blocks: Vec::new(), subtrees: Vec::new(), depth: 0 };
        let mut roots = vec![(root, 1)];
        while let Some(&(of, depth)) = roots.get(top.nodes.len()) {
            top.depth = top.depth.max(depth);
            let classify = |&child: &Subtree| {
                let kind = if inner.is_block(child) {
                    top.blocks.push(child);
                    TopChild::Block(top.blocks.len() - 1)
                } else if child.is_reinserted() || child.count > SUBTREE_LEN {
                    roots.push((child, depth + 1));
                    TopChild::Node(roots.len() - 1)
                } else {
                    top.subtrees.push((child, depth));
                    TopChild::Subtree
                };
                (child, kind)
            };
            let children = planned_children(inner, of).iter().map(classify).collect();
            top.nodes.push(children);
        }
        top.subtrees.sort_unstable_by_key(|(subtree, _)| subtree.first);
        top
    }

    /// Index of a subtree in [`Top::subtrees`].
    fn subtree_index(&self, of: Subtree) -> usize {
        self.subtrees.partition_point(|(subtree, _)| subtree.first < of.first)
    }

    /// Each subtree with its references among all.
    fn split_references<'a>(&self, mut rest: &'a mut [Reference]) -> Vec<(Subtree, &'a mut [Reference])> {
        let (mut split, mut at) = (Vec::with_capacity(self.subtrees.len()), 0);
        for &(subtree, _) in &self.subtrees {
            let (_, tail) = rest.split_at_mut((subtree.first - at) as usize);
            let references;
            (references, rest) = tail.split_at_mut(subtree.count as usize);
            split.push((subtree, references));
            at = subtree.first + subtree.count;
        }
        split
    }
}

/// A subtree after collapsing.
struct CollapsedSubtree {
    /// Its wide nodes. They refer to each other by index, and to the blocks of its packing.
    nodes: Vec<WideNode>,
    /// Number of nodes on the longest path down.
    depth: usize,
    stats: SubtreeStats,
}

/// A child after collapsing.
#[derive(Clone, Copy)]
struct CollapsedChild {
    bounds: Aabb,
    child: Child,
    stats: SubtreeStats,
}

impl CollapsedChild {
    fn node(index: usize, bounds: Aabb, stats: SubtreeStats) -> Self {
        Self { bounds, child: Child::node(index), stats }
    }
}

/// Collapses a subtree. The children of a node are consecutive. Leaf blocks are packed into the memory of
/// `references`.
fn collapse_subtree(
    inner: &InnerNodes,
    mesh: &IndexedMesh<'_>,
    subtree: Subtree,
    references: &mut [Reference],
) -> (CollapsedSubtree, LeafPacking) {
    let primitives: Vec<u32> = references.iter().map(Reference::primitive).collect();
    let start = subtree.first as usize * (size_of::<Reference>() / size_of::<u32>());
    let mut packer = LeafPacker::new(start, bytemuck::cast_slice_mut(references));
    let mut nodes = Vec::with_capacity(subtree.count as usize / WIDTH);
    nodes.push(WideNode::EMPTY);
    let mut stats_by_slot = vec![StatsBySlot::default()];
    let mut deepest = 0;
    let mut stack = vec![(0, subtree, 1)];
    while let Some((at, of, depth)) = stack.pop() {
        deepest = deepest.max(depth);
        let children = planned_children(inner, of);
        let collapsed = children.iter().map(|&child| {
            if inner.is_block(child) {
                let first = (child.first - subtree.first) as usize;
                pack_block(inner, mesh, child, &primitives[first..][..child.count as usize], &mut packer)
            } else {
                stack.push((nodes.len(), child, depth + 1));
                nodes.push(WideNode::EMPTY);
                stats_by_slot.push(StatsBySlot::default());
                let bounds = inner.bounds(child).to_aabb();
                CollapsedChild::node(nodes.len() - 1, bounds, SubtreeStats::default())
            }
        });
        let node = wide_node(collapsed);
        (nodes[at], stats_by_slot[at]) = node;
    }
    let stats = sort_children(&mut nodes, &stats_by_slot);
    (CollapsedSubtree { nodes, depth: deepest, stats }, packer.finish())
}

/// Packs the leaf block of a subtree over `primitives`.
fn pack_block(
    inner: &InnerNodes,
    mesh: &IndexedMesh<'_>,
    of: Subtree,
    primitives: &[u32],
    packer: &mut LeafPacker,
) -> CollapsedChild {
    let mut triangles = BlockTriangles::default();
    for &primitive in &ascending(primitives)[..primitives.len()] {
        triangles.push(primitive, mesh.is_masked(primitive), mesh.corners(primitive));
    }
    let bounds = match *primitives {
        [primitive] => Aabb::around(mesh.corners(primitive)),
        _ => inner.bounds(of).to_aabb(),
    };
    CollapsedChild { bounds, child: packer.push(&triangles), stats: SubtreeStats::of_block(&triangles) }
}

/// Up to [`BLOCK_TRIANGLES`] ids in ascending order, then others. The `sort` of slices is a call.
fn ascending(primitives: &[u32]) -> [u32; BLOCK_TRIANGLES] {
    let mut sorted = [u32::MAX; BLOCK_TRIANGLES];
    for (count, &primitive) in primitives.iter().enumerate() {
        let mut at = count;
        while at > 0 && sorted[at - 1] > primitive {
            sorted[at] = sorted[at - 1];
            at -= 1;
        }
        sorted[at] = primitive;
    }
    sorted
}

/// The wide node with the given children, and their statistics by slot.
fn wide_node(children: impl Iterator<Item = CollapsedChild>) -> (WideNode, StatsBySlot) {
    let (mut node, mut stats) = (WideNode::EMPTY, StatsBySlot::default());
    for (slot, child) in children.enumerate() {
        node.set(slot, child.bounds, child.child);
        stats[slot] = child.stats;
    }
    (node, stats)
}
