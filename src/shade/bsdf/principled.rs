//! glTF's metallic-roughness surface: a clear coat over sheen over a mixture of metal and dielectric, the
//! dielectric over a diffuse or transparent base.
//!
//! # Where the light goes
//! With E the share that a layer reflects in all its bounces (single-bounce GGX from a table, the
//! rest in a lobe of its own, see [`super::facets`]), what it does not reflect reaches the layer below:
//! - the coat passes `p = 1 − E_coat`: of what the surface below scatters `p(wo) p(wi) / p_mean`, of what its facets
//!   reflect or refract the lesser of `p(wo)` and `p(wi)`, which are the same for a mirror,
//! - sheen passes the lesser of what it leaves towards `wo` and `wi`,
//! - the dielectric layer passes `(1 − E(wo)) (1 − E(wi)) / (1 − E_mean)` to the diffuse base, which
//!   is reciprocal and integrates to `1 − E(wo)`, and `1 − E(wo)` to the transparent base.
//!
//! So a white surface returns all light that falls on it, at every roughness; sheen loses some, and a coat over
//! rough facets as much as a twelfth. A thin film
//! replaces the Fresnel term of facets, but not of further bounces, and under it the base gets the lesser of
//! what is passed in the brightest channel towards `wo` and `wi`. All is reciprocal, but for a body's film, which is
//! not seen from inside, and smooth bodies, which reflect from outside as Schlick has it and from inside as Fresnel.

use super::albedo::Reflectance;
use super::facets::{Facets, Reflection};
use super::fresnel::{self, Schlick};
use super::iridescence::Film;
use super::sheen::Sheen;
use super::transparency::{Frost, Scattered, Seen, Transparency};
use super::{Sample, Smooth, Smoothness, mirrored};
use crate::geom::warp::lanes as warp;
use crate::lanes::{Lanes, Num, Vector};
use crate::scene::{self, Finish, Footprint, Scene};
use crate::shade::lookup;
use std::f32::consts::FRAC_1_PI;

/// Reflectance of a clear coat, and of a computed surface (index 1.5), at normal incidence.
const COAT_F0: f32 = 0.04;

/// By how much more of scattered light passes a coat than its mean says: what is below scatters where the coat
/// lets light through, since both reflect at grazing angles. For two smooth dielectrics, the covariance of what
/// passes them over the mean of what passes one.
const LAYERS_ALIKE: f32 = 0.013;

/// Principled surfaces at points.
#[derive(Clone, Copy, Debug)]
pub struct Principled<L: Lanes> {
    facets: Facets<L>,
    /// Metal and dielectric mixed.
    reflection: Reflection<L>,
    /// The dielectric alone: what the base does not get.
    layer: Reflection<L>,
    /// Diffuse albedo times the share of the surface that is diffuse.
    diffuse: Vector<L>,
    transparency: Option<Transparency<L>>,
    film: Option<Film<L>>,
    sheen: Option<Sheen<L>>,
    coat: Option<Coat<L>>,
}

#[derive(Clone, Copy, Debug)]
struct Coat<L: Lanes> {
    /// Share of the surface that is coated.
    share: Num<L>,
    facets: Facets<L>,
    reflection: Reflection<L>,
}

impl<L: Lanes> Coat<L> {
    #[inline(always)]
    fn new(share: Num<L>, roughness: Num<L>, smooth_below: f32) -> Self {
        let facets = Facets::new(roughness, smooth_below);
        let one = Num::splat(share.lanes(), 1.0);
        let reflection = facets.reflection(Schlick { f0: Vector::grey(one) * COAT_F0, f90: one });
        Self { share, facets, reflection }
    }

    /// What passes towards directions that the facets reflect so much of.
    #[inline(always)]
    fn passed(&self, at: &Reflectance<L>) -> Num<L> {
        let single = self.share * at.single(&self.reflection.fresnel).x;
        1.0 - single - self.share * self.reflection.strength.x * at.deficit
    }

