//! Materials of recipes.

use super::openpbr::OpenPbrRecipe;
use super::unique::unique;
use super::within;
use crate::scene::surface_name::option_texts;
use crate::scene::{
    Alpha, AlphaMode, Anisotropy, Channel, Coat, Coats, Colour, ColourSpace, DiffuseTransmission, Emission,
    Iridescence, Material, Medium, NormalMap, Principled, Scalar, Sheen, Surface, SurfaceName,
    SurfaceRequest, TextureRef,
};
use glam::Vec3;
use serde::Deserialize;
use serde_json::Value;
use std::collections::BTreeMap;

/// A material: glass if `ior` is given, a mirror if `mirror` is true, and otherwise glTF's metallic-roughness
/// surface, which is matte if `roughness` is absent, too. Glass and mirrors cannot have coats; other materials may:
///
/// ```json
/// "candy": { "colour": [0.9, 0.9, 0.9], "roughness": 0.3, "metallic": 1,
///            "coats": [{}, { "weight": 0.9, "ior": 1.6, "roughness": 0.2, "tint": [0.8, 0.1, 0.05] }] },
/// "prism": { "colour": [1, 1, 1], "ior": 1.6, "dispersion": 0.8 },
/// "leaf": { "colour": [0.1, 0.3, 0.05], "roughness": 0.5,
///           "diffuse_transmission": { "share": 0.4, "colour": [0.4, 0.7, 0.1] } }
/// ```
///
/// A material with `openpbr` has OpenPBR's surface instead.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaterialRecipe {
    /// Linear Rec. 709. The texture multiplies it. White by default.
    pub colour: Option<Vec3>,
    /// OpenPBR's surface. Of the other fields only textures, `normal_scale`, `alpha`, `alpha_cutoff`,
    /// `anisotropy_degrees`, `absorption`, `emission`, `surface` and `options` have an effect beside it.
    pub openpbr: Option<OpenPbrRecipe>,
    /// Name of the texture that multiplies `colour`. Its alpha multiplies `alpha`.
    pub texture: Option<String>,
    /// Name of a tangent-space normal map, as glTF's: red, green and blue are x along u, y upwards and z outwards.
    pub normal_texture: Option<String>,
    /// Factor of the normal map's x and y.
    #[serde(default = "one")]
    pub normal_scale: f32,
    /// Name of the texture whose green multiplies `roughness`. Its bytes are linear.
    pub roughness_texture: Option<String>,
    /// Name of the texture whose blue multiplies `metallic`. Its bytes are linear.
    pub metallic_texture: Option<String>,
    /// Name of the texture that multiplies `emission`.
    pub emission_texture: Option<String>,
    /// Share of rays that the surface stops, 0..=1.
    #[serde(default = "one")]
    pub alpha: f32,
    /// If it is given, the surface stops all rays where alpha is at least as great, and no others.
    pub alpha_cutoff: Option<f32>,
    /// Perceptual roughness, 0..=1.
    pub roughness: Option<f32>,
    /// Share of metal, 0..=1.
    #[serde(default)]
    pub metallic: f32,
    /// Strength of a smooth clear coat, 0..=1.
    #[serde(default)]
    pub clearcoat: f32,
    /// Coats of varnish over the whole surface, outermost first, at most [`Coats::MOST`].
    #[serde(default)]
    pub coats: Vec<CoatRecipe>,
    /// Strength of anisotropy, 0..=1: reflection is rougher along u.
    #[serde(default)]
    pub anisotropy: f32,
    /// Rotation of the rougher direction from u towards the texture's top.
    #[serde(default)]
    pub anisotropy_degrees: f32,
    /// A layer of fibres that reflects at grazing angles.
    pub sheen: Option<SheenLayer>,
    /// A thin film with interference colours.
    pub film: Option<ThinFilm>,
    /// Index of refraction of glass. `colour` tints it and `roughness` frosts it; without `roughness` it is clear.
    pub ior: Option<f32>,
    /// Dispersion of glass, 0..=20: 20 divided by its Abbe number, as in KHR_materials_dispersion.
    #[serde(default)]
    pub dispersion: f32,
    /// Light that leaves on the other side. Glass and mirrors have none.
    pub diffuse_transmission: Option<Translucency>,
    /// The medium inside the glass.
    pub absorption: Option<Absorption>,
    /// A perfect mirror.
    #[serde(default)]
    pub mirror: bool,
    /// Radiance that the front emits.
    pub emission: Option<Vec3>,
    /// A surface of user code, which replaces this one in programs that have it: its name, or `{ "shader":
    /// "wood.wgsl", "rings": 12 }`, a shader's file beside the scene with its parameters.
    pub surface: Option<SurfaceName>,
    /// Options of that surface.
    #[serde(default, deserialize_with = "unique")]
    pub options: BTreeMap<String, Value>,
}

