//! What smaller copies of textures average.

use super::{AlphaMode, Channel, Scene, Surface};
use std::collections::HashMap;

/// What a texel of a smaller copy keeps of the texels that it stands for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Averaging {
    /// The mean of each channel; of colours that is of light, not of bytes.
    #[default]
    Light,
    /// The same, but what alpha cuts away has no say in colours: it would darken or tint the fringes of leaves.
    Covered,
    /// The direction of the mean normal; alpha is how much shorter than 1 it was, which is how rough the bumps
    /// are that are too small to be seen.
    Normals,
}

impl Scene {
    /// Gives every texture its smaller copies. Loaders do; scenes made by hand have none before, and then every
    /// lookup is in the image itself.
    pub fn add_pyramids(&mut self) {
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
        // Textures that differ only in their edges share texels. What is made keeps the images alive, lest another
        // come to lie in the place of one.
        let mut made = HashMap::new();
        for (texture, mean) in self.textures.iter_mut().zip(means) {
            let image = texture.texels.clone();
            let (_, copies) = made.entry((image.as_ptr(), texture.space, mean)).or_insert_with(|| {
                texture.add_pyramid(mean);
                (image, (texture.texels.clone(), texture.pyramid.clone()))
            });
            (texture.texels, texture.pyramid) = copies.clone();
        }
    }
}
