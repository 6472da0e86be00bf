//! The crown of the binary tree: its nodes with the largest surfaces. Planes put what they cut on one side or the other, the
//! same for all that is below; so each node of the crown is taken out and put back where surfaces grow least (Bittner,
//! Hapala and Havran 2013, *Fast Insertion-Based Optimization of Bounding Volume Hierarchies*, with the search of Meister and Bittner 2018,
//! *Parallel Reinsertion for Bounding Volume Hierarchy Optimization*). What is below the crown stays as it is, and where the
//! builder left it: only who is whose child changes.

use super::collapse_plan::{Choice, CollapsePlan, Costs};
use super::reference::Bounds;
use super::sah::{Built, MAX_DEPTH, Subtree, Tree};
use super::small_subtree::FEW;
use rayon::prelude::*;
use std::collections::BinaryHeap;

/// Nodes of a crown, about. Most of what there is to gain is gained by few: four and eight times as many bring a per cent or two more,
/// for as many times the work.
const NODES: usize = 1 << 11;

/// How often each node may be taken out.
const PASSES: usize = 3;

/// A pass that leaves more than this share of the surfaces is not worth another, and the first not worth a crown.
const WORTH: f32 = 0.99;

/// Nodes for which one thread looks at least.
const AT_ONCE: usize = 1 << 7;

/// Gains less than this share of a node's surface are none: rounding might bring them back again and again.
const LEAST_GAIN: f32 = 1e-5;

/// An inner node of the crown when it has grown.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fork {
    pub bounds: Bounds,
    pub children: [Subtree; 2],
    pub choice: Choice,
}

/// A node while the crown grows: an inner one has children, any other is a subtree of the builder's.
struct Node {
    bounds: Bounds,
    area: f32,
    /// Of the root: itself.
    parent: u32,
    children: Option<[u32; 2]>,
    /// At least as many as there are nodes on the longest way down.
    height: usize,
}

/// A crown that grows. The first node is the root, and stays it.
struct Reinsertion {
    nodes: Vec<Node>,
    /// What the builder made of each.
    subtrees: Vec<(Subtree, Built)>,
}

impl Reinsertion {
    /// The crown of a tree, as it was built.
    fn of(tree: &Tree, root: Subtree, built: Built, costs: Costs) -> Self {
        let mut crown = Self { nodes: Vec::new(), subtrees: Vec::new() };
        crown.push(tree, root, built, 0);
        // Surfaces are not negative: their bits are in their order.
        let mut largest = BinaryHeap::from([(crown.at(0).area.to_bits(), 0)]);
        while let Some((_, at)) = largest.pop()
            && crown.nodes.len() < NODES
        {
            let (subtree, built) = &mut crown.subtrees[at as usize];
            if tree.branches.is_leaf(*subtree) {
                continue;
            }
            let children = tree.branches.children(*subtree);
            let sides = match built.sides.take() {
                Some(sides) => *sides,
                None if subtree.count as usize <= FEW => {
                    children.map(|child| Built::few(tree.plan_of_few(child, costs), child.count as usize))
                }
                None => continue,
            };
            let [left, right] = children;
            let [left_side, right_side] = sides;
            let children = [crown.push(tree, left, left_side, at), crown.push(tree, right, right_side, at)];
            crown.nodes[at as usize].children = Some(children);
            largest.extend(children.map(|child| (crown.at(child).area.to_bits(), child)));
        }
        crown
    }

    fn push(&mut self, tree: &Tree, subtree: Subtree, built: Built, parent: u32) -> u32 {
        let bounds = tree.bounds(subtree);
        let area = bounds.half_area();
        self.nodes.push(Node { bounds, area, parent, children: None, height: built.height });
        self.subtrees.push((subtree, built));
        self.nodes.len() as u32 - 1
    }

    fn at(&self, node: u32) -> &Node {
        &self.nodes[node as usize]
    }

    /// The other child of a node's parent.
    fn sibling(&self, node: u32) -> u32 {
        let [left, right] = self.at(self.at(node).parent).children.expect("a parent has children");
        if left == node { right } else { left }
    }

