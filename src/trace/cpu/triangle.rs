//! [`crate::geom::CanonicalRay::triangle`] in lanes: the same operations in the same order.

use super::lanes::Lanes;

/// A vector of three in lanes.
type Vector<L> = [<L as Lanes>::F; 3];

/// The slab test's constants.
pub(super) struct Slabs<L: Lanes> {
    inverse: Vector<L>,
    near: Vector<L>,
    far: Vector<L>,
}

impl<L: Lanes> Slabs<L> {
    /// From what rows hold.
    #[inline(always)]
    pub fn new(l: L, inverse: Vector<L>, shift: Vector<L>, slack: L::F) -> Self {
        let pad: Vector<L> = inverse.map(|inverse| l.mul(slack, l.abs(inverse)));
        Self { inverse, near: zip(shift, pad, |s, p| l.sub(s, p)), far: zip(shift, pad, |s, p| l.add(s, p)) }
    }
}

/// Edge functions of rays and triangles, and what the rest of the test needs again.
pub(super) struct Edges<L: Lanes> {
    a: Vector<L>,
    e0: Vector<L>,
    e1: Vector<L>,
    u: L::F,
    v: L::F,
    w: L::F,
}

/// The edge functions; lanes may differ in ray, triangle or both.
#[inline(always)]
pub(super) fn edges<L: Lanes>(
    l: L,
    origin: &Vector<L>,
    direction: &Vector<L>,
    triangle: &[Vector<L>; 3],
) -> Edges<L> {
    let [a, b, c] = triangle.map(|vertex| zip(vertex, *origin, |x, o| l.sub(x, o)));
    let minus = |a, b| zip(a, b, |a, b| l.sub(a, b));
    let plus = |a, b| zip(a, b, |a, b| l.add(a, b));
    let (e0, e1, e2) = (minus(c, a), minus(a, b), minus(b, c));
    let u = dot(l, cross(l, e0, plus(c, a)), *direction);
    let v = dot(l, cross(l, e1, plus(a, b)), *direction);
    let w = dot(l, cross(l, e2, plus(b, c)), *direction);
    Edges { a, e0, e1, u, v, w }
}

impl<L: Lanes> Edges<L> {
    /// The lanes whose ray passes through the triangle's inside or edge.
    #[inline(always)]
    pub fn inside(&self, l: L, among: u32) -> u32 {
        let Self { u, v, w, .. } = *self;
        let lowest = l.min(l.min(u, v), w);
        let highest = l.max(l.max(u, v), w);
        let zero = l.splat(0.0);
        l.le(among, zero, lowest) | l.le(among, highest, zero)
    }

    /// The rest of the test for the lanes of `inside`: those with a hit in `t_min..=limit`, and t, u, v.
    /// All rays are of one octant.
    #[allow(clippy::too_many_arguments)]
    #[inline(always)]
    pub fn hit(
        &self,
        l: L,
        inside: u32,
        direction: &Vector<L>,
        triangle: &[Vector<L>; 3],
        slabs: &Slabs<L>,
        octant: usize,
        t_min: L::F,
        limit: L::F,
    ) -> (u32, L::F, L::F, L::F) {
        let zero = l.splat(0.0);
        let normal = cross(l, self.e1, self.e0);
        let facing = dot(l, normal, *direction);
        // Finite over not zero: never NaN where the lane stays in.
        let t = l.div(dot(l, normal, self.a), facing);
        let [v0, v1, v2] = *triangle;
        let low = zip(zip(v0, v1, |a, b| l.min(a, b)), v2, |a, b| l.min(a, b));
        let high = zip(zip(v0, v1, |a, b| l.max(a, b)), v2, |a, b| l.max(a, b));
        let crossing = |axis: usize, entering: bool| {
            let lower = entering == (octant >> axis & 1 == 0);
            let plane = if lower { low[axis] } else { high[axis] };
            let constant = if entering { slabs.near[axis] } else { slabs.far[axis] };
            l.fma(plane, slabs.inverse[axis], constant)
        };
        let enter = l.max(l.max(crossing(0, true), crossing(1, true)), crossing(2, true));
        let leave = l.min(l.min(crossing(0, false), crossing(1, false)), crossing(2, false));
        let t = l.add(l.min(l.max(t, enter), leave), zero);
        let scale = l.div(l.splat(1.0), l.add(l.add(self.u, self.v), self.w));
        let mut hit = inside & !l.eq(inside, facing, zero);
        hit = l.le(hit, enter, leave);
        hit = l.le(hit, t_min, t);
        hit = l.le(hit, t, limit);
        hit = l.le(hit, l.abs(scale), l.splat(f32::MAX));
        let weight = |edge| l.add(l.min(l.mul(edge, scale), l.splat(1.0)), zero);
        (hit, t, weight(self.u), weight(self.v))
    }
}

#[inline(always)]
fn zip<F: Copy>(a: [F; 3], b: [F; 3], f: impl Fn(F, F) -> F) -> [F; 3] {
    [f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2])]
}

#[inline(always)]
fn cross<L: Lanes>(l: L, a: Vector<L>, b: Vector<L>) -> Vector<L> {
    let component = |i: usize, j: usize| l.fms(a[i], b[j], l.mul(a[j], b[i]));
    [component(1, 2), component(2, 0), component(0, 1)]
}

#[inline(always)]
fn dot<L: Lanes>(l: L, a: Vector<L>, b: Vector<L>) -> L::F {
    l.fma(a[0], b[0], l.fma(a[1], b[1], l.mul(a[2], b[2])))
}
