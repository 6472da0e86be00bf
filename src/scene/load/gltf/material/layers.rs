//! Reads the extensions of layers and specular reflection.

use super::super::super::LoadProblem;
use super::super::texture::TextureInfo;
use super::Converter;
use super::base::numbers;
use crate::scene::{
    Anisotropy, Channel, Colour, ColourSpace, DiffuseTransmission, Iridescence, NormalMap, Principled,
    Scalar, Sheen,
};
use ::gltf::json::Value;
use glam::Vec3;

/// An extension for which the `gltf` crate has no type: its name and its JSON object.
pub(super) type Extension<'a> = (&'static str, &'a Value);

impl<'a, 'b> Converter<'a, 'b> {
    pub(super) fn specular(&mut self) -> Result<(Scalar, Colour), LoadProblem> {
        let Some(specular) = self.source.specular() else {
            return Ok((Scalar::constant(1.0), Colour::constant(Vec3::ONE)));
        };
        let texture = specular.specular_texture().map(|info| TextureInfo::of(&info));
        let strength = self.scalar("specularFactor", specular.specular_factor(), texture, Channel::A)?;
        let factor = Vec3::from(specular.specular_color_factor())
            .map(|v| self.clamped("a component of specularColorFactor", v, f32::MAX));
        let texture = specular.specular_color_texture().map(|info| TextureInfo::of(&info));
        Ok((strength, Colour { texture: self.colour(texture)?, ..Colour::constant(factor) }))
    }

    /// Strength, roughness and normal map of the clear coat.
    fn clearcoat(&mut self) -> Result<(Scalar, Scalar, Option<NormalMap>), LoadProblem> {
        let Some(coat) = self.extension("KHR_materials_clearcoat") else {
            return Ok((Scalar::constant(0.0), Scalar::constant(0.0), None));
        };
        let strength = self.textured_factor(coat, "clearcoatFactor", "clearcoatTexture", Channel::R)?;
        let roughness =
            self.textured_factor(coat, "clearcoatRoughnessFactor", "clearcoatRoughnessTexture", Channel::G)?;
        let mut normal_map = None;
        if let Some(texture) = self.texture_info(coat, "clearcoatNormalTexture")? {
            let texture = self.texture(&texture, ColourSpace::Linear)?;
            let scale = coat.1["clearcoatNormalTexture"]["scale"].as_f64().unwrap_or(1.0) as f32;
            normal_map = Some(NormalMap { texture, scale });
        }
        Ok((strength, roughness, normal_map))
    }

    fn anisotropy(&mut self) -> Result<Option<Anisotropy>, LoadProblem> {
        let Some(extension) = self.extension("KHR_materials_anisotropy") else { return Ok(None) };
        let strength =
            self.textured_factor(extension, "anisotropyStrength", "anisotropyTexture", Channel::B)?;
        let rotation = number(extension, "anisotropyRotation", 0.0);
        let direction = strength.texture.map(|(texture, _)| texture);
        Ok((strength.factor > 0.0).then_some(Anisotropy { strength, rotation, direction }))
    }

    fn sheen(&mut self) -> Result<Option<Sheen>, LoadProblem> {
        let Some(extension) = self.extension("KHR_materials_sheen") else { return Ok(None) };
        let factor = Vec3::from(numbers(&extension.1["sheenColorFactor"], 0.0))
            .map(|v| self.clamped("a component of sheenColorFactor", v, 1.0));
        let texture = self.texture_info(extension, "sheenColorTexture")?;
        let colour = Colour { texture: self.colour(texture)?, ..Colour::constant(factor) };
        let roughness =
            self.textured_factor(extension, "sheenRoughnessFactor", "sheenRoughnessTexture", Channel::A)?;
        Ok((factor != Vec3::ZERO).then_some(Sheen { colour, roughness }))
    }

