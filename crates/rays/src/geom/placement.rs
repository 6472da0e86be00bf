//! The placement of an instance: the canonical motion of shared geometry into the world.

use super::Aabb;
use glam::{Affine3A, DMat4, DVec3, Mat4, Vec3};

/// A transform whose triple product of columns is a smaller share of the product of their lengths is singular.
/// A product of rotations with a scale of 0 has some 1e-7, by rounding.
const LEAST_VOLUME: f64 = 1e-6;

/// Error of a matrix that places no geometry.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlacementError {
    /// An element is NaN or infinite, or becomes so as `f32`.
    #[error("row {row}, column {column} of the transform is {value}; elements must be finite")]
    NotFinite {
        /// Row of the element.
        row: usize,
        /// Column of the element.
        column: usize,
        /// The element.
        value: f64,
    },
    /// The last row of the matrix is not 0 0 0 1.
    #[error("the last row of the transform is {0:?}, a perspective; it must be [0, 0, 0, 1]")]
    Perspective([f64; 4]),
    /// The matrix maps space onto a plane, a line or a point.
    #[error("the transform is singular: it flattens space, as a scale of 0 does")]
    Singular,
}

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

    /// The motion with these rows, whose fourth numbers are the translation.
    ///
    /// # Errors
    /// If an element is not finite or the matrix is singular.
    #[inline]
    fn checked(rows: [[f32; 4]; 3]) -> Result<Self, PlacementError> {
        if is_surely_regular(&rows) { Ok(Self { rows }) } else { Self::checked_exactly(rows) }
    }

    /// [`Placement::checked`] by the definition.
    #[cold]
    fn checked_exactly(rows: [[f32; 4]; 3]) -> Result<Self, PlacementError> {
        if rows.as_flattened().iter().any(|element| !element.is_finite()) {
            return Err(Self::first_not_finite(&rows));
        }
        let column =
            |i: usize| DVec3::new(f64::from(rows[0][i]), f64::from(rows[1][i]), f64::from(rows[2][i]));
        let (x, y, z) = (column(0), column(1), column(2));
        // The quotient of a column of zeros is NaN.
        let share = x.cross(y).dot(z).abs() / (x.length() * y.length() * z.length());
        if share >= LEAST_VOLUME { Ok(Self { rows }) } else { Err(PlacementError::Singular) }
    }

    fn first_not_finite(rows: &[[f32; 4]; 3]) -> PlacementError {
        let elements = rows.as_flattened();
        let at = elements.iter().position(|element| !element.is_finite()).unwrap_or(0);
        PlacementError::NotFinite { row: at / 4, column: at % 4, value: elements[at].into() }
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

    /// The direction of the normal of a moved surface, of any length: it stays on its side, also where the motion
    /// mirrors.
    pub fn normal(&self, normal: Vec3) -> DVec3 {
        let [x, y, z] = self.rows.map(|[x, y, z, _]| Vec3::new(x, y, z).as_dvec3());
        let (across, normal) = ([y.cross(z), z.cross(x), x.cross(y)], normal.as_dvec3());
        DVec3::from_array(across.map(|row| row.dot(normal))) * x.dot(across[0]).signum()
    }

    /// A box around all moved points of a box. An empty box stays empty.
    #[inline]
    pub fn bounds(&self, of: &Aabb) -> Aabb {
        if of.is_empty() {
            return Aabb::EMPTY;
        }
        let [x, y, z] = &self.rows;
        Aabb {
            min: Vec3::new(face(x, of.min, of.max), face(y, of.min, of.max), face(z, of.min, of.max)),
            max: Vec3::new(face(x, of.max, of.min), face(y, of.max, of.min), face(z, of.max, of.min)),
        }
    }

    /// The approximate octant, in the geometry's own space, of directions in a world octant. An octant has a
    /// bit for each axis, x in bit 0, set for negative components. Octants order children, so an
    /// approximation suffices.
    #[inline]
    pub fn octant(&self, world: usize) -> usize {
        let mut octant = 0;
        for i in 0..3 {
            // The transpose rotates as the inverse does.
            let mut local = 0.0;
            for axis in 0..3 {
                let element = self.rows[axis][i];
                local += if world >> axis & 1 == 1 { -element } else { element };
            }
            octant |= usize::from(local < 0.0) << i;
        }
        octant
    }
}

impl TryFrom<[[f32; 4]; 3]> for Placement {
    type Error = PlacementError;

    /// From the rows of an affine matrix; the fourth number of each is the translation.
    #[inline]
    fn try_from(rows: [[f32; 4]; 3]) -> Result<Self, PlacementError> {
        Self::checked(rows)
    }
}

impl TryFrom<Affine3A> for Placement {
    type Error = PlacementError;

    #[inline]
    fn try_from(transform: Affine3A) -> Result<Self, PlacementError> {
        let matrix = transform.matrix3;
        let row = |i: usize| matrix.row(i).extend(transform.translation[i]).to_array();
        Self::checked([row(0), row(1), row(2)])
    }
}

impl TryFrom<Mat4> for Placement {
    type Error = PlacementError;

