//! The bottom of the binary tree: two to eight primitives in the lanes of a register. Three or four are split
//! in the best of all ways, more at the best of all planes across the longest axis. Most are cheaper as one
//! leaf block, and then no nodes are made below their root.

use super::binary_tree::InnerNode;
use super::collapse_plan::{Choice, CollapsePlan, Costs};
use super::packed_bounds::PackedBounds;
use super::reference::{Extent, Reference};
use crate::lanes::{Lanes, OutlinedTask, both, columns, eight_u32, load_one, store_one};

/// The largest number of primitives in a small subtree.
pub(super) const MAX_SMALL: usize = 8;

/// Builds the subtree over two to [`MAX_SMALL`] references; run by [`Lanes::outlined`].
pub(super) struct SmallSubtree<'a> {
    pub references: &'a mut [Reference],
    pub inner: &'a mut [InnerNode],
    pub costs: Costs,
    /// Split at the median: the depth that is left suffices for nothing else.
    pub at_median: bool,
    pub extent: &'a Extent,
}

/// An inner node while its subtree is built.
#[derive(Clone, Copy, Default)]
struct SmallNode {
    /// Number of primitives.
    count: usize,
    /// Number of primitives on the left.
    left_count: usize,
    /// For an inner node its index, for a leaf its lane plus [`MAX_SMALL`].
    children: [usize; 2],
}

impl<L: Lanes> OutlinedTask<L> for SmallSubtree<'_> {
    type Output = CollapsePlan;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) -> CollapsePlan {
        let Self { references, inner, costs, at_median, extent } = self;
        let count = references.len();
        let mut rows = [references[0]; MAX_SMALL];
        for (i, row) in rows.iter_mut().enumerate() {
            *row = references[i.min(count - 1)];
        }
        let boxes = LaneBoxes::new(l, &rows);
        let leaf_areas = store_one(l, half_area(l, boxes.columns));
        let first = match count {
            2 => LaneSplit { left: 1, area: leaf_areas[0] + leaf_areas[1] },
            _ => boxes.best_split(l, (1 << count) - 1, at_median),
        };
        let area = extent.bounds.half_area();
        if area <= first.area && costs.may_stop(area) {
            inner[0] = InnerNode::new(&extent.bounds, 1, Choice::ONE_BLOCK);
            return CollapsePlan::one_block(costs, area, count);
        }
        let nodes = boxes.split_down(l, references, first, at_median);
        // Inner nodes come before their children, and all inner nodes before the leaves.
        let mut bounds = [PackedBounds::EMPTY; 2 * MAX_SMALL];
        let mut areas = [0.0; 2 * MAX_SMALL];
        let mut plans = [CollapsePlan::one_block(costs, 0.0, 1); 2 * MAX_SMALL];
        for lane in 0..MAX_SMALL {
            areas[MAX_SMALL + lane] = leaf_areas[lane];
            bounds[MAX_SMALL + lane] = rows[lane].0;
            plans[MAX_SMALL + lane] = CollapsePlan::one_block(costs, areas[MAX_SMALL + lane], 1);
        }
        for root in (0..count - 1).rev() {
            let SmallNode { count, left_count, children } = nodes[root];
            let [a, b] = both(children, |child| child % (2 * MAX_SMALL));
            let union = PackedBounds::store(l, l.min(bounds[a].load(l), bounds[b].load(l)));
            let area = union.half_area();
            let (plan, choice) = match count {
                2 => CollapsePlan::pair(costs, areas[a], areas[b], area),
                _ => CollapsePlan::merge(costs, &plans[a], &plans[b], area, count),
            };
            inner[root] = InnerNode::new(&union, left_count, choice);
            (bounds[root], areas[root], plans[root]) = (union, area, plan);
        }
        plans[0]
    }
}

/// A split of some lanes in two.
#[derive(Clone, Copy)]
struct LaneSplit {
    /// The lanes on the left; 0 if no split was chosen.
    left: u32,
    /// Sum of half the surface areas of both sides' boxes; infinite if no split was chosen.
    area: f32,
}

impl LaneSplit {
    const NONE: Self = Self { left: 0, area: f32::INFINITY };
}

/// The lowest `count` of `lanes`.
#[inline(always)]
fn lowest(lanes: u32, count: usize) -> u32 {
    let mut above = lanes;
    for _ in 0..count {
        above &= above - 1;
    }
    lanes & !above
}

/// All splits of three or four primitives, one in each lane. The first two rows name the primitives on the
/// left, the other three those on the right, with repetitions. Of equally good splits the first is taken;
/// even ones come first.
type SplitTable = [[u32; MAX_SMALL]; 5];

