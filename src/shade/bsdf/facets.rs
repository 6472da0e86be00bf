//! Reflection by microfacets without loss: a single bounce and all further ones.

use super::albedo::{Albedo, MIN_ROUGHNESS, Reflectance};
use super::anisotropic_albedo::AnisotropicAlbedo;
use super::fresnel::{Schlick, schlick_weight};
use super::ggx::Ggx;
use crate::lanes::{Lanes, Mask, Num, OutlinedTask, Vector};
use std::f32::consts::FRAC_1_PI;

/// Facets of one roughness in each lane, without a Fresnel term.
#[derive(Clone, Copy, Debug)]
pub struct Facets<L: Lanes> {
    /// Lanes that are not a mirror. The distribution and its tables mean nothing in the other lanes.
    pub rough: Mask<L>,
    /// The distribution.
    pub ggx: Ggx<L>,
    albedo: Albedo<L>,
    /// Replaces `albedo` where the two alphas differ.
    anisotropic: Option<AnisotropicAlbedo<L>>,
    mean: Reflectance<L>,
}

/// A Fresnel term on facets, with the strength of the further bounces. Their lobe is that of Kulla and Conty
/// (2017, *Revisiting Physically Based Shading at Imageworks*), `strength · (1 − E(wo)) (1 − E(wi)) / (π (1 −
/// E_mean))`, with E the single-bounce share of perfect facets. It is reciprocal. If nothing is absorbed, it
/// returns exactly what the single bounce lost.
#[derive(Clone, Copy, Debug)]
pub struct Reflection<L: Lanes> {
    /// Fresnel term of a facet.
    pub fresnel: Schlick<L>,
    /// Share of the masked light that leaves after further bounces.
    pub strength: Vector<L>,
}

impl<L: Lanes> Facets<L> {
    /// Facets of a perceptual roughness. Below `smooth_below`, or below [`MIN_ROUGHNESS`], they are a mirror.
    #[inline(always)]
    pub fn new(roughness: Num<L>, smooth_below: f32) -> Self {
        let rough = roughness.ge(Num::splat(roughness.lanes(), smooth_below.max(MIN_ROUGHNESS)));
        let roughness = roughness.clamp(MIN_ROUGHNESS, 1.0);
        let albedo = Albedo::new(roughness);
        let mean = Reflectance::select(rough, albedo.mean(), mirror_mean(roughness.lanes()));
        let alpha = roughness * roughness;
        Self { rough, ggx: Ggx { alpha: [alpha; 2] }, albedo, anisotropic: None, mean }
    }

    /// Facets that are rougher along x: KHR_materials_anisotropy. They are a mirror only if they are smooth
    /// along both axes.
    #[inline(always)]
    pub fn anisotropic(roughness: Num<L>, strength: Num<L>, smooth_below: f32) -> Self {
        roughness.lanes().outlined(Anisotropic { roughness, strength, smooth_below })
    }

    /// Lanes that are rough and have at least this perceptual roughness along the rougher axis.
    #[inline(always)]
    pub fn rougher_than(&self, roughness: f32) -> Mask<L> {
        let [along, _] = self.ggx.alpha;
        self.rough & along.ge(Num::splat(along.lanes(), roughness * roughness))
    }

    /// Single-bounce reflectance towards a direction.
    #[inline(always)]
    pub fn at(&self, w: Vector<L>) -> Reflectance<L> {
        let mirror = Reflectance { deficit: Num::zero(w.lanes()), grazing: schlick_weight(w.z) };
        if self.rough.none() {
            return mirror;
        }
        let table = match &self.anisotropic {
            None => self.albedo.at(w.z),
            Some(anisotropic) => anisotropic.at(w),
        };
        Reflectance::select(self.rough, table, mirror)
    }

    /// Cosine-weighted mean of [`Facets::at`].
    #[inline(always)]
    pub fn mean(&self) -> Reflectance<L> {
        self.mean
    }

    /// The reflection of these facets with a Fresnel term.
    #[inline(always)]
    pub fn reflection(&self, fresnel: Schlick<L>) -> Reflection<L> {
        let lost = self.mean.deficit;
        let average = fresnel.average();
        // Light after the single bounce is reflected at least twice, and at each bounce the share 1 − lost
        // leaves: average² (1 − lost) Σ (average · lost)ⁿ.
        let one = Vector::grey(Num::splat(lost.lanes(), 1.0));
        let strength = (average * average * (1.0 - lost)).over(one - average * lost);
        Reflection { fresnel, strength }
    }

    /// The lobe of further bounces × cosine of `wi`, without its strength. It is computed from the
    /// reflectances towards both directions.
    #[inline(always)]
    pub fn bounces(&self, near: &Reflectance<L>, far: &Reflectance<L>, wi_z: Num<L>) -> Num<L> {
        (near.deficit * far.deficit / self.mean.deficit * (wi_z * FRAC_1_PI)).only(self.rough)
    }
}

/// Constructs anisotropic facets, out of line: few surfaces are anisotropic.
struct Anisotropic<L: Lanes> {
    roughness: Num<L>,
    strength: Num<L>,
    smooth_below: f32,
}

impl<L: Lanes> OutlinedTask<L> for Anisotropic<L> {
    type Output = Facets<L>;

    #[inline(always)]
    fn run(self, l: L) -> Facets<L> {
        let roughness = self.roughness.clamp(MIN_ROUGHNESS, 1.0);
        let anisotropic = AnisotropicAlbedo::new(roughness, self.strength);
        let alpha = anisotropic.alpha();
        let least = self.smooth_below.max(MIN_ROUGHNESS);
        let rough = alpha[0].ge(Num::splat(l, least * least));
        let mean = Reflectance::select(rough, anisotropic.mean(), mirror_mean(l));
        Facets {
            rough,
            ggx: Ggx { alpha },
            albedo: Albedo::new(roughness),
            anisotropic: Some(anisotropic),
            mean,
        }
    }
}

/// Cosine-weighted mean reflectance of a mirror.
#[inline(always)]
fn mirror_mean<L: Lanes>(l: L) -> Reflectance<L> {
    let grazing = Num::splat(l, 1.0 / 21.0);
    Reflectance { deficit: Num::zero(l), grazing }
}

impl<L: Lanes> Reflection<L> {
    /// Share of light that leaves towards a direction, summed over all bounces.
    #[inline(always)]
    pub fn share(&self, at: &Reflectance<L>) -> Vector<L> {
        at.single(&self.fresnel) + self.strength * at.deficit
    }

    /// A mixture of `self` and the share `share` of `other`.
    #[inline(always)]
    pub fn mix(&self, other: &Self, share: Num<L>) -> Self {
        Self {
            fresnel: self.fresnel.mix(&other.fresnel, share),
            strength: self.strength.lerp(other.strength, share),
        }
    }

    /// The reflection multiplied by a factor.
    #[inline(always)]
    pub fn scaled(&self, scale: Num<L>) -> Self {
        let Schlick { f0, f90 } = self.fresnel;
        Self { fresnel: Schlick { f0: f0 * scale, f90: f90 * scale }, strength: self.strength * scale }
    }
}
