//! Interval tests: which boxes of a node none of several rays can enter, from the extremes of the rays.

use super::lane_math::LaneVec3;
use super::slabs::Faces;
use crate::bvh::WIDTH;
use crate::lanes::{LaneBits, Lanes, keep, load, load_one, splat, splat_row};

/// The extremes of rays of one octant.
///
/// # Why the test is conservative
/// Let `x` be the distance of a plane from a ray's origin on one axis, and `i` the ray's inverse direction there. The
/// slab test lets the ray enter the plane at `x * i - slack * |i|` and leave it at `x * i + slack * |i|`, both up to
/// rounding. All rounding errors of these terms and of the products here sum to less than 10 half ulps of the largest
/// coordinate `m` times `|i|`, that is `2⁻²⁰ m |i|`, and `slack` is `2⁻¹⁹ m`. So if planes are moved outwards by
/// twice the slack, `x * i` is a lower bound of the entry and an upper bound of the exit, provided that these are not
/// negative.
///
/// For several rays, entries are bounded by `x` times the least `|i|`, exits by `x` times the greatest. If the rays
/// start at different points, `x` is measured from the last origin along the octant for entries, and from the first one
/// for exits.
#[derive(Clone, Copy)]
pub(super) struct Interval {
    /// The inverse direction of least absolute value on each axis; its sign is that of the octant.
    pub low: [f32; 3],
    /// The inverse direction of greatest absolute value on each axis.
    pub high: [f32; 3],
    /// The greatest [limit](super::substream::Row::limit).
    pub limit: f32,
}

/// The distances of the planes of a node's boxes from the rays' origins, moved outwards: see [`Interval`].
#[repr(C, align(32))]
pub(super) struct PlaneDistances {
    near: [[f32; WIDTH]; 3],
    far: [[f32; WIDTH]; 3],
}

impl PlaneDistances {
    /// For boxes with these faces and rays of one octant. `origins` are the least and the greatest coordinates of their
    /// origins, `slack` is their greatest.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn new<E: Lanes>(e: E, origins: [[f32; 3]; 2], slack: f32, faces: &Faces<'_>, octant: usize) -> Self {
        let negative = [octant & 1, octant >> 1 & 1, octant >> 2 & 1];
        let margin = |axis: usize| 2.0 * slack * (1.0 - 2.0 * negative[axis] as f32);
        let first = |axis: usize| origins[negative[axis]][axis];
        let last = |axis: usize| origins[1 - negative[axis]][axis];
        let margin = splat(e, [margin(0), margin(1), margin(2)]);
        let first = splat(e, [first(0), first(1), first(2)]);
        let last = splat(e, [last(0), last(1), last(2)]);
        let near = [
            e.sub(e.sub(load_one(e, faces.near[0]), last[0]), margin[0]),
            e.sub(e.sub(load_one(e, faces.near[1]), last[1]), margin[1]),
            e.sub(e.sub(load_one(e, faces.near[2]), last[2]), margin[2]),
        ];
        let far = [
            e.add(e.sub(load_one(e, faces.far[0]), first[0]), margin[0]),
            e.add(e.sub(load_one(e, faces.far[1]), first[1]), margin[1]),
            e.add(e.sub(load_one(e, faces.far[2]), first[2]), margin[2]),
        ];
        Self { near: keep(e, near), far: keep(e, far) }
    }

    /// The slots whose box some ray of the interval may enter.
    #[inline(always)]
    pub fn slots_entered<E: Lanes>(&self, e: E, interval: &Interval) -> LaneBits {
        let Interval { low, high, limit } = *interval;
        let (near, far) = (load(e, &self.near), load(e, &self.far));
        may_enter(e, E::ALL, near, splat(e, low), far, splat(e, high), e.splat(limit))
    }

    /// The lanes of `among` whose ray may enter the box of one slot.
    #[inline(always)]
    pub fn rays_entering<L: Lanes>(
        &self,
        l: L,
        among: LaneBits,
        slot: usize,
        inverse: LaneVec3<L>,
        limit: L::F,
    ) -> LaneBits {
        let (near, far) = (splat_row(l, &self.near, slot), splat_row(l, &self.far, slot));
        may_enter(l, among, near, inverse, far, inverse, limit)
    }
}

/// The lanes of `among` in which the last entry `near * low` is not after the first exit `far * high`, within
/// `0..=limit`.
#[inline(always)]
fn may_enter<L: Lanes>(
    l: L,
    among: LaneBits,
    near: LaneVec3<L>,
    low: LaneVec3<L>,
    far: LaneVec3<L>,
    high: LaneVec3<L>,
    limit: L::F,
) -> LaneBits {
    let [x, y, z] = [l.mul(near[0], low[0]), l.mul(near[1], low[1]), l.mul(near[2], low[2])];
    let enter = l.max(l.max(x, y), l.max(z, l.splat(0.0)));
    let [x, y, z] = [l.mul(far[0], high[0]), l.mul(far[1], high[1]), l.mul(far[2], high[2])];
    let leave = l.min(l.min(x, y), l.min(z, limit));
    l.le(among, enter, leave)
}
