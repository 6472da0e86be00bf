//! FlatTree tree → eight-wide tree, as planned: the top one node after the other, the subtrees below it
//! in parallel, each by itself, and then all are put side by side.

use super::Shape;
use super::huge_pages::Pages;
use super::leaf_block::{BLOCK_TRIANGLES, LeafBlocks};
use super::leaf_packing::{LeafPacker, LeafPacking, Triangles};
use super::reference::Reference;
use super::sah::{Branches, Subtree, Tree};
use super::shadow_order::ShadowOrder;
use super::wide_tree::{Child, WIDTH, WideNode, WideTree};
use crate::geom::Aabb;
use rayon::prelude::*;

/// Subtrees of at most this many primitives are laid out by one thread. Never depends on the number of
/// threads, nor does then the layout.
const PART: u32 = 1 << 14;

/// Collapses a tree; the second answer says in which block each triangle lies. Blocks take the memory of references, most
/// of which are larger.
pub(super) fn collapse(tree: Tree, shape: &impl Shape) -> (WideTree, Vec<Child>) {
    let Some(root) = tree.root() else {
        let mut nodes = Pages::zeroed(1);
        nodes[0] = WideNode::VACANT;
        return (WideTree { nodes, blocks: LeafBlocks::none(), depth: 1 }, Vec::new());
    };
    let top = Top::new(&tree.branches, root);
    // How large parts become is known when they are there.
    let mut pile = LeafPacker::new(0, &mut []);
    let layout = Layout { branches: &tree.branches, shape };
    let block = |&of: &Subtree| layout.block(of, &tree.primitives(of), &mut pile);
    let top_blocks: Vec<Laid> = top.blocks.iter().map(block).collect();
    let Tree { mut references, branches } = tree;
    let layout = Layout { branches: &branches, shape };
    let (parts, mut piles): (Vec<Part>, Vec<LeafPacking>) =
        top.rooms(&mut references).into_par_iter().map(|(part, room)| layout.part(part, room)).unzip();
    piles.push(pile.done());
    let mut starts = Vec::with_capacity(parts.len());
    let mut count = top.nodes.len();
    for part in &parts {
        starts.push(count);
        count += part.nodes.len();
    }
    assert!(count <= Child::LIMIT, "references to children have 28 bits");

    let mut nodes = Pages::zeroed(count);
    let (top_nodes, mut nodes_left) = nodes.split_at_mut(top.nodes.len());
    let mut leaves = Vec::with_capacity(top.nodes.len());
    for (node, children) in top_nodes.iter_mut().zip(&top.nodes) {
        let laid = |(of, place): &(Subtree, TopChild)| match *place {
            TopChild::Node(index) => {
                Laid::node(index, branches.bounds(*of).to_aabb(), ShadowOrder::default())
            }
            TopChild::LeafBlock(index) => top_blocks[index],
            TopChild::Part => {
                let index = top.part(*of);
                Laid::node(starts[index], branches.bounds(*of).to_aabb(), parts[index].odds)
            }
        };
        let leaves_of_node;
        (*node, leaves_of_node) = self::node(children.iter().map(laid));
        leaves.push(leaves_of_node);
    }
    order(top_nodes, &leaves);
    let (blocks, block_starts) = LeafBlocks::of(references.cast(), &piles);
    // The top's blocks are the last pile.
    for node in top_nodes.iter_mut() {
        *node = node.moved(0, block_starts[parts.len()]);
    }
    let mut depth = top.depth;
    let mut copies = Vec::with_capacity(parts.len());
    for (((part, (_, above)), &start), &blocks) in
        parts.iter().zip(&top.parts).zip(&starts).zip(&block_starts)
    {
        let room;
        (room, nodes_left) = nodes_left.split_at_mut(part.nodes.len());
        copies.push((part, start, blocks, room));
        depth = depth.max(above + part.depth);
    }
    copies.into_par_iter().for_each(|(part, start, blocks, room)| {
        for (to, node) in room.iter_mut().zip(&part.nodes) {
            *to = node.moved(start, blocks);
        }
    });
    let wide = WideTree { nodes, blocks, depth };
    let places = wide.places(root.count as usize, |primitive| primitive as usize);
    (wide, places)
}

/// Odds of a node's children that are no nodes beside it, by slot.
type Leaves = [ShadowOrder; WIDTH];

/// Puts the children of nodes into the slots where they belong, from the last node, which no other is above, to the first,
/// whose odds it answers.
fn order(nodes: &mut [WideNode], leaves: &[Leaves]) -> ShadowOrder {
    let mut odds = vec![ShadowOrder::default(); nodes.len()];
    for at in (0..nodes.len()).rev() {
        odds[at] = ShadowOrder::order(&mut nodes[at], |slot, child| match child.index() {
            index if !child.is_block() && index < odds.len() => odds[index],
            _ => leaves[at][slot],
        });
    }
    odds.first().copied().unwrap_or_default()
}

/// The children that the plan gives the wide node of a subtree.
fn children(branches: &Branches, of: Subtree) -> Few {
    let mut few = Few { subtrees: [of; WIDTH], len: 0 };
    let mut take = |subtree| {
        few.subtrees[few.len] = subtree;
        few.len += 1;
    };
    if branches.is_block(of) {
        take(of); // Only a root of few primitives.
    } else {
        branches.gather(of, WIDTH, &mut take);
    }
    few
}

/// At most eight subtrees.
struct Few {
    subtrees: [Subtree; WIDTH],
    len: usize,
}

impl std::ops::Deref for Few {
    type Target = [Subtree];

    fn deref(&self) -> &[Subtree] {
        &self.subtrees[..self.len]
    }
}

