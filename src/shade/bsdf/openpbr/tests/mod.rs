//! Tests of the BSDF by itself: energy, reciprocity, sampling, and the values of a published implementation.

mod energy;
mod reference;

use super::parameters::{CoatParameters, FilmParameters, FuzzParameters, Parameters};
use super::{OpenPbr, Smoothness};
use crate::geom::Sampler;
use crate::lanes::{Int, LaneTask, Lanes, Num, SimdLevel, Vector};
use glam::Vec3;

/// The parameters of a surface, with the specification's defaults.
#[derive(Clone, Copy, Debug)]
struct Numbers {
    base: Vec3,
    diffuse_roughness: f32,
    metalness: f32,
    specular_weight: f32,
    specular_color: Vec3,
    roughness: f32,
    anisotropy: f32,
    ior: f32,
    transmission: (f32, Vec3),
    coat: f32,
    coat_color: Vec3,
    coat_roughness: f32,
    coat_ior: f32,
    coat_darkening: f32,
    fuzz: f32,
    fuzz_color: Vec3,
    fuzz_roughness: f32,
    film: f32,
    film_thickness: f32,
    film_ior: f32,
    thin: bool,
    outside: bool,
}

impl Default for Numbers {
    fn default() -> Self {
        Self {
            base: Vec3::splat(0.8),
            diffuse_roughness: 0.0,
            metalness: 0.0,
            specular_weight: 1.0,
            specular_color: Vec3::ONE,
            roughness: 0.3,
            anisotropy: 0.0,
            ior: 1.5,
            transmission: (0.0, Vec3::ONE),
            coat: 0.0,
            coat_color: Vec3::ONE,
            coat_roughness: 0.0,
            coat_ior: 1.6,
            coat_darkening: 1.0,
            fuzz: 0.0,
            fuzz_color: Vec3::ONE,
            fuzz_roughness: 0.5,
            film: 0.0,
            film_thickness: 0.5,
            film_ior: 1.4,
            thin: false,
            outside: true,
        }
    }
}

impl Numbers {
    #[inline(always)]
    fn bsdf<L: Lanes>(&self, l: L) -> OpenPbr<L> {
        let (x, v) = (|x: f32| Num::splat(l, x), |v: Vec3| Vector::splat(l, v));
        let parameters = Parameters {
            base: v(self.base),
            base_diffuse_roughness: x(self.diffuse_roughness),
            base_metalness: x(self.metalness),
            specular_weight: x(self.specular_weight),
            specular_color: v(self.specular_color),
            specular_roughness: x(self.roughness),
            specular_anisotropy: (self.anisotropy > 0.0).then_some(x(self.anisotropy)),
            specular_ior: x(self.ior),
            transmission: (self.transmission.0 > 0.0)
                .then_some((x(self.transmission.0), v(self.transmission.1))),
            coat: (self.coat > 0.0).then_some(CoatParameters {
                weight: x(self.coat),
                color: v(self.coat_color),
                roughness: x(self.coat_roughness),
                anisotropy: None,
                ior: x(self.coat_ior),
                darkening: x(self.coat_darkening),
            }),
            fuzz: (self.fuzz > 0.0).then_some(FuzzParameters {
                weight: x(self.fuzz),
                color: v(self.fuzz_color),
                roughness: x(self.fuzz_roughness),
            }),
            film: (self.film > 0.0).then_some(FilmParameters {
                weight: x(self.film),
                thickness: x(self.film_thickness),
                ior: x(self.film_ior),
            }),
            thin_walled: self.thin,
        };
        OpenPbr::of(
            &parameters,
            (Num::splat(l, 1.0)).above(if self.outside { 0.5 } else { 2.0 }),
            Smoothness::EXACT,
        )
    }
}

/// Light reflected and transmitted towards a direction under a uniform environment, by sampling. Light that passes
/// into another medium counts as energy, without the change of its solid angle.
struct Furnace<'a> {
    of: &'a Numbers,
    wo: Vec3,
    samples: u32,
}

impl LaneTask for Furnace<'_> {
    type Output = [Vec3; 2];

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> [Vec3; 2] {
        let bsdf = self.of.bsdf(l);
        let wo = Vector::splat(l, self.wo);
        let mut sums = [Vec3::ZERO; 2];
        for first in (0..self.samples).step_by(L::LANES) {
            let sampler = Sampler::of(Int::splat(l, 17), Int::iota(l) + first, 3);
            let [u, pair] = [0, 1].map(|dimension| Int::splat(l, dimension));
            let (u, [a, b]) = (sampler.one(u), sampler.two(pair));
            let sample = bsdf.sample(wo, u, [a, b]);
            let light = (sample.weight * sample.eta * sample.eta).only(sample.valid);
            for (sum, light) in sums.iter_mut().zip([light.only(!sample.crosses), light.only(sample.crosses)])
            {
                for (k, column) in [light.x, light.y, light.z].into_iter().enumerate() {
                    sum[k] += column.to_array().as_ref().iter().sum::<f32>();
                }
            }
        }
        sums.map(|sum| sum / self.samples as f32)
    }
}

fn furnace(of: &Numbers, wo: Vec3, samples: u32) -> [Vec3; 2] {
    SimdLevel::detect().run(Furnace { of, wo, samples })
}

fn direction(z: f32, phi: f32) -> Vec3 {
    let sine = (1.0 - z * z).max(0.0).sqrt();
    Vec3::new(sine * libm::cosf(phi), sine * libm::sinf(phi), z)
}
