//! Tests of the BSDF by itself: energy, reciprocity, sampling, and the values of a published implementation.

mod energy;
mod reference;

use super::parameters::{CoatParameters, FilmParameters, FuzzParameters, Parameters, SubsurfaceParameters};
use super::{Evaluate, OpenPbr, Sampling, Smoothness};
use crate::geom::Sampler;
use crate::lanes::{Int, LaneTask, Lanes, Mask, Num, OutlinedTask, SimdLevel, Vector};
use crate::shade::bsdf::Sample;
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
    subsurface: (f32, Vec3),
    subsurface_anisotropy: f32,
    /// True if light enters the body of a subsurface.
    enters: bool,
    coat: f32,
    coat_color: Vec3,
    coat_roughness: f32,
    coat_anisotropy: f32,
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
            subsurface: (0.0, Vec3::ONE),
            subsurface_anisotropy: 0.0,
            enters: true,
            coat: 0.0,
            coat_color: Vec3::ONE,
            coat_roughness: 0.0,
            coat_anisotropy: 0.0,
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
        Self::lanes(l, std::slice::from_ref(self), 0)
    }

    /// The BSDF of the surfaces in turn, from number `first` on, one in each lane. It has the layers of all of them, as
    /// a surface with textures has. All are thin walls, or entered, if the first one is.
    #[inline(always)]
    fn lanes<L: Lanes>(l: L, all: &[Self], first: u32) -> OpenPbr<L> {
        let x = |of: &dyn Fn(&Self) -> f32| {
            let mut numbers = L::array(0.0);
            for (k, number) in numbers.as_mut().iter_mut().enumerate() {
                *number = of(&all[(first as usize + k) % all.len()]);
            }
            Num::from_array(l, &numbers)
        };
        let v = |of: fn(&Self) -> Vec3| Vector::new(x(&|n| of(n).x), x(&|n| of(n).y), x(&|n| of(n).z));
        let any = |of: fn(&Self) -> f32| all.iter().any(|numbers| of(numbers) > 0.0);
        let parameters = Parameters {
            base: v(|n| n.base),
            base_diffuse_roughness: x(&|n| n.diffuse_roughness),
            base_metalness: x(&|n| n.metalness),
            specular_weight: x(&|n| n.specular_weight),
            specular_color: v(|n| n.specular_color),
            specular_roughness: x(&|n| n.roughness),
            specular_anisotropy: any(|n| n.anisotropy).then(|| x(&|n| n.anisotropy)),
            specular_ior: x(&|n| n.ior),
            transmission: any(|n| n.transmission.0)
                .then(|| (x(&|n| n.transmission.0), v(|n| n.transmission.1))),
            subsurface: any(|n| n.subsurface.0).then(|| SubsurfaceParameters {
                weight: x(&|n| n.subsurface.0),
                color: v(|n| n.subsurface.1),
                anisotropy: x(&|n| n.subsurface_anisotropy),
            }),
            coat: any(|n| n.coat).then(|| CoatParameters {
                weight: x(&|n| n.coat),
                color: v(|n| n.coat_color),
                roughness: x(&|n| n.coat_roughness),
                anisotropy: any(|n| n.coat_anisotropy).then(|| x(&|n| n.coat_anisotropy)),
                ior: x(&|n| n.coat_ior),
                darkening: x(&|n| n.coat_darkening),
            }),
            fuzz: any(|n| n.fuzz).then(|| FuzzParameters {
                weight: x(&|n| n.fuzz),
                color: v(|n| n.fuzz_color),
                roughness: x(&|n| n.fuzz_roughness),
            }),
            film: any(|n| n.film).then(|| FilmParameters {
                weight: x(&|n| n.film),
                thickness: x(&|n| n.film_thickness),
                ior: x(&|n| n.film_ior),
            }),
            thin_walled: all[0].thin,
        };
        let outside = x(&|n| if n.outside { 1.0 } else { 0.0 }).above(0.5);
        let smoothness = Smoothness { enters_media: all[0].enters, ..Smoothness::EXACT };
        l.outlined(Make { parameters: &parameters, outside, smoothness })
    }
}

/// [`OpenPbr::of`] out of line. Wherever these functions were inlined the compiler would take many seconds.
struct Make<'a, L: Lanes> {
    parameters: &'a Parameters<L>,
    outside: Mask<L>,
    smoothness: Smoothness,
}

impl<L: Lanes> OutlinedTask<L> for Make<'_, L> {
    type Output = OpenPbr<L>;

    #[inline(always)]
    fn run(self, _: L) -> OpenPbr<L> {
        OpenPbr::of(self.parameters, self.outside, self.smoothness)
    }
}

/// [`OpenPbr::evaluate`] as shaders call it.
#[inline(always)]
fn evaluate<L: Lanes>(surface: &OpenPbr<L>, wo: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
    wo.lanes().outlined(Evaluate { surface, wo, wi })
}

/// [`OpenPbr::sample`] as shaders call it.
#[inline(always)]
fn sample<L: Lanes>(surface: &OpenPbr<L>, wo: Vector<L>, u: Num<L>, u2: [Num<L>; 2]) -> Sample<L> {
    wo.lanes().outlined(Sampling { surface, wo, u, u2 })
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
            let sample = sample(&bsdf, wo, u, [a, b]);
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
