//! The canonical ray/triangle test: the one definition of what a ray hits.
//!
//! Every tracer (scalar oracle, SIMD tracer, GPU with confirmation on the host) answers as if it ran this
//! code for every triangle of the scene and kept the nearest `t`, of equal ones the lowest primitive id. Each
//! operation below is one IEEE-754 binary32 operation; `mul_add` is a fused multiply-add with one rounding.
//! No tracer may reorder, contract or approximate them. All functions are `inline(always)`: `mul_add` is one
//! instruction only in callers that are compiled for it, and otherwise a slower call with the same result.
//!
//! # Why the answer does not depend on the BVH
//! The `t` of a hit is clamped to the interval in which the ray is inside the triangle's *own* bounding box,
//! computed by the slab test below. For a fixed ray the crossing of a slab plane is `fma(plane, inverse,
//! offset)`, which is monotone in `plane`, after rounding too. So if a box contains the triangle's box, its
//! computed interval contains the triangle's computed interval, to the bit. Consider a traversal that (a)
//! tests its boxes with this slab test, (b) uses boxes that contain the exact boxes of their triangles, and
//! (c) skips a box only if its interval is empty, begins after the nearest hit so far, or ends before
//! `t_min`. It never skips a triangle that this test would have accepted. Any tree, any order and any split
//! give the same bits.
//!
//! # Why it is watertight
//! The edge functions are Plücker products of edge and ray, computed from the edge's two vertices relative to
//! the ray's origin (Embree's robust mode; Davis and Wald, see also Woop, Benthin, Wald 2013). Swapping the
//! two vertices negates every intermediate exactly. So two triangles that share an edge get opposite signs of
//! the same number, and zero counts as inside for both. The box planes are moved outwards by `SLACK` times
//! the largest coordinate of scene and origin (see [`CanonicalRay::new`]). That is far more than the rounding
//! errors of either test, so a box never cuts off a hit that the edge test accepts.

use glam::Vec3;

/// The largest absolute coordinate of a vertex or a ray origin for which the canonical test is defined.
/// Scenes beyond it are refused when loaded, rays beyond it hit nothing. Up to it no intermediate of the test
/// overflows.
pub const MAX_COORDINATE: f32 = 1.0e11;

/// Range of the largest direction component. Rays outside of it hit nothing.
#[doc(hidden)]
pub const DIRECTION_RANGE: std::ops::RangeInclusive<f32> = 1.0e-9..=1.0e9;

/// Direction components below this share of the largest one are raised to it, in the slab test only, so that
/// reciprocals stay finite. That moves the ray by less than [`SLACK`] allows.
#[doc(hidden)]
pub const MIN_COMPONENT: f32 = 1.0 / (1u64 << 40) as f32;

/// Distance by which box planes are moved outwards, relative to the largest coordinate of scene and origin.
pub const SLACK: f32 = 1.0 / (1u32 << 19) as f32;

/// A ray prepared for the canonical test, once for each ray and scene.
///
/// The slab test uses `inverse`, `near` and `far`: the ray crosses the plane `axis = p` at `fma(p,
/// inverse[axis], near[axis])` where it enters and at `fma(p, inverse[axis], far[axis])` where it leaves. It
/// enters through the box's lower face if `inverse >= 0`, else through the upper.
#[derive(Clone, Copy, Debug)]
pub struct CanonicalRay {
    /// Ray origin.
    pub origin: Vec3,
    /// Ray direction, not normalised: `t` is in lengths of it.
    pub direction: Vec3,
    /// Reciprocal direction, finite on every axis.
    pub inverse: Vec3,
    /// Added for planes through which the ray enters.
    pub near: Vec3,
    /// Added for planes through which the ray leaves.
    pub far: Vec3,
    /// Start of the interval, ≥ 0.
    pub t_min: f32,
    /// End of the interval; may be +∞. Less than `t_min` for a ray that hits nothing by definition.
    pub t_max: f32,
}

/// The result of the canonical test of one ray and one triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CanonicalHit {
    /// Ray parameter.
    pub t: f32,
    /// Barycentric weight of the second vertex.
    pub u: f32,
    /// Barycentric weight of the third vertex.
    pub v: f32,
}

impl CanonicalRay {
    /// A ray that hits nothing.
    pub const NONE: Self = Self {
        origin: Vec3::ZERO,
        direction: Vec3::X,
        inverse: Vec3::ONE,
        near: Vec3::ZERO,
        far: Vec3::ZERO,
        t_min: 0.0,
        t_max: -1.0,
    };

