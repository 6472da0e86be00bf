//! Triangles → [`Bvh`]: a binary tree built by the surface area heuristic, and its collapse into the
//! eight-wide tree with blocks of triangles that the CPU traces. Knows no scene and no ray.

mod binary;
mod block;
mod collapse;
mod filter;
mod pages;
mod sah;
mod validate;
mod wide;

pub use binary::{Binary, BinaryNode};
pub use block::{BLOCK_TRIANGLES, Block, MASKED};
pub use filter::Filter;
pub use sah::MAX_DEPTH;
pub use validate::BvhError;
pub use wide::{Child, WIDTH, Wide, WideNode};

use crate::geom::MAX_COORDINATE;
use glam::Vec3;
use rayon::prelude::*;

/// Where a triangle lies: block index in the upper bits, row in the lower three.
#[derive(Clone, Copy, Debug, Default)]
struct Place(u32);

/// A bounding volume hierarchy over the triangles of a scene, with all that tracers need of them.
///
/// Holds about 64 bytes of binary nodes, 4 bytes of index, and 60 to 100 bytes of eight-wide nodes
/// and blocks a triangle. Boxes are exact: each is the smallest around its triangles.
#[derive(Clone, Debug)]
pub struct Bvh {
    binary: Binary,
    wide: Wide,
    places: Vec<Place>,
    scene_max_abs: f32,
}

impl Bvh {
    /// Builds the tree over `triangles`, which index `positions`. Triangles for which `masked` is true
    /// are the ones that a tracer asks its [`Filter`] about. Runs on the current rayon pool; the
    /// result depends on nothing but the arguments. Takes any triangles, degenerate ones too: the
    /// tree is at most [`MAX_DEPTH`] deep. No triangles give a tree that no ray hits.
    ///
    /// # Panics
    /// If an index is out of range, a coordinate exceeds [`MAX_COORDINATE`] or is NaN, or there are
    /// more triangles than a scene may have; `Mesh::validate` refuses such meshes.
    pub fn build(positions: &[Vec3], triangles: &[[u32; 3]], masked: impl Fn(u32) -> bool + Sync) -> Self {
        assert!(triangles.len() < 1 << 30, "primitive ids have 30 bits");
        let is_sound = |p: &Vec3| p.abs().cmple(Vec3::splat(MAX_COORDINATE)).all();
        assert!(positions.par_iter().all(is_sound), "coordinates are at most {MAX_COORDINATE:e}");
        let corners = |primitive: u32| triangles[primitive as usize].map(|i| positions[i as usize]);
        let binary = sah::build(triangles.len(), corners);
        let wide = collapse::collapse(&binary, corners, masked);
        let mut places = vec![Place::default(); triangles.len()];
        for (index, block) in wide.blocks.iter().enumerate() {
            for row in 0..block.len() {
                places[block.primitive(row) as usize] = Place((index * BLOCK_TRIANGLES + row) as u32);
            }
        }
        let scene_max_abs = binary.bounds().max_abs();
        Self { binary, wide, places, scene_max_abs }
    }

    /// The binary tree, one primitive a leaf.
    pub fn binary(&self) -> &Binary {
        &self.binary
    }

    /// The eight-wide tree.
    pub fn wide(&self) -> &Wide {
        &self.wide
    }

    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Whether there are no triangles.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// Largest absolute coordinate of all triangles, which [`crate::geom::CanonicalRay::new`] wants.
    pub fn scene_max_abs(&self) -> f32 {
        self.scene_max_abs
    }

    /// The corners of a triangle.
    ///
    /// # Panics
    /// If there is no such primitive.
    pub fn corners(&self, primitive: u32) -> [Vec3; 3] {
        let (block, row) = self.place(primitive);
        block.corners(row)
    }

    /// Whether the filter has a say in hits of this triangle.
    ///
    /// # Panics
    /// If there is no such primitive.
    pub fn is_masked(&self, primitive: u32) -> bool {
        let (block, row) = self.place(primitive);
        block.is_masked(row)
    }

    /// Bytes on the heap.
    pub fn bytes(&self) -> usize {
        size_of_val(self.binary.nodes.as_slice())
            + size_of_val(self.wide.nodes())
            + size_of_val(self.wide.blocks())
            + size_of_val(self.places.as_slice())
    }

    fn place(&self, primitive: u32) -> (&Block, usize) {
        let place = self.places[primitive as usize].0 as usize;
        (&self.wide.blocks[place / BLOCK_TRIANGLES], place % BLOCK_TRIANGLES)
    }
}
