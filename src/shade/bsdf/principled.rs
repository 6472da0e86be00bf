//! glTF's metallic-roughness surface. Coats lie over sheen, and sheen over a mixture of metal and dielectric.
//! The dielectric lies over a diffuse or transparent base.
//!
//! # Energy
//! E is the share that a layer reflects in all its bounces. The single bounce of GGX facets is tabulated;
//! further bounces have their own lobe ([`super::facets`]). The rest of the light reaches the layer below:
//! - The coat passes `p = 1 − E_coat`. Light scattered by the surface below passes by `p(wo) p(wi) / p_mean`.
//!   Light reflected or refracted by its facets passes by the lesser of `p(wo)` and `p(wi)`, which are equal
//!   for a mirror. Further coats do the same ([`super::coat_stack`]).
//! - Sheen passes light scattered by the surface below by `p(wo) p(wi) / p_mean`, as coats do, and of light that facets
//!   reflect or refract the lesser of both shares.
//! - The dielectric layer passes `(1 − E(wo)) (1 − E(wi)) / (1 − E_mean)` to the diffuse base. This is
//!   reciprocal and integrates to `1 − E(wo)`. It passes `1 − E(wo)` to the transparent base. Where glossiness
//!   is given, E is that of the brightest channel.
//! - Of light that the diffuse base gets, a share leaves on the other side. The layers pass it as they pass
//!   light that leaves at the same angle on this side. Where a body refracts, the crossing radiance changes by the
//!   squared index, as everywhere. From inside, only the reciprocal of that square of it crosses, and the rest is
//!   scattered back.
//!
//! So a white surface returns all light that falls on it, at every roughness. Exceptions are sheen over facets,
//! which loses some of their light, and a coat over rough facets, which loses up to a twelfth.
//!
//! A thin film replaces the Fresnel term of single bounces, but not that of further bounces. Under a film the
//! base gets the lesser of the shares that pass towards `wo` and `wi` in the brightest channel.
//!
//! The BSDF is reciprocal with two exceptions. A body's film has no effect from inside. Smooth bodies reflect
//! by Schlick's approximation from outside and by Fresnel's equations from inside.

use super::albedo::Reflectance;
use super::coat::{CLEAR_F0, Coat, CoatRoughness};
use super::coat_stack::{CoatStack, EvaluateStack, SampleStack, StackAlbedoTask};
use super::facets::{Facets, Reflection};
use super::fresnel::{self, Schlick, mean};
use super::frost::{EvaluateFrost, SampleFrost};
use super::iridescence::Film;
use super::lobes::{LobeProbabilities, Lobes};
use super::sheen::Sheen;
use super::transparency::{Frost, Transparency};
use super::{Sample, Smooth, Smoothness, mirrored};
use crate::geom::Basis;
use crate::geom::warp::lanes as warp;
use crate::lanes::{Lanes, Mask, Num, Vector};
use crate::scene::{self, Scene, TexturePoint};
use crate::shade::{CoatShape, lookup};
use std::f32::consts::FRAC_1_PI;

/// Principled BSDFs at points.
#[derive(Clone, Copy, Debug)]
pub struct Principled<L: Lanes> {
    pub(super) facets: Facets<L>,
    /// The mixture of metal and dielectric.
    pub(super) reflection: Reflection<L>,
    /// The dielectric alone. Its reflection does not reach the base.
    pub(super) layer: Reflection<L>,
    /// Diffuse albedo × share of the surface that is diffuse.
    pub(super) diffuse: Vector<L>,
    /// Share of the surface that transmits diffusely × share that it does not absorb.
    pub(super) translucency: Option<Vector<L>>,
    pub(super) transparency: Option<Transparency<L>>,
    pub(super) film: Option<Film<L>>,
    pub(super) sheen: Option<Sheen<L>>,
    pub(super) coat: Option<Coat<L>>,
    /// Further coats over `coat`.
    pub(super) stack: Option<CoatStack<L>>,
    /// Unit normals of the coats in the shading basis, if they differ from it.
    pub(super) coat_normal: Option<Vector<L>>,
}

#[cfg_attr(not(unoptimised), inline(always))]
pub(super) fn white<L: Lanes>(l: L) -> Vector<L> {
    Vector::grey(Num::splat(l, 1.0))
}

