//! Averages of mipmap levels, by the texture's use.

use super::{AlphaMode, Channel, ColourSpace, Mipmap, Scene, Surface};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::sync::Arc;

/// Average that a texel of a mipmap level stores of the texels that it covers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Averaging {
    /// The mean of each channel. Colours are averaged as linear light, not as bytes.
    #[default]
    Light,
    /// The same mean, but texels that alpha cuts away do not count in colours. They would darken or tint the fringes
    /// of leaves.
    Covered,
    /// The direction of the mean normal. Alpha stores by how much the mean is shorter than 1, which measures the
    /// roughness of bumps that are smaller than a texel.
    Normals,
}

impl Scene {
    /// Bytes that [`Scene::add_mipmaps`] adds: for each image in each of its colour spaces, the image with its levels.
    pub(super) fn mipmap_bytes(&self) -> u64 {
        let mut images: Vec<_> =
            self.textures.iter().map(|texture| (texture.image(), texture.space as u8)).collect();
        images.sort_by_key(|(image, space)| (image.as_ptr(), *space));
        images.dedup_by_key(|(image, space)| (image.as_ptr(), *space));
        images.iter().map(|(image, _)| image.len() as u64 * 16 / 3).sum()
    }

    /// Computes the mipmap levels of every texture. Loaders call it. A scene built in code has no levels until it is
    /// called; then every lookup reads the image itself.
    pub fn add_mipmaps(&mut self) {
        self.take_mipmaps(&mut Mipmaps::default());
    }

    /// [`Scene::add_mipmaps`] with levels that have been computed before; those that were missing are added to them.
    pub(super) fn take_mipmaps(&mut self, Mipmaps(made): &mut Mipmaps) {
        let mut means = vec![Averaging::Light; self.textures.len()];
        for material in &self.materials {
            let alpha = &material.alpha;
            if let (true, Some((texture, Channel::A))) =
                (alpha.mode != AlphaMode::Opaque, alpha.value.texture)
            {
                means[texture.texture as usize] = Averaging::Covered;
            }
        }
        for material in &self.materials {
            let coats = match &material.surface {
                Surface::Principled(surface) => surface.coat_normal_map,
                _ => None,
            };
            for map in material.normal_map.iter().chain(&coats) {
                means[map.texture.texture as usize] = Averaging::Normals;
            }
        }
        for (texture, mean) in self.textures.iter_mut().zip(means) {
            let image = texture.texels.clone();
            let (_, mipmapped) =
                made.entry((image.as_ptr().addr(), texture.space, mean)).or_insert_with(|| {
                    texture.add_mipmap(mean);
                    (image, (texture.texels.clone(), texture.mipmap.clone()))
                });
            (texture.texels, texture.mipmap) = mipmapped.clone();
        }
    }
}

type Texels = Arc<[[u8; 4]]>;

/// Texels with those of their mipmap levels.
type Mipmapped = (Texels, Mipmap);

/// Mipmap levels that have been computed, by the address of the image, its colour space and the average. Textures that
/// differ only in addressing share texels. The map keeps the images alive, so that no other image is allocated at the
/// address of a freed one.
#[derive(Clone, Debug, Default)]
pub(super) struct Mipmaps(HashMap<(usize, ColourSpace, Averaging), (Texels, Mipmapped)>);
