//! Reads the scene that a command names.

use super::args::SceneArgs;
use crate::scene::Scene;
use crate::scene::load::{LoadError, load_with};
use std::path::Path;

/// Reads a scene and prints what the loader warns of, whether it succeeds or not.
pub fn read(path: &Path, args: &SceneArgs) -> Result<Scene, LoadError> {
    let loaded = load_with(path, &args.options());
    let warnings = match &loaded {
        Ok(scene) => &scene.warnings[..],
        Err(error) => error.warnings(),
    };
    for warning in warnings {
        log::warn!("{warning}");
    }
    loaded
}
