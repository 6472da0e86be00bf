//! BSDFs computed by user code.

use super::Sample;
use crate::lanes::{Lanes, Mask, Num, Vector};
use crate::scene::{Points, Scattered, ScatteringSurface};

/// A [`crate::scene::Scattering`] at points.
#[derive(Clone, Copy, Debug)]
pub struct Scattering<'s, L: Lanes> {
    /// The surface.
    pub surface: &'s ScatteringSurface,
    /// The surface points.
    pub points: Points<'s, L>,
}

impl<L: Lanes> Scattering<'_, L> {
    /// See [`super::Bsdf::evaluate`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn evaluate(&self, wo: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        let (value, pdf) = self.surface.evaluate(&self.points, wo, wi);
        let above = if self.surface.transmits() { Mask::splat(wi.lanes(), true) } else { wi.z.above(0.0) };
        (value.only(above), pdf.only(above))
    }

    /// See [`super::Bsdf::sample`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn sample(&self, wo: Vector<L>, u: Num<L>, u2: [Num<L>; 2]) -> Sample<L> {
        let Scattered { wi, weight, pdf } = self.surface.sample(&self.points, wo, u, u2);
        let (above, below) = (wi.z.above(0.0), wi.z.below(0.0));
        let there = if self.surface.transmits() { above | below } else { above };
        Sample {
            valid: there & pdf.above(0.0),
            wi,
            weight,
            pdf,
            specular: Mask::splat(wo.lanes(), false),
            crosses: below,
            eta: Num::splat(wo.lanes(), 1.0),
        }
    }
}
