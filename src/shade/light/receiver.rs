//! Points that receive light.

use crate::geom::octahedral;
use crate::lanes::{Int, Lanes, Vector};
use crate::shade::Interaction;

/// Bits of each of the two coordinates of [`Receiver::facing`].
const BITS: u32 = 10;

/// The facing of a receiver lit from both sides. Two codes mean the octahedron's lowest corner; no normal
/// uses this one.
const TWO_SIDED: u32 = 0;
const LOWEST: u32 = (1 << (2 * BITS)) - 1;

/// Points for which a light is chosen, with all data that the choice depends on. They are small enough for a
/// path to carry to its next hit, where MIS needs the probability of having chosen that light.
#[derive(Clone, Copy, Debug)]
pub struct Receiver<L: Lanes> {
    /// Start of scattered rays.
    pub position: Vector<L>,
    /// Octahedral encoding of [`Interaction::facing`] in [`Receiver::FACING_BITS`] bits.
    pub facing: Int<L>,
}

impl<L: Lanes> Receiver<L> {
    /// Number of bits of `facing` that are used.
    pub const FACING_BITS: u32 = 2 * BITS;

    /// The receivers at surface points.
    #[inline(always)]
    pub fn of(at: &Interaction<L>) -> Self {
        Self::new(at.origin(at.raised, at.normal), at.facing())
    }

    /// Receivers without a facing. They suffice where there are few lights, since then only the position is
    /// used.
    #[inline(always)]
    pub fn position_of(at: &Interaction<L>) -> Self {
        let position = at.origin(at.raised, at.normal);
        Self { position, facing: Int::splat(position.lanes(), TWO_SIDED) }
    }

    /// Receivers at `position` that are lit from above their unit `normal`.
    #[inline(always)]
    pub fn new(position: Vector<L>, normal: Vector<L>) -> Self {
        let facing = octahedral::encode::<L, BITS>(normal);
        let lowest = Int::splat(facing.lanes(), LOWEST);
        Self { position, facing: Int::select(facing.is(TWO_SIDED), lowest, facing) }
    }

    /// The same receivers, lit from both sides.
    #[inline(always)]
    pub fn two_sided(self) -> Self {
        Self { facing: Int::splat(self.facing.lanes(), TWO_SIDED), ..self }
    }

    /// The decoded normal, which light sampling uses instead of the exact one; 0 for receivers lit from both
    /// sides.
    #[inline(always)]
    pub fn normal(&self) -> Vector<L> {
        octahedral::decode::<L, BITS>(self.facing).only(!self.facing.is(TWO_SIDED))
    }
}
