//! Converts glTF materials to [`Material`].

mod base;
mod layers;
mod openpbr;
mod scatter;

use super::super::LoadProblem;
use super::super::textures::Textures;
use super::Context;
use super::colour::VertexColours;
use super::texture::TextureInfo;
use crate::scene::{
    Alpha, AlphaMode, Channel, Colour, ColourSpace, Emission, Material, Medium, NormalMap, Principled,
    Scalar, Surface, TextureRef,
};
use ::gltf::Material as Source;
use base::SpecularGlossiness;
use glam::Vec3;

/// A material and the sets of texture coordinates that it uses.
pub(super) struct Converted {
    pub(super) material: Material,
    /// The sets of the file (1 for `TEXCOORD_1`) in the order in which the material's textures name them, the base
    /// colour's first. Set `k` of the mesh ([`TextureRef::set`]) holds the set `uv_sets[k]` of the file.
    pub(super) uv_sets: Vec<u32>,
    /// True if meshes keep their other sets, too, for surfaces of user code.
    pub(super) has_all_uv_sets: bool,
}

/// Converts a material. `colours` says whether meshes with vertex colours use it.
///
/// # Errors
/// When a texture is missing or cannot be decoded.
pub(super) fn convert<'a>(
    context: &mut Context<'a>,
    textures: &mut Textures,
    source: &Source<'a>,
    colours: VertexColours,
) -> Result<Converted, LoadProblem> {
    let name =
        source.name().map_or_else(|| format!("material {}", source.index().unwrap_or(0)), str::to_owned);
    let mut converter = Converter { context, textures, source, name, colours, uv_sets: Vec::new() };
    let material = if source.extension_value("KHR_materials_unlit").is_some() {
        converter.unlit()?
    } else {
        let surface = converter.surface()?;
        let alpha = converter.alpha()?;
        let normal_map = converter.normal_map()?;
        let emission = converter.emission()?;
        let medium = converter.medium();
        Material { name: converter.name, surface, emission, normal_map, alpha, medium }
    };
    let has_all_uv_sets = converter.context.session.options.all_uv_sets;
    Ok(Converted { material, uv_sets: converter.uv_sets, has_all_uv_sets })
}

struct Converter<'a, 'b> {
    context: &'a mut Context<'b>,
    textures: &'a mut Textures,
    source: &'a Source<'b>,
    name: String,
    colours: VertexColours,
    uv_sets: Vec<u32>,
}

