//! Checks textures and environment maps.

use super::{FINITE, POSITIVE, SceneError, ScenePart};
use crate::scene::{Environment, EnvironmentMap, Scene, Texture};
use rayon::prelude::*;
use std::sync::Arc;

/// Texels that a thread checks at a time.
const CHUNK: usize = 1 << 16;

impl Scene {
    /// Checks the sizes of all textures. Their texels are bytes, and every byte is valid.
    pub(super) fn validate_textures(&self) -> Result<(), SceneError> {
        self.textures.iter().enumerate().try_for_each(|(index, texture)| check_texture(index, texture))
    }
}

fn check_texture(index: usize, texture: &Texture) -> Result<(), SceneError> {
    let Texture { name, width, height, texels, space: _, wrap_u: _, wrap_v: _, mipmap } = texture;
    let part = || ScenePart::Texture { index, name: name.clone() };
    let (width, height, found) = (*width, *height, texels.len());
    // Lookups number texels by 32 bits.
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > found as u64 || found > u32::MAX as usize {
        let expected = "at least one for each pixel, at most 2^32 - 1, and at least one pixel";
        return Err(SceneError::Texels { part: part(), width, height, found, expected });
    }
    if !mipmap.fits((width, height), found) {
        return Err(SceneError::Mipmap { part: part() });
    }
    Ok(())
}

/// Checks an environment map. The texels are not read again if a scene that has passed shares them.
pub(super) fn check_environment(map: &EnvironmentMap, valid: Option<&Scene>) -> Result<(), SceneError> {
    let EnvironmentMap { width, height, ref texels, rotation_degrees } = *map;
    let part = ScenePart::Environment;
    let (found, pixels) = (texels.len(), u64::from(width) * u64::from(height));
    if pixels == 0 || pixels != found as u64 || found > u32::MAX as usize {
        let expected = "one for each pixel, at most 2^32 - 1, and at least one pixel";
        return Err(SceneError::Texels { part, width, height, found, expected });
    }
    FINITE.check(&part, "its rotation in degrees", [rotation_degrees])?;
    if let Some(Scene { environment: Environment::Map(other), .. }) = valid
        && Arc::ptr_eq(texels, &other.texels)
    {
        return Ok(());
    }
    let values: &[f32] = texels.as_flattened();
    let check = |chunk: &[f32]| POSITIVE.check(&part, "a texel", chunk.iter().copied());
    values.par_chunks(CHUNK).try_for_each(check)
}
