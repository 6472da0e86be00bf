//! The plan for collapsing a binary tree into an eight-wide one: of all ways to merge binary nodes into wide
//! ones and to make leaf blocks, the cheapest by the surface area heuristic. Found by dynamic programming
//! (Ylitie, Karras and Laine 2017, *Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs*,
//! section 3.1).
//!
//! The builder plans on its way back up. So costs live on its stack, and only the choices go to memory, four
//! bytes a node.
//!
//! All areas here are half the surface of a box.

use super::child::{BLOCK_TRIANGLES, Child, WIDTH};
use crate::geom::Aabb;
use crate::lanes::from_index;

/// Cost of testing a ray against the boxes of a wide node.
pub(super) const NODE_COST: f32 = 1.0;

/// Cost of testing a single ray against a leaf block, and cost of each of its triangles: all eight are tested
/// at once. If blocks cost less, the plan makes more and emptier ones, which trace no faster.
const SINGLE_RAY_COST: [f32; 2] = [1.0, 0.04];

/// The same for one of a list of rays: many rays are tested at once, but against one triangle after the
/// other.
const LISTED_RAY_COST: [f32; 2] = [0.5, 0.7];

/// Boxes larger than this share of the whole tree's surface count as large: rays come to them in lists.
const LARGE: f32 = 0.01;

/// Nodes whose boxes are larger than this share of the whole tree's surface may take part in reinsertion.
const REINSERTED: f32 = 1.0 / 512.0;

/// The cost model of a tree. The cost of a leaf block depends on how many rays reach it together, and that on
/// how large its box is in the tree.
#[derive(Clone, Copy, Debug)]
pub(super) struct Costs {
    /// Boxes of more area are large.
    large_area: f32,
    /// Nodes with boxes of more area may take part in reinsertion.
    reinsertion_area: f32,
}

impl Costs {
    /// The model of a tree whose box has the given area.
    pub fn of_tree(area: f32) -> Self {
        Self { large_area: LARGE * area, reinsertion_area: REINSERTED * area }
    }

    /// The same with all boxes large: the builder goes down to single primitives.
    #[cfg(test)]
    pub fn of_large_boxes(area: f32) -> Self {
        Self { large_area: 0.0, ..Self::of_tree(area) }
    }

    /// True if up to eight primitives in a box of the given area may become one leaf block without a subtree
    /// below. The builder makes them one where two boxes would have no less area together.
    #[inline(always)]
    pub fn may_stop(self, area: f32) -> bool {
        area <= self.large_area
    }

    /// True if a node with a box of the given area may take part in reinsertion.
    #[inline(always)]
    pub fn may_reinsert(self, area: f32) -> bool {
        area > self.reinsertion_area
    }

    /// Cost of a leaf block of `count` triangles in a box of the given area: the area times the cost of a ray
    /// that enters.
    #[inline(always)]
    pub fn block(self, area: f32, count: usize) -> f32 {
        let [block, triangle] = if area > self.large_area { LISTED_RAY_COST } else { SINGLE_RAY_COST };
        area * (block + triangle * count as f32)
    }

    /// Cost of a child of a wide node, without that of nodes below it: the area of its box times the cost of
    /// a ray that enters.
    #[inline]
    pub fn child(self, bounds: &Aabb, child: Child) -> f32 {
        let area = bounds.half_area();
        if child.is_block() { self.block(area, child.triangles()) } else { area * NODE_COST }
    }

    /// The surface area heuristic rounds numbers of primitives in a box of the given area up to multiples of
    /// this. Where rays come singly, a partly filled leaf block costs as much as a full one.
    #[inline]
    pub fn count_multiple(self, area: f32) -> u32 {
        if area > self.large_area { 1 } else { BLOCK_TRIANGLES as u32 }
    }
}

/// The expected costs of the primitives below a binary node. Entry `i` is the least cost if at most `i + 1`
/// children of a wide node hold them. The last entry is not used.
#[derive(Clone, Copy, Debug)]
pub(super) struct CollapsePlan([f32; WIDTH]);

/// Choice of the cheapest plan for a binary node.
///
/// Bit 31: as one child, its primitives are a leaf block. Bits `3 (c - 2)` to `3 (c - 2) + 2`, for `c` = 2 to
/// 8: how many of `c` children go to the left subtree, or 0 if `c - 1` children are as good.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub(super) struct Choice(u32);

impl Choice {
    const BLOCK: u32 = 1 << 31;

    /// A leaf block, however many children there may be.
    pub const ONE_BLOCK: Self = Self(Self::BLOCK);

    /// True if the primitives, as one child, are a leaf block and not an inner node.
    #[inline]
    pub fn is_block(self) -> bool {
        self.0 & Self::BLOCK != 0
    }

    /// Number of the `children` ≥ 2 that go to the left subtree; 0 if one child fewer is as good.
    #[inline]
    pub fn on_left(self, children: usize) -> usize {
        (self.0 >> (3 * (children - 2)) & 7) as usize
    }
}

impl CollapsePlan {
    /// The plan of `count` primitives that are one leaf block, however many children there may be
    /// ([`Choice::ONE_BLOCK`]).
    #[inline(always)]
    pub fn one_block(costs: Costs, area: f32, count: usize) -> Self {
        Self([costs.block(area, count); WIDTH])
    }