const SPLITS_OF_THREE: SplitTable = [
    [0, 1, 2, 0, 0, 0, 0, 0],
    [0, 1, 2, 0, 0, 0, 0, 0],
    [1, 0, 0, 1, 1, 1, 1, 1],
    [2, 2, 1, 2, 2, 2, 2, 2],
    [2, 2, 1, 2, 2, 2, 2, 2],
];

const SPLITS_OF_FOUR: SplitTable = [
    [0, 0, 0, 0, 1, 2, 3, 0],
    [1, 2, 3, 0, 1, 2, 3, 1],
    [2, 1, 1, 1, 0, 0, 0, 2],
    [3, 3, 2, 2, 2, 1, 1, 3],
    [3, 3, 2, 3, 3, 3, 2, 3],
];

/// The boxes and keys of up to eight references, one in each lane.
struct LaneBoxes<'a, L: Lanes> {
    rows: &'a [Reference; MAX_SMALL],
    /// The lower corners, then the negated upper corners.
    columns: [L::F; 6],
    keys: [L::F; 3],
    /// The keys in memory.
    key_rows: [[f32; MAX_SMALL]; 3],
}

impl<'a, L: Lanes> LaneBoxes<'a, L> {
    #[inline(always)]
    fn new(l: L, rows: &'a [Reference; MAX_SMALL]) -> Self {
        let [a, b, c, _, x, y, z, _] = columns(l, bytemuck::cast_ref(rows));
        let keys = [l.sub(a, x), l.sub(b, y), l.sub(c, z)];
        let key_rows = [store_one(l, keys[0]), store_one(l, keys[1]), store_one(l, keys[2])];
        Self { rows, columns: [a, b, c, x, y, z], keys, key_rows }
    }

    /// The best split of some lanes; none for two lanes, or if they are to be split at the median.
    #[inline(always)]
    fn best_split(&self, l: L, lanes: u32, at_median: bool) -> LaneSplit {
        match lanes.count_ones() {
            3 if !at_median => self.best_of_table(l, lanes, &SPLITS_OF_THREE),
            4 if !at_median => self.best_of_table(l, lanes, &SPLITS_OF_FOUR),
            5.. if !at_median => self.best_plane(l, lanes),
            _ => LaneSplit::NONE,
        }
    }

