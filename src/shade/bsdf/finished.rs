//! The principled BSDF of a finish that user code computes.

use super::coat::{CLEAR_F0, Coat, CoatRoughness};
use super::facets::Facets;
use super::fresnel::Schlick;
use super::iridescence::Film;
use super::sheen::Sheen;
use super::transparency::Transparency;
use super::{Principled, Smoothness};
use crate::lanes::{Lanes, Mask, Num, Vector};
use crate::scene::{Effects, Finish, Transmission};
use crate::shade::CoatShape;

/// The greatest thickness of a film; colours of thicker ones are white.
const MAX_THICKNESS_NM: f32 = 1e6;

/// The greatest index of refraction of a film.
const MAX_FILM_INDEX: f32 = 10.0;

impl<L: Lanes> Principled<L> {
    /// The BSDFs of a computed finish. `wo` is outside of the body in the lanes of `outside`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn finished(
        finish: &Finish<L>,
        effects: &Effects,
        coat_shape: &Option<CoatShape<L>>,
        outside: Mask<L>,
        smoothness: Smoothness,
    ) -> Self {
        let smooth_below = smoothness.mirror_below;
        let l = finish.colour.lanes();
        let one = Num::splat(l, 1.0);
        let base = finish.colour.clamp(0.0, 1.0);
        let metallic = finish.metallic.clamp(0.0, 1.0);
        let roughness = finish.roughness.clamp(0.0, 1.0);
        let facets = match effects.has_anisotropy {
            false => Facets::new(roughness, smooth_below),
            true => Facets::anisotropic(roughness, finish.anisotropy.clamp(0.0, 1.0), smooth_below),
        };
        // A wall has the clear coat's index of refraction.
        let (ior, reflectance, outside) = match effects.transmission {
            Some(Transmission::Body { ior }) => {
                (ior, Num::splat(l, ((ior - 1.0) / (ior + 1.0)).powi(2)), Some(outside))
            }
            Some(Transmission::ThinWall) | None => (1.5, finish.reflectance.clamp(0.0, 1.0), None),
        };
        let specular = finish.specular.clamp(0.0, 1.0);
        let f0 = (finish.specular_tint * reflectance).clamp(0.0, 1.0) * specular;
        let layer = facets.reflection(Schlick { f0, f90: specular });
        let metal = facets.reflection(Schlick { f0: base, f90: one });
        let (mut outer, mut opaque, mut transparency) = (layer, one - metallic, None);
        let mut leaving = Mask::splat(l, false);
        if effects.transmission.is_some() {
            let share = finish.transmission.clamp(0.0, 1.0);
            let spread = facets.rougher_than(smoothness.clear_below);
            let through = Transparency::new(opaque * share, base, ior, outside, spread);
            leaving = through.leaving;
            outer = layer.scaled(Num::select(through.has_own_reflection(), one - share, one));
            opaque *= one - share;
            transparency = Some(through);
        }
        let (translucency, diffuse) = match effects.has_diffuse_transmission {
            false => (None, base * opaque),
            true => {
                let (crosses, stays) = crossing(finish, base, opaque, ior, leaving);
                (Some(crosses), stays)
            }
        };
        let film = match effects.has_film {
            false => None,
            true => Some(finished_film(finish, &transparency, leaving)),
        };
        let sheen = match effects.has_sheen {
            false => None,
            true => Some(Sheen::of(finish.sheen.clamp(0.0, 1.0), finish.sheen_roughness.clamp(0.0, 1.0))),
        };
        let coat_facets = coat_facets(finish, coat_shape, &facets, smooth_below);
        Self {
            facets,
            reflection: outer.mix(&metal, metallic),
            layer,
            diffuse,
            translucency,
            transparency,
            film,
            sheen,
            coat: Some(Coat::new(finish.clearcoat.clamp(0.0, 1.0), coat_facets, CLEAR_F0)),
            stack: None,
            coat_normal: coat_shape.map(|shape| shape.normal),
        }
    }
}

/// The light that the diffuse base of a finish transmits, and the albedo of what it reflects.
#[cfg_attr(not(unoptimised), inline(always))]
fn crossing<L: Lanes>(
    finish: &Finish<L>,
    base: Vector<L>,
    opaque: Num<L>,
    ior: f32,
    leaving: Mask<L>,
) -> (Vector<L>, Vector<L>) {
    let one = Num::splat(opaque.lanes(), 1.0);
    let share = finish.diffuse_transmission.clamp(0.0, 1.0);
    let mut crosses = finish.diffuse_transmission_colour.clamp(0.0, 1.0) * (opaque * share);
    let mut diffuse = base * (opaque * (one - share));
    if leaving.any() {
        // There are more directions inside than outside by the squared index, so some light returns.
        let returned = crosses * (one * (1.0 - 1.0 / (ior * ior))).only(leaving);
        diffuse += returned;
        crosses = crosses - returned;
    }
    (crosses, diffuse)
}

/// The film of a finish, outside of bodies.
#[cfg_attr(not(unoptimised), inline(always))]
fn finished_film<L: Lanes>(
    finish: &Finish<L>,
    transparency: &Option<Transparency<L>>,
    leaving: Mask<L>,
) -> Film<L> {
    let strength = finish.film.clamp(0.0, 1.0).only(!leaving);
    let thickness_nm = finish.film_thickness.clamp(0.0, MAX_THICKNESS_NM);
    let film = Film::of(strength, thickness_nm, finish.film_ior.clamp(1.0, MAX_FILM_INDEX));
    let Some(through) = transparency else { return film };
    let one = Num::splat(strength.lanes(), 1.0);
    film.on(Num::select(through.has_own_reflection() & !leaving, one - through.share, one))
}

/// The facets of a finish's coat.
#[cfg_attr(not(unoptimised), inline(always))]
fn coat_facets<L: Lanes>(
    finish: &Finish<L>,
    shape: &Option<CoatShape<L>>,
    below: &Facets<L>,
    smooth_below: f32,
) -> Facets<L> {
    let roughness = finish.clearcoat_roughness.clamp(0.0, 1.0);
    match shape {
        None => Facets::new(roughness, smooth_below),
        // Only one mirrored direction is possible. If the facets below are smooth, it is theirs.
        Some(CoatShape { bumps, .. }) => {
            CoatRoughness { bumps: *bumps, smooth_below, spread: !below.rough }.facets(roughness)
        }
    }
}
