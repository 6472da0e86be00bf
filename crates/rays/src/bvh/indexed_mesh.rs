//! The triangles that a tree is built over.

use crate::lanes::each;
use glam::Vec3;

/// An indexed triangle mesh with the alpha mask of each triangle.
pub(super) struct IndexedMesh<'a> {
    pub positions: &'a [Vec3],
    /// Three indices into `positions` for each triangle.
    pub triangles: &'a [[u32; 3]],
    /// Tells of a triangle whether the [`super::Filter`] decides its hits.
    pub masked: &'a (dyn Fn(u32) -> bool + Sync),
}

impl IndexedMesh<'_> {
    /// The corners of a triangle.
    #[inline]
    pub fn corners(&self, primitive: u32) -> [Vec3; 3] {
        each(self.triangles[primitive as usize], |i| self.positions[i as usize])
    }

    /// True if the filter decides the hits of a triangle.
    #[inline]
    pub fn is_masked(&self, primitive: u32) -> bool {
        (self.masked)(primitive)
    }
}
