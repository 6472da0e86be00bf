//! A clear coat.

use super::albedo::{MIN_ROUGHNESS, Reflectance};
use super::facets::{Facets, Reflection};
use super::fresnel::Schlick;
use crate::lanes::{Lanes, Mask, Num, Vector};
use crate::scene::Footprint;

/// Reflectance of a dielectric of index of refraction 1.5 at normal incidence.
pub const CLEAR_F0: f32 = 0.04;

/// Scattered light passes a coat more than the coat's mean suggests, by this amount. The surface below
/// scatters where the coat passes light, since both reflect at grazing angles. The value is that of two
/// smooth dielectrics: the covariance of the shares that they pass over the mean share of one.
const LAYER_COVARIANCE: f32 = 0.013;

/// Facets that reflect some of the light and pass the rest.
#[derive(Clone, Copy, Debug)]
pub struct Coat<L: Lanes> {
    /// Share of the surface that the coat covers.
    pub share: Num<L>,
    pub facets: Facets<L>,
    pub reflection: Reflection<L>,
}

/// Limits and bumps that turn a coat's roughness into its facets.
#[derive(Clone, Copy, Debug)]
pub struct CoatRoughness<L: Lanes> {
    /// [`Footprint::bumps`] of the coats.
    pub bumps: Num<L>,
    /// Coats of lower roughness are mirrors, except in the lanes of `spread`.
    pub smooth_below: f32,
    /// Lanes in which a smoother coat gets the roughness `smooth_below`, so that it is not a mirror.
    pub spread: Mask<L>,
}

impl<L: Lanes> CoatRoughness<L> {
    /// The facets of coats of this roughness.
    #[inline(always)]
    pub fn facets(&self, roughness: Num<L>) -> Facets<L> {
        let footprint = Footprint { bumps: self.bumps, ..Footprint::point(roughness.lanes()) };
        let mut roughness = footprint.roughened(roughness);
        if self.spread.any() {
            let least = Num::splat(roughness.lanes(), self.smooth_below.max(MIN_ROUGHNESS));
            roughness = Num::select(self.spread, roughness.max(least), roughness);
        }
        Facets::new(roughness, self.smooth_below)
    }
}

impl<L: Lanes> Coat<L> {
    /// A coat with reflectance `f0` at normal incidence.
    #[inline(always)]
    pub fn new(share: Num<L>, facets: Facets<L>, f0: f32) -> Self {
        let one = Num::splat(share.lanes(), 1.0);
        let reflection = facets.reflection(Schlick { f0: Vector::grey(one) * f0, f90: one });
        Self { share, facets, reflection }
    }

    /// Shares reflected in a single bounce, and in all further bounces, towards directions of this
    /// reflectance.
    #[inline(always)]
    pub fn reflected(&self, at: &Reflectance<L>) -> [Num<L>; 2] {
        let single = self.share * at.single(&self.reflection.fresnel).x;
        [single, self.share * self.reflection.strength.x * at.deficit]
    }

    /// Share that passes towards directions of this reflectance.
    #[inline(always)]
    pub fn passed(&self, at: &Reflectance<L>) -> Num<L> {
        let [single, further] = self.reflected(at);
        1.0 - single - further
    }

    /// Mean share that passes of light scattered by the surface below, in and out, bounces between the layers
    /// included.
    #[inline(always)]
    pub fn passed_on_average(&self) -> Num<L> {
        self.passed(&self.facets.mean()) + self.share * LAYER_COVARIANCE
    }

    /// Two numbers a and b. Towards a cosine z approximately a − b (1 − z)⁵ passes. The mean of this is
    /// exact.
    #[inline(always)]
    pub fn linear_fit(&self) -> [Num<L>; 2] {
        let Schlick { f0, f90 } = self.reflection.fresnel;
        let slope = self.share * (f90 - f0.x);
        [self.passed(&self.facets.mean()) + slope * (1.0 / 21.0), slope]
    }

    /// Reflection × cosine for light from `wi`, and the density of mirroring `wo` at a sampled facet. Both
    /// are 0 outside of the lanes `there` and where the coat is a mirror. In the lanes of `there`, `half` is
    /// the half vector of both directions.
    #[inline(always)]
    pub fn evaluate(
        &self,
        wo: Vector<L>,
        wi: Vector<L>,
        half: Vector<L>,
        near: &Reflectance<L>,
        there: Mask<L>,
    ) -> (Vector<L>, Num<L>) {
        let rough = self.facets.rough & there;
        if rough.none() {
            return (Vector::zero(wo.lanes()), Num::zero(wo.lanes()));
        }
        let (perfect, density) = self.facets.ggx.evaluate(wo, wi, half);
        let bounces = self.reflection.strength * self.facets.bounces(near, &self.facets.at(wi), wi.z);
        let light = (self.reflection.fresnel.at(half.dot(wo)) * perfect + bounces) * self.share;
        (light.only(rough), density.only(rough))
    }
}
