//! OpenPBR Surface 1.1: fuzz over a coat over metal and a dielectric base, whose facets may have a thin film. The base
//! is diffuse, translucent, lets light diffuse into its medium, or all of these.
//!
//! # Energy
//! Where the specification leaves the choice, this BSDF is reciprocal, and it never returns more light than arrives.
//! - Fuzz and coat pass `p = (1 − fuzz) (1 − coat)`, with the shares that they reflect towards a direction. Light that
//!   facets below reflect or refract passes by the lesser of `p(wo)` and `p(wi)`.
//! - The diffuse base gets `q = p (1 − E)`, with the share E that the dielectric's facets reflect in a single bounce.
//!   It is multiplied by `q(wo) q(wi) / mean(q)`. The mean is that of the product.
//! - Light lost between facets returns in lobes like those of Kulla and Conty (2017) from metal, and on both sides of a
//!   translucent base. The opaque dielectric passes it to the diffuse base, the coat to the layers below.
//!
//! The shares E are those of the exact Fresnel term, with the film, as [`facet_albedo`] has them for any such term.
#![allow(clippy::manual_map, reason = "closures are not inlined into kernels")]

mod coat;
mod eon;
mod facet_albedo;
mod film;
mod fuzz;
mod interface;
mod metal;
mod outlined;
mod parameters;
mod scatter;
mod subsurface;
#[cfg(test)]
mod tests;
mod through;
mod view;

use super::Smoothness;
use super::facets::Facets;
use crate::lanes::{Lanes, Mask, Num, Vector};
use coat::{Below, Coat};
use eon::Eon;
use film::Film;
use fuzz::Fuzz;
use interface::Interface;
use metal::Metal;
pub use outlined::{Construct, Evaluate, Mirroring, Sampling};
use parameters::{CoatParameters, Parameters};
use subsurface::{Parts, Subsurface};
use through::Through;

/// The greatest magnitude of a facet's amplitude at normal incidence.
const MAX_AMPLITUDE: f32 = 0.9999;

/// The least index of refraction of a medium.
const MIN_INDEX: f32 = 0.1;

/// Share of the light lost between facets that is given back. Tables of the loss are inexact by a few hundredths of it,
/// and nothing may be gained.
const GIVEN_BACK: f32 = 0.96;

/// The same for anisotropic facets, whose tables are coarser.
const GIVEN_BACK_ALONG: f32 = 0.85;

/// Factor of the diffuse base under anisotropic facets, its own or the coat's. Their reflectances are those of
/// isotropic ones in the same azimuth.
const DIFFUSE_ALONG: f32 = 0.97;

/// The greatest anisotropy.
const MAX_ANISOTROPY: f32 = 0.99;

/// The BSDF at points.
#[derive(Clone, Copy, Debug)]
pub struct OpenPbr<L: Lanes> {
    facets: Facets<L>,
    metal: Metal<L>,
    /// Share of metal.
    metalness: Num<L>,
    interface: Interface<L>,
    /// Tint of the reflection by the dielectric's facets from outside.
    tint: Vector<L>,
    diffuse: Eon<L>,
    /// Share of the surface that is opaque dielectric.
    opaque: Num<L>,
    /// Share of the surface that reflects diffusely.
    diffuse_share: Num<L>,
    /// Share of the light lost between facets that is given back, and factor of the diffuse base.
    kept: [f32; 2],
    through: Option<Through<L>>,
    subsurface: Option<Subsurface<L>>,
    coat: Option<(Coat<L>, Below<L>)>,
    fuzz: Option<Fuzz<L>>,
}

/// The index of refraction at which the reflectance at normal incidence is `weight` times that of `eta`; and that
/// reflectance.
#[inline(always)]
fn modulated<L: Lanes>(eta: Num<L>, weight: Num<L>) -> (Num<L>, Num<L>) {
    let amplitude = (eta - 1.0) / (eta + 1.0);
    let share = (weight * amplitude * amplitude).clamp(0.0, 1.0);
    let modulated = share.sqrt().clamp(0.0, MAX_AMPLITUDE).copysign(amplitude);
    ((1.0 + modulated) / (1.0 - modulated), share)
}

/// The index of a medium relative to the coat above it, by its share of the surface. Where the coat's index is higher,
/// the ratio is inverted, since parallel faces have no total reflection.
#[inline(always)]
fn under_coat<L: Lanes>(ior: Num<L>, coat: &CoatParameters<L>) -> Num<L> {
    let ratio = ior / coat.ior;
    ior.lerp(ratio.max(1.0 / ratio), coat.weight)
}

