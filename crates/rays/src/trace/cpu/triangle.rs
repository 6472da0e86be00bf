//! The canonical triangle test in lanes: the operations of [`crate::geom::CanonicalRay::triangle`] in the same order,
//! so every lane gives the same bits. RTRT section 3 tests four rays or four triangles at once in the same manner.
//!
//! Lanes may differ in ray, in triangle or in both. The test has two parts. First the *edge values*: three edge
//! functions, whose signs tell whether a ray's line passes through the triangle. Few lines do, so the distance and the
//! limits are computed only where some lane's line passes inside.

use super::lane_math::{LaneVec3, add, cross, dot, max_abs, sub};
use super::slabs::Slabs;
use crate::lanes::{LaneBits, Lanes, zip};

/// Lines of rays, one per lane.
#[derive(Clone, Copy)]
pub struct Lines<L: Lanes> {
    pub origin: LaneVec3<L>,
    pub direction: LaneVec3<L>,
}

/// The bounding boxes of triangles.
pub struct Bounds<L: Lanes> {
    pub low: LaneVec3<L>,
    pub high: LaneVec3<L>,
}

impl<L: Lanes> Bounds<L> {
    #[inline(always)]
    pub fn of(l: L, triangle: &[LaneVec3<L>; 3]) -> Self {
        let [a, b, c] = *triangle;
        Self {
            low: zip(zip(a, b, |a, b| l.min(a, b)), c, |a, b| l.min(a, b)),
            high: zip(zip(a, b, |a, b| l.max(a, b)), c, |a, b| l.max(a, b)),
        }
    }

