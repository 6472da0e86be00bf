//! The half-open ray/triangle test: the rule by which crossings are counted.
//!
//! The canonical test ([`super::CanonicalRay`]) counts a hit on an edge or a corner for every triangle that has it. So
//! its hits cannot be counted: a ray through a corner of a box enters it three times. This test answers for a ray that
//! is moved by an infinitesimal amount, the same for all triangles, which passes no edge and no corner (Edelsbrunner
//! and Mücke 1990, *Simulation of Simplicity*). So a ray that crosses a surface at an edge crosses one triangle, and
//! one that only touches it there crosses none or two. A line crosses a closed surface an even number of times.
//!
//! All decisions are those of the exact numbers that the coordinates stand for. Nearly always `f64` decides, by a bound
//! of its rounding errors; else [`Expansion`] does.
//!
//! # The test
//! With the corners relative to the origin, an edge from `p` to `q` and a direction `d`, the sign of `d · (p × q)` says
//! on which side of the edge the line passes. Moving the origin by `δ` adds `δ · (d × (q - p))`. With `δ` = (ε, ε²,
//! ε³) and ε → 0 the first component of `d × (q - p)` that is not 0 decides where `d · (p × q)` is 0. All are 0
//! only where the edge is parallel to the ray; the triangle is then seen edge-on, and not crossed. A triangle is
//! crossed if the three signs are equal.

use super::expansion::{Expansion, two_difference};
use glam::{DVec3, Vec3};

/// The unit of rounding of `f64`.
const UNIT: f64 = f64::EPSILON / 2.0;

/// Bound of the rounding errors of a determinant of three vectors whose components were rounded, relative to the sum of
/// the sizes of its six products: 3 for the components, 2 for products and 4 for sums, and a reserve.
const ERRORS: f64 = 12.0 * UNIT;

/// A share of `t` by which a computed `t` may differ from the exact one.
pub(super) const LARGEST_ERROR: f64 = 1.0 / (1u64 << 32) as f64;

/// A vector whose components are each the sum of two numbers.
#[derive(Clone, Copy, Debug)]
struct Exact3 {
    high: DVec3,
    low: DVec3,
}

impl Exact3 {
    fn difference(a: DVec3, b: DVec3) -> Self {
        let [x, y, z] = [0, 1, 2].map(|axis| two_difference(a[axis], b[axis]));
        Self { high: DVec3::new(x.0, y.0, z.0), low: DVec3::new(x.1, y.1, z.1) }
    }

    fn component(&self, axis: usize) -> [f64; 2] {
        [self.high[axis], self.low[axis]]
    }
}

/// A ray, or a segment between two points, for the half-open test. Crossings count if `t` lies between the ends.
#[derive(Clone, Copy, Debug)]
pub struct HalfOpenRay {
    origin: DVec3,
    direction: Exact3,
    /// Crossings at this `t` do not count.
    t_min: f64,
    /// Crossings at this `t` count, unless `open` is set.
    t_max: f64,
    open: bool,
}

/// A ray's crossing of a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Ray parameter, to at least 31 bits.
    pub t: f64,
    /// Barycentric weight of the second corner, 0 to 1.
    pub u: f32,
    /// Barycentric weight of the third corner, 0 to 1.
    pub v: f32,
    /// True if the ray meets the side from which the corners are seen in counterclockwise order.
    pub front: bool,
}

impl HalfOpenRay {
    /// A ray. Crossings count if `t_min < t <= t_max`; a negative `t_min` counts as 0.
    ///
    /// Coordinates must be finite, none but 0 smaller than 2^-200 and none greater than 2^200.
    #[inline]
    pub fn new(origin: DVec3, direction: DVec3, t_min: f64, t_max: f64) -> Self {
        let direction = Exact3 { high: direction, low: DVec3::ZERO };
        Self { origin, direction, t_min: t_min.max(0.0), t_max, open: false }
    }

    /// The segment between two points, which do not belong to it: `t` is 0 at the first and 1 at the second.
    pub fn segment(from: DVec3, to: DVec3) -> Self {
        Self { origin: from, direction: Exact3::difference(to, from), t_min: 0.0, t_max: 1.0, open: true }
    }

