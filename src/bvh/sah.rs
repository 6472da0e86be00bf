//! The builder: top-down, binned surface area heuristic (Wald 2007), parallel, of bounded depth. On its
//! way back up it plans the eight-wide tree and hands on what the crown is made of.

use super::bins::{MANY, Plane};
use super::collapse_plan::{Choice, CollapsePlan, Costs};
use super::huge_pages::Pages;
use super::partition::{Sides, partition, partition_long};
use super::reference::{Bounds, Extent, LONG, PIECE, Reference};
use super::reinsertion::{self, Fork};
use super::small_subtree::{FEW, Few};
use crate::geom::Aabb;
use crate::lanes::{LaneTask, Lanes, OutlinedTask, SimdLevel};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use rayon::prelude::*;

/// No leaf lies deeper than this many nodes.
pub const MAX_DEPTH: usize = 96;

/// Ranges at least this long have their halves built in parallel.
const PARALLEL_HALVES: usize = 1 << 12;

/// An inner node. A subtree over `count` primitives is `count` references and the `count - 1` inner
/// nodes from its root on: first the root, then the left subtree's, then the right's.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Inner {
    min: [f32; 3],
    /// Primitives on the left.
    left: u32,
    /// Negated upper corner.
    negated_max: [f32; 3],
    pub choice: Choice,
}

impl Inner {
    #[inline(always)]
    pub fn new(bounds: &Bounds, left: usize, choice: Choice) -> Self {
        let [a, b, c, _, x, y, z, _] = bounds.0;
        Self { min: [a, b, c], left: left as u32, negated_max: [x, y, z], choice }
    }

    pub fn bounds(&self) -> Bounds {
        let ([a, b, c], [x, y, z]) = (self.min, self.negated_max);
        Bounds([a, b, c, 0.0, x, y, z, 0.0])
    }
}

/// A binary tree with one primitive a leaf, and a plan for making it eight-wide.
pub(super) struct Tree {
    pub references: Pages<Reference>,
    pub branches: Branches,
}

/// The inner nodes of a binary tree.
pub(super) struct Branches {
    /// As the builder made them.
    inner: Pages<Inner>,
    /// Those of the crown, which stand in for the builder's.
    crown: Vec<Fork>,
}

/// A subtree.
#[derive(Clone, Copy, Debug)]
pub(super) struct Subtree {
    /// First inner node, or the fork of the crown with [`Subtree::FORK`].
    root: u32,
    /// First reference. Of no meaning in the crown: what is below a fork does not lie side by side.
    pub first: u32,
    /// Number of primitives, at least 1.
    pub count: u32,
}

impl Subtree {
    const FORK: u32 = 1 << 31;

    /// That of a fork.
    pub fn fork(index: usize, count: u32) -> Self {
        Self { root: index as u32 | Self::FORK, first: 0, count }
    }

    /// Whether it begins in the crown.
    pub fn is_fork(self) -> bool {
        self.root & Self::FORK != 0
    }

    fn index(self) -> usize {
        (self.root & !Self::FORK) as usize
    }

    /// Its references among all, unless it begins in the crown.
    pub fn references(self, all: &[Reference]) -> &[Reference] {
        &all[self.first as usize..][..self.count as usize]
    }
}

impl Tree {
    /// Builds the tree over `count` triangles and improves its crown, with costs that follow from half the surface of the box around
    /// them. Takes 64 bytes a triangle.
    pub fn build(
        count: usize,
        corners: impl Fn(u32) -> [Vec3; 3] + Sync,
        costs: impl Fn(f32) -> Costs,
    ) -> Self {
        let mut references = Pages::zeroed(count);
        let pieces = references.par_chunks_mut(PIECE).enumerate();
        let extents = pieces.map(|(piece, references)| {
            for (primitive, reference) in ((piece * PIECE) as u32..).zip(references.iter_mut()) {
                *reference = Reference::new(primitive, &Aabb::around(corners(primitive)));
            }
            Extent::of_piece(references)
        });
        let extent = extents.reduce_with(|a, b| a.union(&b));
        let mut inner = Pages::zeroed(count.saturating_sub(1));
        let Some(extent) = extent else {
            return Self { references, branches: Branches { inner, crown: Vec::new() } };
        };
        let costs = costs(extent.bounds.half_area());
        let built = subtree(&mut references, &mut inner, costs, 0, &extent);
        let mut tree = Self { references, branches: Branches { inner, crown: Vec::new() } };
        let root = Subtree { root: 0, first: 0, count: count as u32 };
        tree.branches.crown = reinsertion::grow(&tree, root, built, costs);
        tree
    }

    /// The whole tree; `None` when there is nothing.
    pub fn root(&self) -> Option<Subtree> {
        let count = self.references.len() as u32;
        let root = match self.branches.crown.is_empty() {
            true => Subtree { root: 0, first: 0, count },
            false => Subtree::fork(0, count),
        };
        (count > 0).then_some(root)
    }

