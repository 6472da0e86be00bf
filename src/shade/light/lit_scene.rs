//! A scene with its lights.

use super::emitters::materials_of_computed_opacity;
use super::{Emitters, EnvironmentLight, Lights, Punctual, emitter_bounds};
use crate::scene::{Emission, Environment, EnvironmentMap, Scene, Texture, TextureRef};
use std::sync::Arc;

/// A scene with its lights prepared for sampling. Clones share both. Made from an `Arc<Scene>` by `From`.
#[derive(Clone, Debug)]
pub struct LitScene {
    scene: Arc<Scene>,
    lights: Arc<Lights>,
}

impl From<Arc<Scene>> for LitScene {
    fn from(scene: Arc<Scene>) -> Self {
        let lights = Arc::new(Lights::new(&scene));
        Self { scene, lights }
    }
}

impl LitScene {
    /// The scene.
    #[inline]
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// Its lights.
    #[inline]
    pub fn lights(&self) -> &Arc<Lights> {
        &self.lights
    }

    /// The same geometry with another appearance: lights that are equal in both are not prepared again. The result is
    /// that of `LitScene::from(scene)`.
    pub fn with_scene(&self, scene: Arc<Scene>) -> Self {
        let lights = Arc::new(self.lights.with_scene(&self.scene, &scene));
        Self { scene, lights }
    }

    /// The same scene for integrators that also sample BSDFs: see [`Lights::without_uniform_sky`].
    pub fn without_uniform_sky(self) -> Self {
        let lights = Arc::new(Arc::unwrap_or_clone(self.lights).without_uniform_sky());
        Self { lights, ..self }
    }
}

impl Lights {
    /// The lights of `new`, which reuse those of `old` that are equal. These are the lights of `old`.
    fn with_scene(&self, old: &Scene, new: &Scene) -> Self {
        let environment = if are_equal(&old.environment, &new.environment) {
            Arc::clone(&self.environment)
        } else {
            Arc::new(EnvironmentLight::new(&new.environment))
        };
        if !new.shares_geometry(old) {
            return self.sampled_alike(Self::under(new, environment));
        }
        let (emitters, bounds) = if have_equal_emission(old, new) {
            // Surfaces of user code may bound emission of their own.
            let is_built_in = old.procedurals.is_empty() && new.procedurals.is_empty();
            let bounds = if is_built_in {
                Arc::clone(&self.emitter_bounds)
            } else {
                Arc::new(emitter_bounds(new, &self.bounds))
            };
            (Arc::clone(&self.emitters), bounds)
        } else {
            (Arc::new(Emitters::new(new)), Arc::new(emitter_bounds(new, &self.bounds)))
        };
        let punctual = if old.lights == new.lights {
            Arc::clone(&self.punctual)
        } else {
            Arc::new(Punctual::new(&new.lights, self.bounds.radius()))
        };
        self.sampled_alike(Self::of_parts(self.bounds, emitters, punctual, environment, bounds))
    }

    /// Other lights, without a uniform sky if these are.
    fn sampled_alike(&self, lights: Self) -> Self {
        if self.skips_uniform_sky { lights.without_uniform_sky() } else { lights }
    }
}

/// True if triangles of all materials emit the same light, and light samples find the same ones.
fn have_equal_emission(old: &Scene, new: &Scene) -> bool {
    let emitting = |scene: &Scene| -> Vec<_> {
        let of = scene.materials.iter().zip(materials_of_computed_opacity(scene));
        of.map(|(material, is_passed)| Some((material.emission?, material.alpha, is_passed))).collect()
    };
    let [emitting_before, emitting_now] = [old, new].map(emitting);
    let is_equal = |index: usize| match [&emitting_before, &emitting_now].map(|of| *of.get(index)?) {
        [None, None] => true,
        [Some(a), Some(b)] => {
            let (Emission { radiance, two_sided: _, is_light: _ }, alpha, _) = a;
            let of_alpha = alpha.value.texture.map(|(texture, _)| texture);
            a == b
                && radiance.texture.into_iter().chain(of_alpha).all(|TextureRef { texture, .. }| {
                    let texture = texture as usize;
                    have_equal_texels(&old.textures[texture], &new.textures[texture])
                })
        }
        _ => false,
    };
    (0..old.materials.len().max(new.materials.len())).all(is_equal)
}

/// True if lookups in both textures are the same. Equal images at different addresses count as different.
fn have_equal_texels(a: &Texture, b: &Texture) -> bool {
    let kind = |t: &Texture| (t.width, t.height, t.space, t.wrap_u, t.wrap_v);
    kind(a) == kind(b) && Arc::ptr_eq(&a.texels, &b.texels)
}

/// True if both environments are the same. Equal images at different addresses count as different.
fn are_equal(a: &Environment, b: &Environment) -> bool {
    match (a, b) {
        (Environment::Constant(a), Environment::Constant(b)) => a == b,
        (Environment::Map(a), Environment::Map(b)) => {
            let kind = |map: &EnvironmentMap| (map.width, map.height, map.rotation_degrees.to_bits());
            kind(a) == kind(b) && Arc::ptr_eq(&a.texels, &b.texels)
        }
        _ => false,
    }
}