    /// The faces as rays of `octant` cross them.
    #[inline(always)]
    pub fn faces(&self, octant: usize) -> BoundsFaces<L> {
        let (x, y, z) = (self.axis(octant, 0), self.axis(octant, 1), self.axis(octant, 2));
        BoundsFaces { near: [x.0, y.0, z.0], far: [x.1, y.1, z.1] }
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

/// The faces of triangles' bounding boxes across each axis, in the order in which rays of one octant cross them.
pub struct BoundsFaces<L: Lanes> {
    pub near: LaneVec3<L>,
    pub far: LaneVec3<L>,
}

/// The corners of triangles relative to the rays' origins.
#[inline(always)]
pub fn relative_corners<L: Lanes>(
    l: L,
    origin: &LaneVec3<L>,
    triangle: &[LaneVec3<L>; 3],
) -> [LaneVec3<L>; 3] {
    [sub(l, triangle[0], *origin), sub(l, triangle[1], *origin), sub(l, triangle[2], *origin)]
}

/// The corners of triangles relative to the rays' origins, and the edges: `e0` is opposite `b`, `e1` opposite `c`, `e2`
/// opposite `a`.
struct Edges<L: Lanes> {
    a: LaneVec3<L>,
    b: LaneVec3<L>,
    c: LaneVec3<L>,
    e0: LaneVec3<L>,
    e1: LaneVec3<L>,
    e2: LaneVec3<L>,
}

impl<L: Lanes> Edges<L> {
    #[inline(always)]
    fn of(l: L, [a, b, c]: [LaneVec3<L>; 3]) -> Self {
        Self { a, b, c, e0: sub(l, c, a), e1: sub(l, a, b), e2: sub(l, b, c) }
    }

    /// The vectors whose dot products with a direction are the [`EdgeValues`].
    #[inline(always)]
    fn normals(&self, l: L) -> [LaneVec3<L>; 3] {
        let Self { a, b, c, e0, e1, e2 } = *self;
        [cross(l, e0, add(l, c, a)), cross(l, e1, add(l, a, b)), cross(l, e2, add(l, b, c))]
    }

    /// The triangles' normals: on either side, as long as twice the area.
    #[inline(always)]
    fn triangle_normal(&self, l: L) -> LaneVec3<L> {
        let Self { e0, e1, e2, .. } = *self;
        let first = l.le(L::ALL, max_abs(l, e0), max_abs(l, e2));
        let shorter =
            [l.select(first, e0[0], e2[0]), l.select(first, e0[1], e2[1]), l.select(first, e0[2], e2[2])];
        cross(l, e1, shorter)
    }
}

/// The terms of the test that depend on the origin but not on the direction, for many rays from one origin.
pub struct OriginTerms<L: Lanes> {
    /// The vectors whose dot products with a direction are the [`EdgeValues`].
    pub edge_normals: [LaneVec3<L>; 3],
    /// The triangles' normals: on either side, as long as twice the area.
    pub normal: LaneVec3<L>,
    /// `dot(normal, a)`, with `a` from the origin to the first corner.
    pub distance: L::F,
}

impl<L: Lanes> OriginTerms<L> {
    #[inline(always)]
    pub fn new(l: L, origin: &LaneVec3<L>, triangle: &[LaneVec3<L>; 3]) -> Self {
        let edges = Edges::of(l, relative_corners(l, origin, triangle));
        let normal = edges.triangle_normal(l);
        Self { edge_normals: edges.normals(l), normal, distance: dot(l, normal, edges.a) }
    }
}

/// The values of a triangle's three edge functions for a ray's line: the barycentric weights of the second, the third
/// and the first corner, before they are divided by their sum.
#[derive(Clone, Copy)]
pub struct EdgeValues<L: Lanes> {
    pub u: L::F,
    pub v: L::F,
    pub w: L::F,
}

impl<L: Lanes> EdgeValues<L> {
    /// From the edge normals of [`OriginTerms`].
    #[inline(always)]
    pub fn new(l: L, edge_normals: &[LaneVec3<L>; 3], direction: LaneVec3<L>) -> Self {
        Self {
            u: dot(l, edge_normals[0], direction),
            v: dot(l, edge_normals[1], direction),
            w: dot(l, edge_normals[2], direction),
        }
    }

    #[inline(always)]
    pub fn of(l: L, lines: &Lines<L>, triangle: &[LaneVec3<L>; 3]) -> Self {
        Self::of_relative(l, relative_corners(l, &lines.origin, triangle), lines.direction)
    }

    /// From [`relative_corners`].
    #[inline(always)]
    pub fn of_relative(l: L, corners: [LaneVec3<L>; 3], direction: LaneVec3<L>) -> Self {
        Self::new(l, &Edges::of(l, corners).normals(l), direction)
    }

    #[inline(always)]
    fn sum(&self, l: L) -> L::F {
        l.add(l.add(self.u, self.v), self.w)
    }

    /// The barycentric weights of the second and of the third corner.
    #[inline(always)]
    pub fn barycentrics(&self, l: L) -> (L::F, L::F) {
        let scale = l.div(l.splat(1.0), self.sum(l));
        let weight = |edge| l.add(l.min(l.mul(edge, scale), l.splat(1.0)), l.splat(0.0));
        (weight(self.u), weight(self.v))
    }

    /// The lanes of `among` whose line passes through the triangle's interior or an edge.
    #[inline(always)]
    pub fn inside(&self, l: L, among: LaneBits) -> LaneBits {
        let Self { u, v, w } = *self;
        let lowest = l.min(l.min(u, v), w);
        let highest = l.max(l.max(u, v), w);
        let zero = l.splat(0.0);
        l.le(among, zero, lowest) | l.le(among, highest, zero)
    }
}

/// Hits in the lanes of a mask.
pub struct LaneHits<L: Lanes> {
    pub mask: LaneBits,
    pub t: L::F,
    pub u: L::F,
    pub v: L::F,
}

/// Limits of the hits of rays, besides the triangle.
pub struct Limits<'a, L: Lanes> {
    pub slabs: &'a Slabs<L>,
    /// The octant of all rays.
    pub octant: usize,
    pub t_min: L::F,
    /// The nearest hit so far, at first `t_max`.
    pub limit: L::F,
}

/// The least number whose reciprocal is finite.
const LEAST_SUM: f32 = f32::from_bits(0x20_0001);

/// The dot products of a triangle's normal that give the distance to its plane.
pub struct PlaneProducts<L: Lanes> {
    /// With the first corner, relative to the origin.
    pub distance: L::F,
    /// With the ray's direction.
    pub facing: L::F,
}

/// The second part of the test: which lanes of `inside` hit, and at which `t`. `faces` are the triangle's.
#[inline(always)]
fn hit_distance<L: Lanes>(
    l: L,
    inside: LaneBits,
    edges: &EdgeValues<L>,
    plane: &PlaneProducts<L>,
    faces: &BoundsFaces<L>,
    limits: &Limits<'_, L>,
) -> (LaneBits, L::F) {
    let zero = l.splat(0.0);
    // A finite number divided by a number that is not 0, wherever the lane remains in the mask: never NaN.
    let t = l.div(plane.distance, plane.facing);
    let (enter, leave) = limits.slabs.entry_and_exit(l, faces.near, faces.far);
    // Adding +0 turns −0 into 0, as the integer comparisons of `Slabs` require of limits.
    let t = l.add(l.min(l.max(t, enter), leave), zero);
    let mut mask = inside & !l.eq(inside, plane.facing, zero);
    mask = l.le(mask, enter, leave);
    mask = l.le(mask, limits.t_min, t);
    mask = l.le(mask, t, limits.limit);
    mask = l.le(mask, l.splat(LEAST_SUM), l.abs(edges.sum(l)));
    (mask, t)
}

/// The second part of the test, with barycentric weights, for triangles whose [`OriginTerms`] are known.
#[inline(always)]
pub fn hits_of_origin<L: Lanes>(
    l: L,
    inside: LaneBits,
    edges: &EdgeValues<L>,
    plane: &PlaneProducts<L>,
    faces: &BoundsFaces<L>,
    limits: &Limits<'_, L>,
) -> LaneHits<L> {
    let (mask, t) = hit_distance(l, inside, edges, plane, faces, limits);
    let (u, v) = edges.barycentrics(l);
    LaneHits { mask, t, u, v }
}

/// The second part of the test, without barycentric weights: which lanes of `inside` hit, and at which `t`.
#[inline(always)]
pub fn hits_inside<L: Lanes>(
    l: L,
    inside: LaneBits,
    lines: &Lines<L>,
    triangle: &[LaneVec3<L>; 3],
    edges: &EdgeValues<L>,
    faces: &BoundsFaces<L>,
    limits: &Limits<'_, L>,
) -> (LaneBits, L::F) {
    let of = Edges::of(l, relative_corners(l, &lines.origin, triangle));
    let normal = of.triangle_normal(l);
    let plane = PlaneProducts { distance: dot(l, normal, of.a), facing: dot(l, normal, lines.direction) };
    hit_distance(l, inside, edges, &plane, faces, limits)
}

/// The whole test; `None` if no lane's line passes through the triangle.
#[inline(always)]
pub fn test<L: Lanes>(
    l: L,
    among: LaneBits,
    lines: &Lines<L>,
    triangle: &[LaneVec3<L>; 3],
    limits: &Limits<'_, L>,
) -> Option<LaneHits<L>> {
    let edges = EdgeValues::of(l, lines, triangle);
    let inside = edges.inside(l, among);
    if inside == 0 {
        return None;
    }
    let faces = Bounds::of(l, triangle).faces(limits.octant);
    let (mask, t) = hits_inside(l, inside, lines, triangle, &edges, &faces, limits);
    let (u, v) = edges.barycentrics(l);
    Some(LaneHits { mask, t, u, v })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn least_sum_is_the_least_number_whose_reciprocal_is_finite() {
        let near = (0..200).map(|i| LEAST_SUM.to_bits() - 100 + i);
        for bits in near.chain((0..u32::MAX).step_by(9973)) {
            let sum = f32::from_bits(bits);
            assert_eq!((1.0 / sum).is_finite(), sum.abs() >= LEAST_SUM, "{sum:e}");
        }
    }
}