    /// The box around a subtree.
    pub fn bounds(&self, of: Subtree) -> Bounds {
        match of.count {
            1 => self.references[of.first as usize].boxed(),
            _ => self.branches.bounds(of),
        }
    }

    /// The plan of a subtree of few primitives, made again.
    pub fn plan_of_few(&self, of: Subtree, costs: Costs) -> CollapsePlan {
        let (area, count) = (self.bounds(of).half_area(), of.count as usize);
        if count == 1 {
            return CollapsePlan::leaf(costs, area);
        }
        if self.branches.is_leaf(of) {
            return CollapsePlan::whole(costs, area, count);
        }
        let [left, right] = self.branches.children(of).map(|child| self.plan_of_few(child, costs));
        CollapsePlan::merge(costs, &left, &right, area, count).0
    }

    /// The primitives of a subtree.
    pub fn primitives(&self, of: Subtree) -> Vec<u32> {
        if of.is_fork() {
            self.branches.children(of).iter().flat_map(|&child| self.primitives(child)).collect()
        } else {
            of.references(&self.references).iter().map(Reference::primitive).collect()
        }
    }

    /// The primitive of a subtree of one.
    pub fn primitive(&self, of: Subtree) -> u32 {
        self.references[of.first as usize].primitive()
    }
}

#[cfg(test)]
impl Tree {
    /// Makes it the tree that the builder made.
    pub fn forget_crown(&mut self) {
        self.branches.crown.clear();
    }
}

impl Branches {
    /// The forks of the crown, the root first; none if there is no crown.
    #[cfg(test)]
    pub fn crown(&self) -> &[Fork] {
        &self.crown
    }

    /// The two children of a subtree of at least two primitives.
    pub fn children(&self, of: Subtree) -> [Subtree; 2] {
        if of.is_fork() {
            return self.crown[of.index()].children;
        }
        let left = self.inner[of.index()].left;
        [
            Subtree { root: of.root + 1, first: of.first, count: left },
            Subtree { root: of.root + left, first: of.first + left, count: of.count - left },
        ]
    }

    /// The box around a subtree of at least two primitives.
    pub fn bounds(&self, of: Subtree) -> Bounds {
        if of.is_fork() { self.crown[of.index()].bounds } else { self.inner[of.index()].bounds() }
    }

    /// What the plan does with a subtree.
    fn choice(&self, of: Subtree) -> Choice {
        match of.count {
            1 => Choice::default(),
            _ if of.is_fork() => self.crown[of.index()].choice,
            _ => self.inner[of.index()].choice,
        }
    }

    /// Whether nothing is below a subtree's root.
    pub fn is_leaf(&self, of: Subtree) -> bool {
        of.count == 1 || self.choice(of) == Choice::whole()
    }

    /// Whether, as one child of a wide node, the subtree is a block.
    pub fn is_block(&self, of: Subtree) -> bool {
        of.count == 1 || self.choice(of).is_block()
    }

    /// Calls `take` with the subtrees that the plan makes of one when a wide node has room for so many.
    pub fn gather(&self, of: Subtree, mut room: usize, take: &mut impl FnMut(Subtree)) {
        let choice = self.choice(of);
        while room > 1 && choice.on_left(room) == 0 {
            room -= 1;
        }
        if room == 1 {
            return take(of);
        }
        let on_left = choice.on_left(room);
        let [left, right] = self.children(of);
        self.gather(left, on_left, take);
        self.gather(right, room - on_left, take);
    }
}

/// What is known of a subtree when it has been built.
#[derive(Debug)]
pub(super) struct Built {
    pub plan: CollapsePlan,
    /// At least as many as there are nodes on its longest way down.
    pub height: usize,
    /// The same of its two sides, if it may be in the crown.
    pub sides: Option<Box<[Built; 2]>>,
}

impl Built {
    /// Of few primitives.
    #[inline(always)]
    pub fn few(plan: CollapsePlan, count: usize) -> Self {
        Self { plan, height: count, sides: None }
    }

    /// Of `count` primitives in a box of half the surface `area`, and what the plan does with it.
    #[inline(always)]
    fn of(costs: Costs, sides: [Self; 2], area: f32, count: usize) -> (Self, Choice) {
        let [left, right] = &sides;
        let (plan, choice) = CollapsePlan::merge(costs, &left.plan, &right.plan, area, count);
        let height = 1 + left.height.max(right.height);
        (Self { plan, height, sides: costs.may_be_in_crown(area).then(|| Box::new(sides)) }, choice)
    }
}

