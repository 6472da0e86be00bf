//! Converts an MTL definition to a [`Material`].
//!
//! | illum | surface |
//! |---|---|
//! | 0, 1 | matte `Kd` |
//! | none | as 2 if `Pr`, `Pm`, `Pc`, `Ps` or `aniso` is given, otherwise matte `Kd` |
//! | 2, 8, 10 | if `Ni`, `Pr`, `Pm`, `Pc`, `Ps` or `aniso` is given: a dielectric coat over `Kd`, or metal by `Pm` |
//! | | otherwise: a gloss of reflectance `Ks` and Phong exponent `Ns` over `Kd` |
//! | | in either case with black `Ks`, unless `Pm`, `Pc` or `Ps` is above 0: matte `Kd` |
//! | 3, 5 | mirror `Ks`; rough metal if `Pr` is given or `Pm` is partial |
//! | 4, 6, 7, 9 | dielectric `Ni`, `Tf`: smooth, or frosted by `Pr` |
//!
//! If `Pm` makes a metal of illum 3 or 5, its colour is `Kd`, as in the PBR extension, or `Ks` if `Kd` is black. Maps
//! multiply their factors. A Phong exponent n corresponds to a GGX alpha of √(2 / (n + 2)). `Pr` is perceptual: alpha
//! = `Pr`². A material with OpenPBR's parameters has OpenPBR's surface instead ([`openpbr`]).

mod openpbr;

use super::super::session::Session;
use super::super::{LoadProblem, named};
use super::mtl::{Definition, Map};
use crate::scene::load::textures::Textures;
use crate::scene::{
    Alpha, AlphaMode, Anisotropy, Channel, Colour, ColourSpace, Emission, Material, NormalMap, Principled,
    Scalar, Sheen, Surface, TextureRef,
};
use glam::{Vec2, Vec3};
use std::f32::consts::TAU;
use std::path::Path;

/// Default index of refraction, that of common glass.
const GLASS: f32 = 1.5;

/// Reflectance at normal incidence of a dielectric of index 1.5.
const GLASS_REFLECTANCE: f32 = 0.04;

/// Converts `definition`, which was read from the file `path`. `coloured` says whether the mesh has colours.
///
/// # Errors
/// When a texture is missing or cannot be decoded.
pub(super) fn convert(
    path: &Path,
    definition: &Definition,
    coloured: bool,
    textures: &mut Textures,
    session: &mut Session,
) -> Result<Material, LoadProblem> {
    let mut converter = Converter { path, definition, coloured, textures, session };
    if let Some(openpbr) = &definition.openpbr {
        return converter.openpbr(openpbr);
    }
    let surface = converter.surface()?;
    let is_body = match &surface {
        Surface::Dielectric { .. } => true,
        Surface::Principled(surface) => surface.transmission.factor > 0.0,
        _ => false,
    };
    Ok(Material {
        name: definition.name.clone(),
        surface,
        emission: converter.emission()?,
        normal_map: converter.normal_map()?,
        // A dielectric's transparency is refraction, so the material's opacity must not apply as well.
        alpha: if is_body { Alpha::default() } else { converter.opacity()? },
        medium: None,
    })
}

struct Converter<'a> {
    path: &'a Path,
    definition: &'a Definition,
    /// True if the mesh has colours. They multiply `Kd`.
    coloured: bool,
    textures: &'a mut Textures,
    session: &'a mut Session,
}