impl<'b> Converter<'_, 'b> {
    /// A surface that looks the same in any light: it shows its base colour as radiance, and reflects nothing.
    fn unlit(&mut self) -> Result<Material, LoadProblem> {
        let radiance = self.base_colour()?;
        let (alpha, name) = (self.alpha()?, self.name.clone());
        let emission = Emission { radiance, two_sided: true, is_light: false };
        let emission = Some(emission).filter(|_| radiance.factor != Vec3::ZERO);
        Ok(Material { emission, alpha, ..Material::matte(name, Vec3::ZERO) })
    }

    fn base_colour(&mut self) -> Result<Colour, LoadProblem> {
        let base = self.base()?;
        Ok(Colour { factor: base.colour, texture: self.colour(base.texture)?, vertex: self.colours.rgb })
    }

    fn surface(&mut self) -> Result<Surface, LoadProblem> {
        let source = self.source;
        let pbr = source.pbr_metallic_roughness();
        let base_colour = self.base_colour()?;
        if let Some(SpecularGlossiness { tint, glossiness }) = self.specular_glossiness()? {
            let (specular_colour, glossiness) = (tint, Some(glossiness));
            let layers = self.layers()?;
            if self.has_drafts() {
                self.warn("its draft extensions have no effect beside KHR_materials_pbrSpecularGlossiness");
            }
            return Ok(Surface::Principled(Principled {
                base_colour,
                specular_colour,
                glossiness,
                ..layers
            }));
        }
        let metal_rough = || pbr.metallic_roughness_texture().map(|info| TextureInfo::of(&info));
        let metallic = self.scalar("metallicFactor", pbr.metallic_factor(), metal_rough(), Channel::B)?;
        let roughness = self.scalar("roughnessFactor", pbr.roughness_factor(), metal_rough(), Channel::G)?;
        let transmission = match source.transmission() {
            None => Scalar::constant(0.0),
            Some(transmission) => {
                let texture = transmission.transmission_texture().map(|info| TextureInfo::of(&info));
                let factor = transmission.transmission_factor();
                self.scalar("transmissionFactor", factor, texture, Channel::R)?
            }
        };
        let layers = self.layers()?;
        let diffuse_transmission = self.diffuse_transmission()?;
        let (specular, mut specular_colour) = self.specular()?;
        let mut ior = source.ior().unwrap_or(1.5);
        if ior == 0.0 {
            // In KHR_materials_ior, 0 means a reflectance of 1 (times the tint) at all angles. The factor cancels the
            // reflectance of 0.04 that an index of 1.5 gives.
            ior = 1.5;
            specular_colour.factor *= 25.0;
        } else if ior < 1.0 {
            self.warn(&format!("ior is {ior}; it must be 0 or at least 1, so 1 is used"));
            ior = 1.0;
        }
        let has_no_layers = layers.clearcoat.factor == 0.0
            && layers.sheen.is_none()
            && layers.iridescence.is_none()
            && diffuse_transmission.is_none();
        let is_matte =
            specular.factor == 0.0 && metallic.factor == 0.0 && transmission.factor == 0.0 && has_no_layers;
        let has_drafts = self.has_drafts();
        if is_matte && !has_drafts {
            return Ok(Surface::Matte { reflectance: base_colour });
        }
        let surface = Principled {
            base_colour,
            metallic,
            roughness,
            ior,
            specular,
            specular_colour,
            transmission,
            thin: self.is_thin(),
            diffuse_transmission,
            dispersion: self.dispersion(transmission.factor > 0.0),
            ..layers
        };
        if has_drafts {
            return Ok(Surface::OpenPbr(self.openpbr(&surface)?));
        }
        Ok(Surface::Principled(surface))
    }

    fn is_thin(&self) -> bool {
        self.source.volume().is_none_or(|volume| volume.thickness_factor() <= 0.0)
    }

    fn medium(&mut self) -> Option<Medium> {
        let volume = self.source.volume().filter(|_| !self.is_thin())?;
        let colour = Vec3::from(volume.attenuation_color())
            .map(|v| self.clamped("a component of attenuationColor", v, 1.0));
        let distance = volume.attenuation_distance();
        if distance.is_nan() || distance <= 0.0 {
            self.warn(&format!(
                "attenuationDistance is {distance}; it must be above 0, so nothing is absorbed"
            ));
            return None;
        }
        Medium::tinting(colour, distance).map(|medium| self.scattering(medium))
    }

    fn emission(&mut self) -> Result<Option<Emission>, LoadProblem> {
        let strength = self.source.emissive_strength().unwrap_or(1.0);
        let strength = self.clamped("emissiveStrength", strength, f32::MAX);
        let factor = Vec3::from(self.source.emissive_factor())
            .map(|v| self.clamped("a component of emissiveFactor", v, f32::MAX));
        let factor = (factor * strength).min(Vec3::splat(f32::MAX));
        if factor == Vec3::ZERO {
            return Ok(None);
        }
        let texture = self.source.emissive_texture().map(|info| TextureInfo::of(&info));
        let radiance = Colour { texture: self.colour(texture)?, ..Colour::constant(factor) };
        Ok(Some(Emission { radiance, two_sided: self.source.double_sided(), is_light: true }))
    }

    fn normal_map(&mut self) -> Result<Option<NormalMap>, LoadProblem> {
        let Some(info) = self.source.normal_texture() else { return Ok(None) };
        let texture = self.texture(&TextureInfo::of_normal(&info), ColourSpace::Linear)?;
        Ok(Some(NormalMap { texture, scale: info.scale() }))
    }

    fn alpha(&mut self) -> Result<Alpha, LoadProblem> {
        use ::gltf::material::AlphaMode as Mode;
        let mode = match self.source.alpha_mode() {
            Mode::Opaque => return Ok(Alpha::default()),
            Mode::Mask => AlphaMode::Mask { cutoff: self.source.alpha_cutoff().unwrap_or(0.5) },
            Mode::Blend => AlphaMode::Blend,
        };
        let base = self.base()?;
        let factor = base.alpha;
        let texture = self.colour(base.texture)?.filter(|used| !self.textures.is_opaque(used.texture));
        let is_everywhere = match mode {
            AlphaMode::Mask { cutoff } => factor >= cutoff,
            AlphaMode::Blend => factor >= 1.0,
            AlphaMode::Opaque => true,
        };
        let vertex = self.colours.alpha;
        if is_everywhere && texture.is_none() && !vertex {
            // Saves the tracer a test that always passes.
            return Ok(Alpha::default());
        }
        let value = Scalar { factor, texture: texture.map(|texture| (texture, Channel::A)) };
        Ok(Alpha { mode, value, vertex })
    }

    fn colour(&mut self, texture: Option<TextureInfo>) -> Result<Option<TextureRef>, LoadProblem> {
        texture.map(|texture| self.texture(&texture, ColourSpace::Srgb)).transpose()
    }

    fn scalar(
        &mut self,
        what: &str,
        factor: f32,
        texture: Option<TextureInfo>,
        channel: Channel,
    ) -> Result<Scalar, LoadProblem> {
        let factor = self.clamped(what, factor, 1.0);
        let texture = texture.map(|texture| self.texture(&texture, ColourSpace::Linear)).transpose()?;
        Ok(Scalar { factor, texture: texture.map(|texture| (texture, channel)) })
    }

    fn texture(&mut self, texture: &TextureInfo, space: ColourSpace) -> Result<TextureRef, LoadProblem> {
        let set = match self.uv_sets.iter().position(|&set| set == texture.set) {
            Some(known) => known,
            None => {
                self.uv_sets.push(texture.set);
                self.uv_sets.len() - 1
            }
        };
        let loaded = texture.load(self.context, self.textures, &self.name, space)?;
        Ok(TextureRef { set: set as u32, ..loaded })
    }

    /// A factor, clamped to 0..=`high` with a warning.
    fn clamped(&mut self, what: &str, value: f32, high: f32) -> f32 {
        self.context.session.warnings.clamp(
            format_args!("Material {:?}: {what}", self.name),
            value,
            0.0,
            high,
        )
    }

    fn warn(&mut self, problem: &str) {
        self.context.session.warnings.add(format!("Material {:?}: {problem}.", self.name));
    }
}
