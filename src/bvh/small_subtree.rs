//! The bottom of the binary tree: up to eight primitives in the lanes of a register. All ways to cut up
//! to four in two are tried, and of more all planes across the longest axis. Most are better a block as they are, and then
//! nothing below their root is made.

use super::collapse_plan::{Choice, CollapsePlan, Costs};
use super::reference::{Bounds, Extent, Reference};
use super::sah::Inner;
use crate::lanes::{Lanes, OutlinedTask, columns, eight_ids, load_one, store_one};

/// How many are few.
pub(super) const FEW: usize = 8;

/// A subtree over at most [`FEW`] and at least two references, to be built by [`Lanes::outlined`].
pub(super) struct Few<'a> {
    pub references: &'a mut [Reference],
    pub inner: &'a mut [Inner],
    pub costs: Costs,
    /// Halve, for there is no room for more depth.
    pub halve: bool,
    pub extent: &'a Extent,
}

/// An inner node while its subtree is built.
#[derive(Clone, Copy, Default)]
struct Cut {
    count: usize,
    /// Primitives on the left.
    left: usize,
    /// Inner nodes, or [`FEW`] more than the lanes of leaves.
    children: [usize; 2],
}

impl<L: Lanes> OutlinedTask<L> for Few<'_> {
    type Output = CollapsePlan;

    #[inline(always)]
    fn run(self, l: L) -> CollapsePlan {
        let Self { references, inner, costs, halve, extent } = self;
        let count = references.len();
        let mut rows = [references[0]; FEW];
        for (i, row) in rows.iter_mut().enumerate() {
            *row = references[i.min(count - 1)];
        }
        let choices = Choices::new(l, &rows);
        let leaves = store_one(l, half_area(l, choices.columns));
        let first = match count {
            2 => Way { left: 1, areas: leaves[0] + leaves[1] },
            _ => choices.best(l, (1 << count) - 1, halve),
        };
        let area = extent.bounds.half_area();
        if area <= first.areas && costs.may_stay_whole(area) {
            inner[0] = Inner::new(&extent.bounds, 1, Choice::whole());
            return CollapsePlan::whole(costs, area, count);
        }
        let cuts = choices.cuts(l, references, first, halve);
        // Children lie behind their parents, and leaves behind inner nodes.
        let mut bounds = [Bounds::EMPTY; 2 * FEW];
        let mut areas = [0.0; 2 * FEW];
        let mut plans = [CollapsePlan::leaf(costs, 0.0); 2 * FEW];
        areas[FEW..].copy_from_slice(&leaves);
        for lane in 0..FEW {
            bounds[FEW + lane] = rows[lane].0;
            plans[FEW + lane] = CollapsePlan::leaf(costs, areas[FEW + lane]);
        }
        for root in (0..count - 1).rev() {
            let Cut { count, left, children } = cuts[root];
            let [a, b] = children.map(|child| child % (2 * FEW));
            let around = Bounds::of(l, l.min(bounds[a].load(l), bounds[b].load(l)));
            let area = around.half_area();
            let (plan, choice) = match count {
                2 => CollapsePlan::pair(costs, areas[a], areas[b], area),
                _ => CollapsePlan::merge(costs, &plans[a], &plans[b], area, count),
            };
            inner[root] = Inner::new(&around, left, choice);
            (bounds[root], areas[root], plans[root]) = (around, area, plan);
        }
        plans[0]
    }
}

/// A way to cut some lanes in two.
#[derive(Clone, Copy)]
struct Way {
    /// Lanes on the left; none where there is nothing to choose from.
    left: u32,
    /// Half the surfaces of both sides' boxes; infinite where there is nothing to choose from.
    areas: f32,
}

impl Way {
    const NONE: Self = Self { left: 0, areas: f32::INFINITY };
}

/// The `count` lowest of lanes.
#[inline(always)]
fn lowest(lanes: u32, count: usize) -> u32 {
    let mut above = lanes;
    for _ in 0..count {
        above &= above - 1;
    }
    lanes & !above
}

