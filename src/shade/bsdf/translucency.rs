//! Light that the diffuse base of a surface transmits.

use super::Principled;
use super::lobes::Lobes;
use crate::lanes::{Lanes, Num, Vector};
use std::f32::consts::FRAC_1_PI;

impl<L: Lanes> Principled<L> {
    /// Index of refraction of the far side relative to the near side for light that crosses diffusely.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn far_index(&self, l: L) -> Num<L> {
        match &self.transparency {
            Some(through) if !through.thin => through.eta,
            _ => Num::splat(l, 1.0),
        }
    }

    /// Light from `wi` on the other side that the base transmits × |cosine|.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn transmitted(&self, colour: &Vector<L>, lobes: &Lobes<L>, wi: Vector<L>) -> Vector<L> {
        let raised = Vector::new(wi.x, wi.y, wi.z.abs());
        let passed = self.passed_both_ways(lobes, &self.facets.at(raised), raised.z);
        let index = self.far_index(wi.lanes());
        *colour * passed * (raised.z * FRAC_1_PI / (index * index))
    }
}