    fn iridescence(&mut self) -> Result<Option<Iridescence>, LoadProblem> {
        let Some(extension) = self.extension("KHR_materials_iridescence") else { return Ok(None) };
        let strength =
            self.textured_factor(extension, "iridescenceFactor", "iridescenceTexture", Channel::R)?;
        let mut ior = number(extension, "iridescenceIor", 1.3);
        if ior < 1.0 {
            self.warn(&format!("iridescenceIor is {ior}; it must be at least 1, so 1 is used"));
            ior = 1.0;
        }
        let mut thickness_nm = [
            number(extension, "iridescenceThicknessMinimum", 100.0),
            number(extension, "iridescenceThicknessMaximum", 400.0),
        ];
        for thickness in &mut thickness_nm {
            *thickness = self.clamped("a thickness of the iridescent film", *thickness, 1e6);
        }
        let texture = self.texture_info(extension, "iridescenceThicknessTexture")?;
        let texture = texture.map(|texture| self.texture(&texture, ColourSpace::Linear)).transpose()?;
        let thickness_texture = texture.map(|texture| (texture, Channel::G));
        let film = Iridescence { strength, ior, thickness_nm, thickness_texture };
        Ok((strength.factor > 0.0).then_some(film))
    }

    /// The layers over the base, on a surface that is the default otherwise.
    pub(super) fn layers(&mut self) -> Result<Principled, LoadProblem> {
        let (clearcoat, clearcoat_roughness, coat_normal_map) = self.clearcoat()?;
        Ok(Principled {
            clearcoat,
            clearcoat_roughness,
            coat_normal_map,
            anisotropy: self.anisotropy()?,
            sheen: self.sheen()?,
            iridescence: self.iridescence()?,
            ..Principled::default()
        })
    }

    pub(super) fn diffuse_transmission(&mut self) -> Result<Option<DiffuseTransmission>, LoadProblem> {
        let Some(extension) = self.extension("KHR_materials_diffuse_transmission") else { return Ok(None) };
        let share = self.textured_factor(
            extension,
            "diffuseTransmissionFactor",
            "diffuseTransmissionTexture",
            Channel::A,
        )?;
        let factor = Vec3::from(numbers(&extension.1["diffuseTransmissionColorFactor"], 1.0))
            .map(|v| self.clamped("a component of diffuseTransmissionColorFactor", v, 1.0));
        let texture = self.texture_info(extension, "diffuseTransmissionColorTexture")?;
        let colour = Colour { texture: self.colour(texture)?, ..Colour::constant(factor) };
        Ok((share.factor > 0.0).then_some(DiffuseTransmission { share, colour }))
    }

    /// The number of KHR_materials_dispersion, 0 by default.
    pub(super) fn dispersion(&mut self, is_transparent: bool) -> f32 {
        let Some(extension) = self.extension("KHR_materials_dispersion") else { return 0.0 };
        let dispersion = self.clamped("dispersion", number(extension, "dispersion", 0.0), f32::MAX);
        if dispersion > 0.0 && (!is_transparent || self.is_thin()) {
            self.warn(
                "KHR_materials_dispersion has no effect without KHR_materials_transmission and the thickness of \
                 KHR_materials_volume",
            );
        }
        dispersion
    }

    pub(super) fn extension(&self, name: &'static str) -> Option<Extension<'a>> {
        self.source.extension_value(name).map(|value| (name, value))
    }

    /// The texture reference `key` of an extension.
    pub(super) fn texture_info(
        &self,
        (name, value): Extension,
        key: &str,
    ) -> Result<Option<TextureInfo<'b>>, LoadProblem> {
        TextureInfo::of_json(self.context.document, value.get(key))
            .map_err(|problem| self.context.error(format!("material {:?}, {name}", self.name), problem))
    }

    /// A factor of an extension, 0 by default, times one channel of a texture.
    fn textured_factor(
        &mut self,
        extension: Extension,
        factor: &str,
        texture: &str,
        channel: Channel,
    ) -> Result<Scalar, LoadProblem> {
        let texture = self.texture_info(extension, texture)?;
        self.scalar(factor, number(extension, factor, 0.0), texture, channel)
    }
}

/// A number of an extension, `unset` by default.
pub(super) fn number((_, value): Extension, key: &str, unset: f32) -> f32 {
    value.get(key).and_then(Value::as_f64).map_or(unset, |number| number as f32)
}
