//! glTF's metallic-roughness surface.

use super::{Channel, Coats, Colour, NormalMap, Scalar, TextureRef};
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// A glTF 2.0 metallic-roughness surface (GGX) with the extensions that its fields name.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Principled {
    /// `baseColorFactor` and `baseColorTexture`, 0..=1: diffuse albedo of the dielectric share, reflectance at normal
    /// incidence of the metallic share.
    pub base_colour: Colour,
    /// `metallicFactor`: share of metal, 0..=1.
    pub metallic: Scalar,
    /// `roughnessFactor`: perceptual roughness of reflection and transmission, 0..=1. Its square is GGX's alpha.
    pub roughness: Scalar,
    /// Index of refraction of the dielectric share, ≥ 1 (KHR_materials_ior).
    pub ior: f32,
    /// Strength of the dielectric share's specular reflection, 0..=1 (`specularFactor` of KHR_materials_specular).
    pub specular: Scalar,
    /// Tint of that reflection at normal incidence, ≥ 0 (`specularColorFactor`).
    pub specular_colour: Colour,
    /// Share of the diffuse reflection that transmission replaces, 0..=1 (KHR_materials_transmission).
    pub transmission: Scalar,
    /// True if the surface is a thin wall, through which light passes without refraction. Otherwise it bounds a
    /// closed body and refracts (KHR_materials_volume with a thickness above 0).
    pub thin: bool,
    /// Strength of the clear coat, 0..=1 (KHR_materials_clearcoat).
    pub clearcoat: Scalar,
    /// Perceptual roughness of the clear coat, 0..=1.
    pub clearcoat_roughness: Scalar,
    /// Further coats over the clear coat. Transparent surfaces ignore them.
    pub coats: Coats,
    /// Normal map of all coats (`clearcoatNormalTexture`). Without one, coats have the interpolated normal, even if
    /// the material has a normal map.
    pub coat_normal_map: Option<NormalMap>,
    /// Anisotropic roughness.
    pub anisotropy: Option<Anisotropy>,
    /// A layer of fibres that reflects at grazing angles, below the coats.
    pub sheen: Option<Sheen>,
    /// A thin film with interference colours, below the coats.
    pub iridescence: Option<Iridescence>,
    /// KHR_materials_pbrSpecularGlossiness: glossiness, 0..=1. If it is there, the roughness is 1 − glossiness instead
    /// of `roughness`. The base then gets, in all channels alike, what the dielectric's reflection leaves in its
    /// brightest channel. The reflection at normal incidence is that of `ior` times `specular_colour`, as without it.
    pub glossiness: Option<Scalar>,
    /// The share of the diffuse base that transmits light.
    pub diffuse_transmission: Option<DiffuseTransmission>,
    /// KHR_materials_dispersion: 20 divided by the Abbe number, ≥ 0; 0 if all colours are refracted alike. Has an
    /// effect on transparent bodies (`transmission`, not `thin`), and in the path tracer alone. Other integrators
    /// refract all colours with `ior`.
    pub dispersion: f32,
}

impl Default for Principled {
    /// glTF's defaults, except that `metallic` is 0.
    fn default() -> Self {
        Self {
            base_colour: Colour::constant(Vec3::ONE),
            metallic: Scalar::constant(0.0),
            roughness: Scalar::constant(1.0),
            ior: 1.5,
            specular: Scalar::constant(1.0),
            specular_colour: Colour::constant(Vec3::ONE),
            transmission: Scalar::constant(0.0),
            thin: true,
            clearcoat: Scalar::constant(0.0),
            clearcoat_roughness: Scalar::constant(0.0),
            coats: Coats::NONE,
            coat_normal_map: None,
            anisotropy: None,
            sheen: None,
            iridescence: None,
            glossiness: None,
            diffuse_transmission: None,
            dispersion: 0.0,
        }
    }
}

/// The wavelengths in nanometres at which red, green and blue light is refracted: Fraunhofer's lines C, d and F, which
/// define the Abbe number.
const LINES_NM: [f32; 3] = [656.3, 587.6, 486.1];

/// The index of refraction for red (0), green (1) or blue light (2) of a medium of index `ior` and a dispersion of 20
/// divided by the Abbe number. At least 1.
pub(super) fn index_for_channel(ior: f32, dispersion: f32, channel: usize) -> f32 {
    let spread = (ior - 1.0) * dispersion / 20.0;
    let place = 523_655.0 / (LINES_NM[channel] * LINES_NM[channel]) - 1.5168;
    (ior + spread * place).max(1.0)
}

