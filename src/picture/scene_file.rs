//! Reads the scene that a spec or a command names.

use crate::film::MAX_RADIANCE;
use crate::scene::load::{LoadError, LoadOptions, load_from, load_with};
use crate::scene::{Environment, Scene};
use std::path::Path;

/// The name of a scene that is read from standard input.
const STANDARD_INPUT: &str = "-";

/// Reads a scene and tells the log what the loader warns of, even if it fails. `-` is standard input, whose content
/// tells the format.
///
/// # Errors
/// What is wrong with the scene.
pub fn read(path: &Path, options: &LoadOptions) -> Result<Scene, LoadError> {
    let loaded = if is_standard_input(path) {
        load_from(std::io::stdin().lock(), "standard input".as_ref(), options)
    } else {
        load_with(path, options)
    };
    let warnings = match &loaded {
        Ok(scene) => &scene.warnings[..],
        Err(error) => error.warnings(),
    };
    tell(warnings);
    loaded
}

/// True if a path stands for standard input.
pub(super) fn is_standard_input(path: &Path) -> bool {
    path == Path::new(STANDARD_INPUT)
}

/// Tells the log what a loader warns of.
pub fn tell(warnings: &[String]) {
    for warning in warnings {
        log::warn!("{warning}");
    }
}

/// Warns of light that is brighter than a picture can hold.
pub fn warn_of_clamped_light(scene: &Scene) {
    let brightest = |emission: glam::Vec3| emission.max_element() > MAX_RADIANCE;
    let shining = scene.materials.iter().filter_map(|material| Some((material, material.emission?)));
    for (material, emission) in shining.filter(|(_, emission)| brightest(emission.radiance.factor)) {
        log::warn!(
            "Material {:?} emits {:e}; radiance above {MAX_RADIANCE} is clamped in the picture.",
            material.name,
            emission.radiance.factor.max_element()
        );
    }
    let texels = match &scene.environment {
        Environment::Constant(radiance) => usize::from(brightest(*radiance)),
        Environment::Map(map) => map.texels.iter().filter(|&&texel| brightest(texel.into())).count(),
    };
    if texels > 0 {
        log::warn!(
            "{texels} texels of the environment are above {MAX_RADIANCE}, to which a picture clamps radiance."
        );
    }
}
