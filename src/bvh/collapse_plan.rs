//! How to make eight-wide nodes of a binary tree: the cheapest of all ways to merge nodes and cut
//! leaves, found by dynamic programming (Ylitie, Karras and Laine 2017, *Efficient Incoherent Ray
//! Traversal on GPUs Through Compressed WideTree BVHs*, section 3.1).
//!
//! The builder plans on its way back up, so that costs live on its stack and only the choices, four
//! bytes a node, go to memory.

use super::leaf_block::BLOCK_TRIANGLES;
use super::wide_tree::{Child, WIDTH};
use crate::geom::Aabb;

/// Cost of testing a ray against the boxes of a wide node.
pub(super) const NODE_COST: f32 = 1.0;

/// Cost of testing a ray that comes alone against a block of no triangles, and of each triangle: the eight of a block are
/// tested at once. Cheaper blocks make more and emptier ones, which trace no faster.
const ALONE: [f32; 2] = [1.0, 0.04];

/// The same for a ray that comes in a list: many are tested at once, but one triangle after the other.
const LISTED: [f32; 2] = [0.5, 0.7];

/// Share of the whole tree's surface from which on a box is so large that rays come to it in lists.
const LARGE: f32 = 0.01;

/// Share of the whole tree's surface up to which a box is too small for the crown.
const CROWN: f32 = 1.0 / 512.0;

/// Costs of blocks. They depend on how many rays meet a block together, and that on how large it is in the tree.
#[derive(Clone, Copy, Debug)]
pub(super) struct Costs {
    /// Half the surface above which boxes are large.
    large: f32,
    /// The same of the crown.
    crown: f32,
    /// Whether all of the tree is wanted, down to single primitives.
    all: bool,
}

impl Costs {
    /// Of a tree whose box has half the surface `area`.
    pub fn of(area: f32) -> Self {
        Self { large: LARGE * area, crown: CROWN * area, all: false }
    }

    /// The same of a tree that is wanted down to single primitives.
    pub fn of_all(area: f32) -> Self {
        Self { all: true, ..Self::of(area) }
    }

    /// Whether primitives that are a block are left as they are, in a box of half the surface `area`, when two boxes
    /// would have no smaller surfaces together.
    #[inline(always)]
    pub fn may_stay_whole(self, area: f32) -> bool {
        !self.all && area <= self.large
    }

    /// Whether a node with a box of half the surface `area` may be in the crown.
    #[inline(always)]
    pub fn may_be_in_crown(self, area: f32) -> bool {
        area > self.crown
    }

    /// Cost of testing a ray that meets a box of half the surface `area` with a block of `count` triangles.
    #[inline(always)]
    pub fn block(self, area: f32, count: usize) -> f32 {
        let [block, triangle] = if area > self.large { LISTED } else { ALONE };
        area * (block + triangle * count as f32)
    }

    /// Cost of testing a ray that meets a child's box with the child.
    pub fn child(self, bounds: &Aabb, child: Child) -> f32 {
        let area = bounds.half_area();
        if child.is_block() { self.block(area, child.triangles()) } else { area * NODE_COST }
    }

    /// In how many primitives the surface area heuristic counts them in parts of a box of half the surface `area`: where
    /// rays come alone, blocks that are not full cost as much as full ones.
    pub fn counted_in(self, area: f32) -> u32 {
        if area > self.large { 1 } else { BLOCK_TRIANGLES as u32 }
    }
}

/// Expected costs of one binary node's primitives: entry `i` when at most `i + 1` children of a wide node hold them.
/// The last entry is of no use.
#[derive(Clone, Copy, Debug)]
pub(super) struct CollapsePlan([f32; WIDTH]);

/// What the cheapest plan does with a binary node.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub(super) struct Choice(u32);

impl Choice {
    const BLOCK: u32 = 1 << 31;

    /// A block, and never anything else.
    pub fn whole() -> Self {
        Self(Self::BLOCK)
    }

    /// Whether, as one child, the primitives are a block and not an inner node.
    pub fn is_block(self) -> bool {
        self.0 & Self::BLOCK != 0
    }

    /// How many of `children` ≥ 2 go to the left; 0: one child fewer is as good.
    pub fn on_left(self, children: usize) -> usize {
        (self.0 >> (3 * (children - 2)) & 7) as usize
    }
}

impl CollapsePlan {
    /// A block of `count` primitives, and never anything else.
    #[inline(always)]
    pub fn whole(costs: Costs, area: f32, count: usize) -> Self {
        Self([costs.block(area, count); WIDTH])
    }

    /// A leaf of one primitive.
    #[inline(always)]
    pub fn leaf(costs: Costs, area: f32) -> Self {
        Self([costs.block(area, 1); WIDTH])
    }

    /// The plan of a node over two primitives: what [`CollapsePlan::merge`] says of their leaves.
    #[inline(always)]
    pub fn pair(costs: Costs, left: f32, right: f32, area: f32) -> (Self, Choice) {
        let apart = costs.block(left, 1) + costs.block(right, 1);
        let block = costs.block(area, 2);
        let inner = area * NODE_COST + apart;
        let together = block.min(inner);
        let mut choice = if block <= inner { Choice::BLOCK } else { 0 };
        choice |= 1 << (3 * (WIDTH - 2)) | u32::from(apart < together);
        let mut costs = [apart.min(together); WIDTH];
        costs[0] = together;
        (Self(costs), Choice(choice))
    }