/// All ways to cut three or four in two, in lanes: two tables of what is on the left, three of what is on the right,
/// with repetitions. Of equals the first way is taken, and halves come first.
type Ways = [[u32; FEW]; 5];

const THREE: Ways = [
    [0, 1, 2, 0, 0, 0, 0, 0],
    [0, 1, 2, 0, 0, 0, 0, 0],
    [1, 0, 0, 1, 1, 1, 1, 1],
    [2, 2, 1, 2, 2, 2, 2, 2],
    [2, 2, 1, 2, 2, 2, 2, 2],
];

const FOUR: Ways = [
    [0, 0, 0, 0, 1, 2, 3, 0],
    [1, 2, 3, 0, 1, 2, 3, 1],
    [2, 1, 1, 1, 0, 0, 0, 2],
    [3, 3, 2, 2, 2, 1, 1, 3],
    [3, 3, 2, 3, 3, 3, 2, 3],
];

/// Boxes and keys of few references.
struct Choices<'a, L: Lanes> {
    rows: &'a [Reference; FEW],
    columns: [L::F; 6],
    keys: [L::F; 3],
    key_rows: [[f32; FEW]; 3],
}

impl<'a, L: Lanes> Choices<'a, L> {
    #[inline(always)]
    fn new(l: L, rows: &'a [Reference; FEW]) -> Self {
        let [a, b, c, _, x, y, z, _] = columns(l, bytemuck::cast_ref(rows));
        let keys = [l.sub(a, x), l.sub(b, y), l.sub(c, z)];
        let key_rows = [store_one(l, keys[0]), store_one(l, keys[1]), store_one(l, keys[2])];
        Self { rows, columns: [a, b, c, x, y, z], keys, key_rows }
    }

    /// The best way to cut lanes in two, unless they are to be halved.
    #[inline(always)]
    fn best(&self, l: L, lanes: u32, halve: bool) -> Way {
        match lanes.count_ones() {
            3 if !halve => self.best_of_all(l, lanes, &THREE),
            4 if !halve => self.best_of_all(l, lanes, &FOUR),
            5.. if !halve => self.best_plane(l, lanes),
            _ => Way::NONE,
        }
    }

    /// Cuts the references, each of which goes to its place; all of them in the `first` way.
    #[inline(always)]
    fn cuts(&self, l: L, references: &mut [Reference], first: Way, halve: bool) -> [Cut; FEW] {
        let mut cuts = [Cut::default(); FEW];
        // Lanes of a subtree, its first reference and its inner node.
        let mut stack = [(0, 0, 0); FEW];
        stack[0] = ((1u32 << references.len()) - 1, 0, 0);
        let mut pending = 1;
        while pending > 0 {
            pending -= 1;
            let (lanes, start, root) = stack[pending];
            let count = lanes.count_ones() as usize;
            let Way { left, .. } = if root == 0 { first } else { self.best(l, lanes, halve) };
            let left = if left == 0 { lowest(lanes, count / 2) } else { left };
            let on_left = left.count_ones() as usize;
            let sides = [(left, start, root + 1), (lanes & !left, start + on_left, root + on_left)];
            let mut children = [0; 2];
            for side in [1, 0] {
                let (lanes, start, root) = sides[side];
                let lane = lanes.trailing_zeros() as usize % FEW;
                if lanes & (lanes - 1) == 0 {
                    references[start] = self.rows[lane];
                    children[side] = FEW + lane;
                } else {
                    stack[pending] = sides[side];
                    pending += 1;
                    children[side] = root;
                }
            }
            cuts[root] = Cut { count, left: on_left, children };
        }
        cuts
    }

