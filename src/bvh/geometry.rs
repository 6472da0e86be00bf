//! Which triangles a tree can be built over.

use super::leaf_block::most_words;
use crate::geom::MAX_COORDINATE;
use glam::Vec3;
use rayon::prelude::*;

/// The most triangles of a tree, even if each is alone in its block: lanes find their words by numbers of 31 bits.
const MOST_TRIANGLES: usize = 130_000_000;
const _: () = assert!(MOST_TRIANGLES * most_words(1) < (1 << 31));

/// Elements that one thread checks at a time.
const PIECE: usize = 1 << 14;

/// Why there can be no tree over some triangles, or none of the old shape.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum GeometryError {
    /// More than primitive ids can name.
    #[error("{found} triangles; at most {most} can be numbered")]
    TooMany {
        /// Given.
        found: usize,
        /// How many there may be.
        most: usize,
    },
    /// Another number of triangles.
    #[error("the tree holds {expected} triangles, not {found}; build it anew")]
    Triangles {
        /// Given.
        found: usize,
        /// In the tree.
        expected: usize,
    },
    /// The tree is put together of others.
    #[error("a tree of placed trees cannot be refitted; build it anew")]
    Assembled,
    /// A triangle names a vertex that is not there.
    #[error("triangle {triangle} names vertex {vertex}, but there are {count} vertices")]
    Vertex {
        /// Triangle index.
        triangle: usize,
        /// The index it names.
        vertex: u32,
        /// How many there are.
        count: usize,
    },
    /// A coordinate is NaN or too large.
    #[error("vertex {vertex} is at {at}; coordinates must be numbers of at most {MAX_COORDINATE:e} in size")]
    Position {
        /// Vertex index.
        vertex: usize,
        /// Where it is said to be.
        at: Vec3,
    },
}

impl GeometryError {
    /// Checks what [`super::Bvh::build`] asks of its arguments, on the current rayon pool.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn check(positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<(), Self> {
        let (found, most, count) = (triangles.len(), MOST_TRIANGLES, positions.len());
        if found > most {
            return Err(Self::TooMany { found, most });
        }
        // A piece is looked through without a branch, and again if something is wrong with it.
        let strays = |&vertex: &u32| vertex as usize >= count;
        let stray = |corners: &[u32; 3]| corners.iter().any(strays);
        let triangle = triangles.par_chunks(PIECE).enumerate().find_map_first(|(piece, triangles)| {
            let highest = triangles.as_flattened().iter().fold(0, |highest, &vertex| vertex.max(highest));
            let found = if strays(&highest) { triangles.iter().position(stray) } else { None };
            found.map(|triangle| piece * PIECE + triangle)
        });
        if let Some(triangle) = triangle {
            let vertex = triangles[triangle].into_iter().find(strays).unwrap_or_default();
            return Err(Self::Vertex { triangle, vertex, count });
        }
        // NaN fails the comparison too.
        let is_sound = |number: &f32| number.abs() <= MAX_COORDINATE;
        let vertex = positions.par_chunks(PIECE).enumerate().find_map_first(|(piece, positions)| {
            let numbers: &[[f32; 3]] = bytemuck::cast_slice(positions);
            let sound = numbers.as_flattened().iter().fold(true, |sound, number| sound & is_sound(number));
            let unsound = |corner: &[f32; 3]| !corner.iter().all(is_sound);
            let found = if sound { None } else { numbers.iter().position(unsound) };
            found.map(|vertex| piece * PIECE + vertex)
        });
        vertex.map_or(Ok(()), |vertex| Err(Self::Position { vertex, at: positions[vertex] }))
    }
}
