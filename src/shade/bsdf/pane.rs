//! Thin clear walls that rays pass by chance.
//!
//! A wall lets a share of the light go straight on. A ray passes it with the least of the channels' shares as its
//! chance, keeps its weight, and has met nothing. What it finds behind is then weighted as if the wall were not there,
//! so light samples and scattered rays find lamps behind windows alike. Rays that stay meet the rest of the wall's
//! light, divided by their chance of staying.

use super::transparency::Transparency;
use super::{MIN_ROUGHNESS, OpenPbr, Principled, Sample, Smooth, openpbr, outlined};
use crate::lanes::{Lanes, Num, Vector};
use crate::scene::{self, Material, Scalar, Surface};

/// A wall as those rays see it from one direction that have not passed it.
#[derive(Clone, Copy, Debug)]
pub struct Pane<L: Lanes> {
    /// The wall without the light that passes.
    wall: Wall<L>,
    /// The chance that a ray passes.
    chance: Num<L>,
    /// The reciprocal of the chance that it stays.
    weight: Num<L>,
}

/// The BSDF of a wall.
#[derive(Clone, Copy, Debug)]
#[allow(clippy::large_enum_variant, reason = "one is made for many rays, and nothing is allocated for it")]
pub(super) enum Wall<L: Lanes> {
    Principled(Principled<L>),
    OpenPbr(OpenPbr<L>),
}

impl<L: Lanes> Wall<L> {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn smooth(&self, wo: Vector<L>) -> Smooth<L> {
        match self {
            Self::Principled(surface) => wo.lanes().outlined(outlined::Mirroring { surface, wo }),
            Self::OpenPbr(surface) => wo.lanes().outlined(openpbr::Mirroring { surface, wo }),
        }
    }

    /// The wall with these shares of its straight light.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn scaled(self, left: Vector<L>) -> Self {
        match self {
            Self::Principled(mut surface) => {
                if let Some(through) = surface.transparency {
                    let tint = through.tint * left;
                    surface.transparency = Some(Transparency { tint, ..through });
                }
                Self::Principled(surface)
            }
            Self::OpenPbr(surface) => Self::OpenPbr(surface.with_unpassed(left)),
        }
    }
}

impl<L: Lanes> Pane<L> {
    /// A wall that [`is_pane`] as rays from `wo` see it that stay.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn new(wall: Wall<L>, wo: Vector<L>) -> Self {
        let one = Num::splat(wo.lanes(), 1.0);
        let straight = wall.smooth(wo).transmission;
        let chance = straight.x.min(straight.y).min(straight.z).clamp(0.0, 1.0);
        // Exactly 0 for channels that pass no more than the least.
        let left = (straight - Vector::grey(chance)).over(straight);
        let left = Vector::select(chance.above(0.0), left, Vector::grey(one));
        let stays = one - chance;
        Self { wall: wall.scaled(left), chance, weight: (one / stays).only(stays.above(0.0)) }
    }

    /// The chance that a ray passes, 0..=1.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn chance(&self) -> Num<L> {
        self.chance
    }

    /// The wall, whose light is to be divided by the chance of staying.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn wall(&self) -> &Wall<L> {
        &self.wall
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn evaluate(&self, wo: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        let (value, pdf) = match &self.wall {
            Wall::Principled(surface) => wo.lanes().outlined(outlined::Evaluate { surface, wo, wi }),
            Wall::OpenPbr(surface) => wo.lanes().outlined(openpbr::Evaluate { surface, wo, wi }),
        };
        (value * self.weight, pdf)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn sample(&self, wo: Vector<L>, u: Num<L>, u2: [Num<L>; 2]) -> Sample<L> {
        let sample = match &self.wall {
            Wall::Principled(surface) => wo.lanes().outlined(outlined::Sampling { surface, wo, u, u2 }),
            Wall::OpenPbr(surface) => wo.lanes().outlined(openpbr::Sampling { surface, wo, u, u2 }),
        };
        Sample { weight: sample.weight * self.weight, ..sample }
    }

    /// What the wall mirrors of all light, also of the light of rays that pass.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn mirrored_share(&self, wo: Vector<L>) -> Vector<L> {
        self.wall.smooth(wo).reflection
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn smooth(&self, wo: Vector<L>) -> Smooth<L> {
        let smooth = self.wall.smooth(wo);
        let (reflection, transmission) = (smooth.reflection * self.weight, smooth.transmission * self.weight);
        Smooth { reflection, transmission, ..smooth }
    }
}

