//! Checks of the meshes that a tree is built over.

use super::leaf_block::max_words;
use crate::geom::MAX_COORDINATE;
use glam::Vec3;
use rayon::prelude::*;

/// The largest number of triangles in a tree. Even if each has a leaf block of its own, indices of words then
/// fit 31 bits, as gathers in lanes need.
const MAX_TRIANGLES: usize = 130_000_000;
const _: () = assert!(MAX_TRIANGLES * max_words(1) < (1 << 31));

/// Number of elements that one thread checks at a time.
const CHECKED_AT_ONCE: usize = 1 << 14;

/// Error of building a tree over a mesh, or of refitting it.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GeometryError {
    /// There are too many triangles.
    #[error("{found} triangles; at most {max} can be numbered")]
    TooMany {
        /// Number of triangles given.
        found: usize,
        /// The largest number allowed.
        max: usize,
    },
    /// The number of triangles differs from the tree's.
    #[error("the tree holds {expected} triangles, not {found}; build it anew")]
    Triangles {
        /// Number of triangles given.
        found: usize,
        /// Number of triangles in the tree.
        expected: usize,
    },
    /// The tree is a two-level tree.
    #[error("a tree over instances cannot be refitted; build it anew")]
    Instanced,
    /// A triangle refers to a vertex that does not exist.
    #[error("triangle {triangle} names vertex {vertex}, but there are {count} vertices")]
    Vertex {
        /// Index of the triangle.
        triangle: usize,
        /// Index of the vertex that it refers to.
        vertex: u32,
        /// Number of vertices.
        count: usize,
    },
    /// A coordinate is NaN or exceeds [`MAX_COORDINATE`].
    #[error("vertex {vertex} is at {at}; coordinates must be numbers of at most {MAX_COORDINATE:e} in size")]
    Position {
        /// Index of the vertex.
        vertex: usize,
        /// Its position.
        at: Vec3,
    },
}

impl GeometryError {
    /// Checks the arguments of [`super::Bvh::build`], on the current rayon pool.
    ///
    /// # Errors
    /// The first defect: of the triangles, then of the positions.
    pub fn check(positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<(), Self> {
        let (found, max, count) = (triangles.len(), MAX_TRIANGLES, positions.len());
        if found > max {
            return Err(Self::TooMany { found, max });
        }
        // Each piece is scanned without branches, and again only if it has a defect.
        let is_missing = |&vertex: &u32| vertex as usize >= count;
        let is_broken = |corners: &[u32; 3]| corners.iter().any(is_missing);
        let triangle =
            triangles.par_chunks(CHECKED_AT_ONCE).enumerate().find_map_first(|(piece, triangles)| {
                let highest = triangles.as_flattened().iter().fold(0, |highest, &vertex| vertex.max(highest));
                let found = if is_missing(&highest) { triangles.iter().position(is_broken) } else { None };
                found.map(|triangle| piece * CHECKED_AT_ONCE + triangle)
            });
        if let Some(triangle) = triangle {
            let vertex = triangles[triangle].into_iter().find(is_missing).unwrap_or_default();
            return Err(Self::Vertex { triangle, vertex, count });
        }
        // NaN fails the comparison.
        let is_sound = |number: &f32| number.abs() <= MAX_COORDINATE;
        let vertex =
            positions.par_chunks(CHECKED_AT_ONCE).enumerate().find_map_first(|(piece, positions)| {
                let numbers: &[[f32; 3]] = bytemuck::cast_slice(positions);
                let sound =
                    numbers.as_flattened().iter().fold(true, |sound, number| sound & is_sound(number));
                let unsound = |corner: &[f32; 3]| !corner.iter().all(is_sound);
                let found = if sound { None } else { numbers.iter().position(unsound) };
                found.map(|vertex| piece * CHECKED_AT_ONCE + vertex)
            });
        vertex.map_or(Ok(()), |vertex| Err(Self::Position { vertex, at: positions[vertex] }))
    }
}
