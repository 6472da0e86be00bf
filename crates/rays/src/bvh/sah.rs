//! The builder: top down, by the binned surface area heuristic (Wald 2007, *On fast Construction of SAH-based
//! Bounding Volume Hierarchies*), in parallel, with bounded depth. On its way back up it plans the eight-wide
//! tree and keeps what reinsertion needs of the largest nodes.

use super::binary_tree::{BinaryTree, BuiltSubtree, InnerNode, InnerNodes, MAX_DEPTH, Subtree};
use super::bins::{SAMPLED_FROM, SplitPlane};
use super::collapse_plan::{CollapsePlan, Costs};
use super::huge_pages::HugePages;
use super::partition::{Sides, partition, partition_in_parallel};
use super::reference::{Extent, PARALLEL_LEN, PIECE_LEN, Reference};
use super::reinsertion;
use super::small_subtree::{MAX_SMALL, SmallSubtree};
use crate::geom::Aabb;
use crate::lanes::{LaneTask, Lanes, OutlinedTask, SimdLevel};
use glam::Vec3;
use rayon::prelude::*;

/// From this many references on, the two sides of a split are built in parallel.
const PARALLEL_SIDES: usize = 1 << 12;

impl BinaryTree {
    /// Builds the tree over `count` triangles and optimises it by reinsertion. `costs` gives the cost model
    /// from half the surface of the box around all triangles. Needs 64 bytes a triangle. Runs on the current
    /// rayon pool.
    pub fn build(
        count: usize,
        corners: impl Fn(u32) -> [Vec3; 3] + Sync,
        costs: impl Fn(f32) -> Costs,
    ) -> Self {
        let mut references = HugePages::zeroed(count);
        let pieces = references.par_chunks_mut(PIECE_LEN).enumerate();
        let extents = pieces.map(|(piece, references)| {
            for (primitive, reference) in ((piece * PIECE_LEN) as u32..).zip(references.iter_mut()) {
                *reference = Reference::new(primitive, &Aabb::around(corners(primitive)));
            }
            Extent::of(references)
        });
        let extent = extents.reduce_with(|a, b| a.union(&b));
        let mut built = HugePages::zeroed(count.saturating_sub(1));
        let Some(extent) = extent else {
            return Self { references, inner: InnerNodes { built, reinserted: Vec::new() } };
        };
        let costs = costs(extent.bounds.half_area());
        let whole = build_subtree(&mut references, &mut built, costs, 0, &extent);
        let mut tree = Self { references, inner: InnerNodes { built, reinserted: Vec::new() } };
        tree.inner.reinserted = reinsertion::optimise(&tree, Subtree::built(count as u32), whole, costs);
        tree
    }
}

/// Builds the subtree over `references` into `inner`. Its root is `depth` nodes below that of the tree.
fn build_subtree(
    references: &mut [Reference],
    inner: &mut [InnerNode],
    costs: Costs,
    depth: usize,
    extent: &Extent,
) -> BuiltSubtree {
    let count = references.len();
    if count < PARALLEL_SIDES {
        return SimdLevel::run_eight(SubtreeTask { references, inner, costs, depth, extent });
    }
    let (root, below) = inner.split_first_mut().expect("one node fewer than references");
    let Sides { middle, extents } = match count {
        PARALLEL_LEN.. => split_in_parallel(references, costs, depth, extent),
        _ => SimdLevel::run_eight(SplitTask { references, costs, depth, extent }),
    };
    let (left, right) = references.split_at_mut(middle);
    let (left_inner, right_inner) = below.split_at_mut(middle - 1);
    let (left, right) = rayon::join(
        || build_subtree(left, left_inner, costs, depth + 1, &extents[0]),
        || build_subtree(right, right_inner, costs, depth + 1, &extents[1]),
    );
    let (built, choice) = BuiltSubtree::merge(costs, [left, right], extent.bounds.half_area(), count);
    *root = InnerNode::new(&extent.bounds, middle, choice);
    built
}

/// Builds a subtree on one thread.
struct SubtreeTask<'a> {
    references: &'a mut [Reference],
    inner: &'a mut [InnerNode],
    costs: Costs,
    depth: usize,
    extent: &'a Extent,
}

impl LaneTask for SubtreeTask<'_> {
    type Output = BuiltSubtree;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> BuiltSubtree {
        l.outlined(self)
    }
}

