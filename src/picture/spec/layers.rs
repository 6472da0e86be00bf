//! Layers of pictures.

use super::form;
use super::option::spec_group;
use crate::render::AovSet;

/// Remover of a picture's noise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Denoiser {
    /// Nothing.
    #[default]
    None,
    /// The filter of raystream.
    Own,
    /// Open Image Denoise. The noisy picture has the same bytes on all units; what OIDN makes of it may not.
    Oidn,
}

spec_group! {
    /// Layers besides the picture.
    pub struct LayerSpec {
        /// Layers to write besides the picture, separated by commas: depth, z, normal, shading-normal, position,
        /// albedo, uv, emission, object, material, instance, primitive, samples, variance, crypto-object,
        /// crypto-material, crypto-asset, denoising-albedo, denoising-normal, noisy.
        maybe "aov" aov: form::Own<AovSet>, "LIST";
        /// Remove noise from the picture: `true` by raystream's own filter, whose result has the same bytes on every
        /// unit and machine, too; `oidn` by Open Image Denoise, where whoever writes the picture has its library.
        one "denoise" denoise: form::DenoiserName = Denoiser::None, "true|oidn";
        /// Leave the environment out where the camera sees it directly, and write alpha.
        flag "transparent" transparent;
    }
}

impl LayerSpec {
    /// All layers that are asked for.
    pub fn aovs(&self) -> AovSet {
        self.aov
            .clone()
            .unwrap_or_default()
            .with_transparent(self.transparent)
            .with_denoised(self.denoise != Denoiser::None)
    }
}