    /// True if a ray's origin and direction can be traced: neither is a reason for [`CanonicalRay::new`] to let it hit
    /// nothing.
    #[inline(always)]
    pub fn can_start(origin: [f32; 3], direction: [f32; 3]) -> bool {
        let (o, d) = (Vec3::from_array(origin), Vec3::from_array(direction));
        o.is_finite()
            && d.is_finite()
            && o.abs().max_element() <= MAX_COORDINATE
            && DIRECTION_RANGE.contains(&d.abs().max_element())
    }

    /// The octant of the direction: bit 0 is set where x is negative, bit 1 for y, bit 2 for z.
    #[inline(always)]
    pub fn octant(&self) -> usize {
        let [x, y, z] = self.inverse.to_array();
        usize::from(x.is_sign_negative())
            | usize::from(y.is_sign_negative()) << 1
            | usize::from(z.is_sign_negative()) << 2
    }

    /// Prepares a ray for a scene whose largest absolute coordinate is `scene_max_abs`.
    ///
    /// A negative `t_min` counts as 0. By definition a ray hits nothing if
    /// - a component of its origin or direction is NaN or infinite,
    /// - an origin coordinate exceeds [`MAX_COORDINATE`],
    /// - the largest direction component is outside 1e-9..=1e9, as that of a zero direction is, or
    /// - `t_min` or `t_max` is NaN, or `t_min > t_max`.
    ///
    /// Such a ray is returned with `t_min = 0`, `t_max = -1` and otherwise finite values, and every slab test
    /// rejects it.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn new(origin: [f32; 3], t_min: f32, direction: [f32; 3], t_max: f32, scene_max_abs: f32) -> Self {
        let o = Vec3::from_array(origin);
        let d = Vec3::from_array(direction);
        let reach = o.abs().max_element();
        let largest = d.abs().max_element();
        if !(Self::can_start(origin, direction) && t_min <= t_max) {
            return Self::NONE;
        }
        let floor = largest * MIN_COMPONENT;
        let slack = scene_max_abs.max(reach) * SLACK;
        let mut inverse = [0.0; 3];
        let mut near = [0.0; 3];
        let mut far = [0.0; 3];
        for axis in 0..3 {
            let component = d[axis].abs().max(floor).copysign(d[axis]);
            let inv = 1.0 / component;
            // Never −0.
            let shift = 0.0 - o[axis] * inv;
            let pad = slack * inv.abs();
            inverse[axis] = inv;
            near[axis] = shift - pad;
            far[axis] = shift + pad;
        }
        Self {
            origin: o,
            direction: d,
            inverse: inverse.into(),
            near: near.into(),
            far: far.into(),
            t_min: t_min.max(0.0),
            t_max,
        }
    }

    /// The interval of `t` in which the ray is inside the box, not clipped to `t_min..t_max`. Empty if the
    /// first number exceeds the second.
    #[inline(always)]
    pub fn slab(&self, min: Vec3, max: Vec3) -> (f32, f32) {
        let mut enter = f32::NEG_INFINITY;
        let mut leave = f32::INFINITY;
        for axis in 0..3 {
            let inv = self.inverse[axis];
            let (first, last) = if inv >= 0.0 { (min[axis], max[axis]) } else { (max[axis], min[axis]) };
            enter = enter.max(first.mul_add(inv, self.near[axis]));
            leave = leave.min(last.mul_add(inv, self.far[axis]));
        }
        (enter, leave)
    }

    /// Tests one triangle. `None` unless the hit lies in `t_min..=t_max`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn triangle(&self, v0: Vec3, v1: Vec3, v2: Vec3) -> Option<CanonicalHit> {
        let d = self.direction;
        let a = v0 - self.origin;
        let b = v1 - self.origin;
        let c = v2 - self.origin;
        // Edge functions. Each is of the edge opposite the vertex whose weight it gives.
        let e0 = c - a;
        let e1 = a - b;
        let e2 = b - c;
        let u = dot(cross(e0, c + a), d);
        let v = dot(cross(e1, a + b), d);
        let w = dot(cross(e2, b + c), d);
        let lowest = u.min(v).min(w);
        let highest = u.max(v).max(w);
        if !(lowest >= 0.0 || highest <= 0.0) {
            return None;
        }
        let normal = cross(e1, shorter(e0, e2));
        let facing = dot(normal, d);
        if facing == 0.0 {
            return None;
        }
        let t = dot(normal, a) / facing;
        let (enter, leave) = self.slab(v0.min(v1).min(v2), v0.max(v1).max(v2));
        // NaN is rejected.
        let inside = enter <= leave && !t.is_nan();
        // `+ 0.0` turns a zero of either sign, as the clamp may give, into +0.
        let t = t.max(enter).min(leave) + 0.0;
        if !(inside && t >= self.t_min && t <= self.t_max) {
            return None;
        }
        let scale = 1.0 / (u + v + w);
        if !scale.is_finite() {
            return None;
        }
        Some(CanonicalHit { t, u: (u * scale).min(1.0) + 0.0, v: (v * scale).min(1.0) + 0.0 })
    }
}

