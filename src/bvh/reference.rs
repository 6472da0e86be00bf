//! Primitives while they are sorted into the tree, as boxes of their own.

use crate::geom::Aabb;
use bytemuck::{Pod, Zeroable};
use glam::{Vec3A, Vec4};
use rayon::prelude::*;

/// Ranges at least this long are scanned in parallel, by pieces of [`PIECE`].
const LONG: usize = 1 << 15;

/// Length of the pieces in which long ranges are scanned. Never depends on the number of threads, nor
/// does then the tree.
const PIECE: usize = 1 << 13;

/// A primitive's box and number in 32 bytes.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Reference {
    /// Lower corner; the last lane is the primitive's number as bits, [`NORMAL`] added.
    low: Vec4,
    /// Upper corner.
    high: Vec4,
}

/// Added to the primitive's number so that its bits are no denormal number: those slow processors down.
const NORMAL: u32 = 1 << 30;

impl Reference {
    pub fn new(primitive: u32, bounds: &Aabb) -> Self {
        let low = bounds.min.extend(f32::from_bits(primitive | NORMAL));
        Self { low, high: bounds.max.extend(0.0) }
    }

    pub fn primitive(&self) -> u32 {
        self.low.w.to_bits() & !NORMAL
    }

    pub fn bounds(&self) -> Bounds {
        Bounds { min: Vec3A::from_vec4(self.low), max: Vec3A::from_vec4(self.high) }
    }

    /// Twice the centre of the box.
    pub fn key(&self) -> Vec3A {
        Vec3A::from_vec4(self.low) + Vec3A::from_vec4(self.high)
    }

    /// One coordinate of the key.
    pub fn key_on(&self, axis: usize) -> f32 {
        self.low[axis] + self.high[axis]
    }
}

/// A box as two registers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    pub min: Vec3A,
    pub max: Vec3A,
}

impl Bounds {
    pub const EMPTY: Self = Self { min: Vec3A::splat(f32::INFINITY), max: Vec3A::splat(f32::NEG_INFINITY) };

    #[inline]
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    #[inline]
    pub fn with(self, point: Vec3A) -> Self {
        Self { min: self.min.min(point), max: self.max.max(point) }
    }

    /// Half the surface; at most about 1e23, so costs stay finite. NaN for an empty box.
    #[inline]
    pub fn half_area(&self) -> f32 {
        let size = self.max - self.min;
        size.x * size.y + size.y * size.z + size.z * size.x
    }

    pub fn to_aabb(self) -> Aabb {
        Aabb { min: self.min.into(), max: self.max.into() }
    }
}

/// The box around references, and the box around their keys.
#[derive(Clone, Copy)]
pub(super) struct Extent {
    pub bounds: Bounds,
    pub keys: Bounds,
}

impl Extent {
    const EMPTY: Self = Self { bounds: Bounds::EMPTY, keys: Bounds::EMPTY };

    pub fn of(references: &[Reference]) -> Self {
        let with = |extent: Self, reference: &Reference| Self {
            bounds: extent.bounds.union(reference.bounds()),
            keys: extent.keys.with(reference.key()),
        };
        let union = |a: Self, b: Self| Self { bounds: a.bounds.union(b.bounds), keys: a.keys.union(b.keys) };
        scan(references, |piece| piece.iter().fold(Self::EMPTY, with), union)
    }
}

/// Folds references, long ranges in parallel.
pub(super) fn scan<T: Send>(
    references: &[Reference],
    fold: impl Fn(&[Reference]) -> T + Sync,
    union: impl Fn(T, T) -> T + Sync + Send,
) -> T {
    if references.len() < LONG {
        return fold(references);
    }
    let pieces = references.par_chunks(PIECE).map(&fold);
    pieces.reduce_with(&union).unwrap_or_else(|| fold(&[]))
}

/// The two sides of a partition: how many are on the left, and the boxes around the keys of each.
pub(super) struct Sides {
    pub middle: usize,
    pub keys: [Bounds; 2],
}

/// Puts the references that `is_left` first; long ranges in parallel.
pub(super) fn partition(references: &mut [Reference], is_left: impl Fn(&Reference) -> bool + Sync) -> Sides {
    if references.len() < LONG {
        return partition_short(references, &is_left);
    }
    let pieces: Vec<Sides> =
        references.par_chunks_mut(PIECE).map(|piece| partition_short(piece, &is_left)).collect();
    let mut all = Sides { middle: 0, keys: [Bounds::EMPTY; 2] };
    for piece in &pieces {
        all.middle += piece.middle;
        all.keys = [0, 1].map(|side| all.keys[side].union(piece.keys[side]));
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

/// Partitions without branches, which would be a coin's toss.
fn partition_short(references: &mut [Reference], is_left: &impl Fn(&Reference) -> bool) -> Sides {
    let mut middle = 0;
    for i in 0..references.len() {
        let left = is_left(&references[i]);
        references.swap(i, middle);
        middle += usize::from(left);
    }
    let (left, right) = references.split_at(middle);
    let keys = |side: &[Reference]| side.iter().fold(Bounds::EMPTY, |keys, r| keys.with(r.key()));
    Sides { middle, keys: [keys(left), keys(right)] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn long_partitions_lose_nothing_and_put_all_where_they_belong() {
        let at = |i: u32| Vec3::splat(crate::geom::mix(i) as f32);
        for (count, part) in [(LONG, 2), (3 * LONG + 17, 3), (100_000, 50_000), (LONG + 1, u32::MAX)] {
            let new = |i: u32| Reference::new(i, &Aabb { min: at(i), max: at(i) });
            let mut references: Vec<Reference> = (0..count as u32).map(new).collect();
            let is_left = |r: &Reference| crate::geom::mix(r.primitive()).is_multiple_of(part);
            let sides = partition(&mut references, is_left);
            let (left, right) = references.split_at(sides.middle);
            assert!(left.iter().all(is_left) && !right.iter().any(is_left));
            for (keys, references) in sides.keys.iter().zip([left, right]) {
                let exact = Extent::of(references).keys;
                assert_eq!((keys.min, keys.max), (exact.min, exact.max));
            }
            let mut primitives: Vec<u32> = references.iter().map(Reference::primitive).collect();
            primitives.sort_unstable();
            assert!(primitives.into_iter().eq(0..count as u32));
        }
    }
}
