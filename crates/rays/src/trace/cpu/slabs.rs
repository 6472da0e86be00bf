//! The slab test in lanes: which axis-aligned boxes rays enter, with the operations of [`CanonicalRay::slab`].

use super::lane_math::{LaneVec3, add, sub};
use crate::bvh::WIDTH;
use crate::geom::CanonicalRay;
use crate::lanes::{LaneBits, Lanes, each, keep, load_eights, load_one, splat};

/// The boxes of a node's eight slots, as `[lower, upper][axis][slot]`.
pub type Boxes = [[[f32; WIDTH]; 3]; 2];

/// The faces of a node's boxes across each axis, in the order in which rays of one octant cross them. Each face has one
/// coordinate per slot.
#[derive(Clone, Copy)]
pub struct Faces<'a> {
    pub near: [&'a [f32; WIDTH]; 3],
    pub far: [&'a [f32; WIDTH]; 3],
}

impl<'a> Faces<'a> {
    /// The faces as rays of `octant` cross them. Bit `axis` of an octant is set if directions are negative on that
    /// axis.
    #[inline(always)]
    pub fn new(boxes: &'a Boxes, octant: usize) -> Self {
        let face = |side: usize, axis: usize| &boxes[side ^ (octant >> axis & 1)][axis];
        Self { near: [face(0, 0), face(0, 1), face(0, 2)], far: [face(1, 0), face(1, 1), face(1, 2)] }
    }

    /// Boxes whose faces are moved outwards by `by`. Their lower faces are the near ones of `octant`, whatever it is.
    #[inline(always)]
    pub fn widened<E: Lanes>(&self, e: E, by: f32, octant: usize) -> Boxes {
        let by = |axis: usize| e.splat(by * (1.0 - 2.0 * (octant >> axis & 1) as f32));
        let by = [by(0), by(1), by(2)];
        let near = [load_one(e, self.near[0]), load_one(e, self.near[1]), load_one(e, self.near[2])];
        let far = [load_one(e, self.far[0]), load_one(e, self.far[1]), load_one(e, self.far[2])];
        [keep(e, sub(e, near, by)), keep(e, add(e, far, by))]
    }

    /// Near and far faces of two nodes, one node in each eight lanes. With eight lanes only the first node counts.
    #[inline(always)]
    fn load_pair<L: Lanes>(l: L, [a, b]: &[Self; 2]) -> (LaneVec3<L>, LaneVec3<L>) {
        let near = [
            load_eights(l, [a.near[0], b.near[0]]),
            load_eights(l, [a.near[1], b.near[1]]),
            load_eights(l, [a.near[2], b.near[2]]),
        ];
        let far = [
            load_eights(l, [a.far[0], b.far[0]]),
            load_eights(l, [a.far[1], b.far[1]]),
            load_eights(l, [a.far[2], b.far[2]]),
        ];
        (near, far)
    }
}

/// The slab test's constants of rays: a ray crosses the plane at coordinate `x` of an axis at `x * inverse + near`
/// where it enters a slab, and at `x * inverse + far` where it leaves one.
pub struct Slabs<L: Lanes> {
    pub inverse: LaneVec3<L>,
    pub near: LaneVec3<L>,
    pub far: LaneVec3<L>,
}

impl<L: Lanes> Slabs<L> {
    /// The constants of rays with these [rows](super::substream::Row).
    #[inline(always)]
    pub fn new(l: L, inverse: LaneVec3<L>, shift: LaneVec3<L>, slack: L::F) -> Self {
        let pad = each(inverse, |inverse| l.mul(slack, l.abs(inverse)));
        Self { inverse, near: sub(l, shift, pad), far: add(l, shift, pad) }
    }

    /// The constants for boxes that are [widened](Faces::widened) instead of the rays.
    #[inline(always)]
    pub fn without_slack(inverse: LaneVec3<L>, shift: LaneVec3<L>) -> Self {
        Self { inverse, near: shift, far: shift }
    }

    /// The constants of one ray, in all lanes.
    #[inline(always)]
    pub fn of_ray(l: L, ray: &CanonicalRay) -> Self {
        let CanonicalRay { inverse, near, far, .. } = ray;
        Self {
            inverse: splat(l, inverse.to_array()),
            near: splat(l, near.to_array()),
            far: splat(l, far.to_array()),
        }
    }

    /// Distances at which rays enter and leave boxes with these faces, behind the origin too.
    #[inline(always)]
    pub fn entry_and_exit(&self, l: L, near: LaneVec3<L>, far: LaneVec3<L>) -> (L::F, L::F) {
        let ([ex, ey, ez], [lx, ly, lz]) = self.plane_distances(l, near, far);
        (l.max(l.max(ex, ey), ez), l.min(l.min(lx, ly), lz))
    }

    /// Rays against one box: the lanes of `among` whose ray is inside the box of a slot somewhere in `0..=limit`.
    /// Whether it is inside after `t_min` is left to the triangle test.
    #[inline(always)]
    pub fn enter_box(&self, l: L, among: LaneBits, faces: &Faces<'_>, slot: usize, limit: L::F) -> LaneBits {
        let Faces { near, far } = *faces;
        let near = [l.splat(near[0][slot]), l.splat(near[1][slot]), l.splat(near[2][slot])];
        let far = [l.splat(far[0][slot]), l.splat(far[1][slot]), l.splat(far[2][slot])];
        self.enter(l, among, near, far, limit)
    }

    /// One ray against eight boxes: the slots whose box it enters. Each eight lanes hold a node and a ray of their own.
    #[inline(always)]
    pub fn enter_boxes(&self, l: L, faces: &[Faces<'_>; 2], limit: L::F) -> LaneBits {
        let (near, far) = Faces::load_pair(l, faces);
        self.enter(l, L::ALL, near, far, limit)
    }

    /// Distances at which a ray, the same in all eight lanes, enters and leaves the box of each slot, cut off at 0 and
    /// at `limit`.
    #[inline(always)]
    pub fn clamped_distances(&self, l: L, faces: &Faces<'_>, limit: L::F) -> (L::F, L::F) {
        let (near, far) = Faces::load_pair(l, &[*faces; 2]);
        let ([x, y, z], [u, v, w]) = self.plane_distances(l, near, far);
        let enter = l.max(l.max(x, y), l.max(z, l.splat(0.0)));
        let leave = l.min(l.min(u, v), l.min(w, limit));
        (enter, leave)
    }

    /// The lanes of `among` whose ray is inside a box somewhere in `0..=limit`.
    ///
    /// Distances are compared as integers, which saves the comparison with 0. The result is exact:
    /// - If the last entry or the first exit is not negative, it is computed as among numbers; if it is negative, so is
    ///   the result.
    /// - If both are negative, the order of negative numbers by their bits is the reverse. Then `enter` is the first
    ///   entry and `leave` the last exit, and `enter <= leave` holds for no ray.
    /// - −0 is the least integer of all, but it does not occur: `far` is never −0, nor is a sum with `far`, unless it
    ///   was rounded to −0 from below 0. Limits are never −0 either: `setup` and `triangle` add +0 to them.
    #[inline(always)]
    fn enter(&self, l: L, among: LaneBits, near: LaneVec3<L>, far: LaneVec3<L>, limit: L::F) -> LaneBits {
        let ([x, y, z], [u, v, w]) = self.plane_distances(l, near, far);
        let enter = l.max_bits(l.max_bits(x, y), z);
        let leave = l.min_bits(l.min_bits(u, v), l.min_bits(w, limit));
        l.le_bits(among, enter, leave)
    }

    /// Distances at which rays cross the near and the far planes of each axis.
    #[inline(always)]
    fn plane_distances(&self, l: L, near: LaneVec3<L>, far: LaneVec3<L>) -> (LaneVec3<L>, LaneVec3<L>) {
        let i = self.inverse;
        (
            [
                l.fma(near[0], i[0], self.near[0]),
                l.fma(near[1], i[1], self.near[1]),
                l.fma(near[2], i[2], self.near[2]),
            ],
            [
                l.fma(far[0], i[0], self.far[0]),
                l.fma(far[1], i[1], self.far[1]),
                l.fma(far[2], i[2], self.far[2]),
            ],
        )
    }
}