/// Of two edges the one whose largest component is smaller. The three edges of a triangle add up to zero, so
/// the cross product of any two is its normal, up to the sign. But in a sliver the product of the two long
/// edges is nearly all rounding error.
#[inline(always)]
fn shorter(a: Vec3, b: Vec3) -> Vec3 {
    if a.abs().max_element() <= b.abs().max_element() { a } else { b }
}

/// Cross product, each component `fma(a, b, -(c·d))`: negating one argument negates the result exactly.
#[inline(always)]
fn cross(a: Vec3, b: Vec3) -> Vec3 {
    Vec3::new(a.y.mul_add(b.z, -(a.z * b.y)), a.z.mul_add(b.x, -(a.x * b.z)), a.x.mul_add(b.y, -(a.y * b.x)))
}

/// Dot product, `fma(x, x', fma(y, y', z·z'))`.
#[inline(always)]
fn dot(a: Vec3, b: Vec3) -> f32 {
    a.x.mul_add(b.x, a.y.mul_add(b.y, a.z * b.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ray(o: [f32; 3], d: [f32; 3]) -> CanonicalRay {
        CanonicalRay::new(o, 0.0, d, f32::INFINITY, 10.0)
    }

    #[test]
    fn hits_report_t_and_barycentrics_of_the_second_and_third_vertex() {
        let hit =
            ray([0.25, 0.5, 2.0], [0.0, 0.0, -2.0]).triangle(Vec3::ZERO, Vec3::X, Vec3::Y).expect("inside");
        assert_eq!((hit.t, hit.u, hit.v), (1.0, 0.25, 0.5));
    }

    #[test]
    fn both_windings_hit_alike() {
        let r = ray([0.3, 0.2, -1.0], [0.01, 0.02, 1.0]);
        let front = r.triangle(Vec3::ZERO, Vec3::X, Vec3::Y).expect("front");
        let back = r.triangle(Vec3::ZERO, Vec3::Y, Vec3::X).expect("back");
        assert_eq!(front.t, back.t);
        assert_eq!((front.u, front.v), (back.v, back.u));
    }

    #[test]
    fn a_ray_through_a_shared_edge_or_vertex_is_never_lost() {
        // A fan of triangles around one vertex; rays are aimed exactly at the vertex and at points of edges.
        let centre = Vec3::new(0.1, 0.7, 0.3);
        let rim: Vec<Vec3> = (0..7)
            .map(|i| {
                let a = i as f32 * std::f32::consts::TAU / 7.0;
                centre + Vec3::new(libm::cosf(a), libm::sinf(a), 0.1 * libm::sinf(3.0 * a))
            })
            .collect();
        for i in 0..5000u32 {
            let s = |k: u32| {
                (i.wrapping_mul(2654435761).wrapping_add(k.wrapping_mul(40503)) >> 8) as f32
                    / (1 << 24) as f32
            };
            let origin = Vec3::new(4.0 * s(1) - 2.0, 4.0 * s(2) - 2.0, 2.0 + 3.0 * s(3));
            let edge = &rim[(i % 7) as usize];
            let target = centre + (*edge - centre) * (0.9 * s(4));
            let d = target - origin;
            let r = ray(origin.into(), d.into());
            let hit = (0..7).any(|k| r.triangle(centre, rim[k], rim[(k + 1) % 7]).is_some());
            assert!(hit, "ray {i} fell through");
        }
    }

    #[test]
    fn slivers_are_hit_on_their_plane_whichever_corner_comes_first() {
        let (mut worst, mut hits) = (0.0f64, 0);
        for i in 0..2000u32 {
            let s = |k: u32| {
                let x = (i ^ k.wrapping_mul(0x9e37_79b9)).wrapping_mul(0x85eb_ca6b);
                ((x ^ (x >> 13)).wrapping_mul(0xc2b2_ae35) >> 8) as f32 / (1 << 24) as f32 * 2.0 - 1.0
            };
            let at = |k: u32| Vec3::new(s(k), s(k + 1), s(k + 2));
            let (apex, base) = (at(1), at(4));
            let corners = [apex, base, base + 1e-3 * at(7)];
            let [long, short] = [corners[1] - apex, corners[2] - corners[1]].map(Vec3::as_dvec3);
            let normal = long.cross(short).normalize();
            let target = apex + 0.7 * (base - apex) + 0.3 * (corners[2] - base);
            let origin = target + 0.02 * (normal.as_vec3() + 0.5 * at(10));
            let r = ray(origin.into(), (target - origin).into());
            let exact = normal.dot((base - origin).as_dvec3()) / normal.dot(r.direction.as_dvec3());
            for rotation in 0..3 {
                let [a, b, c] = [0, 1, 2].map(|k| corners[(rotation + k) % 3]);
                if let Some(hit) = r.triangle(a, b, c) {
                    let off = (f64::from(hit.t) - exact) * normal.dot(r.direction.as_dvec3());
                    (worst, hits) = (worst.max(off.abs()), hits + 1);
                }
            }
        }
        assert!(hits > 5000, "{hits}");
        assert!(worst < 2e-6, "{worst} off the plane");
    }

    #[test]
    fn invalid_rays_hit_nothing() {
        let tri = |r: CanonicalRay| {
            r.triangle(Vec3::new(-9.0, -9.0, 1.0), Vec3::new(9.0, -9.0, 1.0), Vec3::new(0.0, 9.0, 1.0))
        };
        let z = [0.0, 0.0, 1.0];
        let new = |o, lo, d, hi| CanonicalRay::new(o, lo, d, hi, 10.0);
        assert!(tri(new([0.0; 3], 0.0, z, 5.0)).is_some());
        assert!(tri(new([f32::NAN, 0.0, 0.0], 0.0, z, 5.0)).is_none());
        assert!(tri(new([0.0; 3], 0.0, [0.0, 0.0, f32::INFINITY], 5.0)).is_none());
        assert!(tri(new([0.0; 3], 0.0, [0.0; 3], 5.0)).is_none());
        assert!(tri(new([0.0; 3], 0.0, [0.0, 0.0, 1e-40], 5.0)).is_none());
        assert!(tri(new([0.0; 3], 3.0, z, 2.0)).is_none());
        assert!(tri(new([0.0; 3], f32::NAN, z, 2.0)).is_none());
        assert!(tri(new([0.0; 3], 0.0, z, f32::NAN)).is_none());
        assert!(tri(new([0.0, 0.0, 2e11], 0.0, z, 5.0)).is_none());
        assert!(tri(new([0.0; 3], -7.0, z, 5.0)).is_some(), "negative t_min counts as 0");
    }

    #[test]
    fn degenerate_triangles_are_never_hit() {
        let r = ray([0.0; 3], [0.0, 0.0, 1.0]);
        let p = Vec3::new(0.0, 0.0, 1.0);
        assert!(r.triangle(p, p, p).is_none());
        assert!(r.triangle(p - Vec3::X, p, p + Vec3::X).is_none());
    }

    #[test]
    fn a_larger_box_has_a_larger_interval_to_the_bit() {
        for i in 0..20_000u32 {
            let s = |k: u32| {
                let x = (i ^ k.wrapping_mul(0x9e37_79b9)).wrapping_mul(0x85eb_ca6b);
                ((x ^ (x >> 13)).wrapping_mul(0xc2b2_ae35) >> 8) as f32 / (1 << 24) as f32 * 2.0 - 1.0
            };
            let r = ray([s(1), s(2), s(3)], [s(4), if i % 5 == 0 { 0.0 } else { s(5) }, s(6)]);
            let (p, q) = (Vec3::new(s(7), s(8), s(9)), Vec3::new(s(10), s(11), s(12)));
            let (lo, hi) = (p.min(q), p.max(q));
            let grow = Vec3::new(s(13).abs(), s(14).abs(), 0.0) * 1e-6;
            let (a, b) = r.slab(lo, hi);
            let (c, d) = r.slab(lo - grow, hi + grow);
            assert!(c <= a && d >= b);
        }
    }
}
