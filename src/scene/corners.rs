//! The corners of triangles in lanes: positions, normals, texture coordinates and tangents.

use super::TriangleMesh;
use crate::geom::Basis;
use crate::lanes::{Int, Lanes, Mask, Num, Vector};

/// The barycentric weights of a triangle's corners.
pub(crate) type Weights<L> = [Num<L>; 3];

/// The weighted sum of three vectors.
#[inline(always)]
pub(crate) fn blend<L: Lanes>(of: &[Vector<L>; 3], weights: &Weights<L>) -> Vector<L> {
    of[0] * weights[0] + of[1] * weights[1] + of[2] * weights[2]
}

/// Vertex indices of triangles.
#[inline(always)]
pub(crate) fn indices<L: Lanes>(mesh: &TriangleMesh, primitive: Int<L>) -> [Int<L>; 3] {
    primitive.rows::<3>(bytemuck::cast_slice(&mesh.triangles))
}

/// The rows `indices` of a table of vectors.
#[inline(always)]
pub(crate) fn vectors<L: Lanes>(table: &[glam::Vec3], indices: &[Int<L>; 3]) -> [Vector<L>; 3] {
    let table: &[f32] = bytemuck::cast_slice(table);
    let [a, b, c] = *indices;
    [
        Vector::from_columns(a.rows_of(table)),
        Vector::from_columns(b.rows_of(table)),
        Vector::from_columns(c.rows_of(table)),
    ]
}

/// Texture coordinates of the corners ([`TriangleMesh::uv_set`]); zero without any.
#[inline(always)]
pub(crate) fn corner_uvs<L: Lanes>(uvs: &[glam::Vec2], indices: &[Int<L>; 3]) -> [[Num<L>; 2]; 3] {
    if uvs.is_empty() {
        return [[Num::splat(indices[0].lanes(), 0.0); 2]; 3];
    }
    let table: &[f32] = bytemuck::cast_slice(uvs);
    let [a, b, c] = *indices;
    [a.rows_of(table), b.rows_of(table), c.rows_of(table)]
}

/// The weighted sum of three texture coordinates.
#[inline(always)]
pub(crate) fn blend_uvs<L: Lanes>([a, b, c]: &[[Num<L>; 2]; 3], weights: &Weights<L>) -> [Num<L>; 2] {
    // No closure: the compiler might not inline it.
    let mut uv = *a;
    for (k, uv) in uv.iter_mut().enumerate() {
        *uv = a[k] * weights[0] + b[k] * weights[1] + c[k] * weights[2];
    }
    uv
}

/// The tangent bases around the unit normals `outward`, and the lanes that have a tangent. Tangents come from the mesh
/// or, without these, from its texture coordinates.
#[inline(always)]
pub(crate) fn tangent_basis<L: Lanes>(
    mesh: &TriangleMesh,
    indices: &[Int<L>; 3],
    corners: &[Vector<L>; 3],
    uvs: &[[Num<L>; 2]; 3],
    weights: &Weights<L>,
    outward: Vector<L>,
) -> (Basis<L>, Mask<L>) {
    let l = outward.lanes();
    let one = Num::splat(l, 1.0);
    let (mut along, mut handedness, mut there) = (outward, one, Mask::splat(l, false));
    if !mesh.uvs.is_empty() {
        let [a, b, c] = *uvs;
        let (d1, d2) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
        let determinant = d1[0] * d2[1] - d1[1] * d2[0];
        let sign = determinant.signum();
        let (e1, e2) = (corners[1] - corners[0], corners[2] - corners[0]);
        let along_u = (e1 * d2[1] - e2 * d1[1]) * sign;
        // v grows downwards in the image, and the map's y upwards.
        let up = (e1 * d2[0] - e2 * d1[0]) * sign;
        let left = outward.cross(along_u).dot(up).below(0.0);
        (along, there) = (along_u - outward * along_u.dot(outward)).normalize_or(outward);
        there &= determinant.is_finite() & !determinant.is_zero();
        handedness = Num::select(left, -one, one);
    }
    if !mesh.tangents.is_empty() {
        let table: &[f32] = bytemuck::cast_slice(&mesh.tangents);
        let [a, b, c] = *indices;
        let [a, b, c] = [a.rows_of::<4>(table), b.rows_of::<4>(table), c.rows_of::<4>(table)];
        let of =
            [Vector::new(a[0], a[1], a[2]), Vector::new(b[0], b[1], b[2]), Vector::new(c[0], c[1], c[2])];
        let tangent = blend(&of, weights);
        let (given, is_given) = (tangent - outward * tangent.dot(outward)).normalize_or(outward);
        along = Vector::select(is_given, given, along);
        handedness = Num::select(is_given, Num::select(a[3].below(0.0), -one, one), handedness);
        there |= is_given;
    }
    (Basis { tangent: along, bitangent: outward.cross(along) * handedness, normal: outward }, there)
}