/// An index of refraction within its bounds.
#[inline(always)]
fn bounded<L: Lanes>(index: Num<L>) -> Num<L> {
    index.clamp(MIN_INDEX, 1.0 / MIN_INDEX)
}

/// The film over the base.
#[inline(always)]
fn film_of<L: Lanes>(of: &Parameters<L>) -> Option<Film<L>> {
    let film = of.film?;
    let ior = bounded(film.ior);
    let eta = match of.coat {
        Some(coat) => under_coat(ior, &CoatParameters { ior: bounded(coat.ior), ..coat }),
        None => ior,
    };
    Some(Film { weight: film.weight.clamp(0.0, 1.0), thickness: film.thickness.clamp(0.0, 1e3), ior, eta })
}

/// GGX's alphas of a roughness and an anisotropy.
#[inline(always)]
fn alphas<L: Lanes>(roughness: Num<L>, anisotropy: Num<L>) -> [Num<L>; 2] {
    let rest = 1.0 - anisotropy;
    let along = roughness * roughness * (2.0 / (rest * rest + 1.0)).sqrt();
    [along, rest * along]
}

/// Facets of a roughness and an anisotropy.
#[cfg_attr(not(unoptimised), inline(always))]
fn facets<L: Lanes>(roughness: Num<L>, anisotropy: Option<Num<L>>, smooth_below: f32) -> Facets<L> {
    let Some(anisotropy) = anisotropy else { return Facets::new(roughness, smooth_below) };
    let [along, across] = alphas(roughness, anisotropy.clamp(0.0, MAX_ANISOTROPY));
    let least = super::MIN_ROUGHNESS * super::MIN_ROUGHNESS;
    let across = across.max(Num::splat(across.lanes(), least));
    let along = along.max(across);
    // The tables end at an alpha of 1. Rougher facets lose more than they say.
    let strength = ((along - across) / (1.0 - across).clamp(1e-6, 1.0)).clamp(0.0, 1.0).sqrt();
    let mut facets = Facets::anisotropic(across.clamp(0.0, 1.0).sqrt(), strength, smooth_below);
    facets.ggx.alpha = [along, across];
    facets
}

/// The roughness of the base and its index of refraction, both as a coat changes them.
#[cfg_attr(not(unoptimised), inline(always))]
fn below_coat<L: Lanes>(of: &Parameters<L>, ior: Num<L>) -> [Num<L>; 2] {
    let roughness = of.specular_roughness.clamp(0.0, 1.0);
    let Some(coat) = &of.coat else { return [roughness, ior] };
    let coat = CoatParameters { ior: bounded(coat.ior), weight: coat.weight.clamp(0.0, 1.0), ..*coat };
    let over = coat.roughness.clamp(0.0, 1.0).squared().squared();
    let rougher = (roughness.squared().squared() + over * 2.0).clamp(0.0, 1.0).sqrt().sqrt();
    [roughness.lerp(rougher, coat.weight), under_coat(ior, &coat)]
}