    /// The crossing of a triangle, if there is one. Degenerate triangles are never crossed.
    #[inline]
    pub fn crossing(&self, corners: [Vec3; 3]) -> Option<Crossing> {
        let [p, q, r] = [corners[0].as_dvec3(), corners[1].as_dvec3(), corners[2].as_dvec3()];
        let determinants = Determinants::of(self.origin, self.direction.high, [p, q, r]);
        let Determinants { u, v, w, volume, facing } = determinants;
        let positive = u.is_positive() || v.is_positive() || w.is_positive();
        let negative = u.is_negative() || v.is_negative() || w.is_negative();
        if positive && negative {
            return None;
        }
        let certain = |x: &Determinant| x.is_positive() || x.is_negative();
        let side = if certain(&u) && certain(&v) && certain(&w) {
            if positive { 1 } else { -1 }
        } else {
            self.exact_side(corners, &u, &v, &w)?
        };
        let t = volume.value / facing.value;
        let error = determinants.error_of(t);
        let (low, high) = (t - 2.0 * error, t + 2.0 * error);
        // NaN fails the comparisons.
        let precise = error >= 0.0 && error <= t.abs() * LARGEST_ERROR;
        let crossing = |facing: f64, t: f64| Crossing {
            t,
            u: (u.value / facing).clamp(0.0, 1.0) as f32,
            v: (v.value / facing).clamp(0.0, 1.0) as f32,
            front: side < 0,
        };
        if precise && low > self.t_min && high < self.t_max {
            return Some(crossing(facing.value, t));
        }
        if error >= 0.0 && (high < self.t_min || low > self.t_max) {
            return None;
        }
        self.exact_t(corners, side).map(|(facing, t)| crossing(facing, t))
    }

    /// The side from which the moved ray crosses a triangle, where rounding errors leave the sign of a determinant
    /// open.
    #[cold]
    #[inline(never)]
    fn exact_side(
        &self,
        corners: [Vec3; 3],
        u: &Determinant,
        v: &Determinant,
        w: &Determinant,
    ) -> Option<i32> {
        let [a, b, c] = corners.map(|corner| Exact3::difference(corner.as_dvec3(), self.origin));
        let side = self.side(u, &c, &a);
        (side != 0 && self.side(v, &a, &b) == side && self.side(w, &b, &c) == side).then_some(side)
    }

    /// The product of direction and normal, and `t`, of a triangle that the moved ray's line crosses; nothing if `t` is
    /// out of range.
    #[cold]
    #[inline(never)]
    fn exact_t(&self, corners: [Vec3; 3], side: i32) -> Option<(f64, f64)> {
        let corners = corners.map(|corner| Exact3::difference(corner.as_dvec3(), self.origin));
        let [a, b, c] = &corners;
        let volume = determinant(a, b, c);
        if volume.sign() != side {
            // Behind the origin, or at it.
            return None;
        }
        let facing = self.exact_facing(&corners);
        let after_start = beyond(&volume, &facing, self.t_min) == side;
        let before_end = match beyond(&volume, &facing, self.t_max) {
            0 => !self.open,
            sign => sign != side,
        };
        let t = (volume.value() / facing.value()).clamp(self.t_min, self.t_max);
        (after_start && before_end).then(|| (facing.value(), t))
    }

    /// True if the first of two triangles that the ray crosses is crossed first. Where both are crossed at one point,
    /// the moved ray decides; triangles in one plane are crossed at once.
    pub fn crosses_first(&self, first: [Vec3; 3], second: [Vec3; 3]) -> bool {
        let [first, second] = [first, second].map(|corners| {
            let relative = corners.map(|corner| Exact3::difference(corner.as_dvec3(), self.origin));
            let facing = self.exact_facing(&relative);
            (determinant(&relative[0], &relative[1], &relative[2]), facing, normal(corners))
        });
        let signs = first.1.sign() * second.1.sign();
        let before = |a: &Expansion, b: &Expansion| {
            let mut difference = a.times(&second.1);
            difference.add_scaled(&b.times(&first.1), -1.0);
            difference.sign() * signs
        };
        let order = before(&first.0, &second.0);
        if order != 0 {
            return order < 0;
        }
        // Moving the origin by δ subtracts δ · normal / facing from t.
        let moved = (0..3).map(|axis| before(&first.2[axis], &second.2[axis])).find(|&order| order != 0);
        moved.is_some_and(|order| order > 0)
    }

    /// The sign of a determinant of this ray's direction and two corners, after the ray has been moved.
    fn side(&self, approximate: &Determinant, p: &Exact3, q: &Exact3) -> i32 {
        if let Some(sign) = approximate.sign() {
            return sign;
        }
        let sign = determinant(&self.direction, p, q).sign();
        if sign != 0 {
            return sign;
        }
        let d = &self.direction;
        (0..3).map(|axis| cross_difference(d, q, p, axis).sign()).find(|&sign| sign != 0).unwrap_or(0)
    }

