//! What host and device share: structs and constants. Written here; the structs' twins in
//! `shaders/shared/layout.wgsl` are compared with them by a test, the constants are injected.

use bytemuck::{Pod, Zeroable};

/// Both children of an inner BVH2 node.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Node {
    pub left_min: [f32; 3],
    pub left: u32,
    pub left_max: [f32; 3],
    pub spare_0: u32,
    pub right_min: [f32; 3],
    pub right: u32,
    pub right_max: [f32; 3],
    pub spare_1: u32,
}

/// A triangle, in leaf order.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Triangle {
    pub v0: [f32; 3],
    pub primitive: u32,
    pub v1: [f32; 3],
    pub flags: u32,
    pub v2: [f32; 3],
    /// At least the length of any edge along any axis.
    pub extent: f32,
}

/// A tree placed in the world.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Member {
    pub x: [f32; 3],
    /// A child reference.
    pub root: u32,
    pub y: [f32; 3],
    pub first: u32,
    pub z: [f32; 3],
    pub spare_0: u32,
    pub shift: [f32; 3],
    pub spare_1: u32,
}

/// Where the canonical nearest hit of a ray may be: `kept`, in order of distance, [`crate::stream::MISS`]
/// where there are fewer; or what was left out, which is not nearer than `rest`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Candidates {
    pub first: u32,
    pub second: u32,
    pub third: u32,
    /// `f32::MAX` when nothing was left out.
    pub rest: f32,
}

/// What one dispatch is told.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Params {
    pub count: u32,
    pub scene_max_abs: f32,
    pub zero: u32,
    pub spare: u32,
}

/// Bit of a child reference: a leaf, the other bits are its first triangle, or the member above members' trees.
pub(super) const LEAF: u32 = 1 << 31;
/// Bit of [`Triangle::flags`]: alpha decides whether the triangle is there.
pub(super) const MASKED: u32 = 1;
/// Bit of [`Triangle::flags`]: the last of its leaf.
pub(super) const LAST: u32 = 2;
/// A child reference to nothing: the traversal is over. Has the bit of a leaf.
pub(super) const NOWHERE: u32 = u32::MAX;
/// An answer of `trace_any`: something is certainly in the way. The others are
/// [`crate::stream::MISS`] and primitives.
pub(super) const OCCLUDED: u32 = u32::MAX - 1;
/// An answer of `trace_any`: nothing can be said.
pub(super) const UNDECIDED: u32 = u32::MAX - 2;
/// Bit of an answer of `trace_any` that is a primitive: there may be others in the way. Primitives
/// have 30 bits.
pub(super) const MORE: u32 = 1 << 30;

/// What [`Triangle::extent`] is rounded up by, past the subtraction's own error.
pub(super) const EXTENT_MARGIN: f32 = 1.0 + 4.0 * f32::EPSILON;

/// The most triangles of a leaf.
pub(super) const LEAF_TRIANGLES: usize = 2;

/// Threads of a workgroup.
pub(super) const WORKGROUP_SIZE: u32 = 64;

/// Relative error bound of the triangle test; `shaders/shared/triangle.wgsl` derives it.
pub(super) const MARGIN: f32 = 16.0 / (1 << 24) as f32;
/// How much rounding `a`, `b`, `c` may lengthen an edge, relative to their size.
pub(super) const EDGE_ROUNDING: f32 = 4.0 / (1 << 24) as f32;
/// Relative error bound of a quotient and two sums after it.
pub(super) const T_ROUNDING: f32 = 16.0 / (1 << 24) as f32;
/// What flushed denormals may add to a result of size 1: 2^6 times the smallest normal number.
pub(super) const TINY: f32 = 64.0 * f32::MIN_POSITIVE;
/// Slabs pushed out by less than this would drown in underflow.
pub(super) const LEAST_PAD: f32 = 1.0e-30;