/// Light that a thin sheet or a body lets through, evenly in all directions: glTF's diffuse transmission.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Translucency {
    /// Share of the diffuse light that is transmitted instead of reflected, 0..=1.
    pub share: f32,
    /// Share of the transmitted light that remains, linear Rec. 709, 0..=1. All of it by default.
    #[serde(default = "white")]
    pub colour: Vec3,
}

fn white() -> Vec3 {
    Vec3::ONE
}

fn one() -> f32 {
    1.0
}

/// A texture of a material.
#[derive(Clone, Copy, Debug)]
pub(super) struct MaterialTexture {
    pub(super) reference: TextureRef,
    /// True if its alpha is below 1 anywhere.
    pub(super) has_alpha: bool,
}

/// The textures that a material names.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct MaterialTextures {
    colour: Option<MaterialTexture>,
    normal: Option<MaterialTexture>,
    roughness: Option<MaterialTexture>,
    metallic: Option<MaterialTexture>,
    emission: Option<MaterialTexture>,
}

/// A layer of fibres: glTF's sheen.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SheenLayer {
    /// Linear Rec. 709, 0..=1.
    pub colour: Vec3,
    /// Perceptual roughness, 0..=1.
    pub roughness: f32,
}

/// A thin film: glTF's iridescence.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ThinFilm {
    /// Thickness in nanometres, 0..=10000.
    pub nanometres: f32,
    /// Index of refraction, 1..=4.
    pub ior: f32,
}

/// A coat, clear and smooth by default. Mirrors and glass cannot have coats.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CoatRecipe {
    /// Coated share of the surface, 0..=1.
    pub weight: f32,
    /// Index of refraction, 1..=4.
    pub ior: f32,
    /// Perceptual roughness, 0..=1.
    pub roughness: f32,
    /// Share of white light that remains after passing the coat down and up at normal incidence, 0..=1.
    pub tint: Vec3,
}

impl Default for CoatRecipe {
    fn default() -> Self {
        let Coat { weight, ior, roughness, tint } = Coat::CLEAR;
        Self { weight, ior, roughness, tint }
    }
}

impl CoatRecipe {
    fn coat(self) -> Result<Coat, String> {
        within("the ior of a coat", self.ior, 1.0, 4.0)?;
        Ok(Coat {
            weight: share("the weight of a coat", self.weight)?,
            ior: self.ior,
            roughness: share("the roughness of a coat", self.roughness)?,
            tint: shares("the tint of a coat", self.tint)?,
        })
    }
}

/// An absorbing medium.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Absorption {
    /// Colour of white light after `distance`, linear Rec. 709, 0..=1.
    pub colour: Vec3,
    /// The distance, in world units.
    pub distance: f32,
}

impl MaterialRecipe {
    /// The surface of user code that the material asks for; `number` is the material's.
    pub(super) fn request(&self, number: u32) -> Result<Option<SurfaceRequest>, String> {
        let options = option_texts(&self.options)?;
        match &self.surface {
            Some(surface) => surface.request(number, options).map(Some),
            None if options.is_empty() => Ok(None),
            None => Err("it has options but no surface that they are for".into()),
        }
    }

    /// The fields that name textures.
    pub const TEXTURES: [&str; 5] =
        ["texture", "normal_texture", "roughness_texture", "metallic_texture", "emission_texture"];

    /// The textures that the material names, as `find` finds them by their names and what their bytes mean.
    pub(super) fn textures<E>(
        &self,
        mut find: impl FnMut(&str, ColourSpace) -> Result<MaterialTexture, E>,
    ) -> Result<MaterialTextures, E> {
        let mut of = |name: &Option<String>, space| name.as_ref().map(|name| find(name, space)).transpose();
        Ok(MaterialTextures {
            colour: of(&self.texture, ColourSpace::Srgb)?,
            normal: of(&self.normal_texture, ColourSpace::Linear)?,
            roughness: of(&self.roughness_texture, ColourSpace::Linear)?,
            metallic: of(&self.metallic_texture, ColourSpace::Linear)?,
            emission: of(&self.emission_texture, ColourSpace::Srgb)?,
        })
    }

    /// The names of textures whose bytes are linear.
    pub(super) fn linear_textures(&self) -> impl Iterator<Item = &String> {
        let Self { normal_texture, roughness_texture, metallic_texture, .. } = self;
        [normal_texture, roughness_texture, metallic_texture].into_iter().flatten()
    }