/// Light that facets below the fibres reflect or refract, if there are fibres, with the shares of both directions.
#[cfg_attr(not(unoptimised), inline(always))]
fn under_fibres<L: Lanes>(fibres: Option<(&Sheen<L>, [Num<L>; 2])>, light: Vector<L>) -> Vector<L> {
    match fibres {
        None => light,
        Some((sheen, [near, far])) => light * sheen.passed(near).min(sheen.passed(far)),
    }
}

impl<L: Lanes> Principled<L> {
    /// The BSDFs at points. `wo` is outside of the body in the lanes of `outside`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn new(
        scene: &Scene,
        surface: &scene::Principled,
        at: &TexturePoint<L>,
        coat_shape: &Option<CoatShape<L>>,
        outside: Mask<L>,
        smoothness: Smoothness,
    ) -> Self {
        let l = at.lanes();
        let one = Num::splat(l, 1.0);
        let base = lookup::albedo(scene, &surface.base_colour, at);
        let given = [&surface.metallic, &surface.roughness];
        let [metallic, mut roughness] = lookup::shares(scene, given, at);
        if let Some(glossiness) = &surface.glossiness {
            roughness = one - lookup::share(scene, glossiness, at);
        }
        let roughness = at.footprint.roughened(roughness);
        let facets = match &surface.anisotropy {
            None => Facets::new(roughness, smoothness.mirror_below),
            Some(anisotropy) => {
                let strength = lookup::share(scene, &anisotropy.strength, at);
                Facets::anisotropic(roughness, strength, smoothness.mirror_below)
            }
        };
        let ior = surface.ior.max(1.0);
        let f0 = (ior - 1.0) / (ior + 1.0);
        let specular = lookup::share(scene, &surface.specular, at);
        let tint = lookup::colour(scene, &surface.specular_colour, at);
        let f0 = (tint * (f0 * f0)).clamp(0.0, 1.0) * specular;
        let mut layer = facets.reflection(Schlick { f0, f90: specular });
        let metal = facets.reflection(Schlick { f0: base, f90: one });
        let (mut outer, mut opaque, mut transparency, mut leaving) =
            (layer, one - metallic, None, Mask::splat(l, false));
        if surface.glossiness.is_some() {
            layer = facets.reflection(Schlick { f0: Vector::grey(f0.max_element()), f90: specular });
        }
        if surface.transmission.factor != 0.0 {
            let transmission = lookup::share(scene, &surface.transmission, at);
            let share = (one - metallic) * transmission;
            let spread = facets.rougher_than(smoothness.clear_below);
            let outside = (!surface.thin).then_some(outside);
            let through = Transparency::new(share, base, ior, outside, spread);
            leaving = through.leaving;
            outer = layer.scaled(Num::select(through.has_own_reflection(), one - transmission, one));
            opaque *= one - transmission;
            transparency = Some(through);
        }
        let (mut translucency, mut diffuse) = (None, base * opaque);
        if let Some(of) = &surface.diffuse_transmission {
            let share = lookup::share(scene, &of.share, at);
            let mut crosses = lookup::albedo(scene, &of.colour, at) * (opaque * share);
            diffuse = base * (opaque * (one - share));
            if leaving.any() {
                // There are more directions inside than outside by the squared index, so some light returns.
                let returned = crosses * Num::splat(l, 1.0 - 1.0 / (ior * ior)).only(leaving);
                diffuse += returned;
                crosses = crosses - returned;
            }
            translucency = Some(crosses);
        }
        let (mut film, mut sheen, mut coat, mut stack) = (None, None, None, None);
        if let Some(iridescence) = &surface.iridescence {
            let covered = Film::new(scene, iridescence, at, !leaving);
            film = Some(match &transparency {
                None => covered,
                Some(through) => {
                    covered.on(Num::select(through.has_own_reflection() & !leaving, one - through.share, one))
                }
            });
        }
        if let Some(fibres) = &surface.sheen {
            sheen = Some(Sheen::new(scene, fibres, at));
        }
        let mut coat_roughness = CoatRoughness {
            bumps: at.footprint.bumps,
            smooth_below: smoothness.mirror_below,
            spread: Mask::splat(l, false),
        };
        if let Some(shape) = coat_shape {
            // Only one mirrored direction is possible. If the facets are smooth, it is theirs, and the coats
            // are rough.
            coat_roughness.spread = !facets.rough;
            coat_roughness.bumps = shape.bumps;
        }
        if surface.clearcoat.factor != 0.0 {
            let share = lookup::share(scene, &surface.clearcoat, at);
            let roughness = lookup::share(scene, &surface.clearcoat_roughness, at);
            coat = Some(Coat::new(share, coat_roughness.facets(roughness), CLEAR_F0));
        }
        if !surface.coats.is_empty() && transparency.is_none() {
            stack = Some(CoatStack { coats: surface.coats, coat_roughness });
        }
        Self {
            facets,
            reflection: outer.mix(&metal, metallic),
            layer,
            diffuse,
            translucency,
            transparency,
            film,
            sheen,
            coat,
            stack,
            coat_normal: coat_shape.map(|shape| shape.normal),
        }
    }

    /// Transforms a direction from the shading basis to the basis of the coats.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn in_coat_basis(&self, w: Vector<L>) -> Vector<L> {
        match self.coat_normal {
            None => w,
            Some(normal) => Basis::around(normal).local(w),
        }
    }

    /// Transforms a direction from the basis of the coats to the shading basis.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn out_of_coat_basis(&self, w: Vector<L>) -> Vector<L> {
        match self.coat_normal {
            None => w,
            Some(normal) => Basis::around(normal).world(w),
        }
    }

    /// Reflectance of a facet of metal and dielectric at a cosine.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn facet(&self, cosine: Num<L>) -> Vector<L> {
        let bare = &self.reflection.fresnel;
        match &self.film {
            None => bare.at(cosine),
            Some(film) => {
                // Reflectance, without the film, of the share that the film covers.
                let whole = (1.0 / film.share).only(film.share.above(0.0));
                film.over(bare.at(cosine) * whole, bare.f0 * whole, cosine) * film.share
            }
        }
    }

    /// Share that passes the dielectric layer towards a direction of cosine `z`.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn passed(&self, at: &Reflectance<L>, z: Num<L>) -> Vector<L> {
        let Some(film) = &self.film else { return white(z.lanes()) - self.layer.share(at) };
        let bare = &self.layer.fresnel;
        let single = film.over(bare.at(z), bare.f0, z) * (1.0 - at.deficit);
        Vector::grey(1.0 - (single + self.layer.strength * at.deficit).max_element())
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn lobes(&self, wo: Vector<L>) -> Lobes<L> {
        let l = wo.lanes();
        let near = self.facets.at(wo);
        let passed = self.passed(&near, wo.z);
        let (mut coat, mut under, mut further) = (Num::zero(l), Num::splat(l, 1.0), Num::zero(l));
        let mut near_coat = None;
        if let Some(c) = &self.coat {
            let at = c.facets.at(self.in_coat_basis(wo));
            [coat, further] = c.reflected(&at);
            under = 1.0 - coat - further;
            near_coat = Some(at);
        }
        let single = match &self.film {
            None => near.single(&self.reflection.fresnel),
            Some(_) => self.facet(wo.z) * (1.0 - near.deficit),
        };
        let (mut base, mut near_sheen) = (under, None);
        let mut scattered = self.diffuse * passed + self.reflection.strength * near.deficit;
        if let Some(colour) = &self.translucency {
            scattered += *colour * passed;
        }
        if let Some(sheen) = &self.sheen {
            let share = sheen.share(wo.z);
            let left = sheen.passed(share);
            scattered = scattered * left + sheen.reflected(share);
            base = under * left;
            near_sheen = Some(share);
        }
        let mut facets = single * base;
        scattered = scattered * under + Vector::grey(further);
        let mut stack = None;
        if let Some(over) = &self.stack {
            let albedo = l.outlined(StackAlbedoTask { stack: over, wo: self.in_coat_basis(wo) });
            facets = facets * albedo.passed;
            scattered = scattered * albedo.scattered;
            stack = Some(albedo);
        }
        let mut translucent = None;
        if let Some(colour) = &self.translucency {
            let mut light = *colour * passed * base;
            if let Some(albedo) = &stack {
                light = light * albedo.scattered;
            }
            let all = mean(scattered);
            translucent = Some((mean(light) / all).only(all.above(0.0)));
        }
        Lobes {
            coat,
            under,
            base,
            facets,
            scattered,
            translucent,
            passed,
            near,
            near_coat,
            near_sheen,
            stack,
        }
    }

    /// Direction into which `wo` is mirrored: by the facets if they are smooth, else by smooth coats.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn mirrored(&self, wo: Vector<L>) -> Vector<L> {
        let way = mirrored(wo);
        match self.coat_normal {
            None => way,
            Some(_) => Vector::select(
                self.facets.rough,
                self.out_of_coat_basis(mirrored(self.in_coat_basis(wo))),
                way,
            ),
        }
    }

    /// See [`super::Bsdf::smooth`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn smooth(&self, wo: Vector<L>) -> Smooth<L> {
        self.smooth_of(wo, &self.lobes(wo))
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn smooth_of(&self, wo: Vector<L>, lobes: &Lobes<L>) -> Smooth<L> {
        let none = Vector::zero(wo.lanes());
        let reflected = self.mirrored(wo);
        let mut reflection = lobes.facets.only(!self.facets.rough);
        if self.coat_normal.is_some() && !self.facets.rough.all() {
            // The coats' angle to the mirrored direction is another than to `wo`.
            reflection = reflection.over(self.coats_passed(wo, wo)) * self.coats_passed(wo, reflected);
        }
        if let Some(coat) = &self.coat {
            let mut light = Vector::grey(lobes.coat);
            if let Some(stack) = &lobes.stack {
                light = light * stack.passed;
            }
            reflection += light.only(!coat.facets.rough);
        }
        if let Some(stack) = &lobes.stack {
            reflection += stack.smooth;
        }
        let (mut transmitted, mut transmission) = (none, none);
        let mut eta = Num::splat(wo.lanes(), 1.0);
        if let Some(through) = &self.transparency {
            let passed = lobes.passed * lobes.base;
            if through.thin {
                (transmitted, transmission) = (-wo, through.tint * passed);
            } else {
                eta = through.eta;
                let (mirrored, cosine) = fresnel::dielectric(wo.z, eta);
                let inner = (mirrored * through.share * lobes.base).only(through.leaving & !through.frosted);
                reflection += Vector::grey(inner);
                let mut refracted = 1.0 - mirrored;
                if let Some(coat) = &self.coat {
                    // The coat passes as much as from outside. The rest is reflected and stays inside.
                    let outer = coat.passed(&coat.facets.at(Vector::new(wo.x, wo.y, cosine)));
                    let stays = refracted * (1.0 - outer.min(lobes.under) / lobes.under);
                    reflection += Vector::grey(
                        (stays * through.share * lobes.base).only(through.leaving & !through.frosted),
                    );
                    refracted -= stays;
                }
                let leaving = Vector::grey(refracted * lobes.base);
                let passed = Vector::select(through.leaving, leaving, passed);
                transmission = through.tint * passed / (eta * eta);
                transmitted = fresnel::refracted(wo, eta, cosine);
            }
            transmission = transmission.only(!through.frosted);
        }
        Smooth { reflected, reflection, transmitted, transmission, eta }
    }

    /// Share that the coats pass of light reflected by the facets below.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn coats_passed(&self, wo: Vector<L>, wi: Vector<L>) -> Vector<L> {
        let [wo, wi] = [self.in_coat_basis(wo), self.in_coat_basis(wi)];
        let raised = Vector::new(wi.x, wi.y, wi.z.abs());
        let mut passed = white(wo.lanes());
        if let Some(coat) = &self.coat {
            passed = passed * coat.passed(&coat.facets.at(wo)).min(coat.passed(&coat.facets.at(raised)));
        }
        if let Some(stack) = &self.stack {
            let task =
                EvaluateStack { stack, under: None, wo, wi, half: wo, there: Mask::splat(wo.lanes(), false) };
            passed = passed * wo.lanes().outlined(task).passed;
        }
        passed
    }

    /// The frosted transparent share as seen from `wo`; `None` if there is none.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn frost(&self, wo: Vector<L>) -> Option<Frost<'_, L>> {
        let through = self.transparency.as_ref().filter(|through| through.frosted.any())?;
        Some(Frost { through, facets: &self.facets, layer: &self.layer, film: &self.film, wo })
    }

    /// True if light sampling must also consider light from below the surface.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn is_frosted(&self) -> bool {
        self.translucency.is_some() || matches!(&self.transparency, Some(through) if through.frosted.any())
    }

    /// The factor of a diffuse base's light from `wi` for what the dielectric layer passes in both directions.
    /// `far` is the reflectance towards `wi`, whose cosine is `z`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn passed_both_ways(&self, lobes: &Lobes<L>, far: &Reflectance<L>, z: Num<L>) -> Vector<L> {
        let passed = self.passed(far, z);
        if self.film.is_some() {
            return passed.min(lobes.passed);
        }
        let mean = white(z.lanes()) - self.layer.share(&self.facets.mean());
        lobes.passed.over(mean.clamp(f32::MIN_POSITIVE, 1.0)) * passed
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn probabilities(&self, wo: Vector<L>, lobes: &Lobes<L>, smooth: &Smooth<L>) -> LobeProbabilities<L> {
        let mut coat = match &self.coat {
            Some(coat) => lobes.coat.only(coat.facets.rough),
            None => lobes.coat,
        };
        if let Some(stack) = &lobes.stack {
            coat *= mean(stack.passed);
        }
        let facets = mean(lobes.facets).only(self.facets.rough);
        let (scattered, mirrors) = (mean(lobes.scattered), smooth.energy());
        let mut sum = coat + facets + scattered + mirrors;
        let (mut frosted, mut stack) = (Num::zero(wo.lanes()), Num::zero(wo.lanes()));
        if let Some(frost) = self.frost(wo) {
            let through = frost.through;
            let mut light = through.tint * lobes.passed;
            if !through.thin {
                light += (white(wo.lanes()) - lobes.passed) * through.share;
            }
            frosted = (mean(light) * lobes.base).only(through.frosted);
            sum += frosted;
        }
        if let Some(albedo) = &lobes.stack {
            stack = albedo.rough;
            sum += stack;
        }
        let scale = (1.0 / sum).only(sum.above(0.0));
        LobeProbabilities {
            coat: coat * scale,
            facets: facets * scale,
            scattered: scattered * scale,
            frosted: frosted * scale,
            stack: stack * scale,
            mirrors: mirrors * scale,
        }
    }

    /// See [`super::Bsdf::evaluate`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn evaluate(&self, wo: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        let lobes = self.lobes(wo);
        let probabilities = self.probabilities(wo, &lobes, &self.smooth_of(wo, &lobes));
        self.evaluate_lobes(wo, wi, &lobes, &probabilities)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn evaluate_lobes(
        &self,
        wo: Vector<L>,
        wi: Vector<L>,
        lobes: &Lobes<L>,
        probabilities: &LobeProbabilities<L>,
    ) -> (Vector<L>, Num<L>) {
        let far = self.facets.at(wi);
        let passed = self.passed_both_ways(lobes, &far, wi.z);
        let mut value = self.diffuse * passed * (wi.z * FRAC_1_PI)
            + self.reflection.strength * self.facets.bounces(&lobes.near, &far, wi.z);
        let mut pdf = probabilities.scattered * warp::cosine_hemisphere_pdf(wi.z);
        let (half, there) = (wo + wi).normalize_or(wo);
        let mut sides = wi.z.above(0.0);
        let lit = there & sides;
        if let (Some(colour), Some(translucent)) = (&self.translucency, lobes.translucent) {
            value = Vector::select(sides, value, self.transmitted(colour, lobes, wi));
            let below = probabilities.scattered * translucent * warp::cosine_hemisphere_pdf(-wi.z);
            pdf = Num::select(sides, pdf * (1.0 - translucent), below);
            sides = !wi.z.is_zero();
        }
        // The same directions in the basis of the coats.
        let ([near_coat, far_coat, half_coat], mut lit_coat) =
            ([self.in_coat_basis(wo), self.in_coat_basis(wi), self.in_coat_basis(half)], lit);
        if self.coat_normal.is_some() {
            lit_coat = there & far_coat.z.above(0.0);
        }
        let mut under = lobes.under;
        if let Some(coat) = &self.coat {
            let raised = Vector::new(far_coat.x, far_coat.y, far_coat.z.abs());
            let far = coat.passed(&coat.facets.at(raised));
            value = value * (under.max(far) / coat.passed_on_average());
            under = under.min(far);
        }
        let mut across_stack = None;
        if let Some(stack) = &self.stack {
            let (under, there) = (self.coat.as_ref(), lit_coat);
            let task = EvaluateStack { stack, under, wo: near_coat, wi: far_coat, half: half_coat, there };
            let scattering = wo.lanes().outlined(task);
            value = value * scattering.scattered;
            across_stack = Some(scattering);
        }
        let mut fibres = None;
        if let (Some(sheen), Some(near)) = (&self.sheen, lobes.near_sheen) {
            let shares = [near, sheen.share(wi.z.abs())];
            value = value * sheen.passed_both_ways(shares);
            fibres = Some((sheen, shares));
        }
        let facet_cosine = half.dot(wo);
        let rough = self.facets.rough & lit;
        if rough.any() {
            let (perfect, density) = self.facets.ggx.evaluate(wo, wi, half);
            value += under_fibres(fibres, (self.facet(facet_cosine) * perfect).only(rough));
            pdf += (probabilities.facets * density).only(rough);
        }
        if let Some(frost) = self.frost(wo) {
            let (light, density) = wo.lanes().outlined(EvaluateFrost { frost, wi });
            value = value.only(sides) + under_fibres(fibres, light);
            pdf = pdf.only(sides) + probabilities.frosted * density;
            sides |= frost.through.frosted;
        }
        if let Some((sheen, shares)) = fibres {
            value += sheen.evaluate(wo, wi, half, shares).only(lit);
        }
        value = (value * under).only(sides);
        pdf = pdf.only(sides);
        if let (Some(coat), Some(near)) = (&self.coat, &lobes.near_coat) {
            let (light, density) = coat.evaluate(near_coat, far_coat, half_coat, near, lit_coat);
            value += light;
            pdf += probabilities.coat * density;
        }
        if let (Some(across_stack), Some(albedo)) = (&across_stack, &lobes.stack) {
            value = value * across_stack.passed + across_stack.light;
            pdf += (probabilities.stack / albedo.rough * across_stack.density).only(albedo.rough.above(0.0));
        }
        (value, pdf)
    }

    /// See [`super::Bsdf::sample`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn sample(&self, wo: Vector<L>, u: Num<L>, u2: [Num<L>; 2]) -> Sample<L> {
        let lobes = self.lobes(wo);
        let smooth = self.smooth_of(wo, &lobes);
        let probabilities = self.probabilities(wo, &lobes, &smooth);
        let LobeProbabilities { coat, facets, scattered, frosted, stack, mirrors } = probabilities;
        let (first, second) = (u.lt(coat), u.lt(coat + facets));
        let mut rough = coat + facets + scattered;
        let mut wi = warp::cosine_hemisphere(u2);
        if second.any() {
            let normal = self.facets.ggx.sample(wo, u2);
            wi = Vector::select(second, normal * (2.0 * wo.dot(normal)) - wo, wi);
        }
        if first.any()
            && let Some(coat) = &self.coat
        {
            let over = self.in_coat_basis(wo);
            let normal = coat.facets.ggx.sample(over, u2);
            let way = normal * (2.0 * over.dot(normal)) - over;
            wi = Vector::select(first, self.out_of_coat_basis(way), wi);
        }
        let none = Mask::splat(wo.lanes(), false);
        let (mut valid, mut crosses, mut eta) = (wi.z.above(0.0), none, Num::splat(wo.lanes(), 1.0));
        if let Some(translucent) = lobes.translucent {
            crosses = !second & u.lt(coat + facets + scattered * translucent);
            wi.z = Num::select(crosses, -wi.z, wi.z);
            valid |= crosses;
            eta = Num::select(crosses, self.far_index(wo.lanes()), eta);
        }
        if let Some(frost) = self.frost(wo) {
            let through = !u.lt(rough) & frost.through.frosted;
            let rest = ((u - rough) / frosted).clamp(0.0, 1.0);
            let (way, there) = wo.lanes().outlined(SampleFrost { frost, u: rest, u2 });
            wi = Vector::select(through, way, wi);
            valid = Mask::select(through, there, valid);
            crosses = wi.z.below(0.0);
            let inward = frost.through.eta;
            if !frost.through.thin {
                eta = Num::select(crosses, inward, eta);
            }
            rough += frosted;
        }
        if let Some(over) = &self.stack {
            let reflects = !u.lt(rough) & u.lt(rough + stack);
            if reflects.any() {
                let rest = ((u - rough) / stack).clamp(0.0, 1.0);
                let way =
                    wo.lanes().outlined(SampleStack { stack: over, wo: self.in_coat_basis(wo), u: rest, u2 });
                wi = Vector::select(reflects, self.out_of_coat_basis(way), wi);
                valid = Mask::select(reflects, wi.z.above(0.0), valid);
            }
            rough += stack;
        }
        if self.coat_normal.is_some() {
            // Coats may mirror into directions that the surface below does not reach.
            valid |= self.in_coat_basis(wi).z.above(0.0);
        }
        let scatters = u.lt(rough);
        let (value, pdf) = self.evaluate_lobes(wo, wi, &lobes, &probabilities);
        let valid = valid & pdf.above(0.0);
        let mut sample = Sample { valid, wi, weight: value / pdf, pdf, specular: none, crosses, eta };
        if !scatters.all() {
            let rest = ((u - rough) / mirrors).clamp(0.0, 1.0);
            sample = Sample::select(scatters, sample, smooth.sample(rest, mirrors));
        }
        sample
    }
}