    /// What passes of light that the surface below scatters, on the way in and out and to and fro between.
    #[inline(always)]
    fn passed_on_average(&self) -> Num<L> {
        self.passed(&self.facets.mean()) + self.share * LAYERS_ALIKE
    }
}

/// What each lobe sends towards `wo` from an even environment, and what lies between.
struct Lobes<L: Lanes> {
    /// Of the facets towards `wo`, and of the coat's.
    near: Reflectance<L>,
    near_coat: Option<Reflectance<L>>,
    /// The sheen's share.
    near_sheen: Option<Num<L>>,
    /// The coat's own reflection, single bounce.
    coat: Num<L>,
    /// What passes the coat, and the sheen too.
    under: Num<L>,
    base: Num<L>,
    /// Metal and dielectric reflection, single bounce.
    facets: Vector<L>,
    /// The diffuse base, sheen and all further bounces.
    scattered: Vector<L>,
    /// What passes the layer towards `wo`.
    passed: Vector<L>,
}

#[inline(always)]
fn white<L: Lanes>(l: L) -> Vector<L> {
    Vector::grey(Num::splat(l, 1.0))
}

impl<L: Lanes> Principled<L> {
    /// The surface at mesh coordinates `uv`, seen from the outside of its body in the lanes of `outside`.
    #[inline(always)]
    pub fn new(
        scene: &Scene,
        surface: &scene::Principled,
        uv: [Num<L>; 2],
        footprint: &Footprint<L>,
        outside: u32,
        smoothness: Smoothness,
    ) -> Self {
        let l = uv[0].lanes();
        let one = Num::splat(l, 1.0);
        let base = lookup::albedo(scene, &surface.base_colour, uv, footprint);
        let given = [&surface.metallic, &surface.roughness];
        let [metallic, roughness] = lookup::shares(scene, given, uv, footprint);
        let roughness = footprint.roughened(roughness);
        let facets = match &surface.anisotropy {
            None => Facets::new(roughness, smoothness.mirror_below),
            Some(anisotropy) => {
                let strength = lookup::share(scene, &anisotropy.strength, uv, footprint);
                Facets::anisotropic(roughness, strength, smoothness.mirror_below)
            }
        };
        let ior = surface.ior.max(1.0);
        let f0 = (ior - 1.0) / (ior + 1.0);
        let specular = lookup::share(scene, &surface.specular, uv, footprint);
        let tint = lookup::colour(scene, &surface.specular_colour, uv, footprint);
        let f0 = (tint * (f0 * f0)).clamp(0.0, 1.0) * specular;
        let layer = facets.reflection(Schlick { f0, f90: specular });
        let metal = facets.reflection(Schlick { f0: base, f90: one });
        let (mut outer, mut opaque, mut transparency, mut leaving) = (layer, one - metallic, None, 0);
        if surface.transmission.factor != 0.0 {
            let transmission = lookup::share(scene, &surface.transmission, uv, footprint);
            let share = (one - metallic) * transmission;
            let spread = facets.rougher_than(smoothness.clear_below);
            let outside = (!surface.thin).then_some(outside);
            let through = Transparency::new(share, base, ior, outside, spread);
            leaving = through.leaving;
            outer = layer.scaled(Num::select(through.apart(), one - transmission, one));
            opaque *= one - transmission;
            transparency = Some(through);
        }
        let (mut film, mut sheen, mut coat) = (None, None, None);
        if let Some(iridescence) = &surface.iridescence {
            let lies = Film::new(scene, iridescence, uv, footprint, L::ALL & !leaving);
            film = Some(match &transparency {
                None => lies,
                Some(through) => lies.on(Num::select(through.apart() & !leaving, one - through.share, one)),
            });
        }
        if let Some(fibres) = &surface.sheen {
            sheen = Some(Sheen::new(scene, fibres, uv, footprint));
        }
        if surface.clearcoat.factor != 0.0 {
            let share = lookup::share(scene, &surface.clearcoat, uv, footprint);
            let roughness = lookup::share(scene, &surface.clearcoat_roughness, uv, footprint);
            coat = Some(Coat::new(share, footprint.roughened(roughness), smoothness.mirror_below));
        }
        Self {
            facets,
            reflection: outer.mix(&metal, metallic),
            layer,
            diffuse: base * opaque,
            transparency,
            film,
            sheen,
            coat,
        }
    }

