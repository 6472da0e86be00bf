//! Textures as glTF materials refer to them.

use super::super::LoadProblem;
use super::super::textures::{Source, Textures, Wanted};
use super::Context;
use super::buffers::{Buffers, Location, locate};
use crate::scene::{ColourSpace, TextureRef, Wrap};
use ::gltf::buffer::View;
use ::gltf::json::Value;
use ::gltf::material::NormalTexture;
use ::gltf::texture::{Info, WrappingMode};
use ::gltf::{Document, Image, Texture};
use glam::Vec2;
use std::collections::BTreeMap;
use std::path::Path;

/// A reference to a texture: glTF's `textureInfo` with KHR_texture_transform.
pub(super) struct TextureInfo<'a> {
    texture: Texture<'a>,
    /// The set of texture coordinates: 0 for `TEXCOORD_0`.
    pub(super) set: u32,
    offset: Vec2,
    rotation: f32,
    scale: Vec2,
}

impl<'a> TextureInfo<'a> {
    fn untransformed(texture: Texture<'a>, set: u32) -> Self {
        Self { texture, set, offset: Vec2::ZERO, rotation: 0.0, scale: Vec2::ONE }
    }

    /// The reference in an object for which the `gltf` crate has a type.
    pub(super) fn of(info: &Info<'a>) -> Self {
        let untransformed = Self::untransformed(info.texture(), info.tex_coord());
        match info.texture_transform() {
            None => untransformed,
            Some(transform) => Self {
                set: transform.tex_coord().unwrap_or(untransformed.set),
                offset: transform.offset().into(),
                rotation: transform.rotation(),
                scale: transform.scale().into(),
                ..untransformed
            },
        }
    }

    /// The reference of a normal map.
    pub(super) fn of_normal(info: &NormalTexture<'a>) -> Self {
        let untransformed = Self::untransformed(info.texture(), info.tex_coord());
        untransformed.transformed(info.extension_value("KHR_texture_transform"))
    }

    /// The reference in an extension for which the crate has no type. `None` if there is none.
    ///
    /// # Errors
    /// When it names a texture that does not exist.
    pub(super) fn of_json(document: &'a Document, info: Option<&Value>) -> Result<Option<Self>, String> {
        let Some(info) = info else { return Ok(None) };
        let index = info["index"].as_u64().ok_or("a texture without an index")?;
        let count = document.textures().len();
        let texture = usize::try_from(index).ok().and_then(|index| document.textures().nth(index));
        let texture = texture.ok_or_else(|| format!("names texture {index}, but there are {count}"))?;
        let set = info["texCoord"].as_u64().unwrap_or(0) as u32;
        Ok(Some(
            Self::untransformed(texture, set).transformed(info["extensions"].get("KHR_texture_transform")),
        ))
    }

    fn transformed(self, transform: Option<&Value>) -> Self {
        let Some(transform) = transform else { return self };
        let pair = |key: &str, unset: f64| {
            let at = |i: usize| transform[key][i].as_f64().unwrap_or(unset) as f32;
            Vec2::new(at(0), at(1))
        };
        Self {
            set: transform["texCoord"].as_u64().map_or(self.set, |set| set as u32),
            offset: pair("offset", 0.0),
            rotation: transform["rotation"].as_f64().unwrap_or(0.0) as f32,
            scale: pair("scale", 1.0),
            ..self
        }
    }

    /// Loads the texture, as one of the first set of texture coordinates. Each image is decoded once.
    ///
    /// # Errors
    /// When the image is missing or cannot be decoded. The error names the file, the material and the image.
    pub(super) fn load(
        &self,
        context: &mut Context,
        textures: &mut Textures,
        material: &str,
        space: ColourSpace,
    ) -> Result<TextureRef, LoadProblem> {
        let path = context.session.path.clone();
        let (name, image) = self.image(context, textures);
        let image = textures.or_stand_in(context.session, image, |problem| LoadProblem::Texture {
            path,
            material: material.to_owned(),
            texture: name,
            problem,
        })?;
        let sampler = self.texture.sampler();
        let wrap = [sampler.wrap_s(), sampler.wrap_t()].map(|mode| match mode {
            WrappingMode::ClampToEdge => Wrap::Clamp,
            WrappingMode::MirroredRepeat => Wrap::Mirror,
            WrappingMode::Repeat => Wrap::Repeat,
        });
        let texture = textures.texture(image, space, wrap);
        Ok(TextureRef { texture, set: 0, offset: self.offset, rotation: self.rotation, scale: self.scale })
    }