/// True if rays may pass a material as they pass clear walls: it is thin, transparent and smooth, the same everywhere,
/// and neither emits light nor bounds a medium.
///
/// A wall with textures or a normal map is hit. What is read of a texture depends on the ray's width, so rays and light
/// samples would pass with different chances, and their sum would not be the light that there is.
pub fn is_pane(material: &Material) -> bool {
    let is_clear = match &material.surface {
        Surface::Principled(surface) => is_clear(surface),
        Surface::OpenPbr(surface) => {
            surface.thin_walled
                && surface.transmission_weight.factor != 0.0
                && surface.specular_roughness.factor < MIN_ROUGHNESS
                && surface.textures().next().is_none()
        }
        _ => false,
    };
    is_clear && is_bare(material)
}

/// True if a material may mirror light without spread, in the same way everywhere, and lets none into a body.
pub fn mirrors_evenly(material: &Material) -> bool {
    let is_smooth = |roughness: f32| roughness < MIN_ROUGHNESS;
    let mirrors = match &material.surface {
        Surface::Mirror { reflectance } => reflectance.is_constant(),
        Surface::Principled(surface) => {
            let coat = surface.clearcoat.factor != 0.0 && is_smooth(surface.clearcoat_roughness.factor);
            (coat || is_smooth(roughness(surface)))
                && (surface.thin || surface.transmission.factor == 0.0)
                && surface.coats.is_empty()
                && is_even(surface)
        }
        Surface::OpenPbr(surface) => {
            let coat = surface.coat.as_ref().is_some_and(|coat| is_smooth(coat.roughness.factor));
            (coat || is_smooth(surface.specular_roughness.factor))
                && (surface.thin_walled || surface.transmission_weight.factor == 0.0)
                && !surface.base_color.vertex
                && surface.textures().next().is_none()
        }
        _ => false,
    };
    mirrors && is_bare(material)
}

/// True if a material neither emits light nor bounds a medium, and has no normal map.
fn is_bare(material: &Material) -> bool {
    material.emission.is_none() && material.normal_map.is_none() && material.medium.is_none()
}

fn is_clear(surface: &scene::Principled) -> bool {
    surface.thin
        && surface.transmission.factor != 0.0
        && roughness(surface) < MIN_ROUGHNESS
        && is_even(surface)
}

/// Perceptual roughness of an even surface.
fn roughness(surface: &scene::Principled) -> f32 {
    surface.glossiness.map_or(surface.roughness.factor, |glossiness| 1.0 - glossiness.factor)
}

/// True if what decides about a surface's mirrored light and its straight light is the same everywhere.
fn is_even(surface: &scene::Principled) -> bool {
    let is_even = |number: &Scalar| number.texture.is_none();
    let mut numbers = vec![&surface.metallic, &surface.roughness, &surface.specular, &surface.transmission];
    numbers.extend([&surface.clearcoat, &surface.clearcoat_roughness]);
    numbers.extend(&surface.glossiness);
    let mut colours = vec![&surface.base_colour, &surface.specular_colour];
    let mut is_covered_evenly = surface.coat_normal_map.is_none() && surface.anisotropy.is_none();
    if let Some(sheen) = &surface.sheen {
        numbers.push(&sheen.roughness);
        colours.push(&sheen.colour);
    }
    if let Some(film) = &surface.iridescence {
        numbers.push(&film.strength);
        is_covered_evenly &= film.thickness_texture.is_none();
    }
    is_covered_evenly
        && numbers.into_iter().all(is_even)
        && colours.into_iter().all(scene::Colour::is_constant)
}