    /// The surface with a finish that has been computed.
    #[inline(always)]
    pub fn finished(finish: &Finish<L>, smooth_below: f32) -> Self {
        let l = finish.colour.lanes();
        let one = Num::splat(l, 1.0);
        let base = finish.colour.clamp(0.0, 1.0);
        let metallic = finish.metallic.clamp(0.0, 1.0);
        let facets = Facets::new(finish.roughness.clamp(0.0, 1.0), smooth_below);
        let layer = facets.reflection(Schlick { f0: white(l) * COAT_F0, f90: one });
        let metal = facets.reflection(Schlick { f0: base, f90: one });
        Self {
            facets,
            reflection: layer.mix(&metal, metallic),
            layer,
            diffuse: base * (one - metallic),
            transparency: None,
            film: None,
            sheen: None,
            coat: Some(Coat::new(finish.clearcoat.clamp(0.0, 1.0), one.only(0), smooth_below)),
        }
    }

    /// What a facet of metal and dielectric reflects at a cosine.
    #[inline(always)]
    fn facet(&self, cosine: Num<L>) -> Vector<L> {
        let bare = &self.reflection.fresnel;
        match &self.film {
            None => bare.at(cosine),
            Some(film) => {
                // What the share that it lies on reflects without it.
                let whole = (1.0 / film.share).only(film.share.above(0.0));
                film.over(bare.at(cosine) * whole, bare.f0 * whole, cosine) * film.share
            }
        }
    }

    /// What passes the dielectric layer towards a direction of cosine `z`.
    #[inline(always)]
    fn passed(&self, at: &Reflectance<L>, z: Num<L>) -> Vector<L> {
        let Some(film) = &self.film else { return white(z.lanes()) - self.layer.share(at) };
        let bare = &self.layer.fresnel;
        let single = film.over(bare.at(z), bare.f0, z) * (1.0 - at.deficit);
        Vector::grey(1.0 - (single + self.layer.strength * at.deficit).max_element())
    }

    #[inline(always)]
    fn lobes(&self, wo: Vector<L>) -> Lobes<L> {
        let l = wo.lanes();
        let near = self.facets.at(wo);
        let passed = self.passed(&near, wo.z);
        let (mut coat, mut under, mut further) = (wo.z.only(0), Num::splat(l, 1.0), wo.z.only(0));
        let mut near_coat = None;
        if let Some(c) = &self.coat {
            let at = c.facets.at(wo);
            coat = c.share * at.single(&c.reflection.fresnel).x;
            further = c.share * c.reflection.strength.x * at.deficit;
            under = 1.0 - coat - further;
            near_coat = Some(at);
        }
        let single = match &self.film {
            None => near.single(&self.reflection.fresnel),
            Some(_) => self.facet(wo.z) * (1.0 - near.deficit),
        };
        let (mut base, mut near_sheen) = (under, None);
        let mut scattered = self.diffuse * passed + self.reflection.strength * near.deficit;
        if let Some(sheen) = &self.sheen {
            let share = sheen.share(wo.z);
            let left = sheen.passed(share);
            scattered = scattered * left + sheen.reflected(share);
            base = under * left;
            near_sheen = Some(share);
        }
        Lobes {
            coat,
            under,
            base,
            facets: single * base,
            scattered: scattered * under + Vector::grey(further),
            passed,
            near,
            near_coat,
            near_sheen,
        }
    }

    /// See [`super::Bsdf::smooth`].
    #[inline(always)]
    pub fn smooth(&self, wo: Vector<L>) -> Smooth<L> {
        self.smooth_of(wo, &self.lobes(wo))
    }

