//! Binary tree → eight-wide tree, as planned: the top one node after the other, the subtrees below it
//! in parallel, each by itself, and then all are put side by side.

use super::Shape;
use super::block::{BLOCK_TRIANGLES, Blocks};
use super::odds::Odds;
use super::pages::Pages;
use super::pile::{Pile, Triangles};
use super::sah::{Subtree, Tree};
use super::wide::{Child, WIDTH, Wide, WideNode};
use crate::geom::Aabb;
use glam::Vec3;
use rayon::prelude::*;

/// Subtrees of at most this many primitives are laid out by one thread. Never depends on the number of
/// threads, nor does then the layout.
const PART: u32 = 1 << 14;

/// Collapses a tree; the second answer says in which block each triangle lies.
pub(super) fn collapse(tree: &Tree, shape: &impl Shape) -> (Wide, Vec<Child>) {
    let Some(root) = tree.root() else {
        let mut nodes = Pages::zeroed(1);
        nodes[0] = WideNode::VACANT;
        return (Wide { nodes, blocks: Blocks::none(), depth: 1 }, Vec::new());
    };
    let top = Top::new(tree, root);
    let layout = Layout { tree, shape };
    // How large parts become is known when they are there. The top's blocks come first.
    let mut top_pile = Pile::with_capacity(0);
    let top_blocks: Vec<(Child, Odds)> =
        top.blocks.iter().map(|&block| layout.block(block, &mut top_pile)).collect();
    let parts: (Vec<Part>, Vec<Pile>) = top.parts.par_iter().map(|&part| layout.part(part)).unzip();
    let (parts, mut piles) = parts;
    piles.insert(0, top_pile);
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
    for (node, (of, children)) in top_nodes.iter_mut().zip(&top.nodes) {
        let reference = |place: &TopChild| match *place {
            TopChild::Node(index) => (Child::node(index), Odds::default()),
            TopChild::Block(index) => top_blocks[index],
            TopChild::Part(index) => (Child::node(starts[index]), parts[index].odds),
        };
        let leaves_of_node;
        (*node, leaves_of_node) =
            layout.node(*of, children.iter().map(|(child, place)| (*child, reference(place))));
        leaves.push(leaves_of_node);
    }
    order(top_nodes, &leaves);
    let (blocks, block_starts) = Blocks::of(&piles);
    let mut depth = top.depth;
    let mut copies = Vec::with_capacity(parts.len());
    for ((part, &start), (above, &blocks)) in
        parts.iter().zip(&starts).zip(top.depths.iter().zip(&block_starts[1..]))
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
    let wide = Wide { nodes, blocks, depth };
    let places = wide.places(root.count as usize, |primitive| primitive as usize);
    (wide, places)
}

/// Odds of a node's children that are no nodes beside it, by slot.
type Leaves = [Odds; WIDTH];

/// Puts the children of nodes in order for any hit, from the last node, which no other is above, to the first, whose
/// odds it answers.
fn order(nodes: &mut [WideNode], leaves: &[Leaves]) -> Odds {
    let mut odds = vec![Odds::default(); nodes.len()];
    for at in (0..nodes.len()).rev() {
        odds[at] = Odds::order(&mut nodes[at], |slot, child| match child.index() {
            index if !child.is_block() && index < odds.len() => odds[index],
            _ => leaves[at][slot],
        });
    }
    odds.first().copied().unwrap_or_default()
}

