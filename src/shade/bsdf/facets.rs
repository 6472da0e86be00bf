//! Reflection from microfacets, complete: one bounce and all further ones.

use super::albedo::{Albedo, MIN_ROUGHNESS, Reflectance};
use super::anisotropic_albedo::AnisotropicAlbedo;
use super::fresnel::{Schlick, schlick_weight};
use super::ggx::Ggx;
use crate::lanes::{Lanes, Mask, Num, OutlinedTask, Vector};
use std::f32::consts::FRAC_1_PI;

/// Facets of one roughness in each lane, whatever their Fresnel term.
#[derive(Clone, Copy, Debug)]
pub struct Facets<L: Lanes> {
    /// Lanes that are not a mirror; of the others the fields below say nothing.
    pub rough: Mask<L>,
    /// The distribution.
    pub ggx: Ggx<L>,
    albedo: Albedo<L>,
    /// Says more than `albedo` where alphas differ.
    brushed: Option<AnisotropicAlbedo<L>>,
    mean: Reflectance<L>,
}

/// A Fresnel term on facets, with the strength of the further bounces: Kulla and Conty's lobe (2017,
/// *Revisiting Physically Based Shading at Imageworks*), `strength · (1 − E(wo)) (1 − E(wi)) /
/// (π (1 − E_mean))` with E the single-bounce share of perfect facets. It is reciprocal and, where
/// nothing is absorbed, exactly what the single bounce lost.
#[derive(Clone, Copy, Debug)]
pub struct Reflection<L: Lanes> {
    /// At a facet.
    pub fresnel: Schlick<L>,
    /// Share of the masked light that comes out after further bounces.
    pub strength: Vector<L>,
}

impl<L: Lanes> Facets<L> {
    /// Facets of a perceptual roughness; below `smooth_below` (at least [`MIN_ROUGHNESS`]) a mirror.
    #[inline(always)]
    pub fn new(roughness: Num<L>, smooth_below: f32) -> Self {
        let rough = roughness.ge(Num::splat(roughness.lanes(), smooth_below.max(MIN_ROUGHNESS)));
        let roughness = roughness.clamp(MIN_ROUGHNESS, 1.0);
        let albedo = Albedo::new(roughness);
        let mean = Reflectance::select(rough, albedo.mean(), mirror_mean(roughness.lanes()));
        let alpha = roughness * roughness;
        Self { rough, ggx: Ggx { alpha: [alpha; 2] }, albedo, brushed: None, mean }
    }

    /// The same, rougher along x: KHR_materials_anisotropy. A mirror is what is smooth along both axes.
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
        let table = match &self.brushed {
            None => self.albedo.at(w.z),
            Some(brushed) => brushed.at(w),
        };
        Reflectance::select(self.rough, table, mirror)
    }

    /// Cosine-weighted mean of [`Facets::at`].
    #[inline(always)]
    pub fn mean(&self) -> Reflectance<L> {
        self.mean
    }

    /// A Fresnel term on these facets.
    #[inline(always)]
    pub fn reflection(&self, fresnel: Schlick<L>) -> Reflection<L> {
        let lost = self.mean.deficit;
        let average = fresnel.average();
        // Light that bounces on is reflected twice at least, and at every bounce a share 1 − lost of
        // it leaves: average² (1 − lost) Σ (average · lost)ⁿ.
        let one = Vector::grey(Num::splat(lost.lanes(), 1.0));
        let strength = (average * average * (1.0 - lost)).over(one - average * lost);
        Reflection { fresnel, strength }
    }

    /// The lobe of further bounces × cosine of `wi`, without its strength, from the reflectances
    /// towards both directions.
    #[inline(always)]
    pub fn bounces(&self, near: &Reflectance<L>, far: &Reflectance<L>, wi_z: Num<L>) -> Num<L> {
        (near.deficit * far.deficit / self.mean.deficit * (wi_z * FRAC_1_PI)).only(self.rough)
    }
}

/// Anisotropic facets, made out of line: hardly any surface is brushed.
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
        let brushed = AnisotropicAlbedo::new(roughness, self.strength);
        let alpha = brushed.alpha();
        let least = self.smooth_below.max(MIN_ROUGHNESS);
        let rough = alpha[0].ge(Num::splat(l, least * least));
        let mean = Reflectance::select(rough, brushed.mean(), mirror_mean(l));
        Facets { rough, ggx: Ggx { alpha }, albedo: Albedo::new(roughness), brushed: Some(brushed), mean }
    }
}

/// Cosine-weighted mean of what a mirror reflects.
#[inline(always)]
fn mirror_mean<L: Lanes>(l: L) -> Reflectance<L> {
    let grazing = Num::splat(l, 1.0 / 21.0);
    Reflectance { deficit: Num::zero(l), grazing }
}

impl<L: Lanes> Reflection<L> {
    /// The share of light that leaves towards all directions, all bounces.
    #[inline(always)]
    pub fn share(&self, at: &Reflectance<L>) -> Vector<L> {
        at.single(&self.fresnel) + self.strength * at.deficit
    }

    /// A mixture, `share` of it `other`.
    #[inline(always)]
    pub fn mix(&self, other: &Self, share: Num<L>) -> Self {
        Self {
            fresnel: self.fresnel.mix(&other.fresnel, share),
            strength: self.strength.lerp(other.strength, share),
        }
    }

    /// Dimmed.
    #[inline(always)]
    pub fn scaled(&self, scale: Num<L>) -> Self {
        let Schlick { f0, f90 } = self.fresnel;
        Self { fresnel: Schlick { f0: f0 * scale, f90: f90 * scale }, strength: self.strength * scale }
    }
}
