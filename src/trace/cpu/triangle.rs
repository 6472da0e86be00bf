//! [`crate::geom::CanonicalRay::triangle`] in lanes: the same operations in the same order.
//!
//! Functions, not closures, throughout: only `inline(always)` makes sure that all of it ends up where
//! the instructions are enabled.

use super::instance_space::Boxes;
use crate::bvh::WIDTH;
use crate::geom::CanonicalRay;
use crate::lanes::{Lanes, each, keep, load_eights, load_one, splat, zip};

/// A vector of three in lanes.
pub(crate) type Vector<L> = [<L as Lanes>::F; 3];

/// The slab test's constants.
pub(crate) struct Slabs<L: Lanes> {
    inverse: Vector<L>,
    near: Vector<L>,
    far: Vector<L>,
}

impl<L: Lanes> Slabs<L> {
    /// From what rows hold.
    #[inline(always)]
    pub fn new(l: L, inverse: Vector<L>, shift: Vector<L>, slack: L::F) -> Self {
        let pad = each(inverse, |inverse| l.mul(slack, l.abs(inverse)));
        Self { inverse, near: minus(l, shift, pad), far: plus(l, shift, pad) }
    }

    /// From what rows hold, for boxes that are moved apart themselves.
    #[inline(always)]
    pub fn without_slack(inverse: Vector<L>, shift: Vector<L>) -> Self {
        Self { inverse, near: shift, far: shift }
    }

    /// Of one ray, in all lanes.
    #[inline(always)]
    pub fn of(l: L, ray: &CanonicalRay) -> Self {
        let CanonicalRay { inverse, near, far, .. } = ray;
        Self {
            inverse: splat(l, inverse.to_array()),
            near: splat(l, near.to_array()),
            far: splat(l, far.to_array()),
        }
    }

    /// When rays enter and leave boxes with these faces.
    #[inline(always)]
    fn cross(&self, l: L, near: Vector<L>, far: Vector<L>) -> (L::F, L::F) {
        let ([ex, ey, ez], [lx, ly, lz]) = self.planes(l, near, far);
        (l.max(l.max(ex, ey), ez), l.min(l.min(lx, ly), lz))
    }
}