    /// The plan of a node over two primitives whose boxes have the areas `left` and `right`. Equals
    /// [`CollapsePlan::merge`] of their leaves.
    #[inline(always)]
    pub fn pair(costs: Costs, left: f32, right: f32, area: f32) -> (Self, Choice) {
        let two_blocks = costs.block(left, 1) + costs.block(right, 1);
        let block = costs.block(area, 2);
        let inner = area * NODE_COST + two_blocks;
        let one_child = block.min(inner);
        let mut choice = if block <= inner { Choice::BLOCK } else { 0 };
        choice |= 1 << (3 * (WIDTH - 2)) | u32::from(two_blocks < one_child);
        let mut costs = [two_blocks.min(one_child); WIDTH];
        costs[0] = one_child;
        (Self(costs), Choice(choice))
    }

    /// The plan of a node over `count` primitives, from those of its children.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn merge(costs: Costs, left: &Self, right: &Self, area: f32, count: usize) -> (Self, Choice) {
        // forest[c - 1]: the least cost with exactly c children. The inner loop runs over c in lanes.
        let shifted: [f32; 2 * WIDTH] =
            from_index(|i| if i < WIDTH { f32::INFINITY } else { right.0[i - WIDTH] });
        let (mut forest, mut on_left) = ([f32::INFINITY; WIDTH], [0u32; WIDTH]);
        for i in 1..WIDTH {
            let left_cost = left.0[i - 1];
            let right_costs: &[f32; WIDTH] = shifted[WIDTH - i..2 * WIDTH - i].try_into().expect("eight");
            for lane in 0..WIDTH {
                let cost = left_cost + right_costs[lane];
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

    /// A model in which all boxes are small.
    const SMALL: Costs = Costs { large_area: f32::INFINITY, reinsertion_area: f32::INFINITY };

    #[test]
    fn a_block_is_made_where_it_is_cheaper_than_its_parts() {
        let leaf = CollapsePlan([1.0; WIDTH]);
        // In a small box one block of two triangles must beat two blocks and an inner node.
        let (plan, choice) = CollapsePlan::merge(SMALL, &leaf, &leaf, 1.0, 2);
        assert!(choice.is_block());
        assert_eq!(plan.0[0], SMALL.block(1.0, 2));
        // An expensive block is split; two children then cost their sum.
        let (plan, choice) = CollapsePlan::merge(SMALL, &leaf, &leaf, 20.0, 2);
        assert!((plan.0[0] - SMALL.block(20.0, 2)).abs() < 1e-6 && choice.is_block());
        assert_eq!((plan.0[1], choice.on_left(2)), (2.0, 1));
        let (plan, choice) = CollapsePlan::merge(SMALL, &leaf, &leaf, 20.0, 9);
        assert!(!choice.is_block());
        assert_eq!(plan.0[0], 22.0);
    }

    #[test]
    fn large_flat_boxes_become_blocks_of_their_own() {
        // Two walls of a room of area 3: as two blocks each is met by a third of the rays, as one by all.
        let costs = Costs::of_tree(3.0);
        let wall = |area| {
            CollapsePlan::merge(
                costs,
                &CollapsePlan::one_block(costs, area, 1),
                &CollapsePlan::one_block(costs, area, 1),
                area,
                2,
            )
            .0
        };
        let (plan, choice) = CollapsePlan::merge(costs, &wall(1.0), &wall(1.0), 3.0, 4);
        assert_eq!((choice.on_left(2), plan.0[1]), (1, 2.0 * costs.block(1.0, 2)));
        // If the room is a hundredth of the tree, few rays cross it.
        let costs = Costs::of_tree(300.1);
        let (plan, choice) = CollapsePlan::merge(costs, &wall(1.0), &wall(1.0), 3.0, 4);
        assert_eq!((choice.is_block(), plan.0[0]), (true, costs.block(3.0, 4)));
    }

    #[test]
    fn the_plan_of_a_pair_equals_that_of_its_merged_leaves() {
        for areas in [[1.0, 1.0, 1.0], [1.0, 1.0, 20.0], [3.0, 0.5, 3.1], [0.0, 0.0, 0.0]] {
            let [left, right, area] = areas;
            for large_area in [0.0, 2.0, f32::INFINITY] {
                let costs = Costs { large_area, ..SMALL };
                let leaf = |area| CollapsePlan::one_block(costs, area, 1);
                let (merged, choice) = CollapsePlan::merge(costs, &leaf(left), &leaf(right), area, 2);
                let (plan, same) = CollapsePlan::pair(costs, left, right, area);
                // The last entry is not used.
                assert_eq!((&plan.0[..WIDTH - 1], same), (&merged.0[..WIDTH - 1], choice), "{areas:?}");
            }
        }
    }

    #[test]
    fn the_plan_costs_what_the_best_of_all_splits_costs() {
        let number = |i: u32| (crate::geom::mix(i) >> 20) as f32;
        for seed in 0..500 {
            // Costs that fall with the number of children, as those of plans do.
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