    /// The product of the direction and a triangle's normal, which is twice as long as its area.
    fn exact_facing(&self, [a, b, c]: &[Exact3; 3]) -> Expansion {
        let mut facing = Expansion::zero();
        for (p, q) in [(b, c), (c, a), (a, b)] {
            add_determinant(&mut facing, &self.direction, p, q);
        }
        facing
    }
}

/// True if a point lies on a triangle, its edges and corners included.
pub fn is_on_triangle(point: DVec3, corners: [Vec3; 3]) -> bool {
    let [a, b, c] = corners.map(|corner| Exact3::difference(corner.as_dvec3(), point));
    if Determinant::of(a.high, b.high, c.high).sign().is_some() || determinant(&a, &b, &c).sign() != 0 {
        return false;
    }
    // In its plane, the point is inside if it is on one side of all edges, seen along any axis. A triangle that an axis
    // shows as a segment says nothing along it, so all axes must agree, and the box must contain the point.
    let edges = [(&a, &b), (&b, &c), (&c, &a)];
    let along = |axis: usize| {
        let signs = edges.map(|(p, q)| cross_of(p, q, axis).sign());
        signs.iter().all(|&sign| sign >= 0) || signs.iter().all(|&sign| sign <= 0)
    };
    let (low, high) = (a.high.min(b.high).min(c.high), a.high.max(b.high).max(c.high));
    low.cmple(DVec3::ZERO).all() && high.cmpge(DVec3::ZERO).all() && (0..3).all(along)
}

/// The determinants of a ray and a triangle that decide on a crossing, if they are certain.
#[derive(Clone, Copy)]
pub(super) struct Determinants {
    /// Of the edge functions.
    pub u: Determinant,
    pub v: Determinant,
    pub w: Determinant,
    /// Of the corners, relative to the origin.
    pub volume: Determinant,
    /// The product of the direction and the triangle's normal.
    pub facing: Determinant,
}

impl Determinants {
    #[inline(always)]
    pub fn of(origin: DVec3, direction: DVec3, [p, q, r]: [DVec3; 3]) -> Self {
        let (a, b, c) = (p - origin, q - origin, r - origin);
        Self {
            // With edges in place of the second corners the determinants are the same, and their errors smaller.
            u: Determinant::of(direction, c, p - r),
            v: Determinant::of(direction, a, q - p),
            w: Determinant::of(direction, b, r - q),
            volume: Determinant::of(a, q - p, r - p),
            facing: Determinant::of(direction, q - p, r - p),
        }
    }

    /// At most the distance of `t`, the quotient of volume and facing, from the exact one, if not negative.
    #[inline(always)]
    pub fn error_of(&self, t: f64) -> f64 {
        let Self { volume, facing, .. } = self;
        (volume.error + t.abs() * facing.error) / (facing.value.abs() - facing.error)
    }
}

/// A determinant of three vectors, rounded.
#[derive(Clone, Copy)]
pub(super) struct Determinant {
    pub value: f64,
    /// At most the distance from the exact value.
    error: f64,
}

impl Determinant {
    #[inline(always)]
    fn of(a: DVec3, b: DVec3, c: DVec3) -> Self {
        let (plus, minus) =
            (DVec3::new(b.y * c.z, b.z * c.x, b.x * c.y), DVec3::new(b.z * c.y, b.x * c.z, b.y * c.x));
        let sizes = plus.abs() + minus.abs();
        Self { value: a.dot(plus - minus), error: ERRORS * a.abs().dot(sizes) }
    }

    #[inline(always)]
    pub fn is_positive(&self) -> bool {
        self.value > self.error
    }

    #[inline(always)]
    pub fn is_negative(&self) -> bool {
        self.value < -self.error
    }

    /// The sign of the exact value, where this one decides.
    #[inline]
    fn sign(&self) -> Option<i32> {
        match (self.is_positive(), self.is_negative()) {
            (true, _) => Some(1),
            (_, true) => Some(-1),
            _ => None,
        }
    }
}

/// The determinant of three vectors.
fn determinant(a: &Exact3, b: &Exact3, c: &Exact3) -> Expansion {
    let mut sum = Expansion::zero();
    add_determinant(&mut sum, a, b, c);
    sum
}

fn add_determinant(sum: &mut Expansion, a: &Exact3, b: &Exact3, c: &Exact3) {
    for axis in 0..3 {
        let (i, k) = ((axis + 1) % 3, (axis + 2) % 3);
        for a in parts(a.component(axis)) {
            for (b, c, sign) in
                [(b.component(i), c.component(k), 1.0), (b.component(k), c.component(i), -1.0)]
            {
                for b in parts(b) {
                    for c in parts(c) {
                        sum.add_triple(sign * a, b, c);
                    }
                }
            }
        }
    }
}

