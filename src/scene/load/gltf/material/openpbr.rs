//! Reads the draft extensions that have no equal in ratified ones. A material that has one of them gets OpenPBR's
//! surface.
//!
//! KHR_materials_coat, KHR_materials_diffuse_roughness and KHR_materials_fuzz were read on 29 November 2026,
//! KHR_materials_scatter and KHR_materials_volume_scatter on 30 November, in pull requests to KhronosGroup/glTF.

use super::super::super::LoadProblem;
use super::Converter;
use super::base::numbers;
use super::layers::{Extension, number};
use crate::scene::{
    Anisotropy, Channel, Colour, OpenPbr, OpenPbrCoat, OpenPbrFuzz, Principled, Scalar, Sheen,
};
use glam::Vec3;

const COAT: &str = "KHR_materials_coat";
const DIFFUSE_ROUGHNESS: &str = "KHR_materials_diffuse_roughness";
const FUZZ: &str = "KHR_materials_fuzz";
pub(super) const SCATTER: &str = "KHR_materials_scatter";
pub(super) const VOLUME_SCATTER: &str = "KHR_materials_volume_scatter";

/// All of them.
const DRAFTS: [&str; 5] = [COAT, DIFFUSE_ROUGHNESS, FUZZ, SCATTER, VOLUME_SCATTER];

impl<'a> Converter<'a, '_> {
    /// True if the material has one of the draft extensions.
    pub(super) fn has_drafts(&self) -> bool {
        DRAFTS.into_iter().any(|name| self.extension(name).is_some())
    }

    /// OpenPBR's surface of a metallic-roughness surface and the draft extensions.
    pub(super) fn openpbr(&mut self, of: &Principled) -> Result<OpenPbr, LoadProblem> {
        let one = Scalar::constant(1.0);
        // A tint above 1 makes the dielectric reflect more. OpenPBR has that in the weight, and tints of at most 1.
        let tint = of.specular_colour.factor.min(Vec3::splat(f32::MAX));
        let most = tint.max_element().max(1.0);
        let mut surface = OpenPbr {
            base_weight: one,
            base_color: of.base_colour,
            base_diffuse_roughness: Scalar::constant(0.0),
            base_metalness: of.metallic,
            specular_weight: Scalar { factor: of.specular.factor * most, ..of.specular },
            specular_color: Colour { factor: tint / most, ..of.specular_colour },
            specular_roughness: of.roughness,
            specular_anisotropy: None,
            specular_ior: of.ior,
            transmission_weight: of.transmission,
            // In glTF the base colour tints transmitted light.
            transmission_color: of.base_colour,
            dispersion: of.dispersion,
            subsurface: None,
            coat: None,
            fuzz: of.sheen.map(fuzz_of_sheen),
            thin_film: of.iridescence,
            thin_walled: of.thin,
        };
        let diffuses = self.subsurface(of, &mut surface)?;
        if of.diffuse_transmission.is_some() && !diffuses {
            self.warn(&format!("KHR_materials_diffuse_transmission has no effect beside {}", self.drafts()));
        }
        if let Some(extension) = self.extension(DIFFUSE_ROUGHNESS) {
            let [factor, texture] = ["diffuseRoughnessFactor", "diffuseRoughnessTexture"];
            surface.base_diffuse_roughness = self.factor(extension, factor, 0.0, texture, Channel::A)?;
        }
        if of.clearcoat.factor > 0.0 {
            let (weight, roughness) = (of.clearcoat, of.clearcoat_roughness);
            surface.coat =
                Some(OpenPbrCoat { weight, roughness, ior: 1.5, darkening: 0.0, ..OpenPbrCoat::default() });
            if self.extension(COAT).is_none() && of.has_own_coat(self.normal_map()?.as_ref()) {
                let lost = match of.coat_normal_map {
                    Some(_) => "clearcoatNormalTexture is left out",
                    None => "a clear coat without clearcoatNormalTexture is not even",
                };
                self.warn(&format!("{lost} beside {}: the coat has the material's normals", self.drafts()));
            }
        }
        if let Some(extension) = self.extension(COAT) {
            surface.coat = self.coat(extension)?;
        }
        if let Some(extension) = self.extension(FUZZ) {
            surface.fuzz = self.fuzz(extension)?;
        }
        surface.specular_anisotropy = self.tangent(of, &mut surface)?;
        Ok(surface)
    }

    /// The names of the drafts that the material has.
    fn drafts(&self) -> String {
        DRAFTS.into_iter().filter(|name| self.extension(name).is_some()).collect::<Vec<_>>().join(", ")
    }

    fn coat(&mut self, extension: Extension<'a>) -> Result<Option<OpenPbrCoat>, LoadProblem> {
        let weight = self.factor(extension, "coatFactor", 0.0, "coatTexture", Channel::R)?;
        let roughness =
            self.factor(extension, "coatRoughnessFactor", 0.0, "coatRoughnessTexture", Channel::G)?;
        let mut ior = number(extension, "coatIor", 1.5);
        if ior < 1.0 {
            self.warn(&format!("coatIor is {ior}; it must be at least 1, so 1 is used"));
            ior = 1.0;
        }
        let darkening =
            self.clamped("coatDarkeningFactor", number(extension, "coatDarkeningFactor", 1.0), 1.0);
        if self.texture_info(extension, "coatNormalTexture")?.is_some() {
            self.warn(
                "coatNormalTexture of KHR_materials_coat is left out: the coat has the material's normals",
            );
        }
        let color = self.tint(extension, "coatColorFactor", "coatColorTexture")?;
        let anisotropy = Scalar::constant(0.0);
        Ok((weight.factor > 0.0).then_some(OpenPbrCoat {
            weight,
            color,
            roughness,
            anisotropy,
            ior,
            darkening,
        }))
    }

    fn fuzz(&mut self, extension: Extension<'a>) -> Result<Option<OpenPbrFuzz>, LoadProblem> {
        let weight = self.factor(extension, "fuzzFactor", 0.0, "fuzzTexture", Channel::R)?;
        let roughness =
            self.factor(extension, "fuzzRoughnessFactor", 0.5, "fuzzRoughnessTexture", Channel::A)?;
        let color = self.tint(extension, "fuzzColorFactor", "fuzzColorTexture")?;
        Ok((weight.factor > 0.0).then_some(OpenPbrFuzz { weight, color, roughness }))
    }

    /// The anisotropy of base and coat, which share one tangent. It changes the roughness: glTF stretches the
    /// highlight along one axis, OpenPBR keeps the mean of both.
    fn tangent(&mut self, of: &Principled, surface: &mut OpenPbr) -> Result<Option<Anisotropy>, LoadProblem> {
        let mut tangent = None;
        if let Some(given) = of.anisotropy {
            let (roughness, strength) = stretched(of.roughness.factor, given.strength.factor);
            if of.roughness.texture.is_some() || given.strength.texture.is_some() {
                self.warn("textures of its roughness or anisotropy are read as OpenPBR's, not as glTF's");
            }
            surface.specular_roughness.factor = roughness;
            let strength = Scalar { factor: strength, ..given.strength };
            tangent = Some(Anisotropy { strength, ..given });
        }
        let Some(extension) = self.extension(COAT) else { return Ok(tangent) };
        let Some(coat) = &mut surface.coat else { return Ok(tangent) };
        let strength = number(extension, "coatAnisotropyStrength", 0.0);
        let strength = self.clamped("coatAnisotropyStrength", strength, 1.0);
        if strength == 0.0 {
            return Ok(tangent);
        }
        let rotation = number(extension, "coatAnisotropyRotation", 0.0);
        if self.texture_info(extension, "coatAnisotropyTexture")?.is_some() {
            self.warn("coatAnisotropyTexture of KHR_materials_coat is left out");
        }
        let (roughness, strength) = stretched(coat.roughness.factor, strength);
        (coat.roughness.factor, coat.anisotropy) = (roughness, Scalar::constant(strength));
        if tangent.is_some_and(|of| of.rotation != rotation) {
            self.warn(
                "coatAnisotropyRotation is left out: the coat is anisotropic along the base's direction",
            );
        }
        let none = Anisotropy { strength: Scalar::constant(0.0), rotation, direction: None };
        Ok(Some(tangent.unwrap_or(none)))
    }

    /// A factor of an extension, `unset` by default, times one channel of a texture.
    fn factor(
        &mut self,
        extension: Extension<'a>,
        factor: &str,
        unset: f32,
        texture: &str,
        channel: Channel,
    ) -> Result<Scalar, LoadProblem> {
        let texture = self.texture_info(extension, texture)?;
        self.scalar(factor, number(extension, factor, unset), texture, channel)
    }

    /// A colour of an extension, white by default, times a texture.
    fn tint(&mut self, extension: Extension<'a>, factor: &str, texture: &str) -> Result<Colour, LoadProblem> {
        let given = Vec3::from(numbers(&extension.1[factor], 1.0));
        let given = given.map(|v| self.clamped(&format!("a component of {factor}"), v, 1.0));
        let texture = self.texture_info(extension, texture)?;
        Ok(Colour { texture: self.colour(texture)?, ..Colour::constant(given) })
    }
}

