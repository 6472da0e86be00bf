//! glTF's metallic-roughness surface.

use super::{Channel, Coats, Colour, NormalMap, Scalar, TextureRef};
use glam::Vec3;

/// A glTF 2.0 metallic-roughness surface (GGX) with the extensions that its fields name.
#[derive(Clone, Copy, Debug, PartialEq)]
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
    /// Whether the surface is a thin wall, through which light passes without refraction. Otherwise it bounds a
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
        }
    }
}

impl Principled {
    /// Whether the surface has a clear coat or other coats.
    pub fn has_coats(&self) -> bool {
        self.clearcoat.factor != 0.0 || !self.coats.is_empty()
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
#[derive(Clone, Copy, Debug, PartialEq)]
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
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sheen {
    /// `sheenColorFactor`, 0..=1.
    pub colour: Colour,
    /// Perceptual roughness of the sheen, 0..=1: how far fibres deviate from the normal.
    pub roughness: Scalar,
}

/// KHR_materials_iridescence: interference in a thin film.
#[derive(Clone, Copy, Debug, PartialEq)]
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
