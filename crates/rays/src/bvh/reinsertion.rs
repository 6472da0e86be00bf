//! Reinsertion: an optimiser for the nodes of the binary tree with the largest surfaces.
//!
//! A split plane puts a primitive on one side or the other, for everything below. So each of the largest
//! nodes is taken out and inserted again where surfaces grow least (Bittner, Hapala and Havran 2013, *Fast
//! Insertion-Based Optimization of Bounding Volume Hierarchies*, with the search of Meister and Bittner 2018,
//! *Parallel Reinsertion for Bounding Volume Hierarchy Optimization*). The subtrees below the largest nodes
//! stay as they are, and where the builder stored them: only the parents change.

use super::binary_tree::{BinaryTree, BuiltSubtree, MAX_DEPTH, ReinsertedNode, Subtree};
use super::collapse_plan::{Choice, CollapsePlan, Costs};
use super::packed_bounds::PackedBounds;
use super::small_subtree::MAX_SMALL;
use crate::lanes::both;
use rayon::prelude::*;
use std::collections::BinaryHeap;

/// About how many nodes take part. Few bring most of the gain: four and eight times as many bring a per cent
/// or two more, for as many times the work.
const MAX_NODES: usize = 1 << 11;

/// The largest number of passes over the nodes.
const MAX_PASSES: usize = 3;

/// A pass that leaves more than this share of the surfaces is the last one. If it is the first, its result is
/// not used.
const MIN_REDUCTION: f32 = 0.99;

/// The least number of nodes that one thread searches places for.
const MIN_SEARCHES: usize = 1 << 7;

/// Gains below this share of a node's surface count as none: rounding might repeat them forever.
const MIN_GAIN: f32 = 1e-5;

/// A node during optimisation.
struct Node {
    bounds: PackedBounds,
    /// Half the surface of the box.
    area: f32,
    /// The root is its own parent.
    parent: u32,
    /// `None` for a subtree that stays as it was built.
    children: Option<[u32; 2]>,
    /// At least the number of nodes on the longest path from here to a leaf.
    height: usize,
}

/// The optimiser. Node 0 is the root and remains so.
struct Reinsertion {
    nodes: Vec<Node>,
    /// The builder's subtree of each node.
    subtrees: Vec<(Subtree, BuiltSubtree)>,
}

impl Reinsertion {
    /// Takes the largest nodes of a tree as it was built.
    fn of(tree: &BinaryTree, root: Subtree, built: BuiltSubtree, costs: Costs) -> Self {
        let mut all = Self { nodes: Vec::new(), subtrees: Vec::new() };
        all.push(tree, root, built, 0);
        // Areas are not negative, so their bits compare as they do.
        let mut largest = BinaryHeap::from([(all.node(0).area.to_bits(), 0)]);
        while let Some((_, at)) = largest.pop()
            && all.nodes.len() < MAX_NODES
        {
            let (subtree, built) = &mut all.subtrees[at as usize];
            if tree.inner.is_leaf(*subtree) {
                continue;
            }
            let children = tree.inner.children(*subtree);
            let built_children = match built.children.take() {
                Some(built) => *built,
                None if subtree.count as usize <= MAX_SMALL => {
                    children.map(|child| BuiltSubtree::small(tree.plan(child, costs), child.count as usize))
                }
                None => continue,
            };
            let [left, right] = children;
            let [built_left, built_right] = built_children;
            let children = [all.push(tree, left, built_left, at), all.push(tree, right, built_right, at)];
            all.nodes[at as usize].children = Some(children);
            largest.extend(children.map(|child| (all.node(child).area.to_bits(), child)));
        }
        all
    }

    /// Adds a node and returns its index.
    fn push(&mut self, tree: &BinaryTree, subtree: Subtree, built: BuiltSubtree, parent: u32) -> u32 {
        let bounds = tree.bounds(subtree);
        let area = bounds.half_area();
        self.nodes.push(Node { bounds, area, parent, children: None, height: built.height });
        self.subtrees.push((subtree, built));
        self.nodes.len() as u32 - 1
    }

    fn node(&self, index: u32) -> &Node {
        &self.nodes[index as usize]
    }

    /// The other child of a node's parent.
    fn sibling(&self, node: u32) -> u32 {
        let [left, right] = self.node(self.node(node).parent).children.expect("a parent has children");
        if left == node { right } else { left }
    }

