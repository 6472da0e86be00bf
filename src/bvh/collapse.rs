//! Binary tree → eight-wide tree: the cheapest of all ways to merge nodes and cut leaves, found by
//! dynamic programming (Ylitie, Karras and Laine 2017, *Efficient Incoherent Ray Traversal on GPUs
//! Through Compressed Wide BVHs*, section 3.1).

use super::binary::Binary;
use super::block::{BLOCK_TRIANGLES, Block};
use super::sah::half_area;
use super::wide::{Child, WIDTH, Wide, WideNode};
use glam::Vec3;

/// Cost of testing a ray against the boxes of a wide node.
const NODE_COST: f32 = 1.0;

/// Cost of testing a ray against a block of no triangles, and of each triangle.
const BLOCK_COST: [f32; 2] = [0.6, 0.08];

/// Subtrees at least this large are planned in parallel.
const PARALLEL: usize = 1 << 12;

/// The cheapest ways to hold one binary node's primitives.
#[derive(Clone, Copy, Default)]
struct Plan {
    /// Expected cost when at most `i + 1` children of a wide node hold them.
    cost: [f32; WIDTH - 1],
    /// How many of `i + 1` children go to the left; 0: one child fewer is as good.
    left: [u8; WIDTH],
    /// Whether, as one child, they are a block and not an inner node.
    block: bool,
}

/// Collapses a tree; `corners` and `masked` tell of primitives.
pub(super) fn collapse(
    binary: &Binary,
    corners: impl Fn(u32) -> [Vec3; 3],
    masked: impl Fn(u32) -> bool,
) -> Wide {
    let mut plans = vec![Plan::default(); binary.nodes.len()];
    let mut layout = Layout {
        binary,
        plans: &[],
        nodes: vec![WideNode::VACANT],
        blocks: Vec::new(),
        depth: 1,
        corners,
        masked,
    };
    if !binary.nodes.is_empty() {
        plan(binary, &mut plans, 0);
        layout.plans = &plans;
        layout.fill();
    }
    let Layout { nodes, blocks, depth, .. } = layout;
    Wide { nodes: nodes.as_slice().into(), blocks: blocks.as_slice().into(), depth }
}

/// Plans the subtree whose root is node `at`; `plans` begins with its plan.
fn plan(binary: &Binary, plans: &mut [Plan], at: usize) {
    let node = &binary.nodes[at];
    let area = half_area(&node.bounds());
    let block_cost = area * (BLOCK_COST[0] + BLOCK_COST[1] * node.count as f32);
    if node.is_leaf() {
        plans[0] = Plan { cost: [block_cost; WIDTH - 1], left: [0; WIDTH], block: true };
        return;
    }
    let [left_at, right_at] = binary.children(at);
    let (root, below) = plans.split_first_mut().expect("a plan for the root");
    let (left, right) = below.split_at_mut(right_at - left_at);
    if node.count as usize >= PARALLEL {
        rayon::join(|| plan(binary, left, left_at), || plan(binary, right, right_at));
    } else {
        plan(binary, left, left_at);
        plan(binary, right, right_at);
    }
    *root = merge(&left[0], &right[0], area, (node.count as usize <= BLOCK_TRIANGLES).then_some(block_cost));
}

/// The plan of a node from those of its children.
fn merge(left: &Plan, right: &Plan, area: f32, block_cost: Option<f32>) -> Plan {
    let mut forest = [f32::INFINITY; WIDTH];
    let mut plan = Plan::default();
    for children in 2..=WIDTH {
        for on_left in 1..children {
            let cost = left.cost[on_left - 1] + right.cost[children - on_left - 1];
            if cost < forest[children - 1] {
                forest[children - 1] = cost;
                plan.left[children - 1] = on_left as u8;
            }
        }
    }
    let inner_cost = area * NODE_COST + forest[WIDTH - 1];
    plan.block = block_cost.is_some_and(|cost| cost <= inner_cost);
    plan.cost[0] = if plan.block { block_cost.unwrap_or(inner_cost) } else { inner_cost };
    for (i, &cost) in forest[..WIDTH - 1].iter().enumerate().skip(1) {
        plan.cost[i] = cost.min(plan.cost[i - 1]);
        if plan.cost[i - 1] <= cost {
            plan.left[i] = 0;
        }
    }
    plan
}

