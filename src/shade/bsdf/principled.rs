//! glTF's metallic-roughness surface: a clear coat over a mixture of metal and dielectric, the
//! dielectric over a diffuse or transparent base.
//!
//! # Where the light goes
//! With E the share that a layer reflects in all its bounces (single-bounce GGX from a table, the
//! rest in a lobe of its own, see [`super::facets`]), what it does not reflect reaches the layer below:
//! - the coat passes `1 − E_coat(wo)`,
//! - the dielectric layer passes `(1 − E(wo)) (1 − E(wi)) / (1 − E_mean)` to the diffuse base, which
//!   is reciprocal and integrates to `1 − E(wo)`, and `1 − E(wo)` to the transparent base.
//!
//! So a white surface returns all light that falls on it, at every roughness. All is reciprocal but
//! the coat's factor, which depends on `wo` alone, as layering by albedo has it.

use super::facets::{Facets, Reflection};
use super::fresnel::{self, Schlick};
use super::{Sample, Smooth, mirrored};
use crate::geom::warp;
use crate::scene::{self, Scene};
use crate::shade::lookup;
use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;

/// Reflectance of a clear coat (index 1.5) at normal incidence.
const COAT_F0: f32 = 0.04;

/// A Principled surface at a point.
#[derive(Clone, Copy, Debug)]
pub struct Principled {
    facets: Facets,
    /// Metal and dielectric mixed.
    reflection: Reflection,
    /// The dielectric alone: what the base does not get.
    layer: Reflection,
    /// Diffuse albedo times the share of the surface that is diffuse.
    diffuse: Vec3,
    /// Tint times the share of the surface that is transparent.
    transparent: Vec3,
    boundary: Boundary,
    coat: Option<Coat>,
}

/// How the transparent share lets light through.
#[derive(Clone, Copy, Debug)]
enum Boundary {
    /// Straight, through a thin wall.
    Thin,
    /// Into a body of this relative index.
    Entering(f32),
    /// Out of a body, into a medium of this relative index; the share of the surface that does so.
    Leaving(f32, f32),
}

#[derive(Clone, Copy, Debug)]
struct Coat {
    /// Share of the surface that is coated.
    share: f32,
    facets: Facets,
    reflection: Reflection,
}

/// What each lobe sends towards `wo` from an even environment, and what lies between.
struct Lobes {
    /// The coat's own reflection, single bounce.
    coat: f32,
    /// What passes the coat.
    under: f32,
    /// Metal and dielectric reflection, single bounce.
    facets: Vec3,
    /// The diffuse base and all further bounces.
    scattered: Vec3,
    /// Density of the layer's pass to the diffuse base, per channel.
    pass: Vec3,
}

impl Principled {
    /// The surface at mesh coordinates `uv`, seen from the outside of its body or not; facets smoother
    /// than `smooth_below` count as a mirror.
    pub fn new(
        scene: &Scene,
        surface: &scene::Principled,
        uv: Vec2,
        outside: bool,
        smooth_below: f32,
    ) -> Self {
        let base = lookup::albedo(scene, &surface.base_colour, uv);
        let metallic = lookup::share(scene, &surface.metallic, uv);
        let transmission = lookup::share(scene, &surface.transmission, uv);
        let facets = Facets::new(lookup::share(scene, &surface.roughness, uv), smooth_below);
        let ior = surface.ior.max(1.0);
        let f0 = ((ior - 1.0) / (ior + 1.0)).powi(2);
        let specular = surface.specular.clamp(0.0, 1.0);
        let layer = facets.reflection(Schlick {
            f0: (surface.specular_colour * f0).max(Vec3::ZERO).min(Vec3::ONE) * specular,
            f90: specular,
        });
        let metal = facets.reflection(Schlick { f0: base, f90: 1.0 });
        let transparent = (1.0 - metallic) * transmission;
        let boundary = match (surface.thin, outside) {
            (true, _) => Boundary::Thin,
            (false, true) => Boundary::Entering(ior),
            (false, false) => Boundary::Leaving(1.0 / ior, transparent),
        };
        // Inside a body its transparent share is a boundary of its own and has no outer reflection.
        let outer =
            if matches!(boundary, Boundary::Leaving(..)) { layer.scaled(1.0 - transmission) } else { layer };
        let coat = lookup::share(scene, &surface.clearcoat, uv);
        let coat = (coat > 0.0).then(|| {
            let facets = Facets::new(lookup::share(scene, &surface.clearcoat_roughness, uv), smooth_below);
            let reflection = facets.reflection(Schlick { f0: Vec3::splat(COAT_F0), f90: 1.0 });
            Coat { share: coat, facets, reflection }
        });
        Self {
            facets,
            reflection: outer.mix(&metal, metallic),
            layer,
            diffuse: base * ((1.0 - metallic) * (1.0 - transmission)),
            transparent: base * transparent,
            boundary,
            coat,
        }
    }

    fn lobes(&self, wo: Vec3) -> Lobes {
        let at = self.facets.at(wo.z);
        let passed = Vec3::ONE - self.layer.share(&at);
        let mean = Vec3::ONE - self.layer.share(&self.facets.mean());
        let (mut coat, mut under) = (0.0, 1.0);
        let mut further = 0.0;
        if let Some(c) = &self.coat {
            let at = c.facets.at(wo.z);
            coat = c.share * at.single(&c.reflection.fresnel).x;
            further = c.share * c.reflection.strength.x * at.deficit;
            under = 1.0 - coat - further;
        }
        Lobes {
            coat,
            under,
            facets: at.single(&self.reflection.fresnel) * under,
            scattered: (self.diffuse * passed + self.reflection.strength * at.deficit) * under
                + Vec3::splat(further),
            pass: passed / mean.max(Vec3::splat(f32::MIN_POSITIVE)),
        }
    }