/// The children that the plan gives the wide node of a subtree.
fn children(tree: &Tree, of: Subtree) -> Few {
    let mut few = Few { subtrees: [of; WIDTH], len: 0 };
    let mut take = |subtree| {
        few.subtrees[few.len] = subtree;
        few.len += 1;
    };
    if tree.is_block(of) {
        take(of); // Only a root of few primitives.
    } else {
        tree.gather(of, WIDTH, &mut take);
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

/// The wide nodes over more than [`PART`] primitives, and what lies directly below them.
#[derive(Default)]
struct Top {
    nodes: Vec<(Subtree, Vec<(Subtree, TopChild)>)>,
    blocks: Vec<Subtree>,
    /// Subtrees to lay out in parallel.
    parts: Vec<Subtree>,
    /// Nodes above each of them.
    depths: Vec<usize>,
    depth: usize,
}

/// Where a child is.
enum TopChild {
    /// Index of a node.
    Node(usize),
    /// Index of a block.
    Block(usize),
    /// Index of a part.
    Part(usize),
}

impl Top {
    fn new(tree: &Tree, root: Subtree) -> Self {
        let mut top = Self { nodes: vec![(root, Vec::new())], ..Self::default() };
        let mut depths = vec![1];
        let mut at = 0;
        while at < top.nodes.len() {
            let (of, depth) = (top.nodes[at].0, depths[at]);
            top.depth = top.depth.max(depth);
            for &child in children(tree, of).iter() {
                let place = if tree.is_block(child) {
                    top.blocks.push(child);
                    TopChild::Block(top.blocks.len() - 1)
                } else if child.count > PART {
                    top.nodes.push((child, Vec::new()));
                    depths.push(depth + 1);
                    TopChild::Node(top.nodes.len() - 1)
                } else {
                    top.parts.push(child);
                    top.depths.push(depth);
                    TopChild::Part(top.parts.len() - 1)
                };
                top.nodes[at].1.push((child, place));
            }
            at += 1;
        }
        top
    }
}

/// A subtree laid out.
struct Part {
    /// Inner nodes, whose children are nodes of the part.
    nodes: Vec<WideNode>,
    /// Inner nodes on the longest way down.
    depth: usize,
    odds: Odds,
}

/// Makes nodes and blocks.
struct Layout<'a, S> {
    tree: &'a Tree,
    shape: &'a S,
}

impl<S: Shape> Layout<'_, S> {
    /// Lays a subtree out, children of one node side by side, and its blocks on a pile.
    fn part(&self, part: Subtree) -> (Part, Pile) {
        let mut nodes = Vec::with_capacity(part.count as usize / WIDTH);
        nodes.push(WideNode::VACANT);
        let mut pile = Pile::with_capacity(part.count as usize);
        let mut leaves = vec![Leaves::default()];
        let mut deepest = 0;
        let mut stack = vec![(0, part, 1)];
        while let Some((at, of, depth)) = stack.pop() {
            deepest = deepest.max(depth);
            let children = children(self.tree, of);
            let references = children.iter().map(|&child| {
                if self.tree.is_block(child) {
                    (child, self.block(child, &mut pile))
                } else {
                    stack.push((nodes.len(), child, depth + 1));
                    nodes.push(WideNode::VACANT);
                    leaves.push(Leaves::default());
                    (child, (Child::node(nodes.len() - 1), Odds::default()))
                }
            });
            let node = self.node(of, references);
            (nodes[at], leaves[at]) = node;
        }
        let odds = order(&mut nodes, &leaves);
        (Part { nodes, depth: deepest, odds }, pile)
    }

    fn node(
        &self,
        of: Subtree,
        children: impl Iterator<Item = (Subtree, (Child, Odds))>,
    ) -> (WideNode, Leaves) {
        let mut references = [(Child::NONE, Odds::default(), Aabb::EMPTY); WIDTH];
        let mut len = 0;
        for (child, (reference, odds)) in children {
            references[len] = (reference, odds, self.tree.bounds(child));
            len += 1;
        }
        let references = &references[..len];
        let centre = self.tree.bounds(of).centre();
        let (mut node, mut leaves) = (WideNode::VACANT, Leaves::default());
        let slots = slots(references.iter().map(|(.., bounds)| bounds.centre() - centre));
        for ((reference, odds, bounds), slot) in references.iter().zip(slots) {
            node.set(slot, *bounds, *reference);
            leaves[slot] = *odds;
        }
        (node, leaves)
    }

    /// Puts a block on a pile.
    fn block(&self, of: Subtree, pile: &mut Pile) -> (Child, Odds) {
        let mut primitives = [u32::MAX; BLOCK_TRIANGLES];
        for (to, primitive) in primitives.iter_mut().zip(self.tree.primitives(of)) {
            *to = primitive;
        }
        let primitives = &mut primitives[..of.count as usize];
        primitives.sort_unstable();
        let mut triangles = Triangles::default();
        for &primitive in &*primitives {
            triangles.push(primitive, self.shape.is_masked(primitive), self.shape.corners(primitive));
        }
        (pile.push(&triangles), Odds::of_block(&triangles))
    }
}

/// A slot for each of at most eight children at these offsets from the middle: greedily those that lie
/// farthest in the direction of the slot's octant.
pub(crate) fn slots(offsets: impl Iterator<Item = Vec3>) -> [usize; WIDTH] {
    let mut gains = [[f32::NEG_INFINITY; WIDTH]; WIDTH];
    let mut children = 0;
    for offset in offsets {
        for (slot, gain) in gains[children].iter_mut().enumerate() {
            let along = |axis: usize| if slot >> axis & 1 == 1 { offset[axis] } else { -offset[axis] };
            *gain = along(0) + along(1) + along(2);
        }
        children += 1;
    }
    let mut slots = [0; WIDTH];
    for _ in 0..children {
        // Of each slot, then of all: branches would be guessed wrong.
        let (mut most, mut who) = ([f32::NEG_INFINITY; WIDTH], [0u32; WIDTH]);
        for (child, gains) in (0..).zip(&gains[..children]) {
            for slot in 0..WIDTH {
                let better = gains[slot] > most[slot];
                most[slot] = if better { gains[slot] } else { most[slot] };
                who[slot] = if better { child } else { who[slot] };
            }
        }
        let mut slot = 0;
        for other in 1..WIDTH {
            let better = most[other] > most[slot] || most[other] == most[slot] && who[other] < who[slot];
            slot = if better { other } else { slot };
        }
        let child = who[slot] as usize;
        slots[child] = slot;
        gains[child] = [f32::NEG_INFINITY; WIDTH];
        gains.iter_mut().for_each(|gains| gains[slot] = f32::NEG_INFINITY);
    }
    slots
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_child_has_a_slot_of_its_own_towards_its_corner() {
        let corner = |i: usize| {
            let along = |axis: usize| if i >> axis & 1 == 1 { 1.0 } else { -1.0 };
            Vec3::new(along(0), along(1), along(2))
        };
        assert_eq!(slots((0..8).rev().map(corner)), [7, 6, 5, 4, 3, 2, 1, 0]);
        let mut same = slots((0..8).map(|_| Vec3::ZERO));
        same.sort_unstable();
        assert_eq!(same, [0, 1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(slots([Vec3::new(1.0, 2.0, -3.0)].into_iter())[0], 3);
    }
}