    /// The material. An error names a number that is out of range, and the range.
    pub(super) fn material(&self, name: &str, textures: &MaterialTextures) -> Result<Material, String> {
        self.check()?;
        let surface = match &self.openpbr {
            Some(openpbr) => self.openpbr(openpbr, textures)?,
            None => self.surface(textures)?,
        };
        let mut emission = self.radiance()?.map(emission).transpose()?;
        if let (Some(emission), Some(texture)) = (&mut emission, textures.emission) {
            emission.radiance.texture = Some(texture.reference);
        }
        if self.absorption.is_some() && self.openpbr.is_some_and(|of| of.scatters()) {
            return Err("it has both absorption and a medium of openpbr that scatters light; keep one".into());
        }
        let medium = match (&self.absorption, &self.openpbr) {
            (Some(absorption), _) => absorption.medium()?,
            (None, openpbr) => openpbr.as_ref().and_then(OpenPbrRecipe::medium),
        };
        let normal_map =
            textures.normal.map(|texture| NormalMap { texture: texture.reference, scale: self.normal_scale });
        let alpha = self.coverage(textures.colour);
        Ok(Material { name: name.into(), surface, emission, normal_map, alpha, medium })
    }

    /// The surface of a material without OpenPBR's.
    fn surface(&self, textures: &MaterialTextures) -> Result<Surface, String> {
        let texture = textures.colour.map(|texture| texture.reference);
        let transmittance = shares("colour", self.colour.unwrap_or(Vec3::ONE))?;
        let colour = Colour { texture, ..Colour::constant(transmittance) };
        let is_coated = !self.coats.is_empty();
        if is_coated && (self.ior.is_some() || self.mirror) {
            return Err(
                "glass and mirrors cannot have coats; metal with a roughness of 0 is a mirror, too".into()
            );
        }
        Ok(if let Some(ior) = self.ior {
            match (self.roughness.unwrap_or(0.0), self.dispersion) {
                (0.0, 0.0) => Surface::Dielectric { ior, transmittance },
                (rough, dispersion) => {
                    let texture = textures.roughness.map(|texture| (texture.reference, Channel::G));
                    let glass = Principled::glass(ior, transmittance, Scalar { factor: rough, texture });
                    Surface::Principled(Principled { dispersion, ..glass })
                }
            }
        } else if self.mirror {
            Surface::Mirror { reflectance: colour }
        } else if let Some(roughness) = self.roughness {
            let mut surface = self.layered(colour, roughness);
            surface.roughness.texture = textures.roughness.map(|texture| (texture.reference, Channel::G));
            surface.metallic.texture = textures.metallic.map(|texture| (texture.reference, Channel::B));
            Surface::Principled(self.coated(surface)?)
        } else if is_coated || self.diffuse_transmission.is_some() {
            let (base_colour, specular) = (colour, Scalar::constant(0.0));
            let diffuse_transmission = self.diffuse_transmission.map(Translucency::lobe);
            let matte = Principled { base_colour, specular, diffuse_transmission, ..Principled::default() };
            Surface::Principled(self.coated(matte)?)
        } else {
            Surface::Matte { reflectance: colour }
        })
    }

    /// True if alpha is given by numbers.
    pub(super) fn has_alpha(&self) -> bool {
        self.coverage(None).mode != AlphaMode::Opaque
    }

    /// Alpha, which the colour's texture multiplies.
    fn coverage(&self, colour: Option<MaterialTexture>) -> Alpha {
        let factor = self.alpha * self.openpbr.map_or(1.0, |openpbr| openpbr.geometry_opacity);
        let texture = colour.filter(|texture| texture.has_alpha);
        let mode = match self.alpha_cutoff {
            Some(cutoff) => AlphaMode::Mask { cutoff },
            None if texture.is_none() && factor >= 1.0 => AlphaMode::Opaque,
            None => AlphaMode::Blend,
        };
        let texture = texture.map(|texture| (texture.reference, Channel::A));
        Alpha { mode, value: Scalar { factor, texture }, vertex: false }
    }

    /// OpenPBR's surface.
    fn openpbr(&self, openpbr: &OpenPbrRecipe, textures: &MaterialTextures) -> Result<Surface, String> {
        if self.colour.is_some() {
            return Err("it has both a colour and openpbr; write base-color in openpbr".into());
        }
        openpbr.check()?;
        let base = textures.colour.map(|texture| texture.reference);
        let mut surface = openpbr.surface(base, self.anisotropy_degrees.to_radians());
        surface.specular_roughness.texture =
            textures.roughness.map(|texture| (texture.reference, Channel::G));
        surface.base_metalness.texture = textures.metallic.map(|texture| (texture.reference, Channel::B));
        Ok(Surface::OpenPbr(surface))
    }

