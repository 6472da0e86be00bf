//! The reflectance of metals.

use super::super::fresnel::{Schlick, schlick_weight};
use crate::lanes::{Lanes, Num, Vector};

/// The cosine, of 82 degrees, at which the edge's tint is exact.
const EDGE: f32 = 1.0 / 7.0;

/// Schlick's approximation with a tint towards the edge (Kutz, Hašan and Edmondson 2021, *Novel aspects of the Adobe
/// Standard Material*, "F82-tint").
#[derive(Clone, Copy, Debug)]
pub struct Metal<L: Lanes> {
    /// Reflectance at normal incidence, 0..=1.
    pub f0: Vector<L>,
    /// Share of Schlick's reflectance that is left at 82 degrees, 0..=1.
    pub edge: Vector<L>,
    /// Factor of all reflectances, 0..=1.
    pub weight: Num<L>,
}

impl<L: Lanes> Metal<L> {
    /// Factor of μ (1 − μ)⁶ by which the reflectance is below Schlick's.
    #[inline(always)]
    fn dip(&self) -> Vector<L> {
        let l = self.weight.lanes();
        let rest = 1.0 - EDGE;
        let at = self.schlick().at(Num::splat(l, EDGE));
        let white = Vector::grey(Num::splat(l, 1.0));
        at * (white - self.edge) * (1.0 / (EDGE * rest * rest * rest * rest * rest * rest))
    }

    #[inline(always)]
    fn schlick(&self) -> Schlick<L> {
        Schlick { f0: self.f0, f90: Num::splat(self.weight.lanes(), 1.0) }
    }

    /// Reflectance at a cosine.
    #[inline(always)]
    pub fn at(&self, cosine: Num<L>) -> Vector<L> {
        let z = cosine.clamp(0.0, 1.0);
        let low = self.dip() * (z * (1.0 - z) * schlick_weight(z));
        (self.schlick().at(z) - low).clamp(0.0, 1.0) * self.weight
    }

    /// Cosine-weighted mean over the hemisphere.
    #[inline(always)]
    pub fn average(&self) -> Vector<L> {
        (self.schlick().average() - self.dip() * (1.0 / 126.0)).clamp(0.0, 1.0) * self.weight
    }
}