/// The terms of a component that are not 0.
fn parts(component: [f64; 2]) -> impl Iterator<Item = f64> {
    component.into_iter().filter(|&part| part != 0.0)
}

/// A component of the cross product of two vectors.
fn cross_of(a: &Exact3, b: &Exact3, axis: usize) -> Expansion {
    let mut sum = Expansion::zero();
    add_cross(&mut sum, a, b, axis, 1.0);
    sum
}

/// A component of `a × (q - p)`.
fn cross_difference(a: &Exact3, q: &Exact3, p: &Exact3, axis: usize) -> Expansion {
    let mut sum = Expansion::zero();
    add_cross(&mut sum, a, q, axis, 1.0);
    add_cross(&mut sum, a, p, axis, -1.0);
    sum
}

fn add_cross(sum: &mut Expansion, a: &Exact3, b: &Exact3, axis: usize, factor: f64) {
    let (i, k) = ((axis + 1) % 3, (axis + 2) % 3);
    for (a, b, sign) in [(a.component(i), b.component(k), factor), (a.component(k), b.component(i), -factor)]
    {
        for a in parts(a) {
            for b in parts(b) {
                sum.add_product(sign * a, b);
            }
        }
    }
}

/// The components of a triangle's normal, which is twice as long as its area.
fn normal([a, b, c]: [Vec3; 3]) -> [Expansion; 3] {
    let (b, c) =
        (Exact3::difference(b.as_dvec3(), a.as_dvec3()), Exact3::difference(c.as_dvec3(), a.as_dvec3()));
    [0, 1, 2].map(|axis| cross_of(&b, &c, axis))
}