    #[inline(always)]
    fn smooth_of(&self, wo: Vector<L>, lobes: &Lobes<L>) -> Smooth<L> {
        let none = (-wo).only(0);
        let mut reflection = lobes.facets.only(!self.facets.rough);
        if let Some(coat) = &self.coat {
            reflection += Vector::grey(lobes.coat).only(!coat.facets.rough);
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
                    // As much as from outside; what does not pass stays inside.
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
        Smooth { reflected: mirrored(wo), reflection, transmitted, transmission, eta }
    }

    /// The frosted share, if there is any, seen from `wo`.
    #[inline(always)]
    fn frost(&self, wo: Vector<L>) -> Option<Frost<'_, L>> {
        let through = self.transparency.as_ref().filter(|through| through.frosted != 0)?;
        Some(Frost { through, facets: &self.facets, layer: &self.layer, film: &self.film, wo })
    }

    /// Whether light from below, too, is found by light sampling.
    #[inline(always)]
    pub fn is_frosted(&self) -> bool {
        matches!(&self.transparency, Some(through) if through.frosted != 0)
    }

    /// Chances of sampling the coat's facets, the facets, the cosine, what is frosted, and all smooth ones.
    #[inline(always)]
    fn chances(&self, wo: Vector<L>, lobes: &Lobes<L>, smooth: &Smooth<L>) -> [Num<L>; 5] {
        let rough_coat = match &self.coat {
            Some(coat) => lobes.coat.only(coat.facets.rough),
            None => lobes.coat,
        };
        let facets = mean(lobes.facets).only(self.facets.rough);
        let (scattered, mirrors) = (mean(lobes.scattered), smooth.energy());
        let mut sum = rough_coat + facets + scattered + mirrors;
        let mut frosted = wo.z.only(0);
        if let Some(frost) = self.frost(wo) {
            let through = frost.through;
            let mut light = through.tint * lobes.passed;
            if !through.thin {
                light += (white(wo.lanes()) - lobes.passed) * through.share;
            }
            frosted = (mean(light) * lobes.base).only(through.frosted);
            sum += frosted;
        }
        let scale = (1.0 / sum).only(sum.above(0.0));
        [rough_coat * scale, facets * scale, scattered * scale, frosted * scale, mirrors * scale]
    }

    /// See [`super::Bsdf::evaluate`].
    #[inline(always)]
    pub fn evaluate(&self, wo: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        let lobes = self.lobes(wo);
        let chances = self.chances(wo, &lobes, &self.smooth_of(wo, &lobes));
        self.evaluate_lobes(wo, wi, &lobes, &chances)
    }

