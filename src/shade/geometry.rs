//! Hits in lanes and the geometry of their triangles: corners, vertex normals and texture coordinates.

use super::offset::{self, Plane};
use crate::lanes::{Int, Lanes, Mask, Num, Vector};
use crate::scene::TriangleMesh;
use crate::scene::corners::{Weights, blend, blend_uvs, corner_uvs, indices, vectors};

/// One [`crate::stream::Hit`] a lane. None of them is a miss.
#[derive(Clone, Copy, Debug)]
pub struct Hits<L: Lanes> {
    /// Ray parameter.
    pub t: Num<L>,
    /// Barycentric weight of the triangle's second vertex.
    pub u: Num<L>,
    /// Barycentric weight of the triangle's third vertex.
    pub v: Num<L>,
    /// Index of the triangle.
    pub primitive: Int<L>,
}

/// The geometry of hits: their triangles, and the smooth surfaces that the vertex normals suggest.
#[derive(Clone, Copy, Debug)]
pub struct Geometry<L: Lanes> {
    /// Vertex indices of the triangles.
    pub indices: [Int<L>; 3],
    /// Corner positions.
    pub corners: [Vector<L>; 3],
    /// Barycentric weights of the corners at the hits.
    pub weights: Weights<L>,
    /// The points on the triangles.
    pub position: Vector<L>,
    /// Unit directions back along the rays.
    pub wo: Vector<L>,
    /// Planes of the triangles. Their normals follow the winding.
    pub plane: Plane<L>,
    /// Lanes that are hit on the front: `wo` is on the side from which the triangle's vertices run
    /// counter-clockwise.
    pub front: Mask<L>,
    /// Unit normals of the triangles on the side of `wo`.
    pub normal: Vector<L>,
    /// Lanes whose triangles have three vertex normals.
    pub smooth: Mask<L>,
    /// Unit normals that point outwards: interpolated in the lanes of `smooth`, by winding in the others.
    pub outward: Vector<L>,
    /// Vertex normals; meaningful only in the lanes of `smooth`.
    pub vertex_normals: [Vector<L>; 3],
    /// Lanes whose `wo` is outside of the body.
    pub outside: Mask<L>,
    /// Texture coordinates of the corners in set 0, zero if the mesh has none.
    pub corner_uvs: [[Num<L>; 2]; 3],
    /// Texture coordinates of the hits in set 0.
    pub uv: [Num<L>; 2],
}

impl<L: Lanes> Geometry<L> {
    /// The geometry of hits by rays of unit direction `direction`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn new(mesh: &TriangleMesh, direction: Vector<L>, hits: &Hits<L>) -> Self {
        let l = direction.lanes();
        let indices = indices(mesh, hits.primitive);
        let corners = vectors(&mesh.positions, &indices);
        let weights = [1.0 - hits.u - hits.v, hits.u, hits.v];
        let position = blend(&corners, &weights);
        let wo = -direction;
        let plane = offset::plane(&corners, wo);
        let winding = plane.normal;
        let front = wo.dot(winding).ge(Num::splat(l, 0.0));
        let normal = Vector::select(front, winding, -winding);

        let (mut smooth, mut vertex_normals, mut outward) = (Mask::splat(l, false), corners, winding);
        if !mesh.normals.is_empty() {
            vertex_normals = vectors(&mesh.normals, &indices);
            let [a, b, c] = vertex_normals;
            (outward, smooth) = blend(&vertex_normals, &weights).normalize_or(winding);
            smooth &= !(a.is_zero() | b.is_zero() | c.is_zero());
            outward = Vector::select(smooth, outward, winding);
        }
        let outside = (wo.dot(winding) * outward.dot(winding)).ge(Num::splat(l, 0.0));
        let corner_uvs = corner_uvs(&mesh.uvs, &indices);
        let uv = blend_uvs(&corner_uvs, &weights);
        Self {
            indices,
            corners,
            weights,
            position,
            wo,
            plane,
            front,
            normal,
            smooth,
            outward,
            vertex_normals,
            outside,
            corner_uvs,
            uv,
        }
    }

    /// The hit points, raised to the surface that the vertex normals suggest.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn raised(&self) -> Vector<L> {
        if self.smooth.none() {
            return self.position;
        }
        let side = self.outward.dot(self.normal).signum();
        let raised = raise(self.position, &self.corners, &self.vertex_normals, &self.weights, side);
        Vector::select(self.smooth, raised, self.position)
    }
}

/// Mesh texture coordinates of hits, in set 0.
#[cfg_attr(not(unoptimised), inline(always))]
pub fn mesh_uv<L: Lanes>(mesh: &TriangleMesh, hits: &Hits<L>) -> [Num<L>; 2] {
    let indices = indices(mesh, hits.primitive);
    blend_uvs(&corner_uvs(&mesh.uvs, &indices), &[1.0 - hits.u - hits.v, hits.u, hits.v])
}

/// Raises `position` to the surface that the vertex normals suggest. Where the point lies under the tangent
/// plane of a vertex, it is projected onto that plane. The result is the weighted mean of these projections.
/// `side` is 1 or −1 and flips the normals.
#[cfg_attr(not(unoptimised), inline(always))]
fn raise<L: Lanes>(
    position: Vector<L>,
    corners: &[Vector<L>; 3],
    normals: &[Vector<L>; 3],
    weights: &Weights<L>,
    side: Num<L>,
) -> Vector<L> {
    let mut raised = position;
    for k in 0..3 {
        let normal = normals[k] * side;
        let under = (position - corners[k]).dot(normal).min(Num::splat(position.lanes(), 0.0));
        raised = raised - normal * (under * weights[k]);
    }
    raised
}