    /// The plan of a node over `count` primitives from those of its children.
    #[inline(always)]
    pub fn merge(costs: Costs, left: &Self, right: &Self, area: f32, count: usize) -> (Self, Choice) {
        // forest[c - 1]: cheapest with exactly c children; lanes are children.
        let mut shifted = [f32::INFINITY; 2 * WIDTH];
        shifted[WIDTH..].copy_from_slice(&right.0);
        let (mut forest, mut on_left) = ([f32::INFINITY; WIDTH], [0u32; WIDTH]);
        for i in 1..WIDTH {
            let first = left.0[i - 1];
            let others: &[f32; WIDTH] = shifted[WIDTH - i..2 * WIDTH - i].try_into().expect("eight");
            for lane in 0..WIDTH {
                let cost = first + others[lane];
                let better = cost < forest[lane];
                forest[lane] = if better { cost } else { forest[lane] };
                on_left[lane] = if better { i as u32 } else { on_left[lane] };
            }
        }
        let inner = area * NODE_COST + forest[WIDTH - 1];
        let block = if count <= BLOCK_TRIANGLES { costs.block(area, count) } else { f32::INFINITY };
        let mut choice = if block <= inner { Choice::BLOCK } else { 0 };
        choice |= on_left[WIDTH - 1] << (3 * (WIDTH - 2));
        let mut cost = block.min(inner);
        forest[0] = cost;
        for i in 1..WIDTH - 1 {
            if forest[i] < cost {
                cost = forest[i];
                choice |= on_left[i] << (3 * (i - 1));
            }
            forest[i] = cost;
        }
        (Self(forest), Choice(choice))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Those of small boxes.
    const SMALL: Costs = Costs { large: f32::INFINITY, crown: f32::INFINITY, all: false };

    #[test]
    fn a_block_is_made_where_it_is_cheaper_than_its_parts() {
        let leaf = CollapsePlan([1.0; WIDTH]);
        // Half of a small box each: one block of two must beat two blocks and an inner node.
        let (plan, choice) = CollapsePlan::merge(SMALL, &leaf, &leaf, 1.0, 2);
        assert!(choice.is_block());
        assert_eq!(plan.0[0], SMALL.block(1.0, 2));
        // A dear block is split; two children then cost their sum.
        let (plan, choice) = CollapsePlan::merge(SMALL, &leaf, &leaf, 20.0, 2);
        assert!((plan.0[0] - SMALL.block(20.0, 2)).abs() < 1e-6 && choice.is_block());
        assert_eq!((plan.0[1], choice.on_left(2)), (2.0, 1));
        let (plan, choice) = CollapsePlan::merge(SMALL, &leaf, &leaf, 20.0, 9);
        assert!(!choice.is_block());
        assert_eq!(plan.0[0], 22.0);
    }

    #[test]
    fn large_flat_boxes_are_blocks_of_their_own() {
        // Two walls of a room of half the surface 3: apart each is met by a third of the rays, together by all.
        let costs = Costs::of(3.0);
        let wall = |area| {
            CollapsePlan::merge(
                costs,
                &CollapsePlan::leaf(costs, area),
                &CollapsePlan::leaf(costs, area),
                area,
                2,
            )
            .0
        };
        let (plan, choice) = CollapsePlan::merge(costs, &wall(1.0), &wall(1.0), 3.0, 4);
        assert_eq!((choice.on_left(2), plan.0[1]), (1, 2.0 * costs.block(1.0, 2)));
        // A hundredth of that and the room is crossed by few.
        let costs = Costs::of(300.1);
        let (plan, choice) = CollapsePlan::merge(costs, &wall(1.0), &wall(1.0), 3.0, 4);
        assert_eq!((choice.is_block(), plan.0[0]), (true, costs.block(3.0, 4)));
    }

    #[test]
    fn a_pair_s_plan_is_that_of_its_leaves() {
        for areas in [[1.0, 1.0, 1.0], [1.0, 1.0, 20.0], [3.0, 0.5, 3.1], [0.0, 0.0, 0.0]] {
            let [left, right, area] = areas;
            for large in [0.0, 2.0, f32::INFINITY] {
                let costs = Costs { large, ..SMALL };
                let leaf = |area| CollapsePlan::leaf(costs, area);
                let (merged, choice) = CollapsePlan::merge(costs, &leaf(left), &leaf(right), area, 2);
                let (plan, same) = CollapsePlan::pair(costs, left, right, area);
                // The last entry is of no use.
                assert_eq!((&plan.0[..WIDTH - 1], same), (&merged.0[..WIDTH - 1], choice), "{areas:?}");
            }
        }
    }

    #[test]
    fn the_plan_costs_what_the_best_of_all_splits_costs() {
        let number = |i: u32| (crate::geom::mix(i) >> 20) as f32;
        for seed in 0..500 {
            // Costs that fall with the number of children, as plans do.
            let falling = |salt: u32| {
                let mut costs: [f32; WIDTH] = std::array::from_fn(|i| number(seed * 64 + salt + i as u32));
                costs.sort_by(|a, b| b.total_cmp(a));
                CollapsePlan(costs)
            };
            let (left, right) = (falling(0), falling(8));
            let (plan, choice) = CollapsePlan::merge(SMALL, &left, &right, number(seed + 7777), 9);
            for children in 2..WIDTH {
                let exact = (2..=children)
                    .flat_map(|c| (1..c).map(move |i| left.0[i - 1] + right.0[c - i - 1]))
                    .fold(plan.0[0], f32::min);
                assert_eq!(plan.0[children - 1], exact);
                if choice.on_left(children) != 0 {
                    let i = choice.on_left(children);
                    assert_eq!(exact, left.0[i - 1] + right.0[children - i - 1]);
                }
            }
        }
    }
}
