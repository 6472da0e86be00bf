//! The textures of a scene while it is loaded. Each image is decoded once. Uses of an image in different colour
//! spaces or addressing modes are textures that share its texels.

use super::decode::{ImageSize, decode};
use super::session::Session;
use super::{LoadProblem, named};
use crate::lanes::for_pairs_mut;
use crate::memory::OutOfMemory;
use crate::scene::mip_weights::Mipmaps;
use crate::scene::{ColourSpace, Mipmap, Texture, Wrap};
use image::DynamicImage;
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// The source of an image.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) enum Source {
    /// An image file.
    File(PathBuf),
    /// An image inside the scene file, numbered by the loader.
    Embedded(usize),
    /// Stand-in for images that are missing or broken.
    StandIn,
}

/// The texels of an image. Those without alpha are opaque. Most images are RGB, which the crate `image`, compiled
/// without all optimisations, converts more slowly than this.
fn texels(image: DynamicImage) -> Arc<[[u8; 4]]> {
    match image {
        DynamicImage::ImageRgb8(rgb) => {
            let (rgb, _) = rgb.as_raw().as_chunks::<3>();
            let mut texels = vec![[0; 4]; rgb.len()];
            for_pairs_mut(&mut texels, rgb, |texel, &[r, g, b]| *texel = [r, g, b, u8::MAX]);
            texels.into()
        }
        other => bytemuck::cast_slice::<u8, [u8; 4]>(other.into_rgba8().as_raw()).into(),
    }
}

/// Bytes of a texel.
const HELD_BYTES: u64 = 4;

/// Bytes that each texel takes while an image is decoded, beside the decoded file: the texels and a copy.
const WORKING_BYTES: u64 = 8;

/// A decoded image.
#[derive(Debug)]
pub(super) struct Pixels {
    name: String,
    width: u32,
    height: u32,
    texels: Arc<[[u8; 4]]>,
    /// True if the file stores floats. Such values are linear whatever they are used for.
    is_float: bool,
}

impl Pixels {
    fn new(name: String, image: DynamicImage) -> Self {
        let is_float = matches!(image, DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_));
        let (width, height) = (image.width(), image.height());
        Self { name, width, height, texels: texels(image), is_float }
    }

    /// A checker of magenta and black, which no scene has by intention.
    fn stand_in() -> Self {
        const SIDE: u32 = 32;
        let texel = |i: u32| match (i / 4 + i / SIDE / 4) % 2 {
            0 => [255, 0, 255, 255],
            _ => [16, 0, 16, 255],
        };
        let texels = (0..SIDE * SIDE).map(texel).collect();
        Self { name: "stand-in".into(), width: SIDE, height: SIDE, texels, is_float: false }
    }

    /// True if any texel's alpha is less than 1.
    pub(super) fn has_alpha(&self) -> bool {
        self.texels.iter().any(|texel| texel[3] != 255)
    }

    /// True if the image looks like a tangent-space normal map and not like a height map: nearly all texels decode to
    /// vectors that have a length of about 1 and point outwards, and not all texels are grey.
    pub(super) fn looks_like_normals(&self) -> bool {
        let is_normal = |&[r, g, b, _]: &[u8; 4]| {
            let [x, y, z] = [r, g, b].map(|v| f32::from(v) * (2.0 / 255.0) - 1.0);
            z > 0.0 && (0.7..1.3).contains(&(x * x + y * y + z * z)) && !(r == g && g == b)
        };
        let hits = self.texels.iter().filter(|texel| is_normal(texel)).count();
        hits * 10 >= self.texels.len() * 9
    }
}

/// Images that have been decoded before, and their mipmap levels.
#[derive(Clone, Debug, Default)]
pub(super) struct Images {
    by_source: HashMap<Source, Arc<Pixels>>,
    pub(super) mipmaps: Mipmaps,
}

impl Images {
    /// Bytes of the decoded images, without their mipmap levels.
    pub(super) fn bytes(&self) -> u64 {
        self.by_source.values().map(|pixels| size_of_val(&*pixels.texels) as u64).sum()
    }
}

/// An image that will be asked for.
pub(super) struct Wanted<'a> {
    pub(super) source: Source,
    /// Its name in warnings.
    pub(super) name: String,
    /// Its file, if it lies in another.
    pub(super) bytes: Option<&'a [u8]>,
}

impl Wanted<'_> {
    /// The decoded image. `None` if there is none: whoever asks for it finds out why.
    fn decoded(
        &self,
        session: &Session,
        afford: impl FnOnce(ImageSize) -> Result<(), OutOfMemory>,
    ) -> Option<Pixels> {
        let bytes = match (&self.source, self.bytes) {
            (_, Some(bytes)) => Cow::Borrowed(bytes),
            (Source::File(path), None) if session.options.allows(path) => {
                Cow::Owned(named::read(path, u64::MAX, &session.options).ok()?)
            }
            _ => return None,
        };
        let decoded = decode(&bytes, Path::new(&self.name), afford).ok()?;
        Some(Pixels::new(self.name.clone(), decoded))
    }
}

/// All images and textures so far.
#[derive(Debug, Default)]
pub(super) struct Textures {
    decoded: Images,
    images: Vec<Arc<Pixels>>,
    by_source: HashMap<Source, usize>,
    textures: Vec<Texture>,
    by_use: HashMap<(usize, ColourSpace, [Wrap; 2]), u32>,
}

impl Textures {
    /// No textures yet, of images that need not be decoded again.
    pub(super) fn of_images(decoded: Images) -> Self {
        Self { decoded, ..Self::default() }
    }