/// Lays the planned tree out in memory: children of one node side by side.
struct Layout<'a, C, M> {
    binary: &'a Binary,
    plans: &'a [Plan],
    nodes: Vec<WideNode>,
    blocks: Vec<Block>,
    depth: usize,
    corners: C,
    masked: M,
}

impl<C: Fn(u32) -> [Vec3; 3], M: Fn(u32) -> bool> Layout<'_, C, M> {
    fn fill(&mut self) {
        // Wide node, the binary node that it expands, its depth.
        let mut stack = vec![(0, 0, 1)];
        while let Some((wide_at, at, depth)) = stack.pop() {
            self.depth = self.depth.max(depth);
            let mut children = Vec::with_capacity(WIDTH);
            if self.plans[at].block {
                children.push(at); // Only a root of few primitives.
            } else {
                self.gather(at, WIDTH, &mut children);
            }
            let mut node = WideNode::VACANT;
            let slots = self.slots(at, &children);
            for (&child, slot) in children.iter().zip(slots) {
                let binary = &self.binary.nodes[child];
                let reference = if self.plans[child].block {
                    self.blocks.push(self.block(child));
                    Child::block(self.blocks.len() - 1, binary.count as usize)
                } else {
                    self.nodes.push(WideNode::VACANT);
                    stack.push((self.nodes.len() - 1, child, depth + 1));
                    Child::node(self.nodes.len() - 1)
                };
                node.set(slot, binary.bounds(), reference);
            }
            self.nodes[wide_at] = node;
        }
    }

    /// The binary nodes that the plan makes of node `at` when it may have `room` children.
    fn gather(&self, at: usize, mut room: usize, children: &mut Vec<usize>) {
        let plan = &self.plans[at];
        while room > 1 && plan.left[room - 1] == 0 {
            room -= 1;
        }
        if room == 1 {
            return children.push(at);
        }
        let on_left = plan.left[room - 1] as usize;
        let [left, right] = self.binary.children(at);
        self.gather(left, on_left, children);
        self.gather(right, room - on_left, children);
    }

    fn block(&self, at: usize) -> Block {
        let subtree = &self.binary.nodes[at..at + 2 * self.binary.nodes[at].count as usize - 1];
        let mut primitives: Vec<u32> = subtree.iter().filter(|n| n.is_leaf()).map(|n| n.index).collect();
        primitives.sort_unstable();
        Block::new(primitives.into_iter().map(|p| (p, (self.corners)(p), (self.masked)(p))))
    }

    /// A slot for each child: greedily those that lie farthest in the direction of the slot's octant.
    fn slots(&self, parent: usize, children: &[usize]) -> [usize; WIDTH] {
        let centre = self.binary.nodes[parent].bounds().centre();
        let offsets: Vec<Vec3> =
            children.iter().map(|&c| self.binary.nodes[c].bounds().centre() - centre).collect();
        let gain = |child: usize, slot: usize| {
            (0..3)
                .map(|axis| if slot >> axis & 1 == 1 { offsets[child][axis] } else { -offsets[child][axis] })
                .sum()
        };
        let mut slots = [usize::MAX; WIDTH];
        let mut taken = [false; WIDTH];
        for _ in children {
            let mut best = (f32::NEG_INFINITY, 0, 0);
            for child in (0..children.len()).filter(|&c| slots[c] == usize::MAX) {
                for slot in (0..WIDTH).filter(|&s| !taken[s]) {
                    let gain: f32 = gain(child, slot);
                    if gain > best.0 {
                        best = (gain, child, slot);
                    }
                }
            }
            slots[best.1] = best.2;
            taken[best.2] = true;
        }
        slots
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_plan_costs_no_more_than_any_cut_of_a_small_tree() {
        // Two pairs: one block of four must beat two blocks and an inner node when boxes coincide.
        let same = Plan { cost: [1.0; 7], left: [0; 8], block: true };
        let plan = merge(&same, &same, 1.0, Some(1.5));
        assert!(plan.block && plan.cost[0] == 1.5);
        // A dear block is split; two children then cost their sum.
        let plan = merge(&same, &same, 1.0, Some(9.0));
        assert!(!plan.block);
        assert_eq!((plan.cost[0], plan.cost[1], plan.left[1]), (3.0, 2.0, 1));
    }
}