/// Pointers to the faces of a node's boxes across each axis, in the order in which rays of an octant
/// meet them: eight slots each.
#[derive(Clone, Copy)]
pub(crate) struct Faces<'a> {
    pub near: [&'a [f32; WIDTH]; 3],
    pub far: [&'a [f32; WIDTH]; 3],
}

impl<'a> Faces<'a> {
    #[inline(always)]
    pub fn of(boxes: &'a Boxes, octant: usize) -> Self {
        let face = |side: usize, axis: usize| &boxes[side ^ (octant >> axis & 1)][axis];
        Self { near: [face(0, 0), face(0, 1), face(0, 2)], far: [face(1, 0), face(1, 1), face(1, 2)] }
    }

    /// These boxes, each face moved outwards by `by`: the nearer faces, then the farther ones.
    #[inline(always)]
    pub fn apart<E: Lanes>(&self, e: E, by: f32, octant: usize) -> Boxes {
        let by = |axis: usize| e.splat(by * (1.0 - 2.0 * (octant >> axis & 1) as f32));
        let by = [by(0), by(1), by(2)];
        let near = [load_one(e, self.near[0]), load_one(e, self.near[1]), load_one(e, self.near[2])];
        let far = [load_one(e, self.far[0]), load_one(e, self.far[1]), load_one(e, self.far[2])];
        [keep(e, minus(e, near, by)), keep(e, plus(e, far, by))]
    }

    /// Those of all slots of nodes, one in each eight lanes; with eight lanes only the first counts.
    #[inline(always)]
    fn load<L: Lanes>(l: L, [a, b]: &[Self; 2]) -> (Vector<L>, Vector<L>) {
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

impl<L: Lanes> Slabs<L> {
    /// The lanes of `among` whose ray is in the box of a slot somewhere in `0..=limit`. Whether it is
    /// there after `t_min` is left to triangles.
    #[inline(always)]
    pub fn enters(&self, l: L, among: u32, faces: &Faces<'_>, slot: usize, limit: L::F) -> u32 {
        let Faces { near, far } = *faces;
        let near = [l.splat(near[0][slot]), l.splat(near[1][slot]), l.splat(near[2][slot])];
        let far = [l.splat(far[0][slot]), l.splat(far[1][slot]), l.splat(far[2][slot])];
        self.meets(l, among, near, far, limit)
    }

    /// The same for boxes in lanes, of which these are the faces.
    ///
    /// Entries and leavings are compared as integers, which saves the comparison with 0. Where the last entry or the
    /// first leaving is not negative it comes out as it is; where it is negative, so is what comes out. If both are, the
    /// order of negative numbers by their bits is the reverse, so `enter` is the first entry and `leave` the last
    /// leaving, and `enter <= leave` is true of none. −0 is the least of all, but no number here: `far` is never
    /// −0, and so is no sum with it unless it has been rounded to that from below 0; and limits are not, as
    /// `setup` and [`hits`] see to.
    #[inline(always)]
    fn meets(&self, l: L, among: u32, near: Vector<L>, far: Vector<L>, limit: L::F) -> u32 {
        let ([x, y, z], [u, v, w]) = self.planes(l, near, far);
        let enter = l.max_bits(l.max_bits(x, y), z);
        let leave = l.min_bits(l.min_bits(u, v), l.min_bits(w, limit));
        l.le_bits(among, enter, leave)
    }

    /// When rays cross planes on which they enter and on which they leave.
    #[inline(always)]
    fn planes(&self, l: L, near: Vector<L>, far: Vector<L>) -> (Vector<L>, Vector<L>) {
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

impl<E: Lanes> Slabs<E> {
    /// The slots whose box a ray enters: of a node in each eight lanes, which has a ray of its own.
    #[inline(always)]
    pub fn enters_any(&self, e: E, faces: &[Faces<'_>; 2], limit: E::F) -> u32 {
        let (near, far) = Faces::load(e, faces);
        self.meets(e, E::ALL, near, far, limit)
    }

    /// When a ray, the same in all lanes, enters and leaves the box of each slot: not before 0, not after
    /// `limit`.
    #[inline(always)]
    pub fn cross_each(&self, e: E, faces: &Faces<'_>, limit: E::F) -> (E::F, E::F) {
        let (near, far) = Faces::load(e, &[*faces; 2]);
        let ([x, y, z], [u, v, w]) = self.planes(e, near, far);
        let enter = e.max(e.max(x, y), e.max(z, e.splat(0.0)));
        let leave = e.min(e.min(u, v), e.min(w, limit));
        (enter, leave)
    }
}

/// The boxes of triangles.
pub(super) struct Bounds<L: Lanes> {
    pub low: Vector<L>,
    pub high: Vector<L>,
}

impl<L: Lanes> Bounds<L> {
    #[inline(always)]
    pub fn of(l: L, triangle: &[Vector<L>; 3]) -> Self {
        let [a, b, c] = *triangle;
        Self {
            low: zip(zip(a, b, |a, b| l.min(a, b)), c, |a, b| l.min(a, b)),
            high: zip(zip(a, b, |a, b| l.max(a, b)), c, |a, b| l.max(a, b)),
        }
    }

    /// The faces, in the order in which rays of an octant meet them.
    #[inline(always)]
    pub fn faces(&self, octant: usize) -> [Vector<L>; 2] {
        let (x, y, z) = (self.axis(octant, 0), self.axis(octant, 1), self.axis(octant, 2));
        [[x.0, y.0, z.0], [x.1, y.1, z.1]]
    }

    #[inline(always)]
    fn axis(&self, octant: usize, axis: usize) -> (L::F, L::F) {
        if octant >> axis & 1 == 0 {
            (self.low[axis], self.high[axis])
        } else {
            (self.high[axis], self.low[axis])
        }
    }
}

/// Triangles as seen from an origin.
pub(super) struct Seen<L: Lanes> {
    /// The vectors whose products with a direction are the weights u, v and w, not yet scaled.
    pub edges: [Vector<L>; 3],
    /// A normal, on either side, of twice the triangle's area in length.
    pub normal: Vector<L>,
    /// `dot(normal, a)`, with `a` from the origin to the first corner.
    pub distance: L::F,
}

/// The corners of triangles from the rays' origin. Lanes may differ in origin, triangle or both.
#[inline(always)]
pub(super) fn seen<L: Lanes>(l: L, origin: &Vector<L>, triangle: &[Vector<L>; 3]) -> [Vector<L>; 3] {
    [minus(l, triangle[0], *origin), minus(l, triangle[1], *origin), minus(l, triangle[2], *origin)]
}

/// The corners of triangles from the rays' origin, and the edges.
struct Edges<L: Lanes> {
    a: Vector<L>,
    b: Vector<L>,
    c: Vector<L>,
    e0: Vector<L>,
    e1: Vector<L>,
    e2: Vector<L>,
}

impl<L: Lanes> Edges<L> {
    #[inline(always)]
    fn of(l: L, [a, b, c]: [Vector<L>; 3]) -> Self {
        Self { a, b, c, e0: minus(l, c, a), e1: minus(l, a, b), e2: minus(l, b, c) }
    }

    /// What of the edge functions does not need the direction.
    #[inline(always)]
    fn functions(&self, l: L) -> [Vector<L>; 3] {
        let Self { a, b, c, e0, e1, e2 } = *self;
        [cross(l, e0, plus(l, c, a)), cross(l, e1, plus(l, a, b)), cross(l, e2, plus(l, b, c))]
    }

    /// A normal, on either side, of twice the triangle's area in length.
    #[inline(always)]
    fn normal(&self, l: L) -> Vector<L> {
        let Self { e0, e1, e2, .. } = *self;
        let first = l.le(L::ALL, largest(l, e0), largest(l, e2));
        let shorter =
            [l.select(first, e0[0], e2[0]), l.select(first, e0[1], e2[1]), l.select(first, e0[2], e2[2])];
        cross(l, e1, shorter)
    }
}

impl<L: Lanes> Seen<L> {
    /// All of it, for many directions.
    #[inline(always)]
    pub fn from(l: L, origin: &Vector<L>, triangle: &[Vector<L>; 3]) -> Self {
        let of = Edges::of(l, seen(l, origin, triangle));
        let normal = of.normal(l);
        Self { edges: of.functions(l), normal, distance: dot(l, normal, of.a) }
    }
}

/// Where a ray's line passes triangles.
#[derive(Clone, Copy)]
pub(super) struct Passing<L: Lanes> {
    pub u: L::F,
    pub v: L::F,
    pub w: L::F,
}

impl<L: Lanes> Passing<L> {
    #[inline(always)]
    pub fn new(l: L, edges: &[Vector<L>; 3], direction: Vector<L>) -> Self {
        Self {
            u: dot(l, edges[0], direction),
            v: dot(l, edges[1], direction),
            w: dot(l, edges[2], direction),
        }
    }

    #[inline(always)]
    pub fn of(l: L, origin: &Vector<L>, direction: Vector<L>, triangle: &[Vector<L>; 3]) -> Self {
        Self::seen(l, seen(l, origin, triangle), direction)
    }

    /// The same of triangles whose corners are [`seen`] from the origin.
    #[inline(always)]
    pub fn seen(l: L, corners: [Vector<L>; 3], direction: Vector<L>) -> Self {
        Self::new(l, &Edges::of(l, corners).functions(l), direction)
    }

    /// What the weights have to be divided by.
    #[inline(always)]
    fn sum(&self, l: L) -> L::F {
        l.add(l.add(self.u, self.v), self.w)
    }

    /// The weights of the second corner and of the third.
    #[inline(always)]
    pub fn weights(&self, l: L) -> (L::F, L::F) {
        let scale = l.div(l.splat(1.0), self.sum(l));
        let weight = |edge| l.add(l.min(l.mul(edge, scale), l.splat(1.0)), l.splat(0.0));
        (weight(self.u), weight(self.v))
    }

    /// The lanes in which it passes through the inside or an edge.
    #[inline(always)]
    pub fn inside(&self, l: L, among: u32) -> u32 {
        let Self { u, v, w } = *self;
        let lowest = l.min(l.min(u, v), w);
        let highest = l.max(l.max(u, v), w);
        let zero = l.splat(0.0);
        l.le(among, zero, lowest) | l.le(among, highest, zero)
    }
}

/// Hits, where the mask says so.
pub(crate) struct Hits<L: Lanes> {
    pub mask: u32,
    pub t: L::F,
    pub u: L::F,
    pub v: L::F,
}

/// What of a ray bounds its hits.
pub(crate) struct Range<'a, L: Lanes> {
    pub slabs: &'a Slabs<L>,
    /// Of all rays.
    pub octant: usize,
    pub t_min: L::F,
    pub limit: L::F,
}

/// The least number whose reciprocal is finite.
const LEAST_SUM: f32 = f32::from_bits(0x20_0001);

/// The rest of the test, for the lanes of `inside`: which of them hit, and when. `distance` and `facing` are the products
/// of the normal with the first corner and with the direction; `near` and `far` are the triangle's
/// [`Bounds::faces`].
#[inline(always)]
fn crossing<L: Lanes>(
    l: L,
    inside: u32,
    passing: &Passing<L>,
    [distance, facing]: [L::F; 2],
    [near, far]: [Vector<L>; 2],
    range: &Range<'_, L>,
) -> (u32, L::F) {
    let zero = l.splat(0.0);
    // Finite over not zero: never NaN where the lane stays in.
    let t = l.div(distance, facing);
    let (enter, leave) = range.slabs.cross(l, near, far);
    let t = l.add(l.min(l.max(t, enter), leave), zero);
    let mut mask = inside & !l.eq(inside, facing, zero);
    mask = l.le(mask, enter, leave);
    mask = l.le(mask, range.t_min, t);
    mask = l.le(mask, t, range.limit);
    mask = l.le(mask, l.splat(LEAST_SUM), l.abs(passing.sum(l)));
    (mask, t)
}

/// The same with the weights.
#[inline(always)]
pub(super) fn hits<L: Lanes>(
    l: L,
    inside: u32,
    passing: &Passing<L>,
    products: [L::F; 2],
    faces: [Vector<L>; 2],
    range: &Range<'_, L>,
) -> Hits<L> {
    let (mask, t) = crossing(l, inside, passing, products, faces, range);
    let (u, v) = passing.weights(l);
    Hits { mask, t, u, v }
}

/// When lines that pass inside a triangle, as `passing` says, hit it: the rest of the test without the weights.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "inlined: a struct of them would only be taken apart again")]
pub(super) fn reach<L: Lanes>(
    l: L,
    inside: u32,
    origin: &Vector<L>,
    direction: Vector<L>,
    triangle: &[Vector<L>; 3],
    passing: &Passing<L>,
    faces: [Vector<L>; 2],
    range: &Range<'_, L>,
) -> (u32, L::F) {
    let of = Edges::of(l, seen(l, origin, triangle));
    let normal = of.normal(l);
    crossing(l, inside, passing, [dot(l, normal, of.a), dot(l, normal, direction)], faces, range)
}

/// The whole test of a triangle, or nothing where no line passes inside.
#[inline(always)]
pub(crate) fn test<L: Lanes>(
    l: L,
    among: u32,
    origin: &Vector<L>,
    direction: Vector<L>,
    triangle: &[Vector<L>; 3],
    range: &Range<'_, L>,
) -> Option<Hits<L>> {
    let passing = Passing::of(l, origin, direction, triangle);
    let inside = passing.inside(l, among);
    if inside == 0 {
        return None;
    }
    let faces = Bounds::of(l, triangle).faces(range.octant);
    let (mask, t) = reach(l, inside, origin, direction, triangle, &passing, faces, range);
    let (u, v) = passing.weights(l);
    Some(Hits { mask, t, u, v })
}

#[inline(always)]
fn largest<L: Lanes>(l: L, a: Vector<L>) -> L::F {
    l.max_abs(l.max_abs(a[0], a[1]), a[2])
}

#[inline(always)]
fn plus<L: Lanes>(l: L, a: Vector<L>, b: Vector<L>) -> Vector<L> {
    [l.add(a[0], b[0]), l.add(a[1], b[1]), l.add(a[2], b[2])]
}

#[inline(always)]
fn minus<L: Lanes>(l: L, a: Vector<L>, b: Vector<L>) -> Vector<L> {
    [l.sub(a[0], b[0]), l.sub(a[1], b[1]), l.sub(a[2], b[2])]
}

#[inline(always)]
fn cross<L: Lanes>(l: L, a: Vector<L>, b: Vector<L>) -> Vector<L> {
    [
        l.fms(a[1], b[2], l.mul(a[2], b[1])),
        l.fms(a[2], b[0], l.mul(a[0], b[2])),
        l.fms(a[0], b[1], l.mul(a[1], b[0])),
    ]
}

#[inline(always)]
pub(super) fn dot<L: Lanes>(l: L, a: Vector<L>, b: Vector<L>) -> L::F {
    l.fma(a[0], b[0], l.fma(a[1], b[1], l.mul(a[2], b[2])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_whose_reciprocal_is_finite_are_told_by_their_size() {
        let near = (0..200).map(|i| LEAST_SUM.to_bits() - 100 + i);
        for bits in near.chain((0..u32::MAX).step_by(9973)) {
            let sum = f32::from_bits(bits);
            assert_eq!((1.0 / sum).is_finite(), sum.abs() >= LEAST_SUM, "{sum:e}");
        }
    }
}
