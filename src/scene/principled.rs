//! glTF's surface.

use super::{Channel, Coats, Colour, NormalMap, Scalar, TextureRef};
use glam::Vec3;

/// glTF 2.0 metallic-roughness (GGX) with the extensions of the design's section 4.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Principled {
    /// Diffuse albedo of the dielectric share, reflectance at normal incidence of the metallic one.
    pub base_colour: Colour,
    /// Share of metal, 0..=1.
    pub metallic: Scalar,
    /// Perceptual roughness, 0..=1, of what is reflected and of what is transmitted; its square is GGX's alpha.
    pub roughness: Scalar,
    /// Index of refraction of the dielectric share, ≥ 1.
    pub ior: f32,
    /// Strength of its reflection (KHR_materials_specular), 0..=1.
    pub specular: Scalar,
    /// Tint of its reflection at normal incidence, ≥ 0.
    pub specular_colour: Colour,
    /// Share of the diffuse reflection replaced by transmission (KHR_materials_transmission), 0..=1.
    pub transmission: Scalar,
    /// Whether transmission passes straight through (a thin wall) or enters a closed body that
    /// refracts (KHR_materials_volume with a thickness above 0).
    pub thin: bool,
    /// Strength of the clear coat (KHR_materials_clearcoat), 0..=1.
    pub clearcoat: Scalar,
    /// Its perceptual roughness, 0..=1.
    pub clearcoat_roughness: Scalar,
    /// Coats over the clear coat. What is transparent has none.
    pub coats: Coats,
    /// Bends the normal of all coats. Without one they are even, whatever map the material has.
    pub coat_normal_map: Option<NormalMap>,
    /// Grooves that spread reflections in one direction.
    pub anisotropy: Option<Anisotropy>,
    /// Fibres that shine at grazing angles, below the coat.
    pub sheen: Option<Sheen>,
    /// A thin film that reflects in colours, below the coat.
    pub iridescence: Option<Iridescence>,
}

impl Default for Principled {
    /// glTF's defaults, but not metallic.
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
    /// Whether anything is coated.
    pub fn has_coats(&self) -> bool {
        self.clearcoat.factor != 0.0 || !self.coats.is_empty()
    }

    /// A rough body of glass, tinted at each crossing.
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

/// KHR_materials_anisotropy: along one direction the reflection is rougher, GGX's alpha there being
/// mix(alpha, 1, strength²).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Anisotropy {
    /// 0..=1.
    pub strength: Scalar,
    /// Of that direction, radians from the tangent towards the bitangent.
    pub rotation: f32,
    /// Its red and green, 0..=1 mapped to −1..=1, are the direction before it is rotated, else the tangent.
    pub direction: Option<TextureRef>,
}

/// KHR_materials_sheen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sheen {
    /// 0..=1.
    pub colour: Colour,
    /// Perceptual, 0..=1: how far fibres lean.
    pub roughness: Scalar,
}

/// KHR_materials_iridescence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Iridescence {
    /// 0..=1.
    pub strength: Scalar,
    /// The film's index of refraction, ≥ 1.
    pub ior: f32,
    /// Its thickness in nanometres where the texture is 0 and 1; without a texture the latter counts.
    pub thickness_nm: [f32; 2],
    /// Where between the two it lies.
    pub thickness_texture: Option<(TextureRef, Channel)>,
}
