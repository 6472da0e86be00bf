//! Primitives while they are sorted into the tree, as boxes of their own.

use crate::geom::Aabb;
use crate::lanes::{LaneTask, Lanes, SimdLevel, load_one, store_one, swap_halves};
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

/// Ranges at least this long are scanned in parallel, by pieces of [`PIECE`].
pub(super) const LONG: usize = 1 << 15;

/// Length of the pieces in which long ranges are scanned. Never depends on the number of threads, nor
/// does then the tree.
pub(super) const PIECE: usize = 1 << 13;

/// A box in one register: the lower corner, and the upper one negated, so that a union is the lesser of each number.
/// The last of each four is no part of the box.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(32))]
pub(super) struct Bounds(pub [f32; 8]);

impl Bounds {
    pub const EMPTY: Self = Self([f32::INFINITY; 8]);

    fn new(bounds: &Aabb, word: f32) -> Self {
        let ([a, b, c], [x, y, z]) = (bounds.min.to_array(), bounds.max.to_array());
        Self([a, b, c, word, -x, -y, -z, 0.0])
    }

    #[inline(always)]
    pub fn load<L: Lanes>(&self, l: L) -> L::F {
        load_one(l, &self.0)
    }

    #[inline(always)]
    pub fn of<L: Lanes>(l: L, numbers: L::F) -> Self {
        Self(store_one(l, numbers))
    }

    #[inline]
    pub fn union(&self, other: &Self) -> Self {
        let mut all = *self;
        for (mine, theirs) in all.0.iter_mut().zip(other.0) {
            *mine = if *mine < theirs { *mine } else { theirs };
        }
        all
    }

    /// Half the surface; at most about 1e23, so costs stay finite. Infinite for an empty box.
    #[inline(always)]
    pub fn half_area(&self) -> f32 {
        // Negated sizes have the products of sizes.
        let [a, b, c, _, x, y, z, _] = self.0;
        let [x, y, z] = [a + x, b + y, c + z];
        x * y + y * z + z * x
    }

    pub fn to_aabb(self) -> Aabb {
        let [a, b, c, _, x, y, z, _] = self.0;
        // Subtracted from zero, for a corner at zero is not to be at -0.
        Aabb { min: [a, b, c].into(), max: [0.0 - x, 0.0 - y, 0.0 - z].into() }
    }
}

/// A primitive's box and number in 32 bytes.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(transparent)]
pub(super) struct Reference(pub Bounds);

/// Added to the primitive's number so that its bits are no denormal number: those slow processors down.
const NORMAL: u32 = 1 << 30;

impl Reference {
    pub fn new(primitive: u32, bounds: &Aabb) -> Self {
        Self(Bounds::new(bounds, f32::from_bits(primitive | NORMAL)))
    }

    /// The box alone.
    pub fn boxed(&self) -> Bounds {
        let [a, b, c, _, x, y, z, _] = self.0.0;
        Bounds([a, b, c, 0.0, x, y, z, 0.0])
    }

    pub fn primitive(&self) -> u32 {
        self.0.0[3].to_bits() & !NORMAL
    }

    /// One coordinate of the key.
    pub fn key_on(&self, axis: usize) -> f32 {
        self.0.0[axis] - self.0.0[axis + 4]
    }
}

/// The key of a box, twice its centre, as a box of no size.
#[inline(always)]
pub(super) fn key<L: Lanes>(l: L, bounds: L::F) -> L::F {
    l.sub(bounds, swap_halves(l, bounds))
}

/// The box around references, and the box around their keys.
#[derive(Clone, Copy)]
pub(super) struct Extent {
    pub bounds: Bounds,
    pub keys: Bounds,
}

impl Extent {
    pub const EMPTY: Self = Self { bounds: Bounds::EMPTY, keys: Bounds::EMPTY };

    pub fn of(references: &[Reference]) -> Self {
        let pieces = references.par_chunks(PIECE).map(Self::of_piece);
        pieces.reduce(|| Self::EMPTY, |a, b| a.union(&b))
    }

    /// The same on one thread.
    pub fn of_piece(references: &[Reference]) -> Self {
        SimdLevel::run_eight(Around(references))
    }

    pub fn union(&self, other: &Self) -> Self {
        Self { bounds: self.bounds.union(&other.bounds), keys: self.keys.union(&other.keys) }
    }

    #[inline(always)]
    pub fn of_few<L: Lanes>(l: L, references: &[Reference]) -> Self {
        let (mut bounds, mut keys) = (Bounds::EMPTY.load(l), Bounds::EMPTY.load(l));
        for reference in references {
            let reference = reference.0.load(l);
            bounds = l.min(bounds, reference);
            keys = l.min(keys, key(l, reference));
        }
        Self { bounds: Bounds::of(l, bounds), keys: Bounds::of(l, keys) }
    }
}

/// [`Extent::of_few`] to be run.
struct Around<'a>(&'a [Reference]);

impl LaneTask for Around<'_> {
    type Output = Extent;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Extent {
        Extent::of_few(l, self.0)
    }
}