    /// The emitted radiance.
    fn radiance(&self) -> Result<Option<Vec3>, String> {
        match (self.emission, self.openpbr.filter(|_| self.openpbr_shines())) {
            (Some(_), Some(_)) => Err("it has both emission and emission-luminance; keep one of them".into()),
            (emission, openpbr) => Ok(emission.or(openpbr.map(|openpbr| openpbr.radiance()))),
        }
    }

    fn openpbr_shines(&self) -> bool {
        self.openpbr.is_some_and(|of| of.radiance() != Vec3::ZERO)
    }

    /// True if the material emits light.
    pub(super) fn has_emission(&self) -> bool {
        self.emission.is_some() || self.openpbr_shines()
    }

    /// True if its body has a medium.
    pub(super) fn has_absorption(&self) -> bool {
        self.absorption.is_some() || self.openpbr.is_some_and(|of| of.medium().is_some())
    }

    /// glTF's surface without coats.
    fn layered(&self, base_colour: Colour, roughness: f32) -> Principled {
        let mut surface = Principled {
            base_colour,
            metallic: Scalar::constant(self.metallic),
            roughness: Scalar::constant(roughness),
            clearcoat: Scalar::constant(self.clearcoat),
            diffuse_transmission: self.diffuse_transmission.map(Translucency::lobe),
            ..Principled::default()
        };
        if self.anisotropy != 0.0 {
            let strength = Scalar::constant(self.anisotropy);
            let rotation = self.anisotropy_degrees.to_radians();
            surface.anisotropy = Some(Anisotropy { strength, rotation, direction: None });
        }
        if let Some(SheenLayer { colour, roughness }) = self.sheen {
            let (colour, roughness) = (Colour::constant(colour), Scalar::constant(roughness));
            surface.sheen = Some(Sheen { colour, roughness });
        }
        if let Some(ThinFilm { nanometres, ior }) = self.film {
            surface.iridescence = Some(Iridescence {
                strength: Scalar::constant(1.0),
                ior,
                thickness_nm: [nanometres; 2],
                thickness_texture: None,
            });
        }
        surface
    }

    /// Checks all numbers, whether the surface needs them or not.
    fn check(&self) -> Result<(), String> {
        let Self { roughness, metallic, clearcoat, anisotropy, anisotropy_degrees, sheen, film, ior, .. } =
            self;
        within("dispersion", self.dispersion, 0.0, 20.0)?;
        within("normal_scale", self.normal_scale, -1e3, 1e3)?;
        share("alpha", self.alpha)?;
        share("alpha_cutoff", self.alpha_cutoff.unwrap_or(0.0))?;
        if self.roughness_texture.is_some() && roughness.is_none() && self.openpbr.is_none() {
            return Err(
                "roughness_texture multiplies roughness, which is not given; 1 leaves it as it is".into()
            );
        }
        if self.metallic_texture.is_some()
            && (*metallic == 0.0 || roughness.is_none())
            && self.openpbr.is_none()
        {
            return Err(
                "metallic_texture multiplies metallic, which is 0 or without roughness; give both".into()
            );
        }
        if self.emission_texture.is_some() && !self.has_emission() {
            return Err("emission_texture multiplies emission, which is not given".into());
        }
        if let Some(Translucency { share: through, colour }) = self.diffuse_transmission {
            share("the share of diffuse_transmission", through)?;
            shares("the colour of diffuse_transmission", colour)?;
        }
        share("roughness", roughness.unwrap_or(0.0))?;
        share("metallic", *metallic)?;
        share("clearcoat", *clearcoat)?;
        share("anisotropy", *anisotropy)?;
        within("anisotropy_degrees", *anisotropy_degrees, -1e6, 1e6)?;
        if let Some(SheenLayer { colour, roughness }) = *sheen {
            shares("sheen", colour)?;
            share("the roughness of sheen", roughness)?;
        }
        if let Some(ThinFilm { nanometres, ior }) = *film {
            within("nanometres", nanometres, 0.0, 1e4)?;
            within("the ior of film", ior, 1.0, 4.0)?;
        }
        within("ior", ior.unwrap_or(1.0), 1.0, 4.0)
    }

