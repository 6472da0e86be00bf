//! Layers of pictures.

use crate::render::AovSet;
use clap::Args;

/// Layers besides the picture.
#[derive(Debug, Args)]
pub struct LayerArgs {
    /// Layers to write besides the picture, separated by commas: depth, z, normal, shading-normal, position, albedo,
    /// uv, emission, object, material, instance, primitive, samples, variance, crypto-object, crypto-material,
    /// crypto-asset.
    #[arg(long, value_name = "LIST")]
    pub aov: Option<AovSet>,
    /// Leave the environment out where the camera sees it directly, and write alpha.
    #[arg(long)]
    pub transparent: bool,
}

impl LayerArgs {
    /// All layers that are asked for.
    pub fn aovs(&self) -> AovSet {
        self.aov.clone().unwrap_or_default().with_transparent(self.transparent)
    }
}