    /// See [`super::Bsdf::smooth`].
    pub fn smooth(&self, wo: Vec3) -> Smooth {
        self.smooth_of(wo, &self.lobes(wo))
    }

    fn smooth_of(&self, wo: Vec3, lobes: &Lobes) -> Smooth {
        let mut reflected = Vec3::ZERO;
        if self.facets.ggx().is_none() {
            reflected += lobes.facets;
        }
        if self.coat.as_ref().is_some_and(|c| c.facets.ggx().is_none()) {
            reflected += Vec3::splat(lobes.coat);
        }
        let mut transmission = None;
        let mut eta = 1.0;
        if self.transparent != Vec3::ZERO {
            let passed = (Vec3::ONE - self.layer.share(&self.facets.at(wo.z))) * lobes.under;
            match self.boundary {
                Boundary::Thin => transmission = Some((-wo, self.transparent * passed)),
                Boundary::Entering(index) => {
                    let (_, cosine) = fresnel::dielectric(wo.z, index);
                    eta = index;
                    transmission =
                        Some((refracted(wo, index, cosine), self.transparent * passed / (index * index)));
                }
                Boundary::Leaving(index, share) => {
                    let (mirrored, cosine) = fresnel::dielectric(wo.z, index);
                    eta = index;
                    reflected += Vec3::splat(mirrored * share * lobes.under);
                    if mirrored < 1.0 {
                        let weight = self.transparent * ((1.0 - mirrored) * lobes.under / (index * index));
                        transmission = Some((refracted(wo, index, cosine), weight));
                    }
                }
            }
        }
        let reflection = (reflected != Vec3::ZERO).then(|| (mirrored(wo), reflected));
        Smooth { reflection, transmission, eta }
    }

    /// Chances of sampling the coat's facets, the facets, and the cosine, and of all smooth ones.
    fn chances(&self, lobes: &Lobes, smooth: &Smooth) -> [f32; 4] {
        let of = |rough: bool, share: f32| if rough { share } else { 0.0 };
        let chances = [
            of(self.coat.as_ref().is_some_and(|c| c.facets.ggx().is_some()), lobes.coat),
            of(self.facets.ggx().is_some(), mean(lobes.facets)),
            mean(lobes.scattered),
            smooth.energy(),
        ];
        let sum: f32 = chances.iter().sum();
        if sum > 0.0 { chances.map(|c| c / sum) } else { [0.0; 4] }
    }

    /// See [`super::Bsdf::evaluate`].
    pub fn evaluate(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        if wi.z <= 0.0 {
            return (Vec3::ZERO, 0.0);
        }
        let lobes = self.lobes(wo);
        let chances = self.chances(&lobes, &self.smooth_of(wo, &lobes));
        self.evaluate_lobes(wo, wi, &lobes, &chances)
    }

    fn evaluate_lobes(&self, wo: Vec3, wi: Vec3, lobes: &Lobes, chances: &[f32; 4]) -> (Vec3, f32) {
        let at = self.facets.at(wi.z);
        let passed = lobes.pass * (Vec3::ONE - self.layer.share(&at));
        let mut value = self.diffuse * passed * (FRAC_1_PI * wi.z)
            + self.reflection.strength * self.facets.bounces(wo.z, wi.z);
        let mut pdf = chances[2] * warp::cosine_hemisphere_pdf(wi.z);
        let facet_cosine = (wo + wi).try_normalize().map_or(1.0, |half| half.dot(wo));
        if let Some(ggx) = self.facets.ggx() {
            let (perfect, density) = ggx.evaluate(wo, wi);
            value += self.reflection.fresnel.at(facet_cosine) * perfect;
            pdf += chances[1] * density;
        }
        value *= lobes.under;
        if let Some(coat) = &self.coat
            && let Some(ggx) = coat.facets.ggx()
        {
            let (perfect, density) = ggx.evaluate(wo, wi);
            let bounces = coat.reflection.strength * coat.facets.bounces(wo.z, wi.z);
            value += (coat.reflection.fresnel.at(facet_cosine) * perfect + bounces) * coat.share;
            pdf += chances[0] * density;
        }
        (value, pdf)
    }

    /// See [`super::Bsdf::sample`].
    pub fn sample(&self, wo: Vec3, u: f32, u2: [f32; 2]) -> Option<Sample> {
        let lobes = self.lobes(wo);
        let smooth = self.smooth_of(wo, &lobes);
        let chances = self.chances(&lobes, &smooth);
        let [coat, facets, scattered, mirrors] = chances;
        let facet = |ggx: &super::ggx::Ggx| {
            let normal = ggx.sample(wo, u2);
            normal * (2.0 * wo.dot(normal)) - wo
        };
        let wi = if u < coat {
            facet(self.coat.as_ref()?.facets.ggx()?)
        } else if u < coat + facets {
            facet(self.facets.ggx()?)
        } else if u < coat + facets + scattered {
            warp::cosine_hemisphere(u2)
        } else {
            let rest = ((u - (coat + facets + scattered)) / mirrors).clamp(0.0, 1.0);
            return smooth.sample(rest, mirrors);
        };
        if wi.z <= 0.0 {
            return None;
        }
        let (value, pdf) = self.evaluate_lobes(wo, wi, &lobes, &chances);
        (pdf > 0.0).then(|| Sample::scattered(wi, value / pdf, pdf))
    }
}

fn mean(colour: Vec3) -> f32 {
    colour.element_sum() * (1.0 / 3.0)
}

/// The direction of refracted light whose cosine below the surface is `cosine`.
fn refracted(wo: Vec3, eta: f32, cosine: f32) -> Vec3 {
    Vec3::new(-wo.x / eta, -wo.y / eta, -cosine).normalize()
}