    /// Fields that are given but have no effect on the kind of surface, as the rest of a sentence.
    pub(super) fn unused(&self) -> Option<String> {
        if self.openpbr.is_some() {
            return self.unused_beside_openpbr();
        }
        let (kind, layered) = match (self.ior, self.mirror, self.roughness) {
            (Some(_), ..) => ("glass", false),
            (None, true, _) => ("mirrors", false),
            (None, false, None) => ("a surface without roughness", false),
            (None, false, Some(_)) => ("a surface without ior", true),
        };
        let given = [
            ("mirror", self.mirror && self.ior.is_some()),
            ("texture", self.texture.is_some() && self.ior.is_some()),
            ("roughness", self.roughness.is_some() && self.mirror && self.ior.is_none()),
            ("metallic", self.metallic != 0.0 && !layered && !self.mirror),
            ("clearcoat", self.clearcoat != 0.0 && !layered),
            ("anisotropy", self.anisotropy != 0.0 && !layered),
            ("sheen", self.sheen.is_some() && !layered),
            ("film", self.film.is_some() && !layered),
            ("dispersion", self.dispersion != 0.0 && self.ior.is_none()),
            (
                "diffuse_transmission",
                self.diffuse_transmission.is_some() && (self.ior.is_some() || self.mirror),
            ),
        ];
        let unused: Vec<&str> =
            given.iter().filter(|(_, is_unused)| *is_unused).map(|(name, _)| *name).collect();
        unused_on(kind, &unused)
    }

    fn unused_beside_openpbr(&self) -> Option<String> {
        let given = [
            ("roughness", self.roughness.is_some()),
            ("metallic", self.metallic != 0.0),
            ("clearcoat", self.clearcoat != 0.0),
            ("coats", !self.coats.is_empty()),
            ("anisotropy", self.anisotropy != 0.0),
            ("sheen", self.sheen.is_some()),
            ("film", self.film.is_some()),
            ("ior", self.ior.is_some()),
            ("dispersion", self.dispersion != 0.0),
            ("diffuse_transmission", self.diffuse_transmission.is_some()),
            ("mirror", self.mirror),
        ];
        let unused: Vec<&str> =
            given.iter().filter(|(_, is_unused)| *is_unused).map(|(name, _)| *name).collect();
        unused_on("OpenPBR's surface", &unused)
    }

    /// Adds the coats to the surface below them.
    fn coated(&self, mut surface: Principled) -> Result<Principled, String> {
        let coats: Vec<Coat> = self.coats.iter().map(|coat| coat.coat()).collect::<Result<_, _>>()?;
        within("the number of coats", coats.len(), 0, Coats::MOST)?;
        let mut over = &coats[..];
        if let (Some((lowest, rest)), 0.0) = (coats.split_last(), surface.clearcoat.factor) {
            // The lowest coat becomes glTF's clear coat if that has the same properties.
            if (Coat { weight: lowest.weight, roughness: lowest.roughness, ..Coat::CLEAR }) == *lowest {
                surface.clearcoat = Scalar::constant(lowest.weight);
                surface.clearcoat_roughness = Scalar::constant(lowest.roughness);
                over = rest;
            }
        }
        surface.coats = Coats::new(over).expect("not too many");
        Ok(surface)
    }
}

fn unused_on(kind: &str, unused: &[&str]) -> Option<String> {
    let verb = if unused.len() > 1 { "have" } else { "has" };
    (!unused.is_empty()).then(|| format!("{} {verb} no effect on {kind}", unused.join(", ")))
}

impl Translucency {
    fn lobe(self) -> DiffuseTransmission {
        DiffuseTransmission { share: Scalar::constant(self.share), colour: Colour::constant(self.colour) }
    }
}

/// Emission of the front.
pub(super) fn emission(radiance: Vec3) -> Result<Emission, String> {
    within("emission", radiance.max_element(), 0.0, 1e6)?;
    within("emission", radiance.min_element(), 0.0, 1e6)?;
    Ok(Emission { radiance: Colour::constant(radiance), two_sided: false, is_light: true })
}

impl Absorption {
    /// The medium. `None` if it absorbs nothing.
    pub(super) fn medium(self) -> Result<Option<Medium>, String> {
        within("the distance of absorption", self.distance, 1e-6, 1e6)?;
        Ok(Medium::tinting(shares("absorption", self.colour)?, self.distance))
    }
}

fn share(what: &str, value: f32) -> Result<f32, String> {
    within(what, value, 0.0, 1.0).map(|()| value)
}

fn shares(what: &str, colour: Vec3) -> Result<Vec3, String> {
    within(&format!("the largest channel of {what}"), colour.max_element(), 0.0, 1.0)?;
    within(&format!("the smallest channel of {what}"), colour.min_element(), 0.0, 1.0)?;
    Ok(colour)
}

#[cfg(test)]
mod tests;
