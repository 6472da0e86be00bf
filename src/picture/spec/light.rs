//! Light besides the scene's own.

use super::form::{self, Form};
use super::option::spec_group;
use crate::scene::load::{self, LoadOptions};
use crate::scene::{Environment, EnvironmentMap, Scene};
use anyhow::{Result, bail};
use glam::Vec3;
use std::path::Path;

spec_group! {
    /// Light besides the scene's own.
    pub struct LightSpec {
        /// Environment: an equirectangular .hdr or .exr file, a constant R,G,B, or `studio`
        /// [default: the scene's; studio if no light of the scene reaches what is seen].
        maybe "env" env: form::Text, "FILE|R,G,B|studio";
        /// Rotate the environment map around the vertical axis.
        one "env-rotation" env_rotation: form::Angle = 0.0, "DEG";
    }
}

/// The built-in sky, by name.
const STUDIO: &str = "studio";

impl LightSpec {
    /// The environment's file, if the options name one.
    pub fn env_file(&self) -> Option<&Path> {
        let text = self.env.as_deref();
        text.filter(|text| *text != STUDIO && !is_list_of_numbers(text)).map(Path::new)
    }

    /// The sentence about the light that [`LightSpec::apply_environment`] assumed; `None` if it assumed none.
    pub fn assumed(&self, scene: &Scene) -> Option<&'static str> {
        let is_studio = matches!(&scene.environment, Environment::Map(map) if map.is_studio());
        (self.env.is_none() && is_studio).then_some("no light: a studio sky lights the scene (--env chooses)")
    }

    /// Sets the environment that the options name, or the studio if the scene would have no light. That is decided by
    /// the scene alone.
    pub fn apply_environment(&self, scene: &mut Scene, options: &LoadOptions) -> Result<()> {
        match &self.env {
            Some(text) if text == STUDIO => scene.environment = self.studio(),
            Some(text) => {
                scene.environment = match form::Vector::read(text) {
                    Ok(radiance) if radiance.cmpge(Vec3::ZERO).all() => Environment::Constant(radiance),
                    Ok(radiance) => bail!("--env {radiance}: radiance must not be negative"),
                    Err(problem) if is_list_of_numbers(text) => bail!("--env {text}: {problem}"),
                    Err(_) => {
                        let mut map = load::environment_with(Path::new(text), options)?;
                        map.rotation_degrees = self.env_rotation;
                        Environment::Map(map)
                    }
                };
            }
            None if is_dark(scene) => scene.environment = self.studio(),
            None => {}
        }
        Ok(())
    }

    fn studio(&self) -> Environment {
        Environment::Map(EnvironmentMap { rotation_degrees: self.env_rotation, ..EnvironmentMap::studio() })
    }
}

/// True if a text is meant as a constant radiance, right or wrong, not as a file.
fn is_list_of_numbers(text: &str) -> bool {
    text.split(',').all(|part| part.trim().parse::<f32>().is_ok())
}

fn is_dark(scene: &Scene) -> bool {
    matches!(scene.environment, Environment::Constant(Vec3::ZERO))
        && scene.lights.is_empty()
        && !scene.is_lit_by_surfaces()
}
