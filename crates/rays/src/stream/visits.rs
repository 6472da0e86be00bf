//! Counts of what the walk of a ray visits.

use bytemuck::{Pod, Zeroable};

/// Counts of what the walk of a ray through a tree visits: the work that a ray is, whatever it runs on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Visits {
    /// Inner nodes.
    pub nodes: u32,
    /// Triangles that are tested, coarsely or in full.
    pub triangles: u32,
    /// Bytes of the scene that are read.
    pub bytes: u32,
    /// Tree instances that are entered.
    pub instances: u32,
}
