//! The part of a render spec that decides what a prepared scene is.

use super::{LightSpec, LoadingSpec, RenderSpec, SpecGroup};
use crate::picture::material_change::MaterialChange;
use crate::picture::plugin_options::Setting;
use crate::picture::shaders::ShaderSurface;
use serde_json::json;
use std::path::PathBuf;

/// The part of a [`RenderSpec`] that decides what a prepared scene is: the key of caches of scenes.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneSpec {
    scene: Option<PathBuf>,
    integrator: String,
    set: Vec<Setting>,
    surface: Vec<ShaderSurface>,
    material: Vec<MaterialChange>,
    light: LightSpec,
    loading: LoadingSpec,
}

impl From<&RenderSpec> for SceneSpec {
    fn from(spec: &RenderSpec) -> Self {
        // A new field does not compile until it is said here whether it changes the scene.
        let RenderSpec {
            scene,
            integrator,
            set,
            surface,
            material,
            light,
            loading,
            size: _,
            max_bounces: _,
            seed: _,
            no_russian_roulette: _,
            stop: _,
            part: _,
            sampling: _,
            camera: _,
            optics: _,
            animation: _,
            layers: _,
            look: _,
            encoding: _,
        } = spec.clone();
        Self { scene, integrator, set, surface, material, light, loading }
    }
}

impl SceneSpec {
    /// Returns the key, as text. It begins with the path of the scene.
    pub fn key(&self) -> String {
        let Self { scene, integrator, set, surface, material, light, loading } = self;
        let scene = scene.as_ref().map_or_else(String::new, |scene| scene.display().to_string());
        let set: Vec<String> = set.iter().map(Setting::to_string).collect();
        let surface: Vec<String> = surface.iter().map(ShaderSurface::to_string).collect();
        let material: Vec<String> = material.iter().map(MaterialChange::to_string).collect();
        format!(
            "{scene} {}",
            json!([integrator, set, surface, material, light.entries(true), loading.entries(true)])
        )
    }
}