    /// Splits the references down to single ones, all of them by `first`, and sorts them into the order of
    /// the leaves. Returns the inner nodes, the root first.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn split_down(
        &self,
        l: L,
        references: &mut [Reference],
        first: LaneSplit,
        at_median: bool,
    ) -> [SmallNode; MAX_SMALL] {
        let mut nodes = [SmallNode::default(); MAX_SMALL];
        // For each subtree its lanes, its first reference and its inner node.
        let mut stack = [(0, 0, 0); MAX_SMALL];
        stack[0] = ((1u32 << references.len()) - 1, 0, 0);
        let mut pending = 1;
        while pending > 0 {
            pending -= 1;
            let (lanes, start, root) = stack[pending];
            let count = lanes.count_ones() as usize;
            let LaneSplit { left, .. } = if root == 0 { first } else { self.best_split(l, lanes, at_median) };
            let left = if left == 0 { lowest(lanes, count / 2) } else { left };
            let left_count = left.count_ones() as usize;
            let sides = [(left, start, root + 1), (lanes & !left, start + left_count, root + left_count)];
            let mut children = [0; 2];
            for side in [1, 0] {
                let (lanes, start, root) = sides[side];
                let lane = lanes.trailing_zeros() as usize % MAX_SMALL;
                if lanes & (lanes - 1) == 0 {
                    references[start] = self.rows[lane];
                    children[side] = MAX_SMALL + lane;
                } else {
                    stack[pending] = sides[side];
                    pending += 1;
                    children[side] = root;
                }
            }
            nodes[root] = SmallNode { count, left_count, children };
        }
        nodes
    }

    /// The cheapest split in `table`, which is for as many primitives as there are `lanes`. Each side will be
    /// one leaf block, whatever its number of triangles: only the areas count.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn best_of_table(&self, l: L, lanes: u32, table: &SplitTable) -> LaneSplit {
        let lane_of_primitive = l.bits(l.pack(lanes, l.from_bits(eight_u32(l, &[0, 1, 2, 3, 4, 5, 6, 7]))));
        let (mut left, mut right) = ([l.splat(f32::INFINITY); 6], [l.splat(f32::INFINITY); 6]);
        for (row, primitives) in table.iter().enumerate() {
            let lanes = l.permute_u32(lane_of_primitive, eight_u32(l, primitives));
            let side = if row < 2 { &mut left } else { &mut right };
            for (i, number) in side.iter_mut().enumerate() {
                *number = l.min(*number, l.from_bits(l.permute_u32(l.bits(self.columns[i]), lanes)));
            }
        }
        let cost = l.add(half_area(l, left), half_area(l, right));
        let area = l.lowest(cost);
        let split = l.eq(L::ALL, cost, l.splat(area)).trailing_zeros() as usize % MAX_SMALL;
        let mut left = 0;
        for primitives in &table[..2] {
            let primitive = primitives[split] as usize;
            left |= lanes & !lowest(lanes, primitive) & lowest(lanes, primitive + 1);
        }
        LaneSplit { left, area }
    }

    /// The split of `lanes` by the cheapest plane across the longest axis; none if all keys are equal.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn best_plane(&self, l: L, lanes: u32) -> LaneSplit {
        let infinite = l.splat(f32::INFINITY);
        let (mut longest, mut axis) = (0.0, 0);
        for (i, &keys) in self.keys.iter().enumerate() {
            let highest = l.highest(l.select(lanes, keys, l.neg(infinite)));
            let size = highest - l.lowest(l.select(lanes, keys, infinite));
            axis = if size > longest { i } else { axis };
            longest = if size > longest { size } else { longest };
        }
        let (keys, key_row) = (load_one(l, &self.key_rows[axis]), &self.key_rows[axis]);
        // In each lane: the box of all references whose key is at most this lane's, and the box of the
        // others.
        let (mut left, mut right) = ([infinite; 6], [infinite; 6]);
        let mut rest = lanes;
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize % MAX_SMALL;
            rest &= rest - 1;
            let is_left = l.le(L::ALL, l.splat(key_row[lane]), keys);
            // The box is raised to infinity on the side that it is not on, which leaves the union as it is.
            let left_floor = l.select(is_left, l.splat(f32::NEG_INFINITY), infinite);
            let right_floor = l.neg(left_floor);
            let row = &self.rows[lane].0.0;
            for at in 0..6 {
                let number = l.splat(row[at + at / 3]);
                left[at] = l.min(left[at], l.max(number, left_floor));
                right[at] = l.min(right[at], l.max(number, right_floor));
            }
        }
        let cost = l.add(half_area(l, left), half_area(l, right));
        let cost = l.select(lanes, cost, infinite);
        let area = l.lowest(cost);
        if area == f32::INFINITY {
            return LaneSplit::NONE;
        }
        let lane = l.eq(L::ALL, cost, l.splat(area)).trailing_zeros() as usize % MAX_SMALL;
        LaneSplit { left: l.le(lanes, keys, l.splat(key_row[lane])), area }
    }
}

