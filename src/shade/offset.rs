//! Offsets of ray origins, so that rays do not hit the surface that they leave.

use crate::lanes::{Lanes, Mask, Num, Vector};

/// The offset grows with a triangle's aspect ratio up to this value. Thinner triangles cover too little area
/// to matter.
const MAX_ASPECT: f32 = 16.0;

/// The triangle's plane and the figures that hits and ray origins depend on.
#[derive(Clone, Copy, Debug)]
pub struct Plane<L: Lanes> {
    /// Unit normal on the side from which the vertices run counter-clockwise; robust for tiny and huge
    /// triangles.
    pub normal: Vector<L>,
    /// Lanes in which the corners do not lie on a line. A line has no normal.
    pub there: Mask<L>,
    /// Twice the triangle's area.
    pub twice_area: Num<L>,
    /// Distance along the normal at which a ray must start, so that rounding cannot place the origin on the
    /// other side of the plane in the canonical test.
    pub offset: Num<L>,
}

/// The planes of triangles. Degenerate triangles get the normal `otherwise`.
///
/// The offset covers two errors (ε = 2⁻²⁴, C the largest coordinate, L the longest edge, h the triangle's
/// least height). First, the interpolated position is off the plane by a few ε·C; adding the offset and
/// rounding costs another ε·C. Second, the test moves the corners relative to the origin, with an error of
/// ε·L. This tilts the plane by ε·L/h and moves it by ε·L²/h at the origin. With half the factors a few in a
/// million random triangles and rays, of any scale, place and shape, still fail (see the tests).
#[cfg_attr(not(unoptimised), inline(always))]
pub fn plane<L: Lanes>(corners: &[Vector<L>; 3], otherwise: Vector<L>) -> Plane<L> {
    const EPSILON: f32 = f32::EPSILON * 0.5;
    let [a, b, c] = *corners;
    let coordinate = a.abs().max(b.abs()).max(c.abs()).max_element();
    // Scaled by a power of two, so that the square of the product can neither underflow nor overflow.
    let (e1, e2) = (b - a, c - a);
    let (scale, inverse) = power_of_two(e1.abs().max(e2.abs()).max_element());
    let (e1, e2) = (e1 * inverse, e2 * inverse);
    let across = e1.cross(e2);
    let area = across.length();
    let by_area = 1.0 / area;
    let longest2 = e1.length_squared().max(e2.length_squared()).max((e2 - e1).length_squared());
    // Without an area the ratio is infinite or NaN.
    let aspect = (longest2 * by_area).min(Num::splat(a.lanes(), MAX_ASPECT));
    let there = area.above(0.0);
    Plane {
        normal: Vector::select(there, across * by_area, otherwise),
        there,
        twice_area: area * scale * scale,
        offset: EPSILON * (8.0 * coordinate + 8.0 * aspect * (longest2.sqrt() * scale)),
    }
}

