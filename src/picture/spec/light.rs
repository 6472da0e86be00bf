//! Light besides the scene's own.

use super::form::{self, Form};
use super::option::spec_group;
use crate::scene::load::{self, LoadOptions};
use crate::scene::{Environment, Scene};
use anyhow::{Result, bail};
use glam::Vec3;
use std::path::Path;

spec_group! {
    /// Light besides the scene's own.
    pub struct LightSpec {
        /// Environment: an equirectangular .hdr or .exr file, or a constant R,G,B
        /// [default: the scene's; 1,1,1 if the scene has no light].
        maybe "env" env: form::Text, "FILE|R,G,B";
        /// Rotate the environment map around the vertical axis.
        one "env-rotation" env_rotation: form::Angle = 0.0, "DEG";
    }
}

impl LightSpec {
    /// The environment's file, if the options name one.
    pub fn env_file(&self) -> Option<&Path> {
        self.env.as_deref().filter(|text| !is_list_of_numbers(text)).map(Path::new)
    }

    /// Sets the environment that the options name, or a white one if the scene would have no light.
    pub fn apply_environment(&self, scene: &mut Scene, options: &LoadOptions) -> Result<()> {
        match &self.env {
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
            None if is_dark(scene) => {
                log::warn!("the scene has no light; using a white environment (choose one with --env)");
                scene.environment = Environment::Constant(Vec3::ONE);
            }
            None => {}
        }
        Ok(())
    }
}

/// True if a text is meant as a constant radiance, right or wrong, not as a file.
fn is_list_of_numbers(text: &str) -> bool {
    text.split(',').all(|part| part.trim().parse::<f32>().is_ok())
}

fn is_dark(scene: &Scene) -> bool {
    let emission = |material: &u32| scene.materials[*material as usize].emission;
    let emits = |material: &u32| emission(material).is_some_and(|emission| emission.is_light);
    matches!(scene.environment, Environment::Constant(Vec3::ZERO))
        && scene.lights.is_empty()
        && !scene.mesh.materials.iter().any(emits)
}