    #[inline(always)]
    fn evaluate_lobes(
        &self,
        wo: Vector<L>,
        wi: Vector<L>,
        lobes: &Lobes<L>,
        chances: &[Num<L>; 5],
    ) -> (Vector<L>, Num<L>) {
        let far = self.facets.at(wi);
        let mut passed = self.passed(&far, wi.z);
        if self.film.is_some() {
            passed = passed.min(lobes.passed);
        } else {
            let mean = white(wo.lanes()) - self.layer.share(&self.facets.mean());
            passed = lobes.passed.over(mean.clamp(f32::MIN_POSITIVE, 1.0)) * passed;
        }
        let mut value = self.diffuse * passed * (wi.z * FRAC_1_PI)
            + self.reflection.strength * self.facets.bounces(&lobes.near, &far, wi.z);
        let mut pdf = chances[2] * warp::cosine_hemisphere_pdf(wi.z);
        let mut under = lobes.under;
        if let Some(coat) = &self.coat {
            let far = coat.passed(&coat.facets.at(Vector::new(wi.x, wi.y, wi.z.abs())));
            value = value * (under.max(far) / coat.passed_on_average());
            under = under.min(far);
        }
        let (half, there) = (wo + wi).normalize_or(wo);
        let mut sides = wi.z.above(0.0);
        let there = there & sides;
        let facet_cosine = half.dot(wo);
        let rough = self.facets.rough & there;
        if rough != 0 {
            let (perfect, density) = self.facets.ggx.evaluate(wo, wi, half);
            value += (self.facet(facet_cosine) * perfect).only(rough);
            pdf += (chances[1] * density).only(rough);
        }
        if let Some(frost) = self.frost(wo) {
            let (light, density) = wo.lanes().apart(Seen { frost, wi });
            value = value.only(sides) + light;
            pdf = pdf.only(sides) + chances[3] * density;
            sides |= frost.through.frosted;
        }
        if let (Some(sheen), Some(near)) = (&self.sheen, lobes.near_sheen) {
            let far = sheen.share(wi.z.abs());
            value = value * sheen.passed(near).min(sheen.passed(far))
                + sheen.evaluate(wo, wi, half, [near, far]).only(there);
        }
        value = value * under;
        if let (Some(coat), Some(near)) = (&self.coat, &lobes.near_coat) {
            let rough = coat.facets.rough & there;
            if rough != 0 {
                let (perfect, density) = coat.facets.ggx.evaluate(wo, wi, half);
                let far = coat.facets.at(wi);
                let bounces = coat.reflection.strength * coat.facets.bounces(near, &far, wi.z);
                let light = (coat.reflection.fresnel.at(facet_cosine) * perfect + bounces) * coat.share;
                value += light.only(rough);
                pdf += (chances[0] * density).only(rough);
            }
        }
        (value.only(sides), pdf.only(sides))
    }

    /// See [`super::Bsdf::sample`].
    #[inline(always)]
    pub fn sample(&self, wo: Vector<L>, u: Num<L>, u2: [Num<L>; 2]) -> Sample<L> {
        let lobes = self.lobes(wo);
        let smooth = self.smooth_of(wo, &lobes);
        let chances = self.chances(wo, &lobes, &smooth);
        let [coat, facets, scattered, frosted, mirrors] = chances;
        let (first, second) = (u.lt(coat), u.lt(coat + facets));
        let mut rough = coat + facets + scattered;
        let mut wi = warp::cosine_hemisphere(u2);
        if second != 0 {
            let normal = self.facets.ggx.sample(wo, u2);
            wi = Vector::select(second, normal * (2.0 * wo.dot(normal)) - wo, wi);
        }
        if first != 0
            && let Some(coat) = &self.coat
        {
            let normal = coat.facets.ggx.sample(wo, u2);
            wi = Vector::select(first, normal * (2.0 * wo.dot(normal)) - wo, wi);
        }
        let (mut valid, mut eta) = (wi.z.above(0.0), Num::splat(wo.lanes(), 1.0));
        if let Some(frost) = self.frost(wo) {
            let through = !u.lt(rough) & frost.through.frosted;
            let rest = ((u - rough) / frosted).clamp(0.0, 1.0);
            let (way, there) = wo.lanes().apart(Scattered { frost, u: rest, u2 });
            wi = Vector::select(through, way, wi);
            valid = (through & there) | (valid & !through);
            let inward = frost.through.eta;
            if !frost.through.thin {
                eta = Num::select(wi.z.below(0.0), inward, eta);
            }
            rough += frosted;
        }
        let scatters = u.lt(rough);
        let (value, pdf) = self.evaluate_lobes(wo, wi, &lobes, &chances);
        let valid = valid & pdf.above(0.0);
        let mut sample = Sample { valid, wi, weight: value / pdf, pdf, specular: 0, eta };
        if scatters != L::ALL {
            let rest = ((u - rough) / mirrors).clamp(0.0, 1.0);
            sample = Sample::select(scatters, sample, smooth.sample(rest, mirrors));
        }
        sample
    }
}

#[inline(always)]
fn mean<L: Lanes>(colour: Vector<L>) -> Num<L> {
    colour.element_sum() * (1.0 / 3.0)
}