    /// Decodes images that will be asked for, which all threads of rayon's pool share, as far as they fit the memory
    /// together.
    pub(super) fn decode_ahead(&mut self, session: &Session, mut wanted: Vec<Wanted>) {
        wanted.retain(|image| !self.decoded.by_source.contains_key(&image.source));
        if wanted.len() < 2 {
            return;
        }
        let taken = AtomicU64::new(0);
        let afford = |size: ImageSize| {
            let bytes = size.bytes + WORKING_BYTES * size.texels();
            let all = taken.fetch_add(bytes, Ordering::Relaxed).saturating_add(bytes);
            session.check(size.to_string(), all)
        };
        let decoded = wanted.into_par_iter().with_max_len(1).filter_map(|image| {
            let pixels = image.decoded(session, afford)?;
            Some((image.source, Arc::new(pixels)))
        });
        self.decoded.by_source.extend(decoded.collect::<Vec<_>>());
    }

    /// The index of an image. The image is decoded if it is new; `bytes` reads its file in that case only. `name` is
    /// the image's name in warnings.
    ///
    /// # Errors
    /// A sentence without the image's name.
    pub(super) fn image(
        &mut self,
        session: &mut Session,
        source: Source,
        name: &str,
        bytes: impl FnOnce(&mut Session) -> Result<Vec<u8>, String>,
    ) -> Result<usize, String> {
        if let Some(&image) = self.by_source.get(&source) {
            return Ok(image);
        }
        if let Some(pixels) = self.decoded.by_source.get(&source).map(Arc::clone) {
            if let Source::File(path) = &source {
                session.files.push(path.clone());
            }
            session
                .hold("an image", size_of_val(&*pixels.texels) as u64)
                .map_err(|error| error.to_string())?;
            return Ok(self.add(source, pixels));
        }
        let decoded = decode(&bytes(session)?, Path::new(name), |size| {
            session.check(size.to_string(), size.bytes + WORKING_BYTES * size.texels())?;
            session.hold(size.to_string(), HELD_BYTES * size.texels())
        })?;
        let pixels = Arc::new(Pixels::new(name.to_owned(), decoded));
        self.decoded.by_source.insert(source.clone(), Arc::clone(&pixels));
        Ok(self.add(source, pixels))
    }

    fn add(&mut self, source: Source, pixels: Arc<Pixels>) -> usize {
        self.images.push(pixels);
        self.by_source.insert(source, self.images.len() - 1);
        self.images.len() - 1
    }

    /// The index of a magenta checker in place of an image that is missing or broken, if the options allow it.
    ///
    /// # Errors
    /// The problem of the image, as `told` tells it.
    pub(super) fn or_stand_in(
        &mut self,
        session: &mut Session,
        image: Result<usize, String>,
        told: impl FnOnce(String) -> LoadProblem,
    ) -> Result<usize, LoadProblem> {
        let problem = match image {
            Ok(image) => return Ok(image),
            Err(problem) => problem,
        };
        let remedy = if session.options.allow_missing {
            "a magenta checker stands in for it (--allow-missing)"
        } else {
            "mend it, or show a checker in its place (--allow-missing)"
        };
        session.missing(told(format!("{problem}; {remedy}")))?;
        Ok(match self.by_source.get(&Source::StandIn) {
            Some(&image) => image,
            None => self.add(Source::StandIn, Pixels::stand_in().into()),
        })
    }

    /// The index of the image in a file.
    ///
    /// # Errors
    /// A sentence without the file's name.
    pub(super) fn file(&mut self, session: &mut Session, path: &Path) -> Result<usize, String> {
        self.image(session, Source::File(path.to_owned()), &path.to_string_lossy(), |session| {
            session.read_named(path, u64::MAX).map_err(|problem| problem.to_string())
        })
    }

    /// A decoded image.
    pub(super) fn pixels(&self, image: usize) -> &Pixels {
        &self.images[image]
    }

    /// The index of the texture with this image, colour space and addressing.
    pub(super) fn texture(&mut self, image: usize, space: ColourSpace, wrap: [Wrap; 2]) -> u32 {
        let pixels = &self.images[image];
        let space = if pixels.is_float { ColourSpace::Linear } else { space };
        let textures = &mut self.textures;
        *self.by_use.entry((image, space, wrap)).or_insert_with(|| {
            textures.push(Texture {
                name: pixels.name.clone(),
                width: pixels.width,
                height: pixels.height,
                texels: pixels.texels.clone(),
                space,
                wrap_u: wrap[0],
                wrap_v: wrap[1],
                mipmap: Mipmap::default(),
            });
            (textures.len() - 1) as u32
        })
    }

    /// True if a texture's alpha is 1 everywhere.
    pub(super) fn is_opaque(&self, texture: u32) -> bool {
        self.textures[texture as usize].texels.iter().all(|texel| texel[3] == 255)
    }

    /// All textures.
    pub(super) fn into_list(self) -> Vec<Texture> {
        self.textures
    }

    /// All textures, and all images that have been decoded.
    pub(super) fn into_parts(self) -> (Vec<Texture>, Images) {
        (self.textures, self.decoded)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texels_are_those_of_the_image_crate() {
        let bytes: Vec<u8> = (0..75 * 4).map(|i| (i * 7) as u8).collect();
        let rgba = image::RgbaImage::from_raw(15, 5, bytes).expect("75 pixels");
        let rgba = DynamicImage::ImageRgba8(rgba);
        let images = [
            DynamicImage::ImageRgb8(rgba.to_rgb8()),
            DynamicImage::ImageRgb16(rgba.to_rgb16()),
            DynamicImage::ImageLumaA8(rgba.to_luma_alpha8()),
            rgba,
        ];
        for image in images {
            let expected = image.to_rgba8().into_raw();
            assert_eq!(bytemuck::cast_slice::<[u8; 4], u8>(&texels(image)), expected);
        }
    }
}