/// Fuzz that reflects what KHR_materials_sheen reflects: the sheen's colour is also its strength.
fn fuzz_of_sheen(sheen: Sheen) -> OpenPbrFuzz {
    let strength = sheen.colour.factor.max_element();
    let color = Colour { factor: sheen.colour.factor / strength, ..sheen.colour };
    // The fuzz of this roughness has fibres of the sheen's.
    let roughness = libm::powf(sheen.roughness.factor, 2.0 / 3.0);
    let roughness = Scalar { factor: roughness, ..sheen.roughness };
    OpenPbrFuzz { weight: Scalar::constant(strength), color, roughness }
}

/// OpenPBR's roughness and anisotropy whose alphas are those of KHR_materials_anisotropy.
fn stretched(roughness: f32, strength: f32) -> (f32, f32) {
    let across = roughness * roughness;
    let along = across + (1.0 - across) * strength * strength;
    let mean = (0.5 * (along * along + across * across)).sqrt();
    (mean.sqrt(), if along > 0.0 { 1.0 - across / along } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn anisotropy_keeps_both_alphas() {
        for (roughness, strength) in [(0.3f32, 0.5f32), (0.7, 0.9), (0.2, 0.0)] {
            let (r, a) = stretched(roughness, strength);
            let along = r * r * (2.0 / (1.0 + (1.0 - a) * (1.0 - a))).sqrt();
            let across = roughness * roughness;
            let expected = across + (1.0 - across) * strength * strength;
            assert!((along - expected).abs() < 1e-5 && (along * (1.0 - a) - across).abs() < 1e-5);
        }
    }
}
