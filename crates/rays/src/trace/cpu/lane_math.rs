//! 3-D vectors in lanes: three SIMD vectors, one per axis, so each lane holds a 3-D vector of its own.
//!
//! All of it is functions and no closures: only `inline(always)` guarantees that code ends up inside the functions that
//! enable the instructions.

use crate::lanes::Lanes;

/// A 3-D vector per lane, as x, y and z.
pub type LaneVec3<L> = [<L as Lanes>::F; 3];

#[inline(always)]
pub fn add<L: Lanes>(l: L, a: LaneVec3<L>, b: LaneVec3<L>) -> LaneVec3<L> {
    [l.add(a[0], b[0]), l.add(a[1], b[1]), l.add(a[2], b[2])]
}

#[inline(always)]
pub fn sub<L: Lanes>(l: L, a: LaneVec3<L>, b: LaneVec3<L>) -> LaneVec3<L> {
    [l.sub(a[0], b[0]), l.sub(a[1], b[1]), l.sub(a[2], b[2])]
}

#[inline(always)]
pub fn cross<L: Lanes>(l: L, a: LaneVec3<L>, b: LaneVec3<L>) -> LaneVec3<L> {
    [
        l.fms(a[1], b[2], l.mul(a[2], b[1])),
        l.fms(a[2], b[0], l.mul(a[0], b[2])),
        l.fms(a[0], b[1], l.mul(a[1], b[0])),
    ]
}

#[inline(always)]
pub fn dot<L: Lanes>(l: L, a: LaneVec3<L>, b: LaneVec3<L>) -> L::F {
    l.fma(a[0], b[0], l.fma(a[1], b[1], l.mul(a[2], b[2])))
}

/// The largest absolute value of the three coordinates.
#[inline(always)]
pub fn max_abs<L: Lanes>(l: L, a: LaneVec3<L>) -> L::F {
    l.max_abs(l.max_abs(a[0], a[1]), a[2])
}
