//! The builder: top-down, binned surface area heuristic (Wald 2007), parallel, of bounded depth. On its
//! way back up it plans the eight-wide tree.

use super::bins::{MANY, Plane};
use super::few::{FEW, Few};
use super::pages::Pages;
use super::partition::{Sides, partition, partition_long};
use super::plan::{Choice, Costs, Plan};
use super::reference::{Bounds, Extent, LONG, PIECE, Reference};
use crate::geom::Aabb;
use crate::lanes::{Kernel, Lanes, Piece, SimdLevel};
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

    pub fn bounds(&self) -> Aabb {
        let ([a, b, c], [x, y, z]) = (self.min, self.negated_max);
        Bounds([a, b, c, 0.0, x, y, z, 0.0]).to_aabb()
    }
}

/// A binary tree with one primitive a leaf, and a plan for making it eight-wide.
pub(super) struct Tree {
    pub references: Pages<Reference>,
    pub branches: Branches,
}

/// The inner nodes of a binary tree.
pub(super) struct Branches(Pages<Inner>);

/// A subtree.
#[derive(Clone, Copy, Debug)]
pub(super) struct Subtree {
    /// First inner node.
    root: u32,
    /// First reference.
    pub first: u32,
    /// Number of primitives, at least 1.
    pub count: u32,
}

impl Subtree {
    /// Its references among all.
    pub fn references(self, all: &[Reference]) -> &[Reference] {
        &all[self.first as usize..][..self.count as usize]
    }
}

impl Tree {
    /// Builds the tree over `count` triangles, with costs that follow from half the surface of the box around them. Takes 64
    /// bytes a triangle.
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
        if let Some(extent) = extent {
            let costs = costs(extent.bounds.half_area());
            subtree(&mut references, &mut inner, costs, 0, &extent);
        }
        Self { references, branches: Branches(inner) }
    }

    /// The whole tree; `None` when there is nothing.
    pub fn root(&self) -> Option<Subtree> {
        let count = self.references.len() as u32;
        (count > 0).then_some(Subtree { root: 0, first: 0, count })
    }

    /// The box around a subtree.
    pub fn bounds(&self, of: Subtree) -> Aabb {
        match of.count {
            1 => self.references[of.first as usize].0.to_aabb(),
            _ => self.branches.bounds(of),
        }
    }

    /// The primitive of a subtree of one.
    pub fn primitive(&self, of: Subtree) -> u32 {
        self.references[of.first as usize].primitive()
    }
}

impl Branches {
    /// The two children of a subtree of at least two primitives.
    pub fn children(&self, of: Subtree) -> [Subtree; 2] {
        let left = self.0[of.root as usize].left;
        [
            Subtree { root: of.root + 1, first: of.first, count: left },
            Subtree { root: of.root + left, first: of.first + left, count: of.count - left },
        ]
    }

    /// The box around a subtree of at least two primitives.
    pub fn bounds(&self, of: Subtree) -> Aabb {
        self.0[of.root as usize].bounds()
    }

    /// Whether, as one child of a wide node, the subtree is a block.
    pub fn is_block(&self, of: Subtree) -> bool {
        of.count == 1 || self.0[of.root as usize].choice.is_block()
    }

    /// Calls `take` with the subtrees that the plan makes of one when a wide node has room for so many.
    pub fn gather(&self, of: Subtree, mut room: usize, take: &mut impl FnMut(Subtree)) {
        let choice = if of.count == 1 { Choice::default() } else { self.0[of.root as usize].choice };
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

/// Builds the subtree over `references` into `inner`, `depth` nodes below the root.
fn subtree(
    references: &mut [Reference],
    inner: &mut [Inner],
    costs: Costs,
    depth: usize,
    extent: &Extent,
) -> Plan {
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
    let (left_plan, right_plan) = rayon::join(
        || subtree(left, left_inner, costs, depth + 1, &extents[0]),
        || subtree(right, right_inner, costs, depth + 1, &extents[1]),
    );
    let (plan, choice) = Plan::merge(costs, &left_plan, &right_plan, extent.bounds.half_area(), count);
    *root = Inner::new(&extent.bounds, middle, choice);
    plan
}

/// A subtree that one thread builds.
struct Small<'a> {
    references: &'a mut [Reference],
    inner: &'a mut [Inner],
    costs: Costs,
    depth: usize,
    extent: &'a Extent,
}

impl Kernel for Small<'_> {
    type Output = Plan;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Plan {
        l.apart(self)
    }
}

impl<L: Lanes> Piece<L> for Small<'_> {
    type Output = Plan;

    #[inline(always)]
    fn run(self, l: L) -> Plan {
        let Self { references, inner, costs, depth, extent } = self;
        let (count, area) = (references.len(), extent.bounds.half_area());
        if count <= FEW {
            return match count {
                1 => Plan::leaf(costs, area),
                _ => l.apart(Few { references, inner, costs, halve: depth + FEW >= MAX_DEPTH, extent }),
            };
        }
        let (root, below) = inner.split_first_mut().expect("one node fewer than references");
        let Sides { middle, extents } = split(l, references, costs, depth, extent);
        let (left, right) = references.split_at_mut(middle);
        let (left_inner, right_inner) = below.split_at_mut(middle - 1);
        let depth = depth + 1;
        let left_plan =
            l.apart(Small { references: left, inner: left_inner, costs, depth, extent: &extents[0] });
        let right_plan =
            l.apart(Small { references: right, inner: right_inner, costs, depth, extent: &extents[1] });
        let (plan, choice) = Plan::merge(costs, &left_plan, &right_plan, area, count);
        *root = Inner::new(&extent.bounds, middle, choice);
        plan
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

impl Kernel for Split<'_> {
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
