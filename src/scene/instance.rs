//! Geometry that a scene instances.

use crate::geom::Placement;
use glam::Vec3;
use std::ops::Range;

/// Geometry in its own space.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shape {
    /// Vertex positions.
    pub positions: Vec<Vec3>,
    /// Vertex indices.
    pub triangles: Vec<[u32; 3]>,
    /// The instances, in the order of the scene's triangles.
    pub instances: Vec<Instance>,
}

/// One instance of a shape. The scene's mesh holds a moved copy, which is what is shaded. Its corners equal
/// [`Placement::point`] of the shape's corners to the bit, and its materials have the same alpha modes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instance {
    /// Motion from the shape's space to world space.
    pub placement: Placement,
    /// Index of the instance's first triangle in the scene's mesh. The others follow in order.
    pub first: u32,
}

impl Shape {
    /// The range of primitive ids of each instance.
    pub fn primitives(&self) -> impl Iterator<Item = Range<u32>> {
        let count = self.triangles.len() as u32;
        self.instances.iter().map(move |instance| instance.first..instance.first + count)
    }
}
