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
    pub coat: Option<CoatParameters<L>>,
    pub fuzz: Option<FuzzParameters<L>>,
    pub film: Option<FilmParameters<L>>,
    pub thin_walled: bool,
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
        let share = |of: &scene::Scalar| lookup::share(scene, of, at);
        let colour = |of: &scene::Colour| lookup::albedo(scene, of, at);
        let given = [&of.base_metalness, &of.specular_roughness];
        let [base_metalness, specular_roughness] = lookup::shares(scene, given, at);
        let is_coat_anisotropic =
            |coat: &scene::OpenPbrCoat| of.specular_anisotropy.is_some() && coat.anisotropy.factor > 0.0;
        Self {
            base: colour(&of.base_color) * share(&of.base_weight),
            base_diffuse_roughness: share(&of.base_diffuse_roughness),
            base_metalness,
            specular_weight: lookup::scalar(scene, &of.specular_weight, at).clamp(0.0, f32::MAX),
            specular_color: colour(&of.specular_color),
            specular_roughness: at.footprint.roughened(specular_roughness),
            specular_anisotropy: match &of.specular_anisotropy {
                Some(of) if of.strength.factor > 0.0 => Some(share(&of.strength)),
                _ => None,
            },
            specular_ior: Num::splat(l, of.specular_ior),
            transmission: match of.transmission_weight.factor > 0.0 {
                true => Some((share(&of.transmission_weight), colour(&of.transmission_color))),
                false => None,
            },
            coat: of.coat.as_ref().map(|coat| CoatParameters {
                weight: share(&coat.weight),
                color: colour(&coat.color),
                roughness: at.footprint.roughened(share(&coat.roughness)),
                anisotropy: is_coat_anisotropic(coat).then(|| share(&coat.anisotropy)),
                ior: Num::splat(l, coat.ior),
                darkening: Num::splat(l, coat.darkening),
            }),
            fuzz: of.fuzz.as_ref().map(|fuzz| FuzzParameters {
                weight: share(&fuzz.weight),
                color: colour(&fuzz.color),
                roughness: share(&fuzz.roughness),
            }),
            film: of.thin_film.as_ref().map(|film| FilmParameters {
                weight: share(&film.strength),
                thickness: lookup::film_thickness(scene, film, at) * 1e-3,
                ior: Num::splat(l, film.ior),
            }),
            thin_walled: of.thin_walled,
        }
    }
}
