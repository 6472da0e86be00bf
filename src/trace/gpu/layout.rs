//! Structs and constants that host and device share. They are defined here. A test compares the structs with those of
//! the same names in `shaders/shared/layout.wgsl`; the constants are injected into the kernels' sources.

use bytemuck::{Pod, Zeroable};

/// An inner node of the eight-wide tree, its boxes in bytes: 96 bytes instead of the 256 of the host's nodes.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct WideNode {
    /// The words of its origin's coordinates, and its shape: see `shaders/shared/layout.wgsl`.
    pub corner: [u32; 4],
    /// Lower faces, then upper ones.
    pub x: [[u8; 8]; 2],
    pub y: [[u8; 8]; 2],
    pub z: [[u8; 8]; 2],
    /// Child references.
    pub children: [u32; 8],
}

/// Two triangles that share an edge: `a b c` and `c b d`. The fourth numbers are those of `d`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Pair {
    pub a: [f32; 4],
    pub b: [f32; 4],
    pub c: [f32; 4],
}

impl Pair {
    /// The pair of these corners.
    pub fn new([a, b, c, d]: [[f32; 3]; 4]) -> Self {
        let with = |[x, y, z]: [f32; 3], w| [x, y, z, w];
        Self { a: with(a, d[0]), b: with(b, d[1]), c: with(c, d[2]) }
    }

    /// The corners.
    pub fn corners(&self) -> [[f32; 3]; 4] {
        let first = |[x, y, z, _]: [f32; 4]| [x, y, z];
        [first(self.a), first(self.b), first(self.c), [self.a[3], self.b[3], self.c[3]]]
    }
}

/// The primitives of a pair, each with its turn (how its corners are rotated): see `shaders/shared/layout.wgsl`.
pub(super) type Identities = [u32; 2];

/// A tree instance: the columns of its placement, its tree and its first primitive.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct TreeInstance {
    pub x: [f32; 3],
    /// Child reference to the root of its tree.
    pub root: u32,
    pub y: [f32; 3],
    /// What is added to the primitive ids of its tree.
    pub first: u32,
    pub z: [f32; 3],
    pub spare_0: u32,
    pub shift: [f32; 3],
    pub spare_1: u32,
}

/// Where the canonical nearest hit of a ray may be: on one of up to three primitives, in order of distance
/// ([`crate::stream::MISS`] where there are fewer), or on a primitive that was left out, not nearer than `rest`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Candidates {
    pub first: u32,
    pub second: u32,
    pub third: u32,
    /// `f32::MAX` when nothing was left out.
    pub rest: f32,
}

/// The parameters of one dispatch of a kernel.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Params {
    pub count: u32,
    pub scene_max_abs: f32,
    pub zero: u32,
    pub spare: u32,
}

/// Bit of a child reference: it refers to a leaf, or in a top-level tree to a member.
pub(super) const LEAF: u32 = 1 << 31;
/// Lowest bit, in a leaf's reference, of its number of pairs less one (three bits).
pub(super) const PAIRS_SHIFT: u32 = 28;
/// Bit of a leaf's reference: the filter decides about hits of some of its triangles.
pub(super) const MASKED: u32 = 1 << 27;
/// Bits of a leaf's reference: the index of its first pair.
pub(super) const PAIR_INDEX: u32 = MASKED - 1;
/// Bits of an identity: the primitive id, which has 30 bits.
pub(super) const PRIMITIVE: u32 = (1 << TURN_SHIFT) - 1;
/// Lowest bit of an identity's turn (two bits).
pub(super) const TURN_SHIFT: u32 = 30;
/// A child reference to nothing, which ends the traversal. Has the bit of a leaf.
pub(super) const NOWHERE: u32 = u32::MAX;
/// An answer of `trace_any`: the ray is certainly occluded. Other answers are [`crate::stream::MISS`], [`UNDECIDED`]
/// and primitives.
pub(super) const OCCLUDED: u32 = u32::MAX - 1;
/// An answer of any kernel: the host has to decide.
pub(super) const UNDECIDED: u32 = u32::MAX - 2;
/// Bit of an answer of `trace_any` that is a primitive: other primitives may occlude the ray too. Primitive ids have 30
/// bits.
pub(super) const MORE: u32 = 1 << 30;

/// Bit of a listed ray: it is undecided because the filter decides about a candidate.
pub(super) const MASKED_RAY: u32 = 1 << 31;

/// Threads of a workgroup.
pub(super) const WORKGROUP_SIZE: u32 = 64;

/// Relative error bound of the triangle test; `shaders/candidates/triangle.wgsl` derives it.
pub(super) const MARGIN: f32 = 16.0 / (1 << 24) as f32;
/// Relative error bound of a quotient and of two sums after it.
pub(super) const T_ROUNDING: f32 = 16.0 / (1 << 24) as f32;
/// The error that flushed denormals may add to a result of size 1: 2^6 times the smallest normal number.
pub(super) const TINY: f32 = 64.0 * f32::MIN_POSITIVE;
/// The smallest pad of slabs; underflow could exceed a smaller one.
pub(super) const LEAST_PAD: f32 = 1.0e-30;
