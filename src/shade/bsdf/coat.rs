//! A clear coat.

use super::albedo::{MIN_ROUGHNESS, Reflectance};
use super::facets::{Facets, Reflection};
use super::fresnel::Schlick;
use crate::lanes::{Lanes, Mask, Num, Vector};
use crate::scene::Footprint;

/// Reflectance of a dielectric of index 1.5 at normal incidence.
pub const CLEAR_F0: f32 = 0.04;

/// By how much more of scattered light passes a coat than its mean says: what is below scatters where the coat
/// lets light through, since both reflect at grazing angles. For two smooth dielectrics, the covariance of what
/// passes them over the mean of what passes one.
const LAYERS_ALIKE: f32 = 0.013;

/// Facets that reflect some of the light and let the rest through.
#[derive(Clone, Copy, Debug)]
pub struct Coat<L: Lanes> {
    /// Share of the surface that is coated.
    pub share: Num<L>,
    pub facets: Facets<L>,
    pub reflection: Reflection<L>,
}

/// How coats come by their facets, whatever their own roughness.
#[derive(Clone, Copy, Debug)]
pub struct CoatRoughness<L: Lanes> {
    /// Bumps of the coats, as [`Footprint::bumps`].
    pub bumps: Num<L>,
    /// What reflects with a lesser roughness is a mirror ..
    pub smooth_below: f32,
    /// .. but in these lanes, where it is as rough as that.
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
    /// With a reflectance at normal incidence.
    #[inline(always)]
    pub fn new(share: Num<L>, facets: Facets<L>, f0: f32) -> Self {
        let one = Num::splat(share.lanes(), 1.0);
        let reflection = facets.reflection(Schlick { f0: Vector::grey(one) * f0, f90: one });
        Self { share, facets, reflection }
    }

    /// What is reflected in a single bounce towards directions with this reflectance, and in all further ones.
    #[inline(always)]
    pub fn reflected(&self, at: &Reflectance<L>) -> [Num<L>; 2] {
        let single = self.share * at.single(&self.reflection.fresnel).x;
        [single, self.share * self.reflection.strength.x * at.deficit]
    }

    /// What passes towards directions with this reflectance.
    #[inline(always)]
    pub fn passed(&self, at: &Reflectance<L>) -> Num<L> {
        let [single, further] = self.reflected(at);
        1.0 - single - further
    }

    /// What passes of light that the surface below scatters, on the way in and out and to and fro between.
    #[inline(always)]
    pub fn passed_on_average(&self) -> Num<L> {
        self.passed(&self.facets.mean()) + self.share * LAYERS_ALIKE
    }

    /// Two numbers a and b: what passes is about a − b (1 − z)⁵ towards a cosine z, and on average exactly so.
    #[inline(always)]
    pub fn trend(&self) -> [Num<L>; 2] {
        let Schlick { f0, f90 } = self.reflection.fresnel;
        let slope = self.share * (f90 - f0.x);
        [self.passed(&self.facets.mean()) + slope * (1.0 / 21.0), slope]
    }

    /// The light from `wi` that is reflected × cosine, and the density of mirroring `wo` at a sampled facet; both
    /// 0 beside the lanes `there`, in which `half` lies between the two, and where the coat is a mirror.
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
