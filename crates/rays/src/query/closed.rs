//! Closed meshes: those that have an inside.

use crate::bvh::Bvh;
use glam::Vec3;
use rayon::prelude::*;

/// Error of asking for the inside of a mesh that is open.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the mesh is open: {edges} of its edges have an odd number of triangles, so it has no inside; close its holes, or \
     ask for the parity of crossings"
)]
pub struct OpenMesh {
    /// Number of edges that an odd number of triangles have.
    pub edges: usize,
}

/// A corner by its bits; zeros of both signs are one.
type Corner = [u32; 3];

/// Number of edges that an odd number of triangles have. Edges are equal if their corners are at the same positions,
/// whatever the corners' indices are. Edges of length 0 do not count.
pub(super) fn open_edges(bvh: &Bvh) -> usize {
    let corner = |corner: Vec3| -> Corner { (corner + 0.0).to_array().map(f32::to_bits) };
    let edge = |a: Corner, b: Corner| if a < b { (a, b) } else { (b, a) };
    let mut edges: Vec<(Corner, Corner)> = (0..bvh.len() as u32)
        .into_par_iter()
        .flat_map_iter(|primitive| {
            let [a, b, c] = bvh.corners(primitive).map(corner);
            [edge(a, b), edge(b, c), edge(c, a)].into_iter().filter(|(a, b)| a != b)
        })
        .collect();
    edges.par_sort_unstable();
    edges.chunk_by(|a, b| a == b).filter(|equal| equal.len() % 2 == 1).count()
}