    /// The node that becomes the sibling of `node` in its best place; `None` if it is best where it is.
    ///
    /// The gain of a place is what taking the node out saves, less what inserting it adds to the boxes around
    /// the place. The search climbs from the node to the root and descends from each ancestor into its other
    /// subtree.
    fn best_sibling(&self, node: u32, stack: &mut Vec<(f32, u32)>) -> Option<u32> {
        let (Node { bounds, area, .. }, parent) = (self.node(node), self.node(node).parent);
        let own_sibling = self.sibling(node);
        let (mut best, mut place) = (MIN_GAIN * area, None);
        // The box of the current ancestor without the node, and what taking the node out saves up to there.
        let (mut rest, mut saved) = (self.node(own_sibling).bounds, self.node(parent).area);
        let (mut ancestor, mut beside) = (parent, own_sibling);
        loop {
            stack.push((saved, beside));
            while let Some((saved, at)) = stack.pop() {
                // Every box that holds the node has at least its area.
                if saved - area <= best {
                    continue;
                }
                let candidate = self.node(at);
                let gain = saved - candidate.bounds.union(bounds).half_area();
                if gain > best && at != own_sibling {
                    (best, place) = (gain, Some(at));
                }
                if let Some([left, right]) = candidate.children {
                    stack.push((gain + candidate.area, left));
                    stack.push((gain + candidate.area, right));
                }
            }
            if ancestor != parent {
                rest = rest.union(&self.node(beside).bounds);
                saved += self.node(ancestor).area - rest.half_area();
            }
            if ancestor == 0 {
                return place;
            }
            let gain = saved - rest.union(bounds).half_area();
            if gain > best && ancestor != parent {
                (best, place) = (gain, Some(ancestor));
            }
            beside = self.sibling(ancestor);
            ancestor = self.node(ancestor).parent;
        }
    }

    /// Moves a node to become the sibling of another, unless the tree would become too deep.
    fn reinsert(&mut self, node: u32, beside: u32) {
        let path = std::iter::successors(Some(beside), |&at| (at != 0).then(|| self.node(at).parent));
        let depth = path.count();
        if depth + self.node(node).height.max(self.node(beside).height) > MAX_DEPTH {
            return;
        }
        // The node's parent moves with it.
        let (own_sibling, parent) = (self.sibling(node), self.node(node).parent);
        let grandparent = self.node(parent).parent;
        self.replace_child(grandparent, parent, own_sibling);
        let new_grandparent = self.node(beside).parent;
        self.replace_child(new_grandparent, beside, parent);
        self.nodes[parent as usize].children = Some([node, beside]);
        self.nodes[beside as usize].parent = parent;
        self.refit(grandparent);
        self.refit(parent);
    }

    /// Replaces a child of `parent` by another node.
    fn replace_child(&mut self, parent: u32, child: u32, by: u32) {
        let children = self.nodes[parent as usize].children.as_mut().expect("a parent has children");
        children.iter_mut().filter(|at| **at == child).for_each(|at| *at = by);
        self.nodes[by as usize].parent = parent;
    }

    /// Updates the boxes and heights of a node and of all its ancestors.
    fn refit(&mut self, mut at: u32) {
        loop {
            let [left, right] =
                both(self.node(at).children.expect("a parent has children"), |child| self.node(child));
            let bounds = left.bounds.union(&right.bounds);
            let height = 1 + left.height.max(right.height);
            let node = &mut self.nodes[at as usize];
            (node.bounds, node.area, node.height) = (bounds, bounds.half_area(), height);
            if at == 0 {
                return;
            }
            at = node.parent;
        }
    }

    /// Reinserts the nodes that have a better place, those with the largest surfaces first. Places are
    /// searched in parallel before any node is moved, and for the nodes that have one again when their turn
    /// comes.
    fn run_pass(&mut self) {
        // The root's children stay: their parent cannot move.
        let may_move = |all: &Self, node: u32| all.node(node).parent != 0;
        let nodes: Vec<u32> = (1..self.nodes.len() as u32).collect();
        let is_movable = |stack: &mut Vec<_>, &node: &u32| {
            (may_move(self, node) && self.best_sibling(node, stack).is_some()).then_some(node)
        };
        let searches = nodes.par_iter().with_min_len(MIN_SEARCHES).map_init(Vec::new, is_movable);
        let mut movable: Vec<u32> = searches.flatten_iter().collect();
        movable.sort_by_key(|&node| std::cmp::Reverse(self.node(node).area.to_bits()));
        let mut stack = Vec::new();
        for node in movable {
            if may_move(self, node)
                && let Some(beside) = self.best_sibling(node, &mut stack)
            {
                self.reinsert(node, beside);
            }
        }
    }

