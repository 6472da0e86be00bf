//! Where a ray meets triangles, by exact rational arithmetic.

use glam::{DVec3, Vec3};
use num_rational::BigRational;
use num_traits::{Signed, ToPrimitive, Zero};
use raystream::bvh::Bvh;
use raystream::stream::Ray;

type Point = [BigRational; 3];

/// A number as the fraction that it is.
fn exact(value: f32) -> BigRational {
    BigRational::from_float(value).expect("finite")
}

fn point(p: Vec3) -> Point {
    p.to_array().map(exact)
}

fn difference(a: &Point, b: &Point) -> Point {
    std::array::from_fn(|i| &a[i] - &b[i])
}

fn dot(a: &Point, b: &Point) -> BigRational {
    &a[0] * &b[0] + &a[1] * &b[1] + &a[2] * &b[2]
}

fn cross(a: &Point, b: &Point) -> Point {
    let minor = |i: usize, j: usize| &a[i] * &b[j] - &a[j] * &b[i];
    [minor(1, 2), minor(2, 0), minor(0, 1)]
}

/// The t at which the ray's line meets a triangle, edges included; `None` beside it, and when they are parallel.
pub fn crossing(ray: &Ray, corners: [Vec3; 3]) -> Option<f64> {
    let origin = point(ray.origin.into());
    let direction = point(ray.direction.into());
    let [a, b, c] = corners.map(|corner| difference(&point(corner), &origin));
    let sides = [(&b, &c), (&c, &a), (&a, &b)].map(|(p, q)| dot(&cross(p, q), &direction));
    let inside = sides.iter().all(|s| !s.is_negative()) || sides.iter().all(|s| !s.is_positive());
    let normal = cross(&difference(&b, &a), &difference(&c, &a));
    let facing = dot(&normal, &direction);
    if !inside || facing.is_zero() {
        return None;
    }
    (dot(&normal, &a) / facing).to_f64()
}

/// The nearest exact hit within the ray's interval: distance and triangle.
pub fn nearest(bvh: &Bvh, ray: &Ray) -> Option<(f64, u32)> {
    let may_cross = |&primitive: &u32| in_doubt(ray, bvh.corners(primitive));
    let hit = |primitive: u32| Some((crossing(ray, bvh.corners(primitive))?, primitive));
    (0..bvh.len() as u32)
        .filter(may_cross)
        .filter_map(hit)
        .filter(|(t, _)| (f64::from(ray.t_min.max(0.0))..=f64::from(ray.t_max)).contains(t))
        .min_by(|a, b| a.0.total_cmp(&b.0))
}

/// Whether double precision cannot tell that the line passes the triangle by.
fn in_doubt(ray: &Ray, corners: [Vec3; 3]) -> bool {
    let origin = Vec3::from(ray.origin).as_dvec3();
    let direction = Vec3::from(ray.direction).as_dvec3();
    let [a, b, c] = corners.map(|corner| corner.as_dvec3() - origin);
    // Far above the rounding error of a triple product.
    let slack = |p: DVec3, q: DVec3| 1e-12 * p.length() * q.length() * direction.length();
    let sides = [(b, c), (c, a), (a, b)].map(|(p, q)| (p.cross(q).dot(direction), slack(p, q)));
    sides.iter().all(|(s, slack)| *s >= -slack) || sides.iter().all(|(s, slack)| *s <= *slack)
}