/// The sign of `volume - t * facing`, which is that of `facing` beyond `t`. For `t` = +∞ the opposite.
fn beyond(volume: &Expansion, facing: &Expansion, t: f64) -> i32 {
    if t == f64::INFINITY {
        return -facing.sign();
    }
    let mut difference = volume.clone();
    difference.add_scaled(facing, -t);
    difference.sign()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::dyadic::{Vector, cross, dot, minus, power, sign, vector};
    use crate::geom::mix;
    use num_bigint::BigInt;
    use num_rational::BigRational;
    use num_traits::{Signed, Zero};

    fn rational(number: f64) -> BigRational {
        BigRational::from_float(number).expect("finite")
    }

    /// A point moved by (e, e², e³), for e = 2⁻³⁰⁰ in place of an infinitesimal one.
    fn moved(point: DVec3) -> Vector {
        let point = vector(point);
        [0, 1, 2].map(|axis| &point[axis] + power(-300 * (axis as i32 + 1)))
    }

    /// The crossing of a triangle by the ray whose origin is moved, with nothing but the definition.
    fn moved_crossing(origin: DVec3, direction: DVec3, corners: [Vec3; 3]) -> bool {
        let [a, b, c] = corners.map(|corner| minus(&vector(corner.as_dvec3()), &moved(origin)));
        let d = vector(direction);
        let signs = [(&c, &a), (&a, &b), (&b, &c)].map(|(p, q)| sign(&dot(&d, &cross(p, q))));
        signs[0] != 0 && signs.iter().all(|&sign| sign == signs[0])
    }

    /// The exact `t` of a plane, if the ray is not parallel to it.
    fn exact_t(origin: &Vector, direction: DVec3, corners: [Vec3; 3]) -> Option<BigRational> {
        let [a, b, c] = corners.map(|corner| vector(corner.as_dvec3()));
        let normal = cross(&minus(&b, &a), &minus(&c, &a));
        let facing = dot(&normal, &vector(direction));
        (!facing.is_zero()).then(|| BigRational::new(dot(&normal, &minus(&a, origin)), facing))
    }

    /// Small integers, so that much is degenerate, or any numbers.
    fn point(i: u32, kind: u32) -> Vec3 {
        let number = |k: u32| {
            let bits = mix(i.wrapping_mul(3).wrapping_add(k));
            match kind {
                0 => (bits % 4) as f32 - 1.0,
                1 => (bits >> 8) as f32 / (1 << 23) as f32 - 1.0,
                _ => ((bits >> 8) as f32 / (1 << 23) as f32 - 1.0) * f32::powi(10.0, (bits % 9) as i32 - 6),
            }
        };
        Vec3::new(number(0), number(1), number(2))
    }

    #[test]
    fn crossings_are_those_of_a_ray_that_is_moved_a_little() {
        let (mut crossed, mut touched) = (0, 0);
        for i in 0..1500u32 {
            let (kind, at) = (i % 3, 8 * i);
            let corners = [point(at, kind), point(at + 1, kind), point(at + 2, kind)];
            let origin = point(at + 3, kind).as_dvec3();
            let target = match i % 5 {
                0 => corners[0],
                1 => 0.5 * (corners[1] + corners[2]),
                2 => (corners[0] + corners[1] + corners[2]) / 3.0,
                _ => point(at + 4, kind),
            };
            let direction = target.as_dvec3() - origin;
            let expected_t = exact_t(&vector(origin), direction, corners);
            let moved = moved_crossing(origin, direction, corners);
            for (t_min, t_max) in [(0.0, f64::INFINITY), (1.0, 2.0), (0.0, 1.0)] {
                let crossing = HalfOpenRay::new(origin, direction, t_min, t_max).crossing(corners);
                let in_range = |t: &BigRational| {
                    *t > rational(t_min) && (t_max == f64::INFINITY || *t <= rational(t_max))
                };
                let expected = moved && expected_t.as_ref().is_some_and(in_range);
                assert_eq!(
                    crossing.is_some(),
                    expected,
                    "{i}: {corners:?} {origin} {direction} {t_min} {t_max}"
                );
                if let (Some(crossing), Some(t)) = (crossing, &expected_t) {
                    crossed += 1;
                    let error = (rational(crossing.t) - t).abs() / t;
                    assert!(error < rational(1e-9), "{i}: t = {}", crossing.t);
                }
            }
            if expected_t.is_some() && !moved && i % 5 < 2 {
                touched += 1;
            }
            // The segment's own ends do not belong to it.
            let segment = HalfOpenRay::segment(origin, target.as_dvec3()).crossing(corners);
            let inside = expected_t.is_some_and(|t| t.is_positive() && t < rational(1.0));
            if kind == 0 {
                assert_eq!(segment.is_some(), inside && moved, "{i}");
            }
        }
        assert!(crossed > 350 && touched > 70, "{crossed} crossed, {touched} touched");
    }

    #[test]
    fn points_on_triangles_are_found() {
        let (mut on, mut off) = (0, 0);
        for i in 0..6000u32 {
            let corners = [point(8 * i, 0), point(8 * i + 1, 0), point(8 * i + 2, 0)];
            let at = point(8 * i + 3, 0).as_dvec3();
            let [a, b, c] = corners.map(|corner| minus(&vector(corner.as_dvec3()), &vector(at)));
            // In the convex hull: some weights, none negative, add up to the zero vector. Small integers have a common
            // denominator of at most the square of the area, so the plane and the edges decide.
            let normal = cross(&minus(&b, &a), &minus(&c, &a));
            let expected = if normal.iter().all(BigInt::is_zero) {
                let between = |p: &Vector, q: &Vector| {
                    cross(p, q).iter().all(BigInt::is_zero) && !dot(p, q).is_positive()
                };
                between(&a, &b) || between(&b, &c) || between(&c, &a)
            } else {
                let signs = [(&a, &b), (&b, &c), (&c, &a)].map(|(p, q)| sign(&dot(&normal, &cross(p, q))));
                dot(&normal, &a).is_zero() && signs.iter().all(|&sign| sign >= 0)
            };
            assert_eq!(is_on_triangle(at, corners), expected, "{i}: {at} {corners:?}");
            if expected { on += 1 } else { off += 1 }
        }
        assert!(on > 200 && off > 3000, "{on} on, {off} off");
    }

    #[test]
    fn of_two_triangles_the_moved_ray_finds_the_first() {
        let mut ties = 0;
        for i in 0..4000u32 {
            let at = 8 * i;
            let first = [point(at, 0), point(at + 1, 0), point(at + 2, 0)];
            let second = [first[i as usize % 3], point(at + 3, 0), point(at + 4, 0)];
            let origin = point(at + 5, 0).as_dvec3() - DVec3::new(0.0, 0.0, 9.0);
            let direction = first[i as usize % 3].as_dvec3() - origin;
            let ray = HalfOpenRay::new(origin, direction, 0.0, f64::INFINITY);
            if ray.crossing(first).is_none() || ray.crossing(second).is_none() {
                continue;
            }
            ties += 1;
            let t = |corners| exact_t(&moved(origin), direction, corners).expect("not parallel");
            assert_eq!(ray.crosses_first(first, second), t(first) < t(second), "{i}");
        }
        assert!(ties > 50, "{ties}");
    }
}
