//! OpenPBR's surface.

use super::{Anisotropy, Colour, Iridescence, Scalar, TextureRef, index_for_channel};
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// The surface of OpenPBR 1.1 (Academy Software Foundation 2025, *OpenPBR Surface specification*). Fields have the
/// specification's names, meanings and ranges. Colours are linear Rec. 709. The inside of its body is the material's
/// [`super::Medium`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct OpenPbr {
    /// `base_weight`, 0..=1: a factor of `base_color`.
    pub base_weight: Scalar,
    /// `base_color`, 0..=1: albedo of the diffuse base, reflectance of metal at normal incidence.
    pub base_color: Colour,
    /// `base_diffuse_roughness`, 0..=1.
    pub base_diffuse_roughness: Scalar,
    /// `base_metalness`: share of metal, 0..=1.
    pub base_metalness: Scalar,
    /// `specular_weight`, ≥ 0: factor of the dielectric's reflectance at normal incidence, by its index of refraction.
    /// Up to 1 a factor of the metal's reflectance, too.
    pub specular_weight: Scalar,
    /// `specular_color`, 0..=1: tint of the dielectric's reflection, and of the metal's towards grazing angles.
    pub specular_color: Colour,
    /// `specular_roughness`, 0..=1. Its square is GGX's alpha.
    pub specular_roughness: Scalar,
    /// `specular_roughness_anisotropy`, 0..=1 as the strength, and the tangent that base and coat are rougher along.
    pub specular_anisotropy: Option<Anisotropy>,
    /// `specular_ior`, > 0.
    pub specular_ior: f32,
    /// `transmission_weight`: share of the dielectric base that is translucent, 0..=1.
    pub transmission_weight: Scalar,
    /// `transmission_color` where `transmission_depth` is 0: the share of light that remains at each crossing, 0..=1.
    /// With a depth it is the material's medium instead.
    pub transmission_color: Colour,
    /// 20 × `transmission_dispersion_scale` / `transmission_dispersion_abbe_number`, ≥ 0, as
    /// [`super::Principled::dispersion`].
    pub dispersion: f32,
    /// The subsurface; none if its weight is 0.
    pub subsurface: Option<OpenPbrSubsurface>,
    /// The coat; none if its weight is 0.
    pub coat: Option<OpenPbrCoat>,
    /// The fuzz; none if its weight is 0.
    pub fuzz: Option<OpenPbrFuzz>,
    /// `thin_film_weight`, `thin_film_ior` and `thin_film_thickness`, which here is in nanometres.
    pub thin_film: Option<Iridescence>,
    /// `geometry_thin_walled`: true if the surface is a thin wall, which light passes straight on.
    pub thin_walled: bool,
}

/// A share of the opaque base into which light diffuses. It comes out again after it was scattered in the material's
/// medium, for which [`super::Medium::reflecting`] takes the radii.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct OpenPbrSubsurface {
    /// `subsurface_weight`: share of the opaque dielectric base, 0..=1.
    pub weight: Scalar,
    /// `subsurface_color`, 0..=1: what a thin wall scatters, and what renderers show that scatter no light in media.
    /// Otherwise the medium decides.
    pub color: Vec3,
    /// `subsurface_scatter_anisotropy`, −1..=1: which side a thin wall scatters light to.
    pub anisotropy: f32,
}

/// A layer of dielectric over the base, which absorbs light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct OpenPbrCoat {
    /// `coat_weight`: covered share, 0..=1.
    pub weight: Scalar,
    /// `coat_color`: share of light that passes down and up at normal incidence, 0..=1.
    pub color: Colour,
    /// `coat_roughness`, 0..=1. It makes the base rougher, too.
    pub roughness: Scalar,
    /// `coat_roughness_anisotropy`, 0..=1, along the tangent of [`OpenPbr::specular_anisotropy`]. Without that, coats
    /// are isotropic.
    pub anisotropy: Scalar,
    /// `coat_ior`, > 0.
    pub ior: f32,
    /// `coat_darkening`, 0..=1: strength of the darkening by reflections between coat and base.
    pub darkening: f32,
}

/// Fibres over coat and base.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct OpenPbrFuzz {
    /// `fuzz_weight`: covered share, 0..=1.
    pub weight: Scalar,
    /// `fuzz_color`, 0..=1: tint of the fibres' reflection.
    pub color: Colour,
    /// `fuzz_roughness`, 0..=1.
    pub roughness: Scalar,
}