impl Converter<'_> {
    fn surface(&mut self) -> Result<Surface, LoadProblem> {
        let d = self.definition;
        let numbers = [d.pr, d.pm, d.pc, d.ps, d.aniso];
        let has_pbr = numbers.iter().any(Option::is_some) || d.map_pr.is_some() || d.map_pm.is_some();
        match d.illum {
            Some(4 | 6 | 7 | 9) => self.dielectric(),
            Some(3 | 5) => self.mirror(),
            Some(2 | 8 | 10) => self.glossy(has_pbr || d.ni.is_some()),
            None if has_pbr => self.glossy(true),
            _ => {
                if [d.pm, d.pc, d.ps].iter().any(|factor| factor.unwrap_or(0.0) > 0.0) {
                    self.warn("Pm, Pc and Ps are ignored: illum 0 and 1 are matte");
                }
                Ok(Surface::Matte { reflectance: self.kd()? })
            }
        }
    }

    fn dielectric(&mut self) -> Result<Surface, LoadProblem> {
        let ior = match self.definition.ni {
            Some(ni) if ni > 0.0 => ni,
            Some(ni) => {
                self.warn(&format!("Ni is {ni}; an index of refraction must be above 0, so {GLASS} is used"));
                GLASS
            }
            None => GLASS,
        };
        let transmittance = self.share("Tf", self.definition.tf.unwrap_or(Vec3::ONE));
        let roughness = self.roughness(0.0)?;
        if roughness.factor > 0.0 && ior >= 1.0 {
            return Ok(Surface::Principled(Principled::glass(ior, transmittance, roughness)));
        }
        if roughness.factor > 0.0 {
            self.warn("Pr is ignored: a rough dielectric needs an Ni of at least 1");
        }
        Ok(Surface::Dielectric { ior, transmittance })
    }

    fn mirror(&mut self) -> Result<Surface, LoadProblem> {
        let d = self.definition;
        let is_coloured = d.map_kd.is_some() || d.kd.is_some_and(|kd| kd != Vec3::ZERO);
        let metallic = d.pm.unwrap_or(0.0);
        let tint = if is_coloured && metallic > 0.0 {
            self.kd()?
        } else {
            if is_coloured {
                self.warn("Kd is ignored: illum 3 and 5 are mirrors with reflectance Ks");
            }
            Colour::constant(self.share("Ks", d.ks.unwrap_or(Vec3::ONE)))
        };
        let is_rough = d.pr.unwrap_or(0.0) > 0.0 || d.map_pr.is_some();
        let is_partial = metallic > 0.0 && metallic < 1.0 || d.map_pm.is_some();
        if !is_rough && !is_partial {
            return Ok(Surface::Mirror { reflectance: tint });
        }
        Ok(Surface::Principled(Principled {
            base_colour: tint,
            metallic: self.metallic(1.0)?,
            roughness: self.roughness(0.0)?,
            anisotropy: self.anisotropy(),
            ..Principled::default()
        }))
    }

    /// `is_coat` means that the file gives an index of refraction or a roughness. Otherwise the material is classic
    /// Phong.
    fn glossy(&mut self, is_coat: bool) -> Result<Surface, LoadProblem> {
        let d = self.definition;
        let base_colour = self.kd()?;
        let ks = d.ks.map(|ks| self.share("Ks", ks));
        let has_gloss = ks.is_some_and(|ks| ks != Vec3::ZERO);
        let is_matte = ks == Some(Vec3::ZERO)
            && d.pm.unwrap_or(0.0) <= 0.0
            && d.pc.unwrap_or(0.0) <= 0.0
            && d.ps.unwrap_or(0.0) <= 0.0
            && d.map_pm.is_none();
        if is_matte || !is_coat && !has_gloss {
            return Ok(Surface::Matte { reflectance: base_colour });
        }
        let phong = |ns: f32| (2.0 / (ns.max(0.0) + 2.0)).sqrt().sqrt();
        let roughness = self.roughness(phong(d.ns.unwrap_or(0.0)))?;
        if !is_coat {
            return Ok(Surface::Principled(Principled {
                base_colour,
                roughness,
                specular_colour: Colour::constant(ks.unwrap_or(Vec3::ZERO) / GLASS_REFLECTANCE),
                ..Principled::default()
            }));
        }
        let ior = match d.ni {
            Some(ni) if ni >= 1.0 => ni,
            Some(ni) => {
                self.warn(&format!(
                    "Ni is {ni}; the index of refraction of a coat must be at least 1, so 1 is used"
                ));
                1.0
            }
            None => GLASS,
        };
        Ok(Surface::Principled(Principled {
            base_colour,
            metallic: self.metallic(0.0)?,
            roughness,
            ior,
            // `Ni` determines the reflectance. A black `Ks` removes the reflection.
            specular: Scalar::constant(if ks == Some(Vec3::ZERO) { 0.0 } else { 1.0 }),
            clearcoat: Scalar::constant(self.clamped("Pc", d.pc.unwrap_or(0.0))),
            clearcoat_roughness: Scalar::constant(self.clamped("Pcr", d.pcr.unwrap_or(0.0))),
            anisotropy: self.anisotropy(),
            sheen: self.sheen(),
            ..Principled::default()
        }))
    }

    fn kd(&mut self) -> Result<Colour, LoadProblem> {
        let d = self.definition;
        let unset = if d.map_kd.is_some() { Vec3::ONE } else { Vec3::splat(0.8) };
        let factor = self.share("Kd", d.kd.unwrap_or(unset));
        Ok(Colour { factor, texture: self.colour_map(&d.map_kd)?, vertex: self.coloured })
    }

    fn roughness(&mut self, unset: f32) -> Result<Scalar, LoadProblem> {
        let d = self.definition;
        let unset = if d.map_pr.is_some() { 1.0 } else { unset };
        let factor = self.clamped("Pr", d.pr.unwrap_or(unset));
        Ok(Scalar { factor, texture: self.scalar_map(&d.map_pr)? })
    }

    fn metallic(&mut self, unset: f32) -> Result<Scalar, LoadProblem> {
        let d = self.definition;
        let unset = if d.map_pm.is_some() { 1.0 } else { unset };
        let factor = self.clamped("Pm", d.pm.unwrap_or(unset));
        Ok(Scalar { factor, texture: self.scalar_map(&d.map_pm)? })
    }

    /// `aniso` is read as glTF's strength and `anisor`, in turns, as glTF's rotation. The MTL extension does not
    /// define them.
    fn anisotropy(&mut self) -> Option<Anisotropy> {
        let d = self.definition;
        let strength = Scalar::constant(self.clamped("aniso", d.aniso.unwrap_or(0.0)));
        let rotation = TAU * d.anisor.unwrap_or(0.0);
        (strength.factor > 0.0).then_some(Anisotropy { strength, rotation, direction: None })
    }

    /// White fibres with the surface's roughness. The extension specifies their strength only.
    fn sheen(&mut self) -> Option<Sheen> {
        let strength = self.clamped("Ps", self.definition.ps.unwrap_or(0.0));
        let roughness = Scalar::constant(self.clamped("Pr", self.definition.pr.unwrap_or(1.0)));
        let colour = Colour::constant(Vec3::splat(strength));
        (strength > 0.0).then_some(Sheen { colour, roughness })
    }

    fn emission(&mut self) -> Result<Option<Emission>, LoadProblem> {
        let d = self.definition;
        let unset = if d.map_ke.is_some() { Vec3::ONE } else { Vec3::ZERO };
        let mut factor = d.ke.unwrap_or(unset);
        if factor.min_element() < 0.0 {
            self.warn("Ke is negative; 0 is used");
            factor = factor.max(Vec3::ZERO);
        }
        self.emitted(factor, "Ke, which is black")
    }

    /// Emission of a radiance that `map_Ke` multiplies. `black` names the radiance where it is 0.
    fn emitted(&mut self, factor: Vec3, black: &str) -> Result<Option<Emission>, LoadProblem> {
        let d = self.definition;
        if factor == Vec3::ZERO {
            if d.map_ke.is_some() {
                self.warn(&format!("map_Ke has no effect: it is multiplied by {black}"));
            }
            return Ok(None);
        }
        let radiance = Colour { texture: self.colour_map(&d.map_ke)?, ..Colour::constant(factor) };
        Ok(Some(Emission { radiance, two_sided: true, is_light: true }))
    }

    fn normal_map(&mut self) -> Result<Option<NormalMap>, LoadProblem> {
        let d = self.definition;
        if let Some(map) = &d.norm {
            return Ok(Some(NormalMap {
                texture: self.texture(map, ColourSpace::Linear)?.1,
                scale: map.bump,
            }));
        }
        let Some(map) = &d.map_bump else { return Ok(None) };
        let (image, texture) = self.texture(map, ColourSpace::Linear)?;
        if self.textures.pixels(image).looks_like_normals() {
            return Ok(Some(NormalMap { texture, scale: map.bump }));
        }
        self.warn("map_Bump contains heights, not normals, and is ignored; bake it to a normal map (norm)");
        Ok(None)
    }

    fn opacity(&mut self) -> Result<Alpha, LoadProblem> {
        let d = self.definition;
        let opacity = d.d.or(d.tr.map(|tr| 1.0 - tr)).unwrap_or(1.0);
        let factor = self.clamped("d", opacity);
        self.alpha(factor, "d is 0, or Tr is 1")
    }

    /// Alpha of an opacity that maps multiply. `none` says which opacity is 0.
    fn alpha(&mut self, factor: f32, none: &str) -> Result<Alpha, LoadProblem> {
        let d = self.definition;
        if factor == 0.0 {
            self.warn(&format!("the material is invisible: {none}"));
        }
        let texture = match (&d.map_d, &d.map_kd) {
            (Some(map), _) => {
                let (image, texture) = self.texture(map, ColourSpace::Linear)?;
                let default =
                    if self.textures.pixels(image).has_alpha() { Channel::A } else { Channel::Luminance };
                Some((texture, map.channel.unwrap_or(default)))
            }
            (None, Some(map)) => {
                let (image, texture) = self.texture(map, ColourSpace::Srgb)?;
                self.textures.pixels(image).has_alpha().then_some((texture, Channel::A))
            }
            (None, None) => None,
        };
        let mode = match texture {
            _ if factor < 1.0 => AlphaMode::Blend,
            Some(_) => AlphaMode::Mask { cutoff: 0.5 },
            None => AlphaMode::Opaque,
        };
        Ok(Alpha { mode, value: Scalar { factor, texture }, vertex: false })
    }

    fn colour_map(&mut self, map: &Option<Map>) -> Result<Option<TextureRef>, LoadProblem> {
        map.as_ref().map(|map| Ok(self.texture(map, ColourSpace::Srgb)?.1)).transpose()
    }

    fn scalar_map(&mut self, map: &Option<Map>) -> Result<Option<(TextureRef, Channel)>, LoadProblem> {
        let scalar = |map: &Map| {
            let texture = self.texture(map, ColourSpace::Linear)?.1;
            Ok((texture, map.channel.unwrap_or(Channel::Luminance)))
        };
        map.as_ref().map(scalar).transpose()
    }

    /// The index of a map's image, and the texture with the map's options.
    fn texture(&mut self, map: &Map, space: ColourSpace) -> Result<(usize, TextureRef), LoadProblem> {
        let file = named::file(self.path, &map.file).unwrap_or_else(|| named::beside(self.path, &map.file));
        let image = self.textures.file(self.session, &file);
        let image = self.textures.or_stand_in(self.session, image, |problem| LoadProblem::Texture {
            path: self.path.to_owned(),
            material: self.definition.name.clone(),
            texture: format!("{:?}", map.file),
            problem,
        })?;
        let texture = self.textures.texture(image, space, [map.wrap; 2]);
        // MTL scales and shifts with v upwards; the mesh's v points downwards.
        let offset = Vec2::new(map.offset.x, 1.0 - map.scale.y - map.offset.y);
        Ok((image, TextureRef { scale: map.scale, offset, ..TextureRef::plain(texture) }))
    }

    /// A colour whose components are clamped to 0..=1.
    fn share(&mut self, what: &str, colour: Vec3) -> Vec3 {
        let name = &self.definition.name;
        colour.map(|v| {
            self.session.warnings.clamp(format_args!("Material {name:?}: a component of {what}"), v, 0.0, 1.0)
        })
    }

    /// A number, clamped to 0..=1.
    fn clamped(&mut self, what: &str, value: f32) -> f32 {
        self.session.warnings.clamp(
            format_args!("Material {:?}: {what}", self.definition.name),
            value,
            0.0,
            1.0,
        )
    }

    fn warn(&mut self, problem: &str) {
        self.session.warnings.add(format!("Material {:?}: {problem}.", self.definition.name));
    }
}
