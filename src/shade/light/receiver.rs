//! Who is lit.

use crate::geom::octahedral;
use crate::lanes::{Int, Lanes, Vector};
use crate::shade::Interaction;

/// Bits of each coordinate of a [`Receiver::facing`].
const BITS: u32 = 10;

/// The facing of what sees both sides: of the two codes at the octahedron's lowest corner the one that no normal
/// has.
const AROUND: u32 = 0;
const LOWEST: u32 = (1 << (2 * BITS)) - 1;

/// Points that ask for light, with all that the choice of a light depends on: so little that a path can
/// carry it to its next hit, where the density of having chosen that light is asked for.
#[derive(Clone, Copy, Debug)]
pub struct Receiver<L: Lanes> {
    /// Where scattered rays leave the surface.
    pub position: Vector<L>,
    /// The triangle's normal, octahedral, in [`Receiver::FACING_BITS`].
    pub facing: Int<L>,
}

impl<L: Lanes> Receiver<L> {
    /// Bits of `facing` that count.
    pub const FACING_BITS: u32 = 2 * BITS;

    /// Points on surfaces.
    #[inline(always)]
    pub fn of(at: &Interaction<L>) -> Self {
        Self::new(at.origin(at.raised, at.normal), at.normal)
    }

    /// The same where only the position is used, since there are few lights.
    #[inline(always)]
    pub fn place_of(at: &Interaction<L>) -> Self {
        let position = at.origin(at.raised, at.normal);
        Self { position, facing: Int::splat(position.lanes(), AROUND) }
    }

    /// Points at `position` that see what is above their unit `normal`.
    #[inline(always)]
    pub fn new(position: Vector<L>, normal: Vector<L>) -> Self {
        let facing = octahedral::encode::<L, BITS>(normal);
        let lowest = Int::splat(facing.lanes(), LOWEST);
        Self { position, facing: Int::select(facing.is(AROUND), lowest, facing) }
    }

    /// The same points, which see what is below them as well.
    #[inline(always)]
    pub fn around(self) -> Self {
        Self { facing: Int::splat(self.facing.lanes(), AROUND), ..self }
    }

    /// The normal as it was stored, all that light sampling knows of it; 0 of what sees both sides.
    #[inline(always)]
    pub fn normal(&self) -> Vector<L> {
        octahedral::decode::<L, BITS>(self.facing).only(!self.facing.is(AROUND))
    }
}