impl<L: Lanes> OutlinedTask<L> for SubtreeTask<'_> {
    type Output = BuiltSubtree;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) -> BuiltSubtree {
        let Self { references, inner, costs, depth, extent } = self;
        let (count, area) = (references.len(), extent.bounds.half_area());
        if count <= MAX_SMALL {
            let at_median = depth + MAX_SMALL >= MAX_DEPTH;
            let plan = match count {
                1 => CollapsePlan::one_block(costs, area, 1),
                _ => l.outlined(SmallSubtree { references, inner, costs, at_median, extent }),
            };
            return BuiltSubtree::small(plan, count);
        }
        let (root, below) = inner.split_first_mut().expect("one node fewer than references");
        // Out of line, so that its bins are not on the stack while the sides are built.
        let Sides { middle, extents } =
            l.outlined(SplitTask { references: &mut *references, costs, depth, extent });
        let (left, right) = references.split_at_mut(middle);
        let (left_inner, right_inner) = below.split_at_mut(middle - 1);
        let depth = depth + 1;
        let left = l.outlined(SubtreeTask {
            references: left,
            inner: left_inner,
            costs,
            depth,
            extent: &extents[0],
        });
        let right = l.outlined(SubtreeTask {
            references: right,
            inner: right_inner,
            costs,
            depth,
            extent: &extents[1],
        });
        let (built, choice) = BuiltSubtree::merge(costs, [left, right], area, count);
        *root = InnerNode::new(&extent.bounds, middle, choice);
        built
    }
}

/// True if the range must be split at the median, and all ranges below it too: the depth that is left just
/// suffices for that.
#[inline]
fn must_split_at_median(count: usize, depth: usize) -> bool {
    let median_splits = count.next_power_of_two().trailing_zeros() as usize;
    depth + 1 + median_splits >= MAX_DEPTH
}

/// Splits a range at the cheapest plane, or at the median.
#[inline(always)]
fn split<L: Lanes>(l: L, references: &mut [Reference], costs: Costs, depth: usize, extent: &Extent) -> Sides {
    let at_median = must_split_at_median(references.len(), depth);
    let plane = if at_median { None } else { SplitPlane::best(l, references, extent, costs) };
    match plane {
        Some(plane) if references.len() < SAMPLED_FROM => partition::<L, true>(l, references, &plane),
        Some(plane) => partition::<L, false>(l, references, &plane),
        None => split_at_median(references, extent),
    }
}

/// [`split`] as a task.
struct SplitTask<'a> {
    references: &'a mut [Reference],
    costs: Costs,
    depth: usize,
    extent: &'a Extent,
}

impl LaneTask for SplitTask<'_> {
    type Output = Sides;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Sides {
        l.outlined(self)
    }
}

impl<L: Lanes> OutlinedTask<L> for SplitTask<'_> {
    type Output = Sides;

    #[inline(always)]
    fn run(self, l: L) -> Sides {
        split(l, self.references, self.costs, self.depth, self.extent)
    }
}

/// The same for at least [`PARALLEL_LEN`] references, on the current rayon pool.
fn split_in_parallel(references: &mut [Reference], costs: Costs, depth: usize, extent: &Extent) -> Sides {
    let at_median = must_split_at_median(references.len(), depth);
    let plane = if at_median { None } else { SplitPlane::best_in_parallel(references, extent, costs) };
    match plane {
        Some(plane) => partition_in_parallel(references, &plane),
        None => split_at_median(references, extent),
    }
}

/// Splits a range at the median key along the longest axis. Equal keys are ordered by primitive id; a range
/// whose keys are all equal is split as it is.
#[inline(never)]
fn split_at_median(references: &mut [Reference], extent: &Extent) -> Sides {
    let middle = references.len() / 2;
    let keys = extent.keys.to_aabb();
    let size = keys.max - keys.min;
    let axis = size.max_position();
    if size[axis] > 0.0 {
        references.select_nth_unstable_by(middle, |a, b| {
            a.key_on(axis).total_cmp(&b.key_on(axis)).then(a.primitive().cmp(&b.primitive()))
        });
    }
    let (left, right) = references.split_at(middle);
    Sides { middle, extents: [Extent::in_parallel(left), Extent::in_parallel(right)] }
}
