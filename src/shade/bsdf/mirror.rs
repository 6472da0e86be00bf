//! Perfect specular reflection.

use super::{Smooth, mirrored};
use crate::lanes::{Lanes, Num, Vector};

/// Reflects the share `reflectance` of the light without spread.
#[derive(Clone, Copy, Debug)]
pub struct Mirror<L: Lanes> {
    /// Share of light that is reflected.
    pub reflectance: Vector<L>,
}

impl<L: Lanes> Mirror<L> {
    /// See [`super::Bsdf::smooth`].
    #[inline(always)]
    pub fn smooth(&self, wo: Vector<L>) -> Smooth<L> {
        let none = Vector::zero(wo.lanes());
        Smooth {
            reflected: mirrored(wo),
            reflection: self.reflectance,
            transmitted: none,
            transmission: none,
            eta: Num::splat(wo.lanes(), 1.0),
        }
    }
}