    /// The cheapest of all `ways` to cut as many as there are in `lanes`. However many there are,
    /// they will be one block: only surfaces count.
    #[inline(always)]
    fn best_of_all(&self, l: L, lanes: u32, ways: &Ways) -> Way {
        let members = l.bits(l.pack(lanes, l.from_bits(eight_ids(l, &[0, 1, 2, 3, 4, 5, 6, 7]))));
        let (mut left, mut right) = ([l.splat(f32::INFINITY); 6], [l.splat(f32::INFINITY); 6]);
        for (table, places) in ways.iter().enumerate() {
            let places = l.permute_u32(members, eight_ids(l, places));
            let side = if table < 2 { &mut left } else { &mut right };
            for (number, column) in side.iter_mut().zip(self.columns) {
                *number = l.min(*number, l.from_bits(l.permute_u32(l.bits(column), places)));
            }
        }
        let cost = l.add(half_area(l, left), half_area(l, right));
        let areas = l.lowest(cost);
        let way = l.eq(L::ALL, cost, l.splat(areas)).trailing_zeros() as usize % FEW;
        let mut left = 0;
        for places in &ways[..2] {
            left |= lanes & !lowest(lanes, places[way] as usize) & lowest(lanes, places[way] as usize + 1);
        }
        Way { left, areas }
    }

    /// The cheapest plane across the longest axis that separates some of `lanes` from others; none when all keys are equal.
    #[inline(always)]
    fn best_plane(&self, l: L, lanes: u32) -> Way {
        let nothing = l.splat(f32::INFINITY);
        let (mut longest, mut axis) = (0.0, 0);
        for (i, &keys) in self.keys.iter().enumerate() {
            let among = l.select(lanes, keys, nothing);
            let size = l.highest(l.select(lanes, keys, l.neg(nothing))) - l.lowest(among);
            axis = if size > longest { i } else { axis };
            longest = if size > longest { size } else { longest };
        }
        let (keys, key_row) = (load_one(l, &self.key_rows[axis]), &self.key_rows[axis]);
        // In each lane, the boxes of what is up to this lane's key and of what is beyond.
        let (mut left, mut right) = ([nothing; 6], [nothing; 6]);
        let mut rest = lanes;
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize % FEW;
            rest &= rest - 1;
            let is_left = l.le(L::ALL, l.splat(key_row[lane]), keys);
            let away = l.select(is_left, l.splat(f32::NEG_INFINITY), nothing);
            let other_away = l.neg(away);
            let row = &self.rows[lane].0.0;
            for (at, column) in [0, 1, 2, 4, 5, 6].into_iter().enumerate() {
                let number = l.splat(row[column]);
                left[at] = l.min(left[at], l.max(number, away));
                right[at] = l.min(right[at], l.max(number, other_away));
            }
        }
        let cost = l.add(half_area(l, left), half_area(l, right));
        let cost = l.select(lanes, cost, nothing);
        let areas = l.lowest(cost);
        if areas == f32::INFINITY {
            return Way::NONE;
        }
        let lane = l.eq(L::ALL, cost, l.splat(areas)).trailing_zeros() as usize % FEW;
        Way { left: l.le(lanes, keys, l.splat(key_row[lane])), areas }
    }
}