    /// Where a node is best put, as the sibling of another; `None` if where it is. Surfaces above are
    /// counted on the way: what taking it out saves, less what the boxes that come to hold it grow by.
    fn better(&self, node: u32, stack: &mut Vec<(f32, u32)>) -> Option<u32> {
        let (Node { bounds, area, .. }, parent) = (self.at(node), self.at(node).parent);
        let own = self.sibling(node);
        let (mut best, mut place) = (LEAST_GAIN * area, None);
        // The box that is left of the ancestor at hand, and what is saved up to it.
        let (mut rest, mut saved) = (self.at(own).bounds, self.at(parent).area);
        let (mut ancestor, mut beside) = (parent, own);
        loop {
            stack.push((saved, beside));
            while let Some((saved, at)) = stack.pop() {
                // Every box that holds the node has its surface at least.
                if saved - area <= best {
                    continue;
                }
                let there = self.at(at);
                let gain = saved - there.bounds.union(bounds).half_area();
                if gain > best && at != own {
                    (best, place) = (gain, Some(at));
                }
                if let Some(children) = there.children {
                    stack.extend(children.map(|child| (gain + there.area, child)));
                }
            }
            if ancestor != parent {
                rest = rest.union(&self.at(beside).bounds);
                saved += self.at(ancestor).area - rest.half_area();
            }
            if ancestor == 0 {
                return place;
            }
            let gain = saved - rest.union(bounds).half_area();
            if gain > best && ancestor != parent {
                (best, place) = (gain, Some(ancestor));
            }
            beside = self.sibling(ancestor);
            ancestor = self.at(ancestor).parent;
        }
    }

    /// Makes a node the sibling of another, if the tree does not become too deep.
    fn put(&mut self, node: u32, beside: u32) {
        let depth = std::iter::successors(Some(beside), |&at| (at != 0).then(|| self.at(at).parent)).count();
        if depth + self.at(node).height.max(self.at(beside).height) > MAX_DEPTH {
            return;
        }
        // Its parent goes along.
        let (own, parent) = (self.sibling(node), self.at(node).parent);
        let above = self.at(parent).parent;
        self.replace(above, parent, own);
        let target = self.at(beside).parent;
        self.replace(target, beside, parent);
        self.nodes[parent as usize].children = Some([node, beside]);
        self.nodes[beside as usize].parent = parent;
        self.refit(above);
        self.refit(parent);
    }

    /// Gives a node another child in the place of one.
    fn replace(&mut self, node: u32, child: u32, by: u32) {
        let children = self.nodes[node as usize].children.as_mut().expect("a parent has children");
        children.iter_mut().filter(|at| **at == child).for_each(|at| *at = by);
        self.nodes[by as usize].parent = node;
    }

