//! What the rays of a packet or a shaft have in common, and how they meet the boxes of a node.

use super::triangle::{Faces, Vector};
use crate::bvh::WIDTH;
use crate::lanes::{Lanes, keep, load, load_one, splat, splat_row};

/// The extremes of some rays of an octant.
///
/// A ray enters a plane at distance `x` from its origin at `x * i - slack * |i|` and leaves it at `x * i + slack * |i|`, where
/// `i` is its inverse on that axis, both up to rounding. All errors of these and of the products here sum to less than 10 half
/// ulps of the largest coordinate `m` times `|i|`, that is `2⁻²⁰ m |i|`, and `slack` is `2⁻¹⁹ m`. So where planes are moved
/// apart by twice the slack, `x * i` is a lower bound of the entry and an upper bound of the leaving if these are not negative;
/// and so is `x` times the least `i` of all rays for their entries, and times the greatest for their leavings. Where rays start
/// at different points, `x` is to be taken from the last of these along the octant for entries, and from the first for leavings.
#[derive(Clone, Copy)]
pub(super) struct Interval {
    /// The inverse of least size on each axis; its sign is that of the octant.
    pub low: [f32; 3],
    /// Those of greatest size.
    pub high: [f32; 3],
    /// Greatest `limit`.
    pub limit: f32,
}

/// Distances of the planes of a node's boxes from origins, moved apart: see [`Interval`].
#[repr(C, align(32))]
pub(super) struct Planes {
    near: [[f32; WIDTH]; 3],
    far: [[f32; WIDTH]; 3],
}

impl Planes {
    /// Of boxes with these faces, for rays of an octant whose origins have these least and greatest coordinates and at most this
    /// slack.
    #[inline(always)]
    pub fn new<E: Lanes>(e: E, origins: [[f32; 3]; 2], slack: f32, faces: &Faces<'_>, octant: usize) -> Self {
        let back = [octant & 1, octant >> 1 & 1, octant >> 2 & 1];
        let apart = |axis: usize| 2.0 * slack * (1.0 - 2.0 * back[axis] as f32);
        let first = |axis: usize| origins[back[axis]][axis];
        let last = |axis: usize| origins[1 - back[axis]][axis];
        let apart = splat(e, [apart(0), apart(1), apart(2)]);
        let first = splat(e, [first(0), first(1), first(2)]);
        let last = splat(e, [last(0), last(1), last(2)]);
        let near = [
            e.sub(e.sub(load_one(e, faces.near[0]), last[0]), apart[0]),
            e.sub(e.sub(load_one(e, faces.near[1]), last[1]), apart[1]),
            e.sub(e.sub(load_one(e, faces.near[2]), last[2]), apart[2]),
        ];
        let far = [
            e.add(e.sub(load_one(e, faces.far[0]), first[0]), apart[0]),
            e.add(e.sub(load_one(e, faces.far[1]), first[1]), apart[1]),
            e.add(e.sub(load_one(e, faces.far[2]), first[2]), apart[2]),
        ];
        Self { near: keep(e, near), far: keep(e, far) }
    }

    /// The slots whose box some ray of the interval may enter.
    #[inline(always)]
    pub fn entered<E: Lanes>(&self, e: E, interval: &Interval) -> u32 {
        let Interval { low, high, limit } = *interval;
        let (near, far) = (load(e, &self.near), load(e, &self.far));
        overlap(e, E::ALL, near, splat(e, low), far, splat(e, high), e.splat(limit))
    }

    /// The lanes of `among` whose ray may enter the box of a slot.
    #[inline(always)]
    pub fn enters<L: Lanes>(&self, l: L, among: u32, slot: usize, inverse: Vector<L>, limit: L::F) -> u32 {
        let (near, far) = (splat_row(l, &self.near, slot), splat_row(l, &self.far, slot));
        overlap(l, among, near, inverse, far, inverse, limit)
    }
}

/// The lanes in which the last of `near * low` is not behind the first of `far * high`, somewhere in `0..=limit`.
#[inline(always)]
fn overlap<L: Lanes>(
    l: L,
    among: u32,
    near: Vector<L>,
    low: Vector<L>,
    far: Vector<L>,
    high: Vector<L>,
    limit: L::F,
) -> u32 {
    let [x, y, z] = [l.mul(near[0], low[0]), l.mul(near[1], low[1]), l.mul(near[2], low[2])];
    let enter = l.max(l.max(x, y), l.max(z, l.splat(0.0)));
    let [x, y, z] = [l.mul(far[0], high[0]), l.mul(far[1], high[1]), l.mul(far[2], high[2])];
    let leave = l.min(l.min(x, y), l.min(z, limit));
    l.le(among, enter, leave)
}