/// Builds the subtree over `references` into `inner`, `depth` nodes below the root.
fn subtree(
    references: &mut [Reference],
    inner: &mut [Inner],
    costs: Costs,
    depth: usize,
    extent: &Extent,
) -> Built {
    let count = references.len();
    if count < PARALLEL_HALVES {
        return SimdLevel::run_eight(Small { references, inner, costs, depth, extent });
    }
    let (root, below) = inner.split_first_mut().expect("one node fewer than references");
    let Sides { middle, extents } = match count {
        LONG.. => split_long(references, costs, depth, extent),
        _ => SimdLevel::run_eight(Split { references, costs, depth, extent }),
    };
    let (left, right) = references.split_at_mut(middle);
    let (left_inner, right_inner) = below.split_at_mut(middle - 1);
    let (left, right) = rayon::join(
        || subtree(left, left_inner, costs, depth + 1, &extents[0]),
        || subtree(right, right_inner, costs, depth + 1, &extents[1]),
    );
    let (built, choice) = Built::of(costs, [left, right], extent.bounds.half_area(), count);
    *root = Inner::new(&extent.bounds, middle, choice);
    built
}

/// A subtree that one thread builds.
struct Small<'a> {
    references: &'a mut [Reference],
    inner: &'a mut [Inner],
    costs: Costs,
    depth: usize,
    extent: &'a Extent,
}

impl LaneTask for Small<'_> {
    type Output = Built;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Built {
        l.outlined(self)
    }
}

impl<L: Lanes> OutlinedTask<L> for Small<'_> {
    type Output = Built;

    #[inline(always)]
    fn run(self, l: L) -> Built {
        let Self { references, inner, costs, depth, extent } = self;
        let (count, area) = (references.len(), extent.bounds.half_area());
        if count <= FEW {
            let plan = match count {
                1 => CollapsePlan::leaf(costs, area),
                _ => l.outlined(Few { references, inner, costs, halve: depth + FEW >= MAX_DEPTH, extent }),
            };
            return Built::few(plan, count);
        }
        let (root, below) = inner.split_first_mut().expect("one node fewer than references");
        let Sides { middle, extents } = split(l, references, costs, depth, extent);
        let (left, right) = references.split_at_mut(middle);
        let (left_inner, right_inner) = below.split_at_mut(middle - 1);
        let depth = depth + 1;
        let left =
            l.outlined(Small { references: left, inner: left_inner, costs, depth, extent: &extents[0] });
        let right =
            l.outlined(Small { references: right, inner: right_inner, costs, depth, extent: &extents[1] });
        let (built, choice) = Built::of(costs, [left, right], area, count);
        *root = Inner::new(&extent.bounds, middle, choice);
        built
    }
}

/// Whether halving alone just fits the depth that is left, so that it must begin.
fn must_halve(count: usize, depth: usize) -> bool {
    let levels_of_halving = count.next_power_of_two().trailing_zeros() as usize;
    depth + 1 + levels_of_halving >= MAX_DEPTH
}

/// Sorts references into two halves.
#[inline(always)]
fn split<L: Lanes>(l: L, references: &mut [Reference], costs: Costs, depth: usize, extent: &Extent) -> Sides {
    let halved = must_halve(references.len(), depth);
    let plane = if halved { None } else { Plane::best(l, references, extent, costs) };
    match plane {
        Some(plane) if references.len() < MANY => partition::<L, true>(l, references, &plane),
        Some(plane) => partition::<L, false>(l, references, &plane),
        None => halve(references, extent),
    }
}

/// [`split`] to be run.
struct Split<'a> {
    references: &'a mut [Reference],
    costs: Costs,
    depth: usize,
    extent: &'a Extent,
}

impl LaneTask for Split<'_> {
    type Output = Sides;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Self::Output {
        split(l, self.references, self.costs, self.depth, self.extent)
    }
}

/// The same for a long range, in parallel.
fn split_long(references: &mut [Reference], costs: Costs, depth: usize, extent: &Extent) -> Sides {
    let halved = must_halve(references.len(), depth);
    let plane = if halved { None } else { Plane::best_of_long(references, extent, costs) };
    match plane {
        Some(plane) => partition_long(references, &plane),
        None => halve(references, extent),
    }
}

/// Puts the lower half by key along the longest axis first.
#[inline(never)]
fn halve(references: &mut [Reference], extent: &Extent) -> Sides {
    let middle = references.len() / 2;
    let keys = extent.keys.to_aabb();
    let size = keys.max - keys.min;
    let axis = size.max_position();
    if size[axis] > 0.0 {
        references.select_nth_unstable_by(middle, |a, b| {
            a.key_on(axis).total_cmp(&b.key_on(axis)).then(a.primitive().cmp(&b.primitive()))
        });
    }
    Sides { middle, extents: [Extent::of(&references[..middle]), Extent::of(&references[middle..])] }
}