/// Half the surface area of the box in each lane; infinite for empty ones.
#[inline(always)]
fn half_area<L: Lanes>(l: L, [a, b, c, x, y, z]: [L::F; 6]) -> L::F {
    let (x, y, z) = (l.add(a, x), l.add(b, y), l.add(c, z));
    l.add(l.add(l.mul(x, y), l.mul(y, z)), l.mul(z, x))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Aabb;
    use crate::lanes::{LaneTask, SimdLevel};
    use glam::Vec3;

    #[test]
    fn the_tables_hold_all_splits() {
        for (count, table) in [(3, &SPLITS_OF_THREE), (4, &SPLITS_OF_FOUR)] {
            let mut found = std::collections::BTreeSet::new();
            for lane in 0..MAX_SMALL {
                let side = |rows: &[[u32; MAX_SMALL]]| rows.iter().fold(0, |all, row| all | 1 << row[lane]);
                let (left, right): (u32, u32) = (side(&table[..2]), side(&table[2..]));
                assert_eq!((left & right, left | right), (0, (1 << count) - 1));
                found.insert(left.min(right));
            }
            assert_eq!(found.len(), (1 << (count - 1)) - 1);
        }
    }

    /// The best split of some lanes.
    struct BestSplit<'a>(&'a [Reference; MAX_SMALL], u32);

    impl LaneTask for BestSplit<'_> {
        type Output = LaneSplit;

        fn run<L: Lanes>(self, l: L) -> LaneSplit {
            LaneBoxes::new(l, self.0).best_split(l, self.1, false)
        }
    }

    #[test]
    fn the_cheapest_split_is_found() {
        let number = |i: u32| (crate::geom::mix(i) >> 8) as f32 / (1 << 24) as f32;
        for seed in 0..300 {
            let rows: [Reference; MAX_SMALL] = std::array::from_fn(|i| {
                let number = |salt: u32| number(seed * 64 + 8 * i as u32 + salt);
                let min = Vec3::new(8.0 * number(0), number(1), number(2));
                Reference::new(i as u32, &Aabb { min, max: min + Vec3::new(number(3), number(4), number(5)) })
            });
            let lanes = if seed < 8 { 0xff } else { crate::geom::mix(!seed) & 0xff };
            if lanes.count_ones() < 3 {
                continue;
            }
            let is_in = |set: u32| move |lane: &usize| set >> lane & 1 == 1;
            let cost = |set: u32| {
                let bounds = |lane: usize| rows[lane].0;
                let around = (0..MAX_SMALL)
                    .filter(is_in(set))
                    .map(bounds)
                    .fold(PackedBounds::EMPTY, |a, b| a.union(&b));
                around.half_area()
            };
            let total = |left: u32| cost(left) + cost(lanes & !left);
            let LaneSplit { left, area } = SimdLevel::run_eight(BestSplit(&rows, lanes));
            assert!(left != 0 && left & !lanes == 0 && left != lanes);
            let cheapest = match lanes.count_ones() {
                3 | 4 => (1..lanes).filter(|left| left & !lanes == 0).map(total).fold(f32::MAX, f32::min),
                _ => {
                    // The first axis is by far the longest.
                    let key = |lane: usize| rows[lane].key_on(0);
                    let up_to = |last: usize| {
                        let below =
                            (0..MAX_SMALL).filter(is_in(lanes)).filter(|&lane| key(lane) <= key(last));
                        below.fold(0, |set, lane| set | 1 << lane)
                    };
                    let planes = (0..MAX_SMALL).filter(is_in(lanes)).map(up_to).filter(|&left| left != lanes);
                    planes.map(total).fold(f32::MAX, f32::min)
                }
            };
            assert_eq!([total(left), area], [cheapest; 2], "{lanes:b} {left:b}");
        }
    }

    /// Builds a subtree; whether it is one block, and how many inner nodes were made.
    struct Build<'a>(&'a [Reference], Costs);

    impl LaneTask for Build<'_> {
        type Output = (bool, usize);

        fn run<L: Lanes>(self, l: L) -> Self::Output {
            let Self(references, costs) = self;
            let mut references = references.to_vec();
            let mut inner: Vec<InnerNode> = bytemuck::zeroed_vec(references.len() - 1);
            let extent = &Extent::in_lanes(l, &references);
            let subtree = SmallSubtree {
                references: &mut references,
                inner: &mut inner,
                costs,
                at_median: false,
                extent,
            };
            OutlinedTask::run(subtree, l);
            (
                inner[0].choice == Choice::ONE_BLOCK,
                inner.iter().filter(|inner| inner.bounds().half_area() > 0.0).count(),
            )
        }
    }

    #[test]
    fn primitives_become_one_block_where_two_boxes_have_no_less_area() {
        let mut found = [0; 2];
        for seed in 0..600 {
            let number = |i: u32| (crate::geom::mix(64 * seed + i) >> 8) as f32 / (1 << 24) as f32;
            let count = 2 + seed as usize % 7;
            // The boxes spread more and more with the seed.
            let rows: [Reference; MAX_SMALL] = std::array::from_fn(|i| {
                let corner = |salt: u32| {
                    let salt = 8 * (i % count) as u32 + salt;
                    Vec3::new(1.0 + number(salt), number(salt + 1), number(salt + 2))
                };
                let (at, size) = (corner(0) * (seed / 60) as f32, corner(3));
                Reference::new(i as u32, &Aabb { min: at, max: at + size })
            });
            let around = |set: u32| {
                let among = (0..count).filter(|lane| set >> lane & 1 == 1).map(|lane| rows[lane].0);
                among.fold(PackedBounds::EMPTY, |a, b| a.union(&b)).half_area()
            };
            let all = (1 << count) - 1;
            let split_area = match count {
                2 => around(1) + around(2),
                _ => SimdLevel::run_eight(BestSplit(&rows, all)).area,
            };
            let wanted = around(all) <= split_area;
            let built = |costs| SimdLevel::run_eight(Build(&rows[..count], costs));
            // The box is small in a large tree.
            let (is_block, made) = built(Costs::of_tree(1e9));
            assert_eq!((is_block, made), (wanted, if wanted { 1 } else { count - 1 }));
            // Large boxes have all nodes.
            assert_eq!(built(Costs::of_tree(0.0)).1, count - 1);
            found[usize::from(is_block)] += 1;
        }
        assert!(found[0] > 50 && found[1] > 50, "{found:?}");
    }
}