    /// The image's name, and its index or what is wrong with it.
    fn image(&self, context: &mut Context, textures: &mut Textures) -> (String, Result<usize, String>) {
        let Some(image) = image_of(context.document, &self.texture) else {
            let problem = "has no image of a known kind (PNG, JPEG, WebP or KTX2)".into();
            return (format!("textures[{}]", self.texture.index()), Err(problem));
        };
        let mut name = name(&image);
        let (view, uri) = place(context.document, &image);
        let source = Source::Embedded(image.index());
        let result = match (view, uri) {
            (Some(view), _) => {
                let bytes = |_: &mut _| context.buffers.view(&view).map(<[u8]>::to_vec);
                textures.image(context.session, source, &name, bytes)
            }
            (None, Some(uri)) => match locate(&context.session.path, uri) {
                Ok(Location::File(path)) => {
                    name = format!("{uri:?}");
                    textures.file(context.session, &path)
                }
                Ok(Location::Data(bytes)) => textures.image(context.session, source, &name, |_| Ok(bytes)),
                Err(problem) => Err(problem),
            },
            (None, None) => Err("has neither a buffer view nor a URI".into()),
        };
        (name, result)
    }
}

/// The image of a texture. An image of a later format stands beside a plain one for viewers that cannot read it.
fn image_of<'a>(document: &'a Document, texture: &Texture<'a>) -> Option<Image<'a>> {
    let later = ["KHR_texture_basisu", "EXT_texture_webp"]
        .iter()
        .find_map(|name| texture.extension_value(name)?["source"].as_u64());
    match later.and_then(|index| usize::try_from(index).ok()) {
        Some(index) => document.images().nth(index),
        None => texture.source(),
    }
}

/// The name of an image in messages.
fn name(image: &Image) -> String {
    image.name().map_or_else(|| format!("images[{}]", image.index()), str::to_owned)
}

/// The buffer view or the URI that has an image's file. The crate's accessor panics if both are missing.
fn place<'a>(document: &'a Document, image: &Image) -> (Option<View<'a>>, Option<&'a String>) {
    let json = &document.as_json().images[image.index()];
    let view = json.buffer_view.and_then(|view| document.views().nth(view.value()));
    (view, json.uri.as_ref())
}

/// The images of a document that nearly every conversion of its materials asks for, each once: those of glTF's own
/// textures.
pub(super) fn wanted<'a>(document: &'a Document, buffers: &'a Buffers, path: &Path) -> Vec<Wanted<'a>> {
    let textures = document.materials().flat_map(|material| {
        let pbr = material.pbr_metallic_roughness();
        let has_factor = pbr.metallic_factor() != 0.0 || pbr.roughness_factor() != 0.0;
        let colour = pbr.base_color_texture().map(|info| info.texture());
        let rough = pbr.metallic_roughness_texture().filter(|_| has_factor).map(|info| info.texture());
        let emissive = material.emissive_texture().filter(|_| material.emissive_factor() != [0.0; 3]);
        let normal = material.normal_texture().map(|info| info.texture());
        let is_lit = material.extension_value("KHR_materials_unlit").is_none();
        let lit = [rough, emissive.map(|info| info.texture()), normal].into_iter().filter(move |_| is_lit);
        std::iter::once(colour).chain(lit).flatten()
    });
    let mut found = BTreeMap::new();
    for image in textures.filter_map(|texture| image_of(document, &texture)) {
        let (view, uri) = place(document, &image);
        let embedded = |bytes| Wanted { source: Source::Embedded(image.index()), name: name(&image), bytes };
        let wanted = match (view, uri) {
            (Some(view), _) => buffers.view(&view).ok().map(|bytes| embedded(Some(bytes))),
            (None, Some(uri)) if !uri.starts_with("data:") => match locate(path, uri) {
                Ok(Location::File(file)) => {
                    let name = file.to_string_lossy().into_owned();
                    Some(Wanted { source: Source::File(file), name, bytes: None })
                }
                _ => None,
            },
            _ => None,
        };
        found.extend(wanted.map(|wanted| (image.index(), wanted)));
    }
    found.into_values().collect()
}
