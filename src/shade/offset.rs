//! Ray origins that do not hit the surface they leave.

use glam::Vec3;

/// Most that a sliver's aspect ratio raises the offset; thinner ones cover no area worth more.
const MAX_ASPECT: f32 = 16.0;

/// How far from a triangle's plane, along its unit normal, a ray has to start so that rounding
/// cannot place it on the other side in the canonical test.
///
/// Two errors have to be covered (ε = 2⁻²⁴, C the largest coordinate, L the longest edge, h the
/// triangle's least height). The interpolated position is off the plane by a few ε·C; adding the
/// offset and rounding costs another ε·C. The test sees the corners relative to the origin, off by
/// ε·L, which tilts its plane by ε·L/h and moves it by ε·L²/h at the origin. The factors are twice
/// what a million random triangles and rays of any scale, place and shape need (see the tests).
pub fn distance(corners: &[Vec3; 3]) -> f32 {
    const EPSILON: f32 = f32::EPSILON * 0.5;
    let [a, b, c] = *corners;
    let coordinate = a.abs().max(b.abs()).max(c.abs()).max_element();
    let longest = (b - a).length().max((c - b).length()).max((a - c).length());
    let area = (b - a).cross(c - a).length();
    let aspect = if area > 0.0 { (longest * longest / area).min(MAX_ASPECT) } else { MAX_ASPECT };
    EPSILON * (8.0 * coordinate + 8.0 * aspect * longest)
}

/// Unit normal of a triangle, counter-clockwise seen from its side; robust for tiny and huge
/// triangles. `None` when the corners lie on a line.
pub fn normal(corners: &[Vec3; 3]) -> Option<Vec3> {
    let [a, b, c] = *corners;
    let (e1, e2) = (b - a, c - a);
    let scale = e1.abs().max(e2.abs()).max_element();
    // Scaled so that the product's square cannot underflow or overflow.
    let normal = (e1 / scale).cross(e2 / scale);
    let length = normal.length();
    (length > 0.0).then(|| normal / length)
}