/// Half the surface of boxes, in lanes; infinite for empty ones.
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
    fn ways_are_all_that_there_are() {
        for (count, ways) in [(3, &THREE), (4, &FOUR)] {
            let mut found = std::collections::BTreeSet::new();
            for lane in 0..FEW {
                let side =
                    |tables: &[[u32; FEW]]| tables.iter().fold(0, |all, places| all | 1 << places[lane]);
                let (left, right): (u32, u32) = (side(&ways[..2]), side(&ways[2..]));
                assert_eq!((left & right, left | right), (0, (1 << count) - 1));
                found.insert(left.min(right));
            }
            assert_eq!(found.len(), (1 << (count - 1)) - 1);
        }
    }

    /// The best way to cut lanes.
    struct Best<'a>(&'a [Reference; FEW], u32);

    impl LaneTask for Best<'_> {
        type Output = Way;

        fn run<L: Lanes>(self, l: L) -> Way {
            Choices::new(l, self.0).best(l, self.1, false)
        }
    }

    #[test]
    fn cuts_are_the_cheapest() {
        let number = |i: u32| (crate::geom::mix(i) >> 8) as f32 / (1 << 24) as f32;
        for seed in 0..300 {
            let rows: [Reference; FEW] = std::array::from_fn(|i| {
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
                let around = (0..FEW).filter(is_in(set)).map(bounds).fold(Bounds::EMPTY, |a, b| a.union(&b));
                around.half_area()
            };
            let total = |left: u32| cost(left) + cost(lanes & !left);
            let Way { left, areas } = SimdLevel::run_eight(Best(&rows, lanes));
            assert!(left != 0 && left & !lanes == 0 && left != lanes);
            let cheapest = match lanes.count_ones() {
                3 | 4 => (1..lanes).filter(|left| left & !lanes == 0).map(total).fold(f32::MAX, f32::min),
                _ => {
                    // The first axis is the longest, by far.
                    let key = |lane: usize| rows[lane].key_on(0);
                    let up_to = |last: usize| {
                        let below = (0..FEW).filter(is_in(lanes)).filter(|&lane| key(lane) <= key(last));
                        below.fold(0, |set, lane| set | 1 << lane)
                    };
                    let planes = (0..FEW).filter(is_in(lanes)).map(up_to).filter(|&left| left != lanes);
                    planes.map(total).fold(f32::MAX, f32::min)
                }
            };
            assert_eq!([total(left), areas], [cheapest; 2], "{lanes:b} {left:b}");
        }
    }

    /// Builds a subtree; whether it stayed whole, and how many of its inner nodes were made.
    struct Built<'a>(&'a [Reference], Costs);

    impl LaneTask for Built<'_> {
        type Output = (bool, usize);

        fn run<L: Lanes>(self, l: L) -> Self::Output {
            let Self(references, costs) = self;
            let mut references = references.to_vec();
            let mut inner: Vec<Inner> = bytemuck::zeroed_vec(references.len() - 1);
            let extent = &Extent::of_few(l, &references);
            let few = Few { references: &mut references, inner: &mut inner, costs, halve: false, extent };
            OutlinedTask::run(few, l);
            let is_whole = inner[0].choice == Choice::whole();
            (is_whole, inner.iter().filter(|inner| inner.bounds().half_area() > 0.0).count())
        }
    }

    #[test]
    fn what_two_boxes_would_not_serve_better_stays_whole() {
        let mut stayed = [0; 2];
        for seed in 0..600 {
            let number = |i: u32| (crate::geom::mix(64 * seed + i) >> 8) as f32 / (1 << 24) as f32;
            let count = 2 + seed as usize % 7;
            // Spread more and more.
            let rows: [Reference; FEW] = std::array::from_fn(|i| {
                let corner = |salt: u32| {
                    let salt = 8 * (i % count) as u32 + salt;
                    Vec3::new(1.0 + number(salt), number(salt + 1), number(salt + 2))
                };
                let (at, size) = (corner(0) * (seed / 60) as f32, corner(3));
                Reference::new(i as u32, &Aabb { min: at, max: at + size })
            });
            let around = |set: u32| {
                let among = (0..count).filter(|lane| set >> lane & 1 == 1).map(|lane| rows[lane].0);
                among.fold(Bounds::EMPTY, |a, b| a.union(&b)).half_area()
            };
            let all = (1 << count) - 1;
            let areas = match count {
                2 => around(1) + around(2),
                _ => SimdLevel::run_eight(Best(&rows, all)).areas,
            };
            let wanted = around(all) <= areas;
            let built = |costs| SimdLevel::run_eight(Built(&rows[..count], costs));
            // The box is small in a large tree.
            let (is_whole, made) = built(Costs::of(1e9));
            assert_eq!((is_whole, made), (wanted, if wanted { 1 } else { count - 1 }));
            // Large boxes, and trees that are wanted as a whole, have everything.
            assert_eq!(built(Costs::of(0.0)).1, count - 1);
            assert_eq!(built(Costs::of_all(1e9)).1, count - 1);
            stayed[usize::from(is_whole)] += 1;
        }
        assert!(stayed[0] > 50 && stayed[1] > 50, "{stayed:?}");
    }
}
