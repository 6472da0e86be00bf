//! Reflection from microfacets, complete: one bounce and all further ones.

use super::albedo::{Albedo, MIN_ROUGHNESS, Reflectance};
use super::fresnel::{Schlick, schlick_weight};
use super::ggx::Ggx;
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// Facets of one roughness, whatever their Fresnel term.
#[derive(Clone, Copy, Debug)]
pub struct Facets {
    /// `None` for a mirror.
    rough: Option<(Ggx, Albedo)>,
}

/// A Fresnel term on facets, with the strength of the further bounces: Kulla and Conty's lobe (2017,
/// *Revisiting Physically Based Shading at Imageworks*), `strength · (1 − E(wo)) (1 − E(wi)) /
/// (π (1 − E_mean))` with E the single-bounce share of perfect facets. It is reciprocal and, where
/// nothing is absorbed, exactly what the single bounce lost.
#[derive(Clone, Copy, Debug)]
pub struct Reflection {
    /// At a facet.
    pub fresnel: Schlick,
    /// Share of the masked light that comes out after further bounces.
    pub strength: Vec3,
}

impl Facets {
    /// Facets of a perceptual roughness; below `smooth_below` (at least [`MIN_ROUGHNESS`]) a mirror.
    pub fn new(roughness: f32, smooth_below: f32) -> Self {
        let rough = (roughness >= smooth_below.max(MIN_ROUGHNESS))
            .then(|| (Ggx { alpha: roughness * roughness }, Albedo::new(roughness)));
        Self { rough }
    }

    /// The distribution, `None` for a mirror.
    pub fn ggx(&self) -> Option<&Ggx> {
        self.rough.as_ref().map(|(ggx, _)| ggx)
    }

    /// Single-bounce reflectance towards a cosine.
    pub fn at(&self, z: f32) -> Reflectance {
        match &self.rough {
            Some((_, albedo)) => albedo.at(z),
            None => Reflectance { deficit: 0.0, grazing: schlick_weight(z) },
        }
    }

    /// Cosine-weighted mean of [`Facets::at`].
    pub fn mean(&self) -> Reflectance {
        match &self.rough {
            Some((_, albedo)) => albedo.mean(),
            None => Reflectance { deficit: 0.0, grazing: 1.0 / 21.0 },
        }
    }

    /// A Fresnel term on these facets.
    pub fn reflection(&self, fresnel: Schlick) -> Reflection {
        let lost = self.mean().deficit;
        let average = fresnel.average();
        // Light that bounces on is reflected twice at least, and at every bounce a share 1 − lost of
        // it leaves: average² (1 − lost) Σ (average · lost)ⁿ.
        let strength = average * average * (1.0 - lost) / (Vec3::ONE - average * lost);
        Reflection { fresnel, strength }
    }

    /// The lobe of further bounces × cosine of `wi`, without its strength.
    pub fn bounces(&self, wo_z: f32, wi_z: f32) -> f32 {
        let Some((_, albedo)) = &self.rough else { return 0.0 };
        let lost = albedo.mean().deficit;
        albedo.at(wo_z).deficit * albedo.at(wi_z).deficit / lost * FRAC_1_PI * wi_z
    }
}

impl Reflection {
    /// The share of light that leaves towards all directions, all bounces.
    pub fn share(&self, at: &Reflectance) -> Vec3 {
        at.single(&self.fresnel) + self.strength * at.deficit
    }

    /// A mixture, `share` of it `other`.
    pub fn mix(&self, other: &Self, share: f32) -> Self {
        Self {
            fresnel: self.fresnel.mix(&other.fresnel, share),
            strength: self.strength.lerp(other.strength, share),
        }
    }

    /// Dimmed.
    pub fn scaled(&self, scale: f32) -> Self {
        let Schlick { f0, f90 } = self.fresnel;
        Self { fresnel: Schlick { f0: f0 * scale, f90: f90 * scale }, strength: self.strength * scale }
    }
}
