//! The base of a surface: its colour and alpha, in glTF's own form or by specular reflection and glossiness.

use super::super::super::LoadProblem;
use super::super::texture::TextureInfo;
use super::Converter;
use super::layers::number;
use crate::scene::{Channel, Colour, ColourSpace, Scalar};
use ::gltf::json::Value;
use glam::Vec3;

/// Reflectance at normal incidence that the index of refraction 1.5 gives. A tint of the reflection is relative to it.
const REFLECTANCE: f32 = 0.04;

/// The extension that replaces metal and roughness.
const SPECULAR_GLOSSINESS: &str = "KHR_materials_pbrSpecularGlossiness";

/// The base colour or the diffuse colour, with alpha.
pub(super) struct Base<'a> {
    pub(super) colour: Vec3,
    pub(super) alpha: f32,
    pub(super) texture: Option<TextureInfo<'a>>,
}

/// Reflection as KHR_materials_pbrSpecularGlossiness gives it.
pub(super) struct SpecularGlossiness {
    /// Tint of the reflection that [`crate::scene::Principled::specular_colour`] takes with an index of 1.5.
    pub(super) tint: Colour,
    pub(super) glossiness: Scalar,
}

impl<'a, 'b> Converter<'a, 'b> {
    /// The colour and alpha of `diffuseFactor` and `diffuseTexture` if there are such, else of the base colour.
    pub(super) fn base(&mut self) -> Result<Base<'b>, LoadProblem> {
        let (name, [r, g, b, a], texture) = match self.extension(SPECULAR_GLOSSINESS) {
            None => {
                let pbr = self.source.pbr_metallic_roughness();
                let texture = pbr.base_color_texture().map(|info| TextureInfo::of(&info));
                ("baseColorFactor", pbr.base_color_factor(), texture)
            }
            Some(extension) => {
                let texture = self.texture_info(extension, "diffuseTexture")?;
                ("diffuseFactor", numbers(&extension.1["diffuseFactor"], 1.0), texture)
            }
        };
        let component = format!("a component of {name}");
        let colour = Vec3::new(r, g, b).map(|v| self.clamped(&component, v, 1.0));
        Ok(Base { colour, alpha: self.clamped(&format!("the alpha of {name}"), a, 1.0), texture })
    }

    /// The reflection of KHR_materials_pbrSpecularGlossiness. `None` if the material does not have the extension.
    pub(super) fn specular_glossiness(&mut self) -> Result<Option<SpecularGlossiness>, LoadProblem> {
        let Some(extension) = self.extension(SPECULAR_GLOSSINESS) else { return Ok(None) };
        // The crate keeps only the extensions without a type of its own by name.
        let [diffuse, dispersion] = ["KHR_materials_diffuse_transmission", "KHR_materials_dispersion"];
        let excluded = [
            ("KHR_materials_transmission", self.source.transmission().is_some()),
            ("KHR_materials_specular", self.source.specular().is_some()),
            ("KHR_materials_ior", self.source.ior().is_some()),
            (diffuse, self.extension(diffuse).is_some()),
            (dispersion, self.extension(dispersion).is_some()),
        ];
        for (other, is_there) in excluded {
            if is_there {
                self.warn(&format!("{other} has no effect beside {SPECULAR_GLOSSINESS}"));
            }
        }
        let specular = Vec3::from(numbers(&extension.1["specularFactor"], 1.0))
            .map(|v| self.clamped("a component of specularFactor", v, 1.0));
        let glossiness = self.clamped("glossinessFactor", number(extension, "glossinessFactor", 1.0), 1.0);
        // Colours of the texture are encoded in sRGB; its alpha, the glossiness, is linear.
        let texture = self.texture_info(extension, "specularGlossinessTexture")?;
        let texture = texture.map(|texture| self.texture(&texture, ColourSpace::Srgb)).transpose()?;
        Ok(Some(SpecularGlossiness {
            tint: Colour { texture, ..Colour::constant(specular / REFLECTANCE) },
            glossiness: Scalar { factor: glossiness, texture: texture.map(|texture| (texture, Channel::A)) },
        }))
    }
}

/// The numbers of a JSON list, each `unset` by default.
pub(super) fn numbers<const N: usize>(list: &Value, unset: f32) -> [f32; N] {
    std::array::from_fn(|i| list[i].as_f64().map_or(unset, |number| number as f32))
}
