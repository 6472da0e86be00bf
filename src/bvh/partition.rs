//! References sorted to the two sides of a plane.

use super::bins::Plane;
use super::reference::{Bounds, Extent, LONG, PIECE, Reference, key};
use crate::lanes::{LaneTask, Lanes, SimdLevel};
use rayon::prelude::*;

/// The two sides of a partition: how many are on the left, and the extents of both.
pub(super) struct Sides {
    pub middle: usize,
    pub extents: [Extent; 2],
}

/// Puts the references on the left of a plane first, without branches, which would be a coin's toss. The boxes of both
/// sides are the plane's if it was chosen by `ALL`.
#[inline(always)]
pub(super) fn partition<L: Lanes, const ALL: bool>(
    l: L,
    references: &mut [Reference],
    plane: &Plane,
) -> Sides {
    let mut middle = 0;
    let (mut keys, mut bounds) = ([Bounds::EMPTY.load(l); 2], [Bounds::EMPTY.load(l); 2]);
    for i in 0..references.len() {
        let reference = references[i];
        let numbers = reference.0.load(l);
        let key = key(l, numbers);
        let is_left = plane.is_left(l, key);
        references[i] = references[middle];
        references[middle] = reference;
        middle += usize::from(is_left);
        // Infinity does not count.
        let away = [f32::INFINITY, f32::NEG_INFINITY][usize::from(is_left)];
        let away = [l.splat(away), l.splat(-away)];
        for side in 0..2 {
            keys[side] = l.min(keys[side], l.max(key, away[side]));
            if !ALL {
                bounds[side] = l.min(bounds[side], l.max(numbers, away[side]));
            }
        }
    }
    let keys = [Bounds::of(l, keys[0]), Bounds::of(l, keys[1])];
    let bounds = if ALL { plane.bounds } else { [Bounds::of(l, bounds[0]), Bounds::of(l, bounds[1])] };
    let [left, right] = [0, 1].map(|side| Extent { bounds: bounds[side], keys: keys[side] });
    Sides { middle, extents: [left, right] }
}

/// [`partition`] to be run.
struct Partition<'a> {
    references: &'a mut [Reference],
    plane: &'a Plane,
}

impl LaneTask for Partition<'_> {
    type Output = Sides;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Sides {
        partition::<L, false>(l, self.references, self.plane)
    }
}

/// The same for a long range, in parallel.
pub(super) fn partition_long(references: &mut [Reference], plane: &Plane) -> Sides {
    debug_assert!(references.len() >= LONG);
    let pieces = references.par_chunks_mut(PIECE);
    let pieces: Vec<Sides> =
        pieces.map(|references| SimdLevel::run_eight(Partition { references, plane })).collect();
    let mut all = Sides { middle: 0, extents: [Extent::EMPTY; 2] };
    for piece in &pieces {
        all.middle += piece.middle;
        all.extents = [0, 1].map(|side| all.extents[side].union(&piece.extents[side]));
    }
    // What lies on the wrong side of the middle, in runs: as much on one as on the other.
    let (front, back) = references.split_at_mut(all.middle);
    let cuts = || pieces.iter().enumerate().map(|(i, piece)| (i * PIECE, i * PIECE + piece.middle));
    let in_front = cuts().map(|(start, cut)| (cut, (start + PIECE).min(all.middle)));
    let in_back =
        cuts().map(|(start, cut)| (start.max(all.middle) - all.middle, cut.max(all.middle) - all.middle));
    let wrong_in_front = take_runs(front, in_front);
    let wrong_in_back = take_runs(back, in_back);
    let mut pairs = pair_up(wrong_in_front, wrong_in_back);
    pairs.par_iter_mut().for_each(|(front, back)| front.swap_with_slice(back));
    all
}

/// The runs of a slice, given by where they start and end, in order.
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

/// Cuts runs of equal total length so that they match one to one.
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
                other = others.next().expect("as many on one side as on the other");
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

    /// Whether a reference is on the left.
    struct IsLeft<'a>(&'a Reference, &'a Plane);

    impl LaneTask for IsLeft<'_> {
        type Output = bool;

        fn run<L: Lanes>(self, l: L) -> bool {
            self.1.is_left(l, key(l, self.0.0.load(l)))
        }
    }

    #[test]
    fn long_partitions_lose_nothing_and_put_all_where_they_belong() {
        let at = |i: u32, few: u32| Vec3::X * (crate::geom::mix(i) % few) as f32;
        for (count, few) in [(LONG, 2), (3 * LONG + 17, 3), (100_000, 50_000), (LONG + 1, 17)] {
            let new = |i: u32| Reference::new(i, &Aabb { min: at(i, few), max: at(i, few) });
            let mut references: Vec<Reference> = (0..count as u32).map(new).collect();
            let extent = Extent::of(&references);
            let plane =
                Plane::best_of_long(&references, &extent, Costs::of(0.0)).expect("there are several places");
            let is_left = |r: &Reference| SimdLevel::run_eight(IsLeft(r, &plane));
            let sides = partition_long(&mut references, &plane);
            let (left, right) = references.split_at(sides.middle);
            assert!(!left.is_empty() && !right.is_empty());
            assert!(left.iter().all(is_left) && !right.iter().any(is_left));
            for (side, references) in [left, right].into_iter().enumerate() {
                let exact = Extent::of(references);
                let numbers = |bounds: &Bounds| bounds.to_aabb();
                assert_eq!(numbers(&sides.extents[side].keys), numbers(&exact.keys));
                assert_eq!(numbers(&sides.extents[side].bounds), numbers(&exact.bounds));
            }
            let mut primitives: Vec<u32> = references.iter().map(Reference::primitive).collect();
            primitives.sort_unstable();
            assert!(primitives.into_iter().eq(0..count as u32));
        }
    }
}