    /// Makes the boxes of a node and of all above it fit, and their heights.
    fn refit(&mut self, mut at: u32) {
        loop {
            let [left, right] =
                self.at(at).children.expect("a parent has children").map(|child| self.at(child));
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

    /// Takes nodes out and puts them back, those with the largest surfaces first, if they have a better place before any of them is
    /// moved, which is looked for in parallel, and when it is their turn.
    fn pass(&mut self) {
        // The root's children stay, for their parent could not go along.
        let may_move = |crown: &Self, node: u32| crown.at(node).parent != 0;
        let nodes: Vec<u32> = (1..self.nodes.len() as u32).collect();
        let is_movable = |stack: &mut Vec<_>, &node: &u32| {
            (may_move(self, node) && self.better(node, stack).is_some()).then_some(node)
        };
        let looked = nodes.par_iter().with_min_len(AT_ONCE).map_init(Vec::new, is_movable);
        let mut movable: Vec<u32> = looked.flatten_iter().collect();
        movable.sort_by_key(|&node| std::cmp::Reverse(self.at(node).area.to_bits()));
        let mut stack = Vec::new();
        for node in movable {
            if may_move(self, node)
                && let Some(beside) = self.better(node, &mut stack)
            {
                self.put(node, beside);
            }
        }
    }

    /// Half the surfaces of all inner nodes.
    fn surfaces(&self) -> f32 {
        self.nodes.iter().filter(|node| node.children.is_some()).map(|node| node.area).sum()
    }

    /// Makes passes while they are worth it; whether any was.
    fn improve(&mut self) -> bool {
        let mut passes = 0;
        let mut surfaces = self.surfaces();
        while passes < PASSES {
            self.pass();
            let before = std::mem::replace(&mut surfaces, self.surfaces());
            if surfaces > WORTH * before {
                break;
            }
            passes += 1;
        }
        passes > 0
    }

    /// Writes the forks of a node; the subtree that it is now, and its plan.
    fn fork(&self, at: u32, costs: Costs, forks: &mut Vec<Fork>) -> (Subtree, CollapsePlan) {
        let (Node { bounds, area, children, .. }, (subtree, built)) =
            (self.at(at), &self.subtrees[at as usize]);
        let Some([left, right]) = *children else { return (*subtree, built.plan) };
        let index = forks.len();
        // A place, for parents come before their children.
        forks.push(Fork { bounds: *bounds, children: [*subtree; 2], choice: Choice::default() });
        let ((left, left_plan), (right, right_plan)) =
            (self.fork(left, costs, forks), self.fork(right, costs, forks));
        let count = left.count + right.count;
        let (plan, choice) = CollapsePlan::merge(costs, &left_plan, &right_plan, *area, count as usize);
        forks[index] = Fork { bounds: *bounds, children: [left, right], choice };
        (Subtree::fork(index, count), plan)
    }
}

/// Improves the crown of a tree that has been built: its forks, the root first; none if the builder's nodes are as good.
pub(super) fn grow(tree: &Tree, root: Subtree, built: Built, costs: Costs) -> Vec<Fork> {
    let mut crown = Reinsertion::of(tree, root, built, costs);
    let mut forks = Vec::new();
    if crown.improve() {
        crown.fork(0, costs, &mut forks);
    }
    forks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{Aabb, mix};
    use glam::Vec3;

    fn number(i: u32) -> f32 {
        (mix(i) >> 8) as f32 / (1 << 24) as f32
    }

    /// Small triangles all over a room, and some as large as its walls, which planes cannot part from them.
    fn room(seed: u32, count: u32) -> Vec<[Vec3; 3]> {
        let corner = |i: u32| 10.0 * Vec3::new(number(i), number(i + 1), number(i + 2));
        let triangle = |i: u32| {
            let (at, salt) = (corner(seed + 16 * i), seed + 16 * i + 4);
            let size = if i.is_multiple_of(7) { 1.0 } else { 0.02 };
            [at, at + size * (corner(salt) - at), at + size * (corner(salt + 4) - at)]
        };
        (0..count).map(triangle).collect()
    }

    fn build(triangles: &[[Vec3; 3]]) -> Tree {
        Tree::build(triangles.len(), |i| triangles[i as usize], Costs::of_all)
    }

    /// What the builder makes, before it has a crown.
    fn crown(triangles: &[[Vec3; 3]]) -> Reinsertion {
        let mut tree = build(triangles);
        tree.forget_crown();
        let root = tree.root().expect("there are triangles");
        let costs = Costs::of_all(tree.bounds(root).half_area());
        let built = Built::few(tree.plan_of_few(root, costs), triangles.len());
        let mut crown = Reinsertion { nodes: Vec::new(), subtrees: Vec::new() };
        crown.push(&tree, root, built, 0);
        let mut at = 0;
        while at < crown.nodes.len() {
            let (subtree, _) = crown.subtrees[at];
            if subtree.count > 1 {
                let child = |child: Subtree| Built::few(tree.plan_of_few(child, costs), child.count as usize);
                let children = tree.branches.children(subtree);
                let children = children.map(|side| crown.push(&tree, side, child(side), at as u32));
                crown.nodes[at].children = Some(children);
            }
            at += 1;
        }
        crown
    }

    /// The same by trying all places: what the best of them saves.
    fn best_gain(crown: &Reinsertion, node: u32) -> f32 {
        let below = |of: u32| {
            let mut all = vec![of];
            let mut at = 0;
            while let Some(&next) = all.get(at) {
                all.extend(crown.at(next).children.into_iter().flatten());
                at += 1;
            }
            all
        };
        let (own, parent, below) = (crown.sibling(node), crown.at(node).parent, below(node));
        let places = (1..crown.nodes.len() as u32).filter(|at| !below.contains(at));
        places.filter(|&at| at != own && at != parent).map(|at| gain(crown, node, at)).fold(0.0, f32::max)
    }

    /// What is saved by a move.
    fn gain(crown: &Reinsertion, node: u32, beside: u32) -> f32 {
        let copy = |node: &Node| Node { bounds: node.bounds, ..*node };
        let mut moved = Reinsertion { nodes: crown.nodes.iter().map(copy).collect(), subtrees: Vec::new() };
        moved.put(node, beside);
        crown.surfaces() - moved.surfaces()
    }

    #[test]
    fn the_best_place_of_all_is_found() {
        let mut found = 0;
        for seed in 0..12 {
            let crown = crown(&room(seed << 16, 40));
            for node in (1..crown.nodes.len() as u32).filter(|&node| crown.at(node).parent != 0) {
                let best = best_gain(&crown, node);
                let better = crown.better(node, &mut Vec::new());
                let rounding = 1e-4 * crown.at(0).area;
                match better {
                    Some(beside) => {
                        let gain = gain(&crown, node, beside);
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
    fn a_crown_holds_what_the_tree_held_in_smaller_boxes() {
        for count in [40, 1000, 20_000] {
            let triangles = room(count, count);
            let mut tree = build(&triangles);
            assert!(!tree.branches.crown().is_empty(), "{count}: there is much to gain");
            let root = tree.root().expect("there are triangles");
            let mut surfaces = [0.0; 2];
            let mut primitives = tree.primitives(root);
            primitives.sort_unstable();
            assert!(primitives.iter().copied().eq(0..count));
            for surface in &mut surfaces {
                let mut stack = vec![tree.root().expect("there are triangles")];
                while let Some(of) = stack.pop() {
                    let around = tree.primitives(of).into_iter().map(|i| triangles[i as usize]);
                    let around = Aabb::around(around.flatten());
                    assert_eq!(tree.bounds(of).to_aabb(), around);
                    *surface += if of.count > 1 { around.half_area() } else { 0.0 };
                    stack.extend((of.count > 1).then(|| tree.branches.children(of)).into_iter().flatten());
                }
                tree.forget_crown();
            }
            assert!(surfaces[0] < 0.95 * surfaces[1], "{count}: {surfaces:?}");
        }
    }

    #[test]
    fn no_node_is_put_too_deep() {
        let mut crown = crown(&room(3, 40));
        let movable = |crown: &Reinsertion| {
            let mut nodes = (1..crown.nodes.len() as u32).filter(|&node| crown.at(node).parent != 0);
            nodes.find_map(|node| Some((node, crown.better(node, &mut Vec::new())?)))
        };
        let (node, beside) = movable(&crown).expect("there is much to gain");
        let parent = crown.at(node).parent;
        crown.nodes[node as usize].height = MAX_DEPTH;
        crown.put(node, beside);
        assert_eq!(crown.at(node).parent, parent);
        assert_eq!(movable(&crown), Some((node, beside)), "it stayed where it was");
        crown.nodes[node as usize].height = 1;
        crown.put(node, beside);
        assert_eq!(crown.sibling(node), beside);
    }

    #[test]
    fn trees_of_nothing_to_gain_have_no_crown() {
        assert!(build(&[]).root().is_none());
        let same = [[Vec3::ZERO, Vec3::X, Vec3::Y]; 300];
        assert!(build(&same).branches.crown().is_empty());
        assert!(build(&same[..1]).branches.crown().is_empty());
    }
}
