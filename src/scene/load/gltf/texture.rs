//! Textures as glTF materials refer to them.

use super::super::LoadProblem;
use super::super::textures::{Source, Textures};
use super::Context;
use super::buffers::{Location, locate};
use crate::scene::{ColourSpace, TextureRef, Wrap};
use ::gltf::json::Value;
use ::gltf::material::NormalTexture;
use ::gltf::texture::{Info, WrappingMode};
use ::gltf::{Document, Texture};
use glam::Vec2;

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
        // An image of a later format stands beside a plain one for viewers that cannot read it.
        let later = ["KHR_texture_basisu", "EXT_texture_webp"]
            .iter()
            .find_map(|name| self.texture.extension_value(name)?["source"].as_u64());
        let source = match later.and_then(|index| usize::try_from(index).ok()) {
            Some(index) => context.document.images().nth(index),
            None => self.texture.source(),
        };
        let Some(image) = source else {
            let problem = "has no image of a known kind (PNG, JPEG, WebP or KTX2)".into();
            return (format!("textures[{}]", self.texture.index()), Err(problem));
        };
        let mut name = image.name().map_or_else(|| format!("images[{}]", image.index()), str::to_owned);
        // The crate's accessor panics if both the URI and the buffer view are missing.
        let json = &context.document.as_json().images[image.index()];
        let view = json.buffer_view.and_then(|view| context.document.views().nth(view.value()));
        let source = Source::Embedded(image.index());
        let result = match (view, &json.uri) {
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