/// The greatest powers of two that are not above the magnitudes, and their reciprocals, both exact.
#[inline(always)]
fn power_of_two<L: Lanes>(x: Num<L>) -> (Num<L>, Num<L>) {
    /// The exponent of 1, and the greatest exponent whose negative is a valid exponent too.
    const ONE: u32 = 127 << 23;
    const GREATEST: u32 = 253 << 23;
    let exponent = (x.to_bits() & 0x7f80_0000).at_most(GREATEST);
    let negative = (exponent ^ u32::MAX) + (2 * ONE + 1);
    (exponent.to_num_bits(), negative.to_num_bits())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn distance(corners: &[Vec3; 3]) -> f32 {
        plane(&corners.map(Vector::from), Vec3::ZERO.into()).offset.get()
    }

    fn normal(corners: &[Vec3; 3]) -> Option<Vec3> {
        let plane = plane(&corners.map(Vector::from), Vec3::ZERO.into());
        plane.there.get().then(|| plane.normal.into())
    }

    use crate::geom::{Basis, CanonicalRay, Sampler, warp};

    /// A random triangle of size 10⁻³ to 10⁴, up to 10⁵ sizes from the origin, of any aspect ratio up to 1 :
    /// 1000.
    fn any_triangle(s: &Sampler) -> [Vec3; 3] {
        let size = 10.0f32.powi((s.single(0) * 8.0) as i32 - 3);
        let away = 10.0f32.powi((s.single(1) * 7.0) as i32 - 2);
        let centre = warp::sphere(s.pair(2)) * (size * away);
        let normal = if s.single(3) < 0.3 {
            [Vec3::X, Vec3::Y, Vec3::Z][(s.single(4) * 3.0) as usize]
        } else {
            warp::sphere(s.pair(5))
        };
        let basis = Basis::from_normal(normal);
        let thin = 30.0f32.powf(-s.single(6));
        std::array::from_fn(|k| {
            let [x, y] = s.pair(7 + k as u32);
            centre + basis.to_world(Vec3::new(x - 0.5, (y - 0.5) * thin, 0.0)) * size
        })
    }

    #[test]
    fn rays_that_leave_a_triangle_do_not_hit_it() {
        let (mut own, mut leaving) = (0, 0);
        for i in 0..300_000 {
            let s = Sampler::new(i, 0, 1);
            let corners = any_triangle(&s);
            let Some(normal) = normal(&corners) else { continue };
            // The test cannot know a needle's plane, and a needle has hardly any area.
            let longest = (corners[1] - corners[0]).length().max((corners[2] - corners[0]).length());
            if longest * longest > 1000.0 * (corners[1] - corners[0]).cross(corners[2] - corners[0]).length()
            {
                continue;
            }
            let basis = Basis::from_normal(normal);
            let [u, v] = warp::triangle(s.pair(10));
            let position = corners[0] * (1.0 - u - v) + corners[1] * u + corners[2] * v;
            // Half of the rays leave at a grazing angle.
            let mut local = warp::cosine_hemisphere(s.pair(11));
            if i % 2 == 0 {
                local.z *= 1e-3;
            }
            let side = if i % 3 == 0 { -1.0 } else { 1.0 };
            let wi = (basis.to_world(local) * side).normalize();
            // Below a cosine of 10⁻⁴ rounding decides whether the direction is above the plane.
            if wi.dot(normal) * side < 1e-4 {
                continue;
            }
            let origin = position + normal * (side * distance(&corners));
            let reach = corners.iter().fold(0.0f32, |m, c| m.max(c.abs().max_element()));
            let ray = CanonicalRay::new(origin.into(), 0.0, wi.into(), f32::INFINITY, reach);
            leaving += 1;
            own += u32::from(ray.triangle(corners[0], corners[1], corners[2]).is_some());
        }
        assert!(leaving > 250_000);
        assert_eq!(own, 0, "of {leaving} rays hit the triangle they leave");
    }

    #[test]
    fn the_offset_is_small() {
        // For a triangle of a metre, a kilometre from the origin: less than a millimetre. Near the origin:
        // microns.
        let at = |x: f32| [Vec3::new(x, 0.0, 0.0), Vec3::new(x + 1.0, 0.0, 0.0), Vec3::new(x, 1.0, 0.0)];
        assert!(distance(&at(1000.0)) < 1e-3);
        assert!(distance(&at(0.0)) < 2e-6);
        // The offset scales with the scene.
        let tiny = at(0.0).map(|c| c * 1e-6);
        assert!((distance(&tiny) / distance(&at(0.0)) / 1e-6 - 1.0).abs() < 1e-3);
    }

    #[test]
    fn tiny_and_huge_triangles_have_normals() {
        for scale in [1e-30, 1e-10, 1.0, 1e10] {
            let n = normal(&[Vec3::ZERO, Vec3::X * scale, Vec3::Y * scale]).expect("not degenerate");
            assert!((n - Vec3::Z).length() < 1e-6);
            let corners = [Vec3::ZERO, Vec3::X * scale, Vec3::Y * scale].map(Vector::from);
            let area = plane(&corners, Vec3::ZERO.into()).twice_area.get();
            assert!(scale < 1e-20 || (area / (scale * scale) - 1.0).abs() < 1e-6, "{area} at {scale}");
        }
        assert!(normal(&[Vec3::ZERO, Vec3::X, Vec3::X * 2.0]).is_none());
        assert!(normal(&[Vec3::ONE; 3]).is_none());
    }
}
