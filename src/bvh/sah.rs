//! The builder: top-down, binned surface area heuristic (Wald 2007), parallel, of bounded depth. On its
//! way back up it plans the eight-wide tree.

use super::block::BLOCK_TRIANGLES;
use super::pages::Pages;
use super::plan::{Choice, Plan};
use super::reference::{Bounds, Extent, Reference, partition, scan};
use crate::geom::Aabb;
use bytemuck::{Pod, Zeroable};
use glam::{Vec3, Vec3A};
use rayon::prelude::*;

/// No leaf lies deeper than this many nodes.
pub const MAX_DEPTH: usize = 96;

/// Ranges at least this long have their halves built in parallel.
const PARALLEL_HALVES: usize = 1 << 12;

/// An inner node. A subtree over `count` primitives is `count` references and the `count - 1` inner
/// nodes from its root on: first the root, then the left subtree's, then the right's.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Inner {
    min: [f32; 3],
    /// Primitives on the left.
    left: u32,
    max: [f32; 3],
    choice: Choice,
}

/// A binary tree with one primitive a leaf, and a plan for making it eight-wide.
pub(super) struct Tree {
    references: Pages<Reference>,
    inner: Pages<Inner>,
}

/// A subtree.
#[derive(Clone, Copy, Debug)]
pub(super) struct Subtree {
    /// First inner node.
    root: u32,
    /// First reference.
    first: u32,
    /// Number of primitives, at least 1.
    pub count: u32,
}

impl Tree {
    /// Builds the tree over `count` triangles. Takes 64 bytes a triangle.
    pub fn build(count: usize, corners: impl Fn(u32) -> [Vec3; 3] + Sync) -> Self {
        let mut references = Pages::zeroed(count);
        references.par_iter_mut().zip(0..count as u32).with_min_len(1 << 12).for_each(
            |(reference, primitive)| {
                *reference = Reference::new(primitive, &Aabb::around(corners(primitive)));
            },
        );
        let mut inner = Pages::zeroed(count.saturating_sub(1));
        if count > 0 {
            let extent = Extent::of(&references);
            subtree(&mut references, &mut inner, 0, extent);
        }
        Self { references, inner }
    }

    /// The whole tree; `None` when there is nothing.
    pub fn root(&self) -> Option<Subtree> {
        let count = self.references.len() as u32;
        (count > 0).then_some(Subtree { root: 0, first: 0, count })
    }

    /// The two children of a subtree of at least two primitives.
    pub fn children(&self, of: Subtree) -> [Subtree; 2] {
        let left = self.inner[of.root as usize].left;
        [
            Subtree { root: of.root + 1, first: of.first, count: left },
            Subtree { root: of.root + left, first: of.first + left, count: of.count - left },
        ]
    }

    /// The box around a subtree.
    pub fn bounds(&self, of: Subtree) -> Aabb {
        if of.count == 1 {
            return self.references[of.first as usize].bounds().to_aabb();
        }
        let Inner { min, max, .. } = self.inner[of.root as usize];
        Aabb { min: min.into(), max: max.into() }
    }

    /// The primitives of a subtree.
    pub fn primitives(&self, of: Subtree) -> impl ExactSizeIterator<Item = u32> {
        self.references[of.first as usize..][..of.count as usize].iter().map(Reference::primitive)
    }

    /// Whether, as one child of a wide node, the subtree is a block.
    pub fn is_block(&self, of: Subtree) -> bool {
        of.count == 1 || self.inner[of.root as usize].choice.is_block()
    }