    /// Sum of half the surfaces of all inner nodes.
    fn total_area(&self) -> f32 {
        self.nodes.iter().filter(|node| node.children.is_some()).map(|node| node.area).sum()
    }

    /// Runs passes while they gain enough. Whether any did.
    fn run(&mut self) -> bool {
        let mut passes = 0;
        let mut area = self.total_area();
        while passes < MAX_PASSES {
            self.run_pass();
            let before = std::mem::replace(&mut area, self.total_area());
            if area > MIN_REDUCTION * before {
                break;
            }
            passes += 1;
        }
        passes > 0
    }

    /// Appends the inner nodes of a subtree to `nodes`, parents first. Returns the subtree and its plan.
    fn write(&self, at: u32, costs: Costs, nodes: &mut Vec<ReinsertedNode>) -> (Subtree, CollapsePlan) {
        let (Node { bounds, area, children, .. }, (subtree, built)) =
            (self.node(at), &self.subtrees[at as usize]);
        let Some([left, right]) = *children else { return (*subtree, built.plan) };
        let index = nodes.len();
        // Reserves its place: parents come before their children.
        nodes.push(ReinsertedNode { bounds: *bounds, children: [*subtree; 2], choice: Choice::default() });
        let ((left, left_plan), (right, right_plan)) =
            (self.write(left, costs, nodes), self.write(right, costs, nodes));
        let count = left.count + right.count;
        let (plan, choice) = CollapsePlan::merge(costs, &left_plan, &right_plan, *area, count as usize);
        nodes[index] = ReinsertedNode { bounds: *bounds, children: [left, right], choice };
        (Subtree::reinserted(index, count), plan)
    }
}