impl Principled {
    /// True if the surface refracts red, green and blue light differently.
    #[inline]
    pub fn is_dispersive(&self) -> bool {
        self.dispersion > 0.0 && self.transmission.factor != 0.0 && !self.thin
    }

    /// The index of refraction for red (0), green (1) or blue light (2): the first two terms of Cauchy's equation, as
    /// KHR_materials_dispersion gives them, at Fraunhofer's lines C, d and F. At least 1.
    pub fn index_of_refraction(&self, channel: usize) -> f32 {
        index_for_channel(self.ior, self.dispersion, channel)
    }

    /// The surface for red (0), green (1) or blue light (2). It refracts with that light's index of refraction, and
    /// outside of the body it reflects as the surface does.
    pub fn of_channel(&self, channel: usize) -> Self {
        let ior = self.index_of_refraction(channel);
        let mut one = Self { ior, ..*self };
        let reflectance = |ior: f32| ((ior - 1.0) / (ior + 1.0)).powi(2);
        if ior > 1.0 {
            one.specular_colour.factor *= reflectance(self.ior) / reflectance(ior);
        }
        one
    }

    /// True if the surface has a clear coat or other coats.
    #[inline]
    pub fn has_coats(&self) -> bool {
        self.clearcoat.factor != 0.0 || !self.coats.is_empty()
    }

    /// True if the surface has coats that do not share the material's normals.
    #[inline]
    pub fn has_own_coat(&self, normals: Option<&NormalMap>) -> bool {
        self.has_coats() && self.coat_normal_map.as_ref() != normals
    }

    /// Rough glass that bounds a closed body. Each crossing multiplies light by `tint`.
    pub fn glass(ior: f32, tint: Vec3, roughness: Scalar) -> Self {
        Self {
            base_colour: Colour::constant(tint),
            roughness,
            ior,
            transmission: Scalar::constant(1.0),
            thin: false,
            ..Self::default()
        }
    }
}

/// KHR_materials_anisotropy: reflection is rougher along one direction. GGX's alpha along it is mix(alpha, 1,
/// strength²).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Anisotropy {
    /// `anisotropyStrength`, 0..=1.
    pub strength: Scalar,
    /// `anisotropyRotation`: angle of the rougher direction, radians from the tangent towards the bitangent.
    pub rotation: f32,
    /// Red and green, 0..=1 mapped to −1..=1, are the direction in tangent space before the rotation. Without a
    /// texture the direction is the tangent.
    pub direction: Option<TextureRef>,
}

/// KHR_materials_sheen: reflection of fibres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sheen {
    /// `sheenColorFactor`, 0..=1.
    pub colour: Colour,
    /// Perceptual roughness of the sheen, 0..=1: how far fibres deviate from the normal.
    pub roughness: Scalar,
}

/// KHR_materials_diffuse_transmission: light that leaves on the other side, evenly in all directions. A thin wall or a
/// body.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DiffuseTransmission {
    /// `diffuseTransmissionFactor`: share of the diffuse base that transmits instead of reflecting, 0..=1.
    pub share: Scalar,
    /// `diffuseTransmissionColorFactor`: share of that light which is not absorbed, 0..=1 for each channel.
    pub colour: Colour,
}

/// KHR_materials_iridescence: interference in a thin film.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Iridescence {
    /// `iridescenceFactor`, 0..=1.
    pub strength: Scalar,
    /// Index of refraction of the film, ≥ 1.
    pub ior: f32,
    /// Thickness of the film in nanometres where the texture is 0 and where it is 1. Without a texture the second
    /// value is the thickness.
    pub thickness_nm: [f32; 2],
    /// Interpolates between the two thicknesses.
    pub thickness_texture: Option<(TextureRef, Channel)>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_indices_of_refraction_have_the_given_abbe_number() {
        for (ior, abbe) in [(1.5, 59.0), (2.4168, 55.0), (2.6, 9.8)] {
            let glass = Principled {
                dispersion: 20.0 / abbe,
                ..Principled::glass(ior, Vec3::ONE, Scalar::constant(0.0))
            };
            let [red, green, blue] = [0, 1, 2].map(|channel| glass.index_of_refraction(channel));
            assert!((green - ior).abs() < 1e-4, "{green}");
            assert!(((ior - 1.0) / (blue - red) / abbe - 1.0).abs() < 1e-3, "{red} {green} {blue}");
        }
        let glass =
            Principled { dispersion: 1e6, ..Principled::glass(1.2, Vec3::ONE, Scalar::constant(0.0)) };
        assert_eq!(glass.index_of_refraction(0), 1.0, "never below that of a vacuum");
        assert!(!Principled { thin: true, ..glass }.is_dispersive() && glass.is_dispersive());
    }
}
