//! Materials as files describe them. `shade` turns them into BSDFs.

use super::{Channel, Medium, Principled, TextureRef};
use glam::Vec3;

/// A colour: a factor times a texture, if there is one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Colour {
    /// Linear Rec. 709.
    pub factor: Vec3,
    /// Looked up as RGB.
    pub texture: Option<TextureRef>,
}

impl Colour {
    /// The same colour everywhere.
    pub fn constant(factor: Vec3) -> Self {
        Self { factor, texture: None }
    }
}

/// A number: a factor times one channel of a texture, if there is one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scalar {
    /// The factor.
    pub factor: f32,
    /// The texture and the channel that counts.
    pub texture: Option<(TextureRef, Channel)>,
}

impl Scalar {
    /// The same number everywhere.
    pub fn constant(factor: f32) -> Self {
        Self { factor, texture: None }
    }
}

/// How a surface scatters light.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "there are few, and they stay where they are")]
pub enum Surface {
    /// Lambertian reflection, on both sides.
    Matte {
        /// Albedo, 0..=1.
        reflectance: Colour,
    },
    /// Perfect reflection, on both sides.
    Mirror {
        /// Share of light reflected, 0..=1.
        reflectance: Colour,
    },
    /// A smooth boundary between the outside (index 1) and the inside of a closed body.
    Dielectric {
        /// Index of refraction of the inside, > 0 (1 passes everything).
        ior: f32,
        /// Share of the transmitted light that each crossing lets through, 0..=1.
        transmittance: Vec3,
    },
    /// glTF's metallic-roughness surface.
    Principled(Principled),
    /// One of [`super::Scene::procedurals`].
    Procedural(u32),
    /// One of [`super::Scene::scatterings`].
    Scattering(u32),
    /// One of [`super::Scene::mixes`]. Hits are resolved to its parts before they are shaded.
    Mix(u32),
}

/// Light that a surface gives off, the same in all directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Emission {
    /// Radiance.
    pub radiance: Colour,
    /// Whether the back shines too.
    pub two_sided: bool,
}

/// A tangent-space normal map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalMap {
    /// Linear RGB, 0..=1 mapped to −1..=1; y points along the bitangent (up in the image).
    pub texture: TextureRef,
    /// Scales x and y.
    pub scale: f32,
}

/// What alpha means.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AlphaMode {
    /// Nothing.
    Opaque,
    /// The surface is there where alpha reaches the cutoff.
    Mask {
        /// The least alpha that counts as there.
        cutoff: f32,
    },
    /// The surface is there with probability alpha.
    Blend,
}

/// Where a surface is not there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Alpha {
    /// What alpha means.
    pub mode: AlphaMode,
    /// Alpha, 0..=1.
    pub value: Scalar,
}

impl Default for Alpha {
    fn default() -> Self {
        Self { mode: AlphaMode::Opaque, value: Scalar::constant(1.0) }
    }
}

/// A material.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// What files and reports call it.
    pub name: String,
    /// How it scatters.
    pub surface: Surface,
    /// What it gives off, if anything (`None` rather than zero).
    pub emission: Option<Emission>,
    /// Bends the shading normal.
    pub normal_map: Option<NormalMap>,
    /// Where it is not there.
    pub alpha: Alpha,
    /// What fills the body that it bounds.
    pub medium: Option<Medium>,
}

impl Material {
    /// A matte grey surface of albedo 0.8: what a triangle without a material is made of.
    pub fn fallback() -> Self {
        Self::matte("default", Vec3::splat(0.8))
    }

    /// A matte surface.
    pub fn matte(name: impl Into<String>, reflectance: Vec3) -> Self {
        Self {
            name: name.into(),
            surface: Surface::Matte { reflectance: Colour::constant(reflectance) },
            emission: None,
            normal_map: None,
            alpha: Alpha::default(),
            medium: None,
        }
    }
}