/// Optimises a tree that has been built: `root` and `built` are the whole of it. Returns the nodes that
/// replace its largest ones, the root first, or none if too little was gained. Runs on the current rayon
/// pool.
pub(super) fn optimise(
    tree: &BinaryTree,
    root: Subtree,
    built: BuiltSubtree,
    costs: Costs,
) -> Vec<ReinsertedNode> {
    let mut reinsertion = Reinsertion::of(tree, root, built, costs);
    let mut nodes = Vec::new();
    if reinsertion.run() {
        reinsertion.write(0, costs, &mut nodes);
    }
    nodes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{Aabb, mix};
    use glam::Vec3;

    fn number(i: u32) -> f32 {
        (mix(i) >> 8) as f32 / (1 << 24) as f32
    }

    /// Small triangles all over a room, and some as large as its walls, which no plane separates from them.
    fn room(seed: u32, count: u32) -> Vec<[Vec3; 3]> {
        let corner = |i: u32| 10.0 * Vec3::new(number(i), number(i + 1), number(i + 2));
        let triangle = |i: u32| {
            let (at, salt) = (corner(seed + 16 * i), seed + 16 * i + 4);
            let size = if i.is_multiple_of(7) { 1.0 } else { 0.02 };
            [at, at + size * (corner(salt) - at), at + size * (corner(salt + 4) - at)]
        };
        (0..count).map(triangle).collect()
    }

    fn build(triangles: &[[Vec3; 3]]) -> BinaryTree {
        BinaryTree::build(triangles.len(), |i| triangles[i as usize], Costs::of_large_boxes)
    }

    /// All nodes of the tree that the builder makes, before reinsertion.
    fn before(triangles: &[[Vec3; 3]]) -> Reinsertion {
        let mut tree = build(triangles);
        tree.inner.reinserted.clear();
        let root = tree.root().expect("there are triangles");
        let costs = Costs::of_large_boxes(tree.bounds(root).half_area());
        let built = BuiltSubtree::small(tree.plan(root, costs), triangles.len());
        let mut all = Reinsertion { nodes: Vec::new(), subtrees: Vec::new() };
        all.push(&tree, root, built, 0);
        let mut at = 0;
        while at < all.nodes.len() {
            let (subtree, _) = all.subtrees[at];
            if subtree.count > 1 {
                let children = tree.inner.children(subtree).map(|child| {
                    let built = BuiltSubtree::small(tree.plan(child, costs), child.count as usize);
                    all.push(&tree, child, built, at as u32)
                });
                all.nodes[at].children = Some(children);
            }
            at += 1;
        }
        all
    }

    /// The gain of the best place, found by trying all.
    fn best_gain(all: &Reinsertion, node: u32) -> f32 {
        let below = |of: u32| {
            let mut found = vec![of];
            let mut at = 0;
            while let Some(&next) = found.get(at) {
                found.extend(all.node(next).children.into_iter().flatten());
                at += 1;
            }
            found
        };
        let (own_sibling, parent, below) = (all.sibling(node), all.node(node).parent, below(node));
        let places = (1..all.nodes.len() as u32).filter(|at| !below.contains(at));
        places
            .filter(|&at| at != own_sibling && at != parent)
            .map(|at| gain(all, node, at))
            .fold(0.0, f32::max)
    }

    /// The gain of a move.
    fn gain(all: &Reinsertion, node: u32, beside: u32) -> f32 {
        let copy = |node: &Node| Node { bounds: node.bounds, ..*node };
        let mut moved = Reinsertion { nodes: all.nodes.iter().map(copy).collect(), subtrees: Vec::new() };
        moved.reinsert(node, beside);
        all.total_area() - moved.total_area()
    }

    #[test]
    fn the_best_place_of_all_is_found() {
        let mut found = 0;
        for seed in 0..12 {
            let all = before(&room(seed << 16, 40));
            for node in (1..all.nodes.len() as u32).filter(|&node| all.node(node).parent != 0) {
                let best = best_gain(&all, node);
                let rounding = 1e-4 * all.node(0).area;
                match all.best_sibling(node, &mut Vec::new()) {
                    Some(beside) => {
                        let gain = gain(&all, node, beside);
                        assert!((gain - best).abs() < rounding, "seed {seed}, node {node}: {gain} of {best}");
                        found += 1;
                    }
                    None => assert!(best < rounding, "seed {seed}, node {node}: {best} and none found"),
                }
            }
        }
        assert!(found > 100, "{found}");
    }

    #[test]
    fn the_tree_keeps_its_primitives_in_smaller_boxes() {
        for count in [40, 1000, 20_000] {
            let triangles = room(count, count);
            let mut tree = build(&triangles);
            assert!(!tree.inner.reinserted.is_empty(), "{count}: there is much to gain");
            let root = tree.root().expect("there are triangles");
            let mut areas = [0.0; 2];
            let mut primitives = tree.primitives(root);
            primitives.sort_unstable();
            assert!(primitives.iter().copied().eq(0..count));
            for area in &mut areas {
                let mut stack = vec![tree.root().expect("there are triangles")];
                while let Some(of) = stack.pop() {
                    let around = tree.primitives(of).into_iter().map(|i| triangles[i as usize]);
                    let around = Aabb::around(around.flatten());
                    assert_eq!(tree.bounds(of).to_aabb(), around);
                    *area += if of.count > 1 { around.half_area() } else { 0.0 };
                    stack.extend((of.count > 1).then(|| tree.inner.children(of)).into_iter().flatten());
                }
                tree.inner.reinserted.clear();
            }
            assert!(areas[0] < 0.95 * areas[1], "{count}: {areas:?}");
        }
    }

    #[test]
    fn no_node_is_reinserted_too_deep() {
        let mut all = before(&room(3, 40));
        let movable = |all: &Reinsertion| {
            let mut nodes = (1..all.nodes.len() as u32).filter(|&node| all.node(node).parent != 0);
            nodes.find_map(|node| Some((node, all.best_sibling(node, &mut Vec::new())?)))
        };
        let (node, beside) = movable(&all).expect("there is much to gain");
        let parent = all.node(node).parent;
        all.nodes[node as usize].height = MAX_DEPTH;
        all.reinsert(node, beside);
        assert_eq!(all.node(node).parent, parent);
        assert_eq!(movable(&all), Some((node, beside)), "it stayed where it was");
        all.nodes[node as usize].height = 1;
        all.reinsert(node, beside);
        assert_eq!(all.sibling(node), beside);
    }

    #[test]
    fn trees_without_gain_stay_as_built() {
        assert!(build(&[]).root().is_none());
        let same = [[Vec3::ZERO, Vec3::X, Vec3::Y]; 300];
        assert!(build(&same).inner.reinserted.is_empty());
        assert!(build(&same[..1]).inner.reinserted.is_empty());
    }
}
