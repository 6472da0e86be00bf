//! Geometry that a scene shows several times.

use crate::geom::Placement;
use glam::Vec3;
use std::ops::Range;

/// Geometry in a space of its own.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shape {
    /// Vertex positions.
    pub positions: Vec<Vec3>,
    /// Vertex indices.
    pub triangles: Vec<[u32; 3]>,
    /// Where it stands, in the order of the scene's triangles.
    pub instances: Vec<Instance>,
}

/// One place where a shape stands. The scene's mesh has a moved copy of it, which is what is shaded:
/// [`Placement::point`] of each corner, to the bit, with the same materials' alpha modes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instance {
    /// Moves it into the world.
    pub placement: Placement,
    /// Its first triangle in the scene's mesh; the others follow in order.
    pub first: u32,
}

impl Shape {
    /// The primitives of each instance.
    pub fn primitives(&self) -> impl Iterator<Item = Range<u32>> {
        let count = self.triangles.len() as u32;
        self.instances.iter().map(move |instance| instance.first..instance.first + count)
    }
}