/// The wide nodes in the crown and over more than [`PART`] primitives, and what lies directly below them.
struct Top {
    /// The children of each.
    nodes: Vec<Vec<(Subtree, TopChild)>>,
    blocks: Vec<Subtree>,
    /// Subtrees to lay out in parallel, in the order of their references, and how many nodes are above each.
    parts: Vec<(Subtree, usize)>,
    depth: usize,
}

/// Where a child is.
enum TopChild {
    /// Index of a node.
    Node(usize),
    /// Index of a block.
    LeafBlock(usize),
    /// A part.
    Part,
}

impl Top {
    fn new(branches: &Branches, root: Subtree) -> Self {
        let mut top = Self { nodes: Vec::new(), blocks: Vec::new(), parts: Vec::new(), depth: 0 };
        let mut subtrees = vec![(root, 1)];
        while let Some(&(of, depth)) = subtrees.get(top.nodes.len()) {
            top.depth = top.depth.max(depth);
            let place = |&child: &Subtree| {
                let place = if branches.is_block(child) {
                    top.blocks.push(child);
                    TopChild::LeafBlock(top.blocks.len() - 1)
                } else if child.is_fork() || child.count > PART {
                    subtrees.push((child, depth + 1));
                    TopChild::Node(subtrees.len() - 1)
                } else {
                    top.parts.push((child, depth));
                    TopChild::Part
                };
                (child, place)
            };
            let places = children(branches, of).iter().map(place).collect();
            top.nodes.push(places);
        }
        top.parts.sort_unstable_by_key(|(part, _)| part.first);
        top
    }

    /// Which part a child is.
    fn part(&self, of: Subtree) -> usize {
        self.parts.partition_point(|(part, _)| part.first < of.first)
    }

    /// The parts with their references.
    fn rooms<'a>(&self, mut references: &'a mut [Reference]) -> Vec<(Subtree, &'a mut [Reference])> {
        let (mut rooms, mut at) = (Vec::with_capacity(self.parts.len()), 0);
        for &(part, _) in &self.parts {
            let (_, rest) = references.split_at_mut((part.first - at) as usize);
            let room;
            (room, references) = rest.split_at_mut(part.count as usize);
            rooms.push((part, room));
            at = part.first + part.count;
        }
        rooms
    }
}

/// A subtree laid out.
struct Part {
    /// Inner nodes, whose children are nodes of the part.
    nodes: Vec<WideNode>,
    /// Inner nodes on the longest way down.
    depth: usize,
    odds: ShadowOrder,
}

/// A child laid out.
#[derive(Clone, Copy)]
struct Laid {
    bounds: Aabb,
    child: Child,
    odds: ShadowOrder,
}

impl Laid {
    fn node(index: usize, bounds: Aabb, odds: ShadowOrder) -> Self {
        Self { bounds, child: Child::node(index), odds }
    }
}

/// Makes nodes and blocks.
struct Layout<'a, S> {
    branches: &'a Branches,
    shape: &'a S,
}

impl<S: Shape> Layout<'_, S> {
    /// Lays a subtree out, children of one node side by side, and piles its blocks up where its references are.
    fn part(&self, part: Subtree, references: &mut [Reference]) -> (Part, LeafPacking) {
        let primitives: Vec<u32> = references.iter().map(Reference::primitive).collect();
        let at = part.first as usize * (size_of::<Reference>() / size_of::<u32>());
        let mut pile = LeafPacker::new(at, bytemuck::cast_slice_mut(references));
        let mut nodes = Vec::with_capacity(part.count as usize / WIDTH);
        nodes.push(WideNode::VACANT);
        let mut leaves = vec![Leaves::default()];
        let mut deepest = 0;
        let mut stack = vec![(0, part, 1)];
        while let Some((at, of, depth)) = stack.pop() {
            deepest = deepest.max(depth);
            let children = children(self.branches, of);
            let laid = children.iter().map(|&child| {
                if self.branches.is_block(child) {
                    let first = (child.first - part.first) as usize;
                    self.block(child, &primitives[first..][..child.count as usize], &mut pile)
                } else {
                    stack.push((nodes.len(), child, depth + 1));
                    nodes.push(WideNode::VACANT);
                    leaves.push(Leaves::default());
                    Laid::node(nodes.len() - 1, self.branches.bounds(child).to_aabb(), ShadowOrder::default())
                }
            });
            let node = node(laid);
            (nodes[at], leaves[at]) = node;
        }
        let odds = order(&mut nodes, &leaves);
        (Part { nodes, depth: deepest, odds }, pile.done())
    }

    /// Puts a block of some primitives on a pile.
    fn block(&self, of: Subtree, primitives: &[u32], pile: &mut LeafPacker) -> Laid {
        let mut ascending = [u32::MAX; BLOCK_TRIANGLES];
        let ascending = &mut ascending[..primitives.len()];
        ascending.copy_from_slice(primitives);
        ascending.sort_unstable();
        let mut triangles = Triangles::default();
        for &primitive in &*ascending {
            triangles.push(primitive, self.shape.is_masked(primitive), self.shape.corners(primitive));
        }
        let bounds = match *primitives {
            [primitive] => Aabb::around(self.shape.corners(primitive)),
            _ => self.branches.bounds(of).to_aabb(),
        };
        Laid { bounds, child: pile.push(&triangles), odds: ShadowOrder::of_block(&triangles) }
    }
}

/// The node of some children, and the odds of those.
fn node(children: impl Iterator<Item = Laid>) -> (WideNode, Leaves) {
    let (mut node, mut leaves) = (WideNode::VACANT, Leaves::default());
    for (slot, laid) in children.enumerate() {
        node.set(slot, laid.bounds, laid.child);
        leaves[slot] = laid.odds;
    }
    (node, leaves)
}
