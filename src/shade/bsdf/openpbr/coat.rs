//! The coat: a dielectric layer that absorbs light and darkens what is below it.

use super::super::facets::Facets;
use super::super::fresnel;
use super::facet_albedo::QUADRATURE;
use super::interface::{Curves, Interface};
use crate::lanes::{Lanes, Num, Vector, exponential};

/// A coat over a share of the surface.
#[derive(Clone, Copy, Debug)]
pub struct Coat<L: Lanes> {
    /// Covered share, 0..=1.
    pub weight: Num<L>,
    pub facets: Facets<L>,
    pub interface: Interface<L>,
    /// Share of light that passes down and up at normal incidence, 0..=1 for each channel.
    pub colour: Vector<L>,
    /// Strength of darkening, 0..=1.
    pub darkening: Num<L>,
}

/// What the darkening knows of the base, each 0..=1.
#[derive(Clone, Copy, Debug)]
pub struct Below<L: Lanes> {
    /// Albedo at normal incidence.
    pub albedo: Vector<L>,
    /// Roughness: 1 if light leaves the base in all directions, 0 if it mirrors.
    pub roughness: Num<L>,
}

impl<L: Lanes> Coat<L> {
    /// Share of light that is not absorbed on the way down, or up, towards a cosine outside of the coat.
    #[inline(always)]
    pub fn one_way(&self, z: Num<L>) -> Vector<L> {
        let eta = self.interface.eta;
        let inner2 = 1.0 - (1.0 - z * z).clamp(0.0, 1.0) / (eta * eta);
        let power = 0.5 / inner2.clamp(1e-4, 1.0).sqrt();
        let Vector { x, y, z } = self.colour;
        let [red, green, blue] =
            [exponential::pow(x, power), exponential::pow(y, power), exponential::pow(z, power)];
        Vector::new(red, green, blue).clamp(0.0, 1.0)
    }

    /// Factor of light that the base scatters from one direction to another, for its absorption.
    #[inline(always)]
    pub fn absorption(&self, near: Num<L>, far: Num<L>) -> Vector<L> {
        let white = Vector::grey(Num::splat(near.lanes(), 1.0));
        white.lerp(self.one_way(near) * self.one_way(far), self.weight)
    }

    /// Factor of light that crosses the coat once.
    #[inline(always)]
    pub fn crossing(&self, z: Num<L>) -> Vector<L> {
        let white = Vector::grey(Num::splat(z.lanes(), 1.0));
        white.lerp(self.one_way(z), self.weight)
    }

    /// Mean of the coat's Fresnel term over the hemisphere.
    #[inline(always)]
    fn average(&self) -> Num<L> {
        let l = self.weight.lanes();
        let mut mean = Num::zero(l);
        for [z, weight] in QUADRATURE {
            mean += fresnel::dielectric(Num::splat(l, z), self.interface.eta).0 * weight;
        }
        mean
    }

    /// Factor by which reflections between coat and base darken the base. The specification's internal reflection of a
    /// mirroring base depends on one direction; here it is the mean over both.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn darkened(&self, below: &Below<L>, near: Num<L>, far: Num<L>) -> Vector<L> {
        let eta = self.interface.eta;
        let one = Num::splat(near.lanes(), 1.0);
        let diffuse = (1.0 - (1.0 - self.average()) / (eta * eta)).clamp(0.0, 1.0);
        let mirrored = (fresnel::dielectric(near, eta).0 + fresnel::dielectric(far, eta).0) * 0.5;
        let internal = mirrored.lerp(diffuse, below.roughness).clamp(0.0, 0.9999);
        let white = Vector::grey(one);
        let kept = Vector::grey(one - internal).over(white - below.albedo * internal);
        white.lerp(kept, self.weight * self.darkening)
    }

    /// Share that the coat reflects towards a direction.
    #[inline(always)]
    pub fn share(&self, curves: &Curves<L>, w: Vector<L>) -> Num<L> {
        let mut share = self.interface.share(curves, &self.facets, w).x;
        let bent = self.interface.eta.below(1.0);
        if bent.any() {
            // The table blurs the step to total reflection. What it leaves out there must not pass.
            share = Num::select(bent, share.max(self.interface.at(w.z).x), share);
        }
        share * self.weight
    }
}
