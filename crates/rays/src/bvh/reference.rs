//! References to primitives, which the builder sorts instead of the primitives (Embree's `PrimRef`).

use super::packed_bounds::{PackedBounds, key};
use crate::geom::Aabb;
use crate::lanes::{LaneTask, Lanes, SimdLevel};
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

/// Ranges of at least this many references are scanned in parallel, in pieces of [`PIECE_LEN`].
pub(super) const PARALLEL_LEN: usize = 1 << 15;

/// Number of references in a piece of a long range. It does not depend on the number of threads, so neither
/// does the tree.
pub(super) const PIECE_LEN: usize = 1 << 13;

/// A primitive's box with its id in lane 3: 32 bytes.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(transparent)]
pub(super) struct Reference(pub PackedBounds);

/// Added to the primitive id, so that its bits are not a denormal number: those slow processors down.
const NORMAL_BIT: u32 = 1 << 30;

impl Reference {
    #[inline]
    pub fn new(primitive: u32, bounds: &Aabb) -> Self {
        Self(PackedBounds::new(bounds, f32::from_bits(primitive | NORMAL_BIT)))
    }

    /// The box without the id.
    #[inline]
    pub fn bounds(&self) -> PackedBounds {
        let [a, b, c, _, x, y, z, _] = self.0.0;
        PackedBounds([a, b, c, 0.0, x, y, z, 0.0])
    }

    #[inline]
    pub fn primitive(&self) -> u32 {
        self.0.0[3].to_bits() & !NORMAL_BIT
    }

    /// The [`key`]'s coordinate along an axis.
    #[inline]
    pub fn key_on(&self, axis: usize) -> f32 {
        self.0.0[axis] - self.0.0[axis + 4]
    }
}

/// Extent of a range of references.
#[derive(Clone, Copy)]
pub(super) struct Extent {
    /// The union of the boxes.
    pub bounds: PackedBounds,
    /// The box around the keys.
    pub keys: PackedBounds,
}

impl Extent {
    pub const EMPTY: Self = Self { bounds: PackedBounds::EMPTY, keys: PackedBounds::EMPTY };

    /// The extent of a range, on the current rayon pool.
    pub fn in_parallel(references: &[Reference]) -> Self {
        let pieces = references.par_chunks(PIECE_LEN).map(Self::of);
        pieces.reduce(|| Self::EMPTY, |a, b| a.union(&b))
    }

    /// The extent of a range, on the calling thread.
    pub fn of(references: &[Reference]) -> Self {
        SimdLevel::run_eight(ExtentTask(references))
    }

    /// The same in lanes.
    #[inline(always)]
    pub fn in_lanes<L: Lanes>(l: L, references: &[Reference]) -> Self {
        let (mut bounds, mut keys) = (PackedBounds::EMPTY.load(l), PackedBounds::EMPTY.load(l));
        for reference in references {
            let reference = reference.0.load(l);
            bounds = l.min(bounds, reference);
            keys = l.min(keys, key(l, reference));
        }
        Self { bounds: PackedBounds::store(l, bounds), keys: PackedBounds::store(l, keys) }
    }

    pub fn union(&self, other: &Self) -> Self {
        Self { bounds: self.bounds.union(&other.bounds), keys: self.keys.union(&other.keys) }
    }
}

/// [`Extent::in_lanes`] as a task.
struct ExtentTask<'a>(&'a [Reference]);

impl LaneTask for ExtentTask<'_> {
    type Output = Extent;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Extent {
        Extent::in_lanes(l, self.0)
    }
}