    fn try_from(matrix: Mat4) -> Result<Self, PlacementError> {
        Self::try_from(matrix.as_dmat4())
    }
}

impl TryFrom<DMat4> for Placement {
    type Error = PlacementError;

    /// Each element is rounded to `f32`.
    fn try_from(matrix: DMat4) -> Result<Self, PlacementError> {
        if matrix.row(3) != glam::DVec4::W {
            return Err(PlacementError::Perspective(matrix.row(3).to_array()));
        }
        Self::checked(Self::new(&matrix).rows)
    }
}

/// True only if all elements are finite and the volume is far above [`LEAST_VOLUME`]: by much more than `f32` rounds.
/// Decides nearly always.
#[inline]
fn is_surely_regular(rows: &[[f32; 4]; 3]) -> bool {
    let [[ax, bx, cx, dx], [ay, by, cy, dy], [az, bz, cz, dz]] = *rows;
    let (a, b) = (ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz);
    let c = cx * cx + cy * cy + cz * cz;
    let volume = (ay * bz - az * by) * cx + (az * bx - ax * bz) * cy + (ax * by - ay * bx) * cz;
    // Neither the squares nor their product overflow, or underflow to what is not rounded as usual. NaN fails.
    let is_ordinary = |square: f32| (square > 1e-11) & (square < 1e11);
    let moved = dx.abs() + dy.abs() + dz.abs();
    let are_ordinary = is_ordinary(a) & is_ordinary(b) & is_ordinary(c) & (moved < f32::INFINITY);
    are_ordinary & (volume * volume > 1e-6 * (a * b * c))
}

/// One face of a moved box: from `low` where an element is not negative, else from `high`.
#[inline(always)]
fn face(row: &[f32; 4], low: Vec3, high: Vec3) -> f32 {
    let x = if row[0] >= 0.0 { low.x } else { high.x };
    let y = if row[1] >= 0.0 { low.y } else { high.y };
    let z = if row[2] >= 0.0 { low.z } else { high.z };
    transform_row(*row, x, y, z)
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
    use glam::Vec4;

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
    fn transforms_that_place_nothing_are_refused() {
        let scale = |x, y, z| Affine3A::from_scale(Vec3::new(x, y, z));
        assert_eq!(Placement::try_from(Affine3A::IDENTITY), Ok(Placement::IDENTITY));
        assert_eq!(Placement::try_from(Mat4::IDENTITY), Ok(Placement::IDENTITY));
        assert!(Placement::try_from(scale(1e-6, 1.0, -1e6)).is_ok(), "neither size nor mirroring matters");
        assert_eq!(Placement::try_from(scale(1.0, 0.0, 1.0)), Err(PlacementError::Singular));
        let turn = Affine3A::from_rotation_x(0.3) * Affine3A::from_rotation_y(0.7);
        assert_eq!(Placement::try_from(turn * scale(1.0, 0.0, 1.0) * turn), Err(PlacementError::Singular));
        let moved = Affine3A::from_translation(Vec3::new(0.0, f32::NAN, 0.0));
        let error = Placement::try_from(moved).expect_err("NaN");
        assert!(matches!(error, PlacementError::NotFinite { row: 1, column: 3, .. }), "{error}");
        assert!(Placement::try_from(DMat4::from_scale(1e300 * DVec3::ONE)).is_err(), "too large for f32");
        let perspective = Mat4::from_cols(Vec4::X, Vec4::Y, -Vec4::W, -Vec4::Z);
        let error = Placement::try_from(perspective).expect_err("a perspective");
        assert!(matches!(error, PlacementError::Perspective(_)), "{error}");
    }

    #[test]
    fn the_quick_check_accepts_nothing_that_the_definition_refuses() {
        let (mut quick, mut refused) = (0, 0);
        for i in 0..200_000 {
            // The third column nearly in the plane of the others, sizes from tiny to huge.
            let flat = 10f32.powi(-((mix(i) % 10) as i32));
            let powers = if i % 2 == 0 { 1 } else { 80 };
            let sizes =
                [0, 1, 2].map(|k| 10f32.powi((mix(3 * i + k) % powers) as i32 / 2 - 20 * (i % 2) as i32));
            let (s, t) = (signed(i, 50), signed(i, 51));
            let rows: [[f32; 4]; 3] = [0, 1, 2].map(|k| {
                let (x, y) = (signed(i, k), signed(i, 10 + k));
                let z = s * x + t * y + flat * signed(i, 20 + k);
                let moved = if mix(i ^ 77).is_multiple_of(5) { f32::INFINITY } else { signed(i, 30 + k) };
                [sizes[0] * x, sizes[1] * y, sizes[2] * z, moved]
            });
            let is_quick = is_surely_regular(&rows);
            let exactly = Placement::checked_exactly(rows);
            assert!(!is_quick || exactly.is_ok(), "{rows:?}: {exactly:?}");
            (quick, refused) = (quick + u32::from(is_quick), refused + u32::from(exactly.is_err()));
        }
        assert!(quick > 20_000 && refused > 20_000, "{quick} by the quick check, {refused} refused");
        assert!(is_surely_regular(&Placement::IDENTITY.rows));
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
