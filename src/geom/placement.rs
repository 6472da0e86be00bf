//! The placement of an instance: the canonical motion of shared geometry into the world.

use super::Aabb;
use glam::{DMat4, Vec3};

/// An affine motion that is defined to the bit: every product and every sum is one IEEE-754 binary32
/// operation, in the order of [`Placement::point`], and nothing is fused. So all units, and all code that
/// stores moved vertices, get the same corners.
///
/// # Why boxes need no margin
/// Rounding is monotone. So a larger coordinate gives a product, and then sums, that are at least as large,
/// or at least as small where the matrix element is negative. For each face [`Placement::bounds`] applies the
/// same operations to the corner of the box that makes every product extreme. So it contains the moved copy
/// of every point of the box, to the bit, and what [`super::CanonicalRay`] proves for boxes and trees holds
/// for moved ones, too.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Rows of the matrix; the fourth number of each is the translation.
    pub rows: [[f32; 4]; 3],
}

impl Placement {
    /// The identity.
    pub const IDENTITY: Self =
        Self { rows: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]] };

    /// The motion of an affine matrix, each element rounded to `f32`.
    pub fn new(matrix: &DMat4) -> Self {
        let row = |i: usize| matrix.row(i).as_vec4().to_array();
        Self { rows: [row(0), row(1), row(2)] }
    }

    /// Moves a point.
    #[inline(always)]
    pub fn point(&self, p: Vec3) -> Vec3 {
        let [x, y, z] = self.rows;
        Vec3::new(
            transform_row(x, p.x, p.y, p.z),
            transform_row(y, p.x, p.y, p.z),
            transform_row(z, p.x, p.y, p.z),
        )
    }

    /// A box around all moved points of a box. An empty box stays empty.
    pub fn bounds(&self, of: &Aabb) -> Aabb {
        if of.is_empty() {
            return Aabb::EMPTY;
        }
        let coordinate = |row: [f32; 4], low: Vec3, high: Vec3| {
            let extreme = |i: usize| if row[i] >= 0.0 { low[i] } else { high[i] };
            transform_row(row, extreme(0), extreme(1), extreme(2))
        };
        let face = |low, high| Vec3::from_array(self.rows.map(|row| coordinate(row, low, high)));
        Aabb { min: face(of.min, of.max), max: face(of.max, of.min) }
    }

    /// The approximate octant, in the geometry's own space, of directions in a world octant. An octant has a
    /// bit for each axis, x in bit 0, set for negative components. Octants order children, so an
    /// approximation suffices.
    pub fn octant(&self, world: usize) -> usize {
        let sign = |axis: usize| if world >> axis & 1 == 1 { -1.0 } else { 1.0 };
        // The transpose rotates as the inverse does.
        let local = |i: usize| (0..3).map(|axis| self.rows[axis][i] * sign(axis)).sum::<f32>();
        (0..3).fold(0, |octant, i| octant | usize::from(local(i) < 0.0) << i)
    }
}

/// One coordinate of a moved point: `((a x + b y) + c z) + d`.
#[inline(always)]
fn transform_row([a, b, c, d]: [f32; 4], x: f32, y: f32, z: f32) -> f32 {
    ((a * x + b * y) + c * z) + d
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::mix;

    fn signed(i: u32, k: u32) -> f32 {
        (mix(i ^ mix(k)) >> 8) as f32 / (1 << 23) as f32 - 1.0
    }

    #[test]
    fn moved_boxes_contain_moved_points_to_the_bit() {
        for i in 0..20_000 {
            let s = |k| signed(i, k);
            let v = |k: u32| Vec3::new(s(k), s(k + 1), s(k + 2));
            let mut rows = [[0.0; 4]; 3];
            for (k, element) in (0..).zip(rows.as_flattened_mut()) {
                *element = if i % 7 == k % 7 { 0.0 } else { s(20 + k) * 10f32.powi((mix(i) % 7) as i32 - 3) };
            }
            let placement = Placement { rows };
            let points: Vec<Vec3> = (0..6).map(|k| v(40 + 3 * k)).collect();
            let moved = placement.bounds(&Aabb::around(points.iter().copied()));
            assert!(moved.contains(&Aabb::around(points.iter().map(|&p| placement.point(p)))));
        }
        assert!(Placement::IDENTITY.bounds(&Aabb::EMPTY).is_empty());
    }

    #[test]
    fn the_identity_changes_no_point_and_no_octant() {
        for i in 0..8 {
            let p = Vec3::new(signed(i, 1), signed(i, 2), signed(i, 3));
            assert_eq!(Placement::IDENTITY.point(p), p);
            assert_eq!(Placement::IDENTITY.octant(i as usize), i as usize);
        }
        let half_turn = Placement::new(&DMat4::from_rotation_y(std::f64::consts::PI));
        assert_eq!(half_turn.octant(0b000), 0b101);
    }
}