impl OpenPbr {
    /// The textures that its parameters read, with the parameters' names.
    pub(crate) fn textures(&self) -> impl Iterator<Item = (&'static str, TextureRef)> {
        let of = |scalar: &Scalar| scalar.texture.map(|(texture, _)| texture);
        let (coat, fuzz, film) = (self.coat.as_ref(), self.fuzz.as_ref(), self.thin_film.as_ref());
        let subsurface = self.subsurface.as_ref();
        let grooves = self.specular_anisotropy.as_ref();
        let read = [
            ("base-weight", of(&self.base_weight)),
            ("base-color", self.base_color.texture),
            ("base-diffuse-roughness", of(&self.base_diffuse_roughness)),
            ("base-metalness", of(&self.base_metalness)),
            ("specular-weight", of(&self.specular_weight)),
            ("specular-color", self.specular_color.texture),
            ("specular-roughness", of(&self.specular_roughness)),
            (
                "specular-roughness-anisotropy",
                grooves.and_then(|grooves| grooves.direction.or(of(&grooves.strength))),
            ),
            ("transmission-weight", of(&self.transmission_weight)),
            ("transmission-color", self.transmission_color.texture),
            ("subsurface-weight", subsurface.and_then(|subsurface| of(&subsurface.weight))),
            ("coat-weight", coat.and_then(|coat| of(&coat.weight))),
            ("coat-color", coat.and_then(|coat| coat.color.texture)),
            ("coat-roughness", coat.and_then(|coat| of(&coat.roughness))),
            ("coat-roughness-anisotropy", coat.and_then(|coat| of(&coat.anisotropy))),
            ("fuzz-weight", fuzz.and_then(|fuzz| of(&fuzz.weight))),
            ("fuzz-color", fuzz.and_then(|fuzz| fuzz.color.texture)),
            ("fuzz-roughness", fuzz.and_then(|fuzz| of(&fuzz.roughness))),
            ("thin-film-weight", film.and_then(|film| of(&film.strength))),
            ("thin-film-thickness", film.and_then(|film| film.thickness_texture.map(|(texture, _)| texture))),
        ];
        read.into_iter().filter_map(|(name, texture)| Some((name, texture?)))
    }
}

impl Default for OpenPbr {
    fn default() -> Self {
        let one = Scalar::constant(1.0);
        let zero = Scalar::constant(0.0);
        Self {
            base_weight: one,
            base_color: Colour::constant(Vec3::splat(0.8)),
            base_diffuse_roughness: zero,
            base_metalness: zero,
            specular_weight: one,
            specular_color: Colour::constant(Vec3::ONE),
            specular_roughness: Scalar::constant(0.3),
            specular_anisotropy: None,
            specular_ior: 1.5,
            transmission_weight: zero,
            transmission_color: Colour::constant(Vec3::ONE),
            dispersion: 0.0,
            subsurface: None,
            coat: None,
            fuzz: None,
            thin_film: None,
            thin_walled: false,
        }
    }
}

impl Default for OpenPbrCoat {
    /// The specification's defaults, except that the weight is 1.
    fn default() -> Self {
        Self {
            weight: Scalar::constant(1.0),
            color: Colour::constant(Vec3::ONE),
            roughness: Scalar::constant(0.0),
            anisotropy: Scalar::constant(0.0),
            ior: 1.6,
            darkening: 1.0,
        }
    }
}

impl Default for OpenPbrFuzz {
    /// The specification's defaults, except that the weight is 1.
    fn default() -> Self {
        let [weight, roughness] = [1.0, 0.5].map(Scalar::constant);
        Self { weight, color: Colour::constant(Vec3::ONE), roughness }
    }
}

impl OpenPbr {
    /// True if the surface refracts red, green and blue light differently.
    #[inline]
    pub fn is_dispersive(&self) -> bool {
        self.dispersion > 0.0 && self.transmission_weight.factor != 0.0 && !self.thin_walled
    }

    /// The surface for red (0), green (1) or blue light (2): with that light's index of refraction.
    pub fn of_channel(&self, channel: usize) -> Self {
        Self { specular_ior: index_for_channel(self.specular_ior, self.dispersion, channel), ..*self }
    }
}
