//! Materials as scene files describe them. `shade` converts them to BSDFs.

use super::{Channel, Medium, OpenPbr, Principled, TextureRef};
use glam::{Vec3, Vec4};
use serde::{Deserialize, Serialize};

/// A colour: a factor, multiplied by a texture's RGB if there is a texture, and by the mesh's colours if they count.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Colour {
    /// Linear Rec. 709. The range depends on the use.
    pub factor: Vec3,
    /// Its linear RGB multiplies the factor.
    pub texture: Option<TextureRef>,
    /// True if the RGB of [`super::TriangleMesh::colours`] multiplies the factor, too.
    pub vertex: bool,
}

impl Colour {
    /// A colour without a texture.
    pub fn constant(factor: Vec3) -> Self {
        Self { factor, texture: None, vertex: false }
    }

    /// True if the colour is the same everywhere.
    pub fn is_constant(&self) -> bool {
        self.texture.is_none() && !self.vertex
    }
}

/// A number: a factor, multiplied by one channel of a texture if there is a texture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scalar {
    /// The range depends on the use.
    pub factor: f32,
    /// The texture, and the channel that multiplies the factor.
    pub texture: Option<(TextureRef, Channel)>,
}

impl Scalar {
    /// A number without a texture.
    pub fn constant(factor: f32) -> Self {
        Self { factor, texture: None }
    }
}

/// Scattering of light by a surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "there are few, and they stay where they are")]
#[non_exhaustive]
pub enum Surface {
    /// Lambertian reflection on both sides.
    Matte {
        /// Albedo, 0..=1.
        reflectance: Colour,
    },
    /// Perfect specular reflection on both sides.
    Mirror {
        /// Reflected share of the light, 0..=1.
        reflectance: Colour,
    },
    /// A smooth dielectric boundary between the outside (index of refraction 1) and the inside of a closed body.
    Dielectric {
        /// Index of refraction of the inside, > 0. An index of 1 neither reflects nor refracts.
        ior: f32,
        /// Share of the transmitted light that remains after each crossing, 0..=1 for each channel of linear Rec.
        /// 709.
        transmittance: Vec3,
    },
    /// glTF's metallic-roughness surface.
    Principled(Principled),
    /// Index into [`super::Scene::procedurals`].
    Procedural(u32),
    /// Index into [`super::Scene::scatterings`].
    Scattering(u32),
    /// Index into [`super::Scene::mixes`]. A hit on a mix is resolved to one of its parts before it is shaded.
    Mix(u32),
    /// OpenPBR's surface.
    OpenPbr(OpenPbr),
}

/// Light that a surface emits, with the same radiance in all directions.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Emission {
    /// Emitted radiance, ≥ 0, linear Rec. 709.
    pub radiance: Colour,
    /// True if the back emits too. The front is the side from which the corners are counter-clockwise.
    pub two_sided: bool,
    /// True if the surface is meant to light others. Light sampling then chooses its triangles, unless their opacity
    /// is computed. The light of other surfaces (KHR_materials_unlit) is seen, and rays find it by chance.
    pub is_light: bool,
}

/// A tangent-space normal map, as glTF's `normalTexture`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NormalMap {
    /// Linear RGB, 0..=1 mapped to −1..=1. The y axis points along the bitangent (up in the image).
    pub texture: TextureRef,
    /// Factor of the normal's x and y.
    pub scale: f32,
}

/// Meaning of alpha, as glTF's `alphaMode`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum AlphaMode {
    /// Alpha is ignored.
    Opaque,
    /// Hits count where alpha is at least the cutoff.
    Mask {
        /// The least alpha at which a hit counts.
        cutoff: f32,
    },
    /// Hits count with probability alpha ([`super::Scene::alpha_accepts`]).
    Blend,
}

impl AlphaMode {
    /// True if rays may pass the surface. Trees mark such triangles.
    pub fn is_masked(self) -> bool {
        self != Self::Opaque
    }
}

/// Coverage of a surface. Rays pass where the alpha test fails.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Alpha {
    /// Meaning of alpha.
    pub mode: AlphaMode,
    /// Alpha, 0..=1. A texture's alpha is linear.
    pub value: Scalar,
    /// True if the alpha of [`super::TriangleMesh::colours`] multiplies the value.
    pub vertex: bool,
}

impl Default for Alpha {
    fn default() -> Self {
        Self { mode: AlphaMode::Opaque, value: Scalar::constant(1.0), vertex: false }
    }
}

/// A material of triangles.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Material {
    /// Name in the file, used by warnings and reports.
    pub name: String,
    /// Scattering of light by the surface.
    pub surface: Surface,
    /// Emitted light. `None` if the surface emits nothing, never a radiance of zero.
    pub emission: Option<Emission>,
    /// Perturbs the shading normal.
    pub normal_map: Option<NormalMap>,
    /// Coverage.
    pub alpha: Alpha,
    /// The absorbing medium inside the closed body that the surface bounds. `None` if the body is empty.
    pub medium: Option<Medium>,
}

impl Material {
    /// The material of triangles without one: matte grey, albedo 0.8.
    pub fn fallback() -> Self {
        Self::matte("default", Vec3::splat(0.8))
    }

    /// The material of coloured triangles without one: matte, of the colours of the mesh.
    pub fn vertex_coloured() -> Self {
        let reflectance = Colour { vertex: true, ..Colour::constant(Vec3::ONE) };
        Self { surface: Surface::Matte { reflectance }, ..Self::fallback() }
    }

    /// A matte surface of the given albedo, 0..=1.
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

    /// Lets the colours of vertices multiply the base colour, if the surface has one.
    pub(super) fn count_colours(&mut self) {
        match &mut self.surface {
            Surface::Matte { reflectance } | Surface::Mirror { reflectance } => reflectance.vertex = true,
            Surface::Principled(surface) => surface.base_colour.vertex = true,
            Surface::OpenPbr(surface) => surface.base_color.vertex = true,
            _ => {}
        }
    }

    /// Lets the alpha of vertices count, of one mesh or several, if any is below 1. Returns false, and leaves the
    /// material as it is, if alpha is 0 everywhere: nothing would be seen.
    pub(super) fn count_alpha(&mut self, meshes: &[&[Vec4]]) -> bool {
        let mut colours = meshes.iter().copied().flatten();
        if colours.clone().all(|colour| colour.w >= 1.0) {
            return true;
        }
        if colours.all(|colour| colour.w == 0.0) {
            return false;
        }
        self.alpha.vertex = true;
        if self.alpha.mode == AlphaMode::Opaque {
            self.alpha.mode = AlphaMode::Blend;
        }
        true
    }
}