    /// Calls `take` with the subtrees that the plan makes of one when a wide node has room for so many.
    pub fn gather(&self, of: Subtree, mut room: usize, take: &mut impl FnMut(Subtree)) {
        let choice = if of.count == 1 { Choice::default() } else { self.inner[of.root as usize].choice };
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
fn subtree(references: &mut [Reference], inner: &mut [Inner], depth: usize, extent: Extent) -> Plan {
    let count = references.len();
    let area = extent.bounds.half_area();
    let Some((root, below)) = inner.split_first_mut() else { return Plan::leaf(area) };
    let (middle, [left_extent, right_extent]) = split(references, &extent, depth);
    let (left, right) = references.split_at_mut(middle);
    let (left_inner, right_inner) = below.split_at_mut(middle - 1);
    let mut build_left = || subtree(left, left_inner, depth + 1, left_extent);
    let mut build_right = || subtree(right, right_inner, depth + 1, right_extent);
    let (left_plan, right_plan) = if count >= PARALLEL_HALVES {
        rayon::join(build_left, build_right)
    } else {
        (build_left(), build_right())
    };
    let (plan, choice) = Plan::merge(&left_plan, &right_plan, area, count);
    *root =
        Inner { min: extent.bounds.min.into(), left: middle as u32, max: extent.bounds.max.into(), choice };
    plan
}

/// Sorts at least two references into two halves; the length of the first, and the extents of both.
fn split(references: &mut [Reference], extent: &Extent, depth: usize) -> (usize, [Extent; 2]) {
    let count = references.len();
    if count == 2 {
        return (1, [Extent::of(&references[..1]), Extent::of(&references[1..])]);
    }
    // Once halving alone just fits the depth that is left, halve.
    let levels_of_halving = count.next_power_of_two().trailing_zeros() as usize;
    let plane =
        if depth + 1 + levels_of_halving >= MAX_DEPTH { None } else { best_plane(references, extent) };
    let Some(plane) = plane else {
        let middle = halve(references, extent);
        return (middle, [Extent::of(&references[..middle]), Extent::of(&references[middle..])]);
    };
    let sides = partition(references, |reference| plane.is_left(reference));
    let extent = |side: usize| Extent { bounds: plane.bounds[side], keys: sides.keys[side] };
    (sides.middle, [extent(0), extent(1)])
}

/// Puts the lower half by key along the longest axis first; returns its length.
fn halve(references: &mut [Reference], extent: &Extent) -> usize {
    let middle = references.len() / 2;
    let size = Vec3::from(extent.keys.max - extent.keys.min);
    let axis = size.max_position();
    if size[axis] > 0.0 {
        references.select_nth_unstable_by(middle, |a, b| {
            a.key_on(axis).total_cmp(&b.key_on(axis)).then(a.primitive().cmp(&b.primitive()))
        });
    }
    middle
}

/// Adding this to a number of at most 2²² rounds it to a whole one, which stands in the lowest bits.
const ROUND: f32 = (1 << 23) as f32;

/// Where the bins lie: as many on each axis.
#[derive(Clone, Copy)]
struct Grid {
    origin: Vec3A,
    scale: Vec3A,
    last: f32,
}

impl Grid {
    fn new(keys: &Bounds, bins: usize) -> Self {
        // An axis too short for its reciprocal to be finite has one bin.
        let scale = |size: f32| if size > 1e-36 { bins as f32 / size } else { 0.0 };
        let size = keys.max - keys.min;
        let scale = Vec3A::new(scale(size.x), scale(size.y), scale(size.z));
        Self { origin: keys.min, scale, last: (bins - 1) as f32 }
    }

    /// The bin of a key on each axis, in the lowest bits.
    #[inline]
    fn bins(&self, key: Vec3A) -> [u32; 3] {
        let place = (key - self.origin) * self.scale - Vec3A::splat(0.5);
        let rounded = place.max(Vec3A::ZERO).min(Vec3A::splat(self.last)) + Vec3A::splat(ROUND);
        rounded.to_array().map(f32::to_bits)
    }
}

/// A plane between bins, and the boxes on both sides.
struct Plane {
    axis: usize,
    /// The grid on this axis.
    origin: f32,
    scale: f32,
    last: f32,
    /// First bin on the right, as [`Grid::bins`] says it.
    bin: u32,
    bounds: [Bounds; 2],
}

impl Plane {
    /// Whether [`Grid::bins`] puts the key on the left.
    #[inline]
    fn is_left(&self, reference: &Reference) -> bool {
        let place = (reference.key_on(self.axis) - self.origin) * self.scale - 0.5;
        (place.max(0.0).min(self.last) + ROUND).to_bits() < self.bin
    }
}

/// Box and number of the references in a bin.
#[derive(Clone, Copy)]
struct Bin {
    bounds: Bounds,
    count: u32,
}

impl Bin {
    const EMPTY: Self = Self { bounds: Bounds::EMPTY, count: 0 };

    #[inline]
    fn union(self, other: Self) -> Self {
        Self { bounds: self.bounds.union(other.bounds), count: self.count + other.count }
    }

    /// What the surface area heuristic says of it; NaN for an empty one. Blocks that are not full cost
    /// as much as full ones: that fills them, for an eighth less memory at the same speed of tracing.
    #[inline]
    fn cost(&self) -> f32 {
        self.bounds.half_area() * self.count.next_multiple_of(BLOCK_TRIANGLES as u32) as f32
    }
}

/// The cheapest plane between two bins that leaves something on both sides. A few primitives are as well
/// served by a few bins.
fn best_plane(references: &[Reference], extent: &Extent) -> Option<Plane> {
    match references.len() {
        ..=8 => best_plane_of::<4>(references, extent),
        9..=32 => best_plane_of::<8>(references, extent),
        _ => best_plane_of::<16>(references, extent),
    }
}

/// The same with `BINS` bins, a power of two.
fn best_plane_of<const BINS: usize>(references: &[Reference], extent: &Extent) -> Option<Plane> {
    let grid = Grid::new(&extent.keys, BINS);
    let fold = |piece: &[Reference]| {
        let mut bins = [[Bin::EMPTY; BINS]; 3];
        for reference in piece {
            let at = grid.bins(reference.key());
            let bounds = reference.bounds();
            for axis in 0..3 {
                let bin = &mut bins[axis][at[axis] as usize % BINS];
                bin.bounds = bin.bounds.union(bounds);
                bin.count += 1;
            }
        }
        bins
    };
    let union = |mut a: [[Bin; BINS]; 3], b: [[Bin; BINS]; 3]| {
        for (mine, theirs) in a.iter_mut().flatten().zip(b.iter().flatten()) {
            *mine = mine.union(*theirs);
        }
        a
    };
    let bins = scan(references, fold, union);
    let mut best = None;
    let mut least = f32::INFINITY;
    for (axis, bins) in bins.iter().enumerate() {
        if grid.scale[axis] == 0.0 {
            continue;
        }
        let mut right_cost = [f32::NAN; BINS];
        let mut right = Bin::EMPTY;
        for i in (1..BINS).rev() {
            right = right.union(bins[i]);
            right_cost[i] = right.cost();
        }
        let mut left = Bin::EMPTY;
        for i in 1..BINS {
            left = left.union(bins[i - 1]);
            // NaN, where a side is empty, is not less.
            let cost = left.cost() + right_cost[i];
            if cost < least {
                least = cost;
                best = Some((axis, i));
            }
        }
    }
    let (axis, bin) = best?;
    let side = |bins: &[Bin]| bins.iter().fold(Bounds::EMPTY, |all, bin| all.union(bin.bounds));
    let (left, right) = bins[axis].split_at(bin);
    Some(Plane {
        axis,
        origin: grid.origin[axis],
        scale: grid.scale[axis],
        last: grid.last,
        bin: (bin as f32 + ROUND).to_bits(),
        bounds: [side(left), side(right)],
    })
}