impl<L: Lanes> OpenPbr<L> {
    /// The BSDF of parameters. `wo` is outside of the body in the lanes of `outside`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn of(of: &Parameters<L>, outside: Mask<L>, smoothness: Smoothness) -> Self {
        let l = of.base.lanes();
        let (one, white) = (Num::splat(l, 1.0), Vector::grey(Num::splat(l, 1.0)));
        let share = |x: Num<L>| x.clamp(0.0, 1.0);
        let metalness = share(of.base_metalness);
        let weight = of.specular_weight.clamp(0.0, f32::MAX);
        let ior = bounded(of.specular_ior);
        let [roughness, relative] = below_coat(of, ior);
        let facets = facets(roughness, of.specular_anisotropy, smoothness.mirror_below);
        let (eta, normal) = modulated(relative, weight);
        let film = film_of(of);
        let base = of.base.clamp(0.0, 1.0);
        let metal = Metal { f0: base, edge: of.specular_color.clamp(0.0, 1.0), weight: share(weight) };
        let (mut opaque, mut through, mut albedo) = (one - metalness, None, base);
        let (bent, _) = modulated(ior, weight);
        if let Some(subsurface) = &of.subsurface {
            albedo = albedo.lerp(subsurface.color.clamp(0.0, 1.0), share(subsurface.weight));
        }
        if let Some((weight_of, tint)) = of.transmission {
            let weight_of = share(weight_of);
            let rough = facets.rougher_than(smoothness.clear_below);
            let outside = (!of.thin_walled).then_some(outside);
            through = Some(Through::new(opaque * weight_of, tint.clamp(0.0, 1.0), bent, outside, rough));
            albedo = albedo.lerp(white, weight_of);
            opaque *= one - weight_of;
        }
        let mut parts = Parts { metalness, opaque, diffuse: opaque, through };
        let subsurface = match &of.subsurface {
            Some(_) if of.thin_walled || !smoothness.enters_media => parts.shown(of),
            Some(_) => parts.entered(of, bent, !outside),
            None => None,
        };
        let Parts { metalness, opaque, diffuse, through } = parts;
        let coat = match of.coat {
            Some(coat) => {
                let own = share(of.specular_roughness);
                let dielectric = white * normal + albedo * (one - normal);
                let below = Below {
                    albedo: dielectric.lerp(metal.at(one), metalness),
                    roughness: one.lerp(own, normal).lerp(own, metalness),
                };
                Some((Coat::of(&coat, smoothness.mirror_below), below))
            }
            None => None,
        };
        let is_along =
            of.specular_anisotropy.is_some() || of.coat.is_some_and(|coat| coat.anisotropy.is_some());
        let fuzz = match of.fuzz {
            Some(of) => Some(Fuzz::new(share(of.weight), of.color.clamp(0.0, 1.0), share(of.roughness))),
            None => None,
        };
        Self {
            facets,
            metal,
            metalness,
            interface: Interface { eta, film },
            tint: of.specular_color.clamp(0.0, 1.0),
            diffuse: Eon { colour: base, roughness: share(of.base_diffuse_roughness) },
            opaque,
            diffuse_share: diffuse,
            kept: [
                if of.specular_anisotropy.is_some() { GIVEN_BACK_ALONG } else { GIVEN_BACK },
                if is_along { DIFFUSE_ALONG } else { 1.0 },
            ],
            through,
            subsurface,
            coat,
            fuzz,
        }
    }

    /// True if light sampling must also consider light from below the surface.
    #[inline(always)]
    pub fn is_frosted(&self) -> bool {
        matches!(&self.through, Some(through) if through.frosted.any())
            || matches!(&self.subsurface, Some(subsurface) if subsurface.is_crossed())
    }

    /// The surface with these shares of the light that goes straight on.
    #[inline(always)]
    pub fn with_unpassed(self, unpassed: Vector<L>) -> Self {
        let through = match self.through {
            Some(through) => Some(Through { unpassed, ..through }),
            None => None,
        };
        Self { through, ..self }
    }

    /// Points at which one sees other surfaces rather than this one.
    #[inline(always)]
    pub fn shows_others(&self, polished: f32, least_diffuse: f32) -> Mask<L> {
        let l = self.opaque.lanes();
        if self.fuzz.is_some() {
            return Mask::splat(l, false);
        }
        let mut diffuse = self.diffuse.colour.max_element() * self.diffuse_share;
        if let Some(subsurface) = &self.subsurface {
            diffuse += subsurface.weight;
        }
        !(self.facets.rougher_than(polished) | diffuse.above(least_diffuse))
    }

    /// Reflectance of a facet of metal at a cosine.
    #[inline(always)]
    fn metal_at(&self, cosine: Num<L>) -> Vector<L> {
        let bare = self.metal.at(cosine);
        match &self.interface.film {
            None => bare,
            Some(film) => {
                let Metal { f0, edge, weight } = self.metal;
                bare.lerp(film.on_metal(f0, edge, cosine) * weight, film.weight)
            }
        }
    }
}

impl<L: Lanes> Coat<L> {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn of(of: &CoatParameters<L>, smooth_below: f32) -> Self {
        let share = |x: Num<L>| x.clamp(0.0, 1.0);
        Self {
            weight: share(of.weight),
            facets: facets(share(of.roughness), of.anisotropy, smooth_below),
            interface: Interface { eta: of.ior.clamp(MIN_INDEX, 1.0 / MIN_INDEX), film: None },
            colour: of.color.clamp(0.0, 1.0),
            darkening: share(of.darkening),
        }
    }
}
