//! Who is lit.

use crate::geom::octahedral;
use crate::lanes::{Int, Lanes, Vector};
use crate::shade::Interaction;

/// Bits of each coordinate of a [`Receiver::facing`].
const BITS: u32 = 10;

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

    /// Points at `position` that see what is above their unit `normal`.
    #[inline(always)]
    pub fn new(position: Vector<L>, normal: Vector<L>) -> Self {
        Self { position, facing: octahedral::encode::<L, BITS>(normal) }
    }

    /// The normal as it was stored: all that light sampling knows of it.
    #[inline(always)]
    pub fn normal(&self) -> Vector<L> {
        octahedral::decode::<L, BITS>(self.facing)
    }
}
