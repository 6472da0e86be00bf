//! The parameters of OpenPBR's surface at points.

use crate::lanes::{Lanes, Num, Vector};
use crate::scene::{self, Scene, TexturePoint};
use crate::shade::lookup;

/// The parameters of the surface at points, named and in the units of the specification.
#[derive(Clone, Copy, Debug)]
pub struct Parameters<L: Lanes> {
    /// `base_weight` × `base_color`.
    pub base: Vector<L>,
    pub base_diffuse_roughness: Num<L>,
    pub base_metalness: Num<L>,
    pub specular_weight: Num<L>,
    pub specular_color: Vector<L>,
    pub specular_roughness: Num<L>,
    /// `None` if the facets are isotropic.
    pub specular_anisotropy: Option<Num<L>>,
    pub specular_ior: Num<L>,
    /// `transmission_weight`, and `transmission_color` where the depth is 0.
    pub transmission: Option<(Num<L>, Vector<L>)>,
    pub subsurface: Option<SubsurfaceParameters<L>>,
    pub coat: Option<CoatParameters<L>>,
    pub fuzz: Option<FuzzParameters<L>>,
    pub film: Option<FilmParameters<L>>,
    pub thin_walled: bool,
}

/// `subsurface_weight` and so on.
#[derive(Clone, Copy, Debug)]
pub struct SubsurfaceParameters<L: Lanes> {
    pub weight: Num<L>,
    pub color: Vector<L>,
    pub anisotropy: Num<L>,
}

/// `coat_weight` and so on.
#[derive(Clone, Copy, Debug)]
pub struct CoatParameters<L: Lanes> {
    pub weight: Num<L>,
    pub color: Vector<L>,
    pub roughness: Num<L>,
    pub anisotropy: Option<Num<L>>,
    pub ior: Num<L>,
    pub darkening: Num<L>,
}

/// `fuzz_weight` and so on.
#[derive(Clone, Copy, Debug)]
pub struct FuzzParameters<L: Lanes> {
    pub weight: Num<L>,
    pub color: Vector<L>,
    pub roughness: Num<L>,
}

/// `thin_film_weight` and so on; the thickness is in micrometres.
#[derive(Clone, Copy, Debug)]
pub struct FilmParameters<L: Lanes> {
    pub weight: Num<L>,
    pub thickness: Num<L>,
    pub ior: Num<L>,
}

impl<L: Lanes> Parameters<L> {
    /// The parameters of a surface at points.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn at(scene: &Scene, of: &scene::OpenPbr, at: &TexturePoint<L>) -> Self {
        let l = at.lanes();
        let given = [&of.base_metalness, &of.specular_roughness];
        let [base_metalness, specular_roughness] = lookup::shares(scene, given, at);
        let is_coat_anisotropic =
            |coat: &scene::OpenPbrCoat| of.specular_anisotropy.is_some() && coat.anisotropy.factor > 0.0;
        Self {
            base: lookup::albedo(scene, &of.base_color, at) * lookup::share(scene, &of.base_weight, at),
            base_diffuse_roughness: lookup::share(scene, &of.base_diffuse_roughness, at),
            base_metalness,
            specular_weight: lookup::scalar(scene, &of.specular_weight, at).clamp(0.0, f32::MAX),
            specular_color: lookup::albedo(scene, &of.specular_color, at),
            specular_roughness: at.footprint.roughened(specular_roughness),
            specular_anisotropy: match &of.specular_anisotropy {
                Some(of) if of.strength.factor > 0.0 => Some(lookup::share(scene, &of.strength, at)),
                _ => None,
            },
            specular_ior: Num::splat(l, of.specular_ior),
            transmission: match of.transmission_weight.factor > 0.0 {
                true => Some((
                    lookup::share(scene, &of.transmission_weight, at),
                    lookup::albedo(scene, &of.transmission_color, at),
                )),
                false => None,
            },
            subsurface: match &of.subsurface {
                Some(subsurface) => Some(SubsurfaceParameters {
                    weight: lookup::share(scene, &subsurface.weight, at),
                    color: Vector::splat(l, subsurface.color),
                    anisotropy: Num::splat(l, subsurface.anisotropy),
                }),
                None => None,
            },
            coat: match &of.coat {
                Some(coat) => Some(CoatParameters {
                    weight: lookup::share(scene, &coat.weight, at),
                    color: lookup::albedo(scene, &coat.color, at),
                    roughness: at.footprint.roughened(lookup::share(scene, &coat.roughness, at)),
                    anisotropy: if is_coat_anisotropic(coat) {
                        Some(lookup::share(scene, &coat.anisotropy, at))
                    } else {
                        None
                    },
                    ior: Num::splat(l, coat.ior),
                    darkening: Num::splat(l, coat.darkening),
                }),
                None => None,
            },
            fuzz: match &of.fuzz {
                Some(fuzz) => Some(FuzzParameters {
                    weight: lookup::share(scene, &fuzz.weight, at),
                    color: lookup::albedo(scene, &fuzz.color, at),
                    roughness: lookup::share(scene, &fuzz.roughness, at),
                }),
                None => None,
            },
            film: match &of.thin_film {
                Some(film) => Some(FilmParameters {
                    weight: lookup::share(scene, &film.strength, at),
                    thickness: lookup::film_thickness(scene, film, at) * 1e-3,
                    ior: Num::splat(l, film.ior),
                }),
                None => None,
            },
            thin_walled: of.thin_walled,
        }
    }
}
