//! Partitions references by a split plane.

use super::bins::SplitPlane;
use super::packed_bounds::{PackedBounds, key};
use super::reference::{Extent, PARALLEL_LEN, PIECE_LEN, Reference};
use crate::lanes::{LaneTask, Lanes, SimdLevel, both};
use rayon::prelude::*;

/// The two sides of a partitioned range.
pub(super) struct Sides {
    /// Number of references on the left; they come first.
    pub middle: usize,
    /// The extents of the left and of the right.
    pub extents: [Extent; 2],
}

/// Moves the references on the left of a plane to the front, without branches: they would be mispredicted
/// half the time. With `COUNTED_ALL` the plane was chosen by all references, so its boxes are those of the
/// sides.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) fn partition<L: Lanes, const COUNTED_ALL: bool>(
    l: L,
    references: &mut [Reference],
    plane: &SplitPlane,
) -> Sides {
    let mut middle = 0;
    let (mut keys, mut bounds) = ([PackedBounds::EMPTY.load(l); 2], [PackedBounds::EMPTY.load(l); 2]);
    for i in 0..references.len() {
        let reference = references[i];
        let packed = reference.0.load(l);
        let key = key(l, packed);
        let is_left = plane.is_left(l, key);
        references[i] = references[middle];
        references[middle] = reference;
        middle += usize::from(is_left);
        // For the side that the reference is not on, it is raised to infinity, which leaves the union as it
        // is.
        let floor = [f32::INFINITY, f32::NEG_INFINITY][usize::from(is_left)];
        let floor = [l.splat(floor), l.splat(-floor)];
        for side in 0..2 {
            keys[side] = l.min(keys[side], l.max(key, floor[side]));
            if !COUNTED_ALL {
                bounds[side] = l.min(bounds[side], l.max(packed, floor[side]));
            }
        }
    }
    let keys = [PackedBounds::store(l, keys[0]), PackedBounds::store(l, keys[1])];
    let bounds = if COUNTED_ALL {
        plane.bounds
    } else {
        [PackedBounds::store(l, bounds[0]), PackedBounds::store(l, bounds[1])]
    };
    let extents = both([0, 1], |side: usize| Extent { bounds: bounds[side], keys: keys[side] });
    Sides { middle, extents }
}

/// [`partition`] as a task.
struct PartitionTask<'a> {
    references: &'a mut [Reference],
    plane: &'a SplitPlane,
}

impl LaneTask for PartitionTask<'_> {
    type Output = Sides;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Sides {
        partition::<L, false>(l, self.references, self.plane)
    }
}

/// The same for at least [`PARALLEL_LEN`] references, on the current rayon pool.
pub(super) fn partition_in_parallel(references: &mut [Reference], plane: &SplitPlane) -> Sides {
    debug_assert!(references.len() >= PARALLEL_LEN);
    let pieces = references.par_chunks_mut(PIECE_LEN);
    let pieces: Vec<Sides> =
        pieces.map(|references| SimdLevel::run_eight(PartitionTask { references, plane })).collect();
    let mut all = Sides { middle: 0, extents: [Extent::EMPTY; 2] };
    for piece in &pieces {
        all.middle += piece.middle;
        all.extents = both([0, 1], |side: usize| all.extents[side].union(&piece.extents[side]));
    }
    // Each piece is partitioned. The references on the wrong side of the middle form runs, as many references
    // on one side as on the other: they are swapped.
    let (front, back) = references.split_at_mut(all.middle);
    let splits = || pieces.iter().enumerate().map(|(i, piece)| (i * PIECE_LEN, i * PIECE_LEN + piece.middle));
    let in_front = splits().map(|(start, split)| (split, (start + PIECE_LEN).min(all.middle)));
    let in_back = splits()
        .map(|(start, split)| (start.max(all.middle) - all.middle, split.max(all.middle) - all.middle));
    let wrong_in_front = take_runs(front, in_front);
    let wrong_in_back = take_runs(back, in_back);
    let mut pairs = pair_up(wrong_in_front, wrong_in_back);
    pairs.par_iter_mut().for_each(|(front, back)| front.swap_with_slice(back));
    all
}

/// The given runs of a slice, each from its start to its end. They ascend; empty ones are skipped.
fn take_runs(
    mut rest: &mut [Reference],
    runs: impl Iterator<Item = (usize, usize)>,
) -> Vec<&mut [Reference]> {
    let mut taken = Vec::new();
    let mut at = 0;
    for (start, end) in runs.filter(|(start, end)| start < end) {
        let (_, tail) = rest.split_at_mut(start - at);
        let (run, tail) = tail.split_at_mut(end - start);
        taken.push(run);
        rest = tail;
        at = end;
    }
    taken
}

/// Splits runs of equal total length into pairs of equal length.
fn pair_up<'a>(
    left: Vec<&'a mut [Reference]>,
    right: Vec<&'a mut [Reference]>,
) -> Vec<(&'a mut [Reference], &'a mut [Reference])> {
    let mut pairs = Vec::new();
    let mut others = right.into_iter();
    let mut other: &mut [Reference] = &mut [];
    for mut run in left {
        while !run.is_empty() {
            if other.is_empty() {
                other = others.next().expect("equal total lengths");
            }
            let len = run.len().min(other.len());
            let ((a, run_rest), (b, other_rest)) = (run.split_at_mut(len), other.split_at_mut(len));
            pairs.push((a, b));
            (run, other) = (run_rest, other_rest);
        }
    }
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::collapse_plan::Costs;
    use crate::geom::Aabb;
    use glam::Vec3;

    /// Test that a reference is on the left.
    struct IsLeft<'a>(&'a Reference, &'a SplitPlane);

    impl LaneTask for IsLeft<'_> {
        type Output = bool;

        fn run<L: Lanes>(self, l: L) -> bool {
            self.1.is_left(l, key(l, self.0.0.load(l)))
        }
    }

    #[test]
    fn a_parallel_partition_keeps_all_references_and_their_sides() {
        let at = |i: u32, points: u32| Vec3::X * (crate::geom::mix(i) % points) as f32;
        for (count, points) in
            [(PARALLEL_LEN, 2), (3 * PARALLEL_LEN + 17, 3), (100_000, 50_000), (PARALLEL_LEN + 1, 17)]
        {
            let new = |i: u32| Reference::new(i, &Aabb { min: at(i, points), max: at(i, points) });
            let mut references: Vec<Reference> = (0..count as u32).map(new).collect();
            let extent = Extent::in_parallel(&references);
            let plane = SplitPlane::best_in_parallel(&references, &extent, Costs::of_tree(0.0))
                .expect("there are several points");
            let is_left = |r: &Reference| SimdLevel::run_eight(IsLeft(r, &plane));
            let sides = partition_in_parallel(&mut references, &plane);
            let (left, right) = references.split_at(sides.middle);
            assert!(!left.is_empty() && !right.is_empty());
            assert!(left.iter().all(is_left) && !right.iter().any(is_left));
            for (side, references) in [left, right].into_iter().enumerate() {
                let exact = Extent::in_parallel(references);
                let aabb = |bounds: &PackedBounds| bounds.to_aabb();
                assert_eq!(aabb(&sides.extents[side].keys), aabb(&exact.keys));
                assert_eq!(aabb(&sides.extents[side].bounds), aabb(&exact.bounds));
            }
            let mut primitives: Vec<u32> = references.iter().map(Reference::primitive).collect();
            primitives.sort_unstable();
            assert!(primitives.into_iter().eq(0..count as u32));
        }
    }
}
