//! Light sources: emissive triangles, punctual lights and the environment, sampled by power.

mod alias;
mod emitters;
mod environment;
mod punctual;
#[cfg(test)]
mod tests;

pub use alias::AliasTable;
pub use emitters::{EmitterSample, Emitters};
pub use environment::EnvironmentLight;

use super::Interaction;
use crate::scene::{Light, Scene};
use crate::stream::Ray;
use glam::Vec3;

/// How far short of its end a shadow ray stops, as a share of its length: what rounding may move
/// the far end's own surface by.
const SHORT: f32 = 1.0 / (1u32 << 13) as f32;

/// All light of a scene.
///
/// A light is chosen in two steps: first one of the three kinds, half evenly among those that are
/// there and half by power, so that none starves however its power was misjudged (an environment
/// outside of a closed room); then within the kind by power.
#[derive(Clone, Debug)]
pub struct Lights {
    emitters: Emitters,
    punctual: Vec<Light>,
    punctual_table: AliasTable,
    environment: EnvironmentLight,
    /// Chance of each [`Kind`].
    chances: [f32; 3],
}

/// The kinds of light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Emitter = 0,
    Environment = 1,
    Punctual = 2,
}

/// Light that arrives at a point from one direction, unless something is between.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// Unit direction the light comes from.
    pub wi: Vec3,
    /// Where the light is; `None` for infinitely far away.
    pub target: Option<Vec3>,
    /// Radiance; irradiance on a facing surface where `delta`.
    pub radiance: Vec3,
    /// Density per solid angle; the chance of choosing the light where `delta`.
    pub pdf: f32,
    /// Whether no other way of sampling can find this light.
    pub delta: bool,
}

impl Lights {
    /// Prepares the lights of a scene.
    pub fn new(scene: &Scene) -> Self {
        let radius = scene.bounds().radius();
        let emitters = Emitters::new(scene);
        let powers: Vec<f64> =
            scene.lights.iter().map(|light| f64::from(punctual::power(light, radius))).collect();
        let punctual_table = AliasTable::new(&powers);
        let environment = EnvironmentLight::new(&scene.environment);
        // The disk of the scene's size, from all sides.
        let disk = std::f64::consts::PI * f64::from(radius).powi(2);
        let sky = f64::from(environment.mean()) * disk * 4.0 * std::f64::consts::PI;
        let powers = [emitters.power(), sky, punctual_table.total()];
        let total: f64 = powers.iter().sum();
        let present = powers.iter().filter(|&&p| p > 0.0).count() as f64;
        let chances =
            powers.map(|power| if power > 0.0 { (0.5 / present + 0.5 * power / total) as f32 } else { 0.0 });
        Self { emitters, punctual: scene.lights.clone(), punctual_table, environment, chances }
    }

    /// The punctual lights.
    pub fn punctual(&self) -> &[Light] {
        &self.punctual
    }

    /// The emissive triangles.
    pub fn emitters(&self) -> &Emitters {
        &self.emitters
    }

    /// The environment.
    pub fn environment(&self) -> &EnvironmentLight {
        &self.environment
    }

    /// Samples one light of all: `u` chooses it, `u2` a point or direction of it. `None` when no
    /// light comes this way.
    pub fn sample(&self, scene: &Scene, from: Vec3, u: f32, u2: [f32; 2]) -> Option<LightSample> {
        self.sample_kinds(scene, from, u, u2, &self.chances)
    }

    /// As [`Lights::sample`], without the punctual lights.
    pub fn sample_surfaces(&self, scene: &Scene, from: Vec3, u: f32, u2: [f32; 2]) -> Option<LightSample> {
        let [emitter, sky, _] = self.chances;
        let sum = emitter + sky;
        if sum <= 0.0 {
            return None;
        }
        self.sample_kinds(scene, from, u, u2, &[emitter / sum, sky / sum, 0.0])
    }

    /// Samples one punctual light by power.
    pub fn sample_punctual(&self, from: Vec3, u: f32) -> Option<LightSample> {
        let (index, chance) = self.punctual_table.choose(u)?;
        let sample = punctual::illuminate(&self.punctual[index as usize], from)?;
        Some(LightSample { pdf: chance, ..sample })
    }

    /// The light of punctual light `index` at a point.
    pub fn illuminate(&self, index: usize, from: Vec3) -> Option<LightSample> {
        punctual::illuminate(&self.punctual[index], from)
    }

    fn sample_kinds(
        &self,
        scene: &Scene,
        from: Vec3,
        u: f32,
        u2: [f32; 2],
        chances: &[f32; 3],
    ) -> Option<LightSample> {
        let [emitter, sky, _] = *chances;
        let (kind, low) = if u < emitter {
            (Kind::Emitter, 0.0)
        } else if u < emitter + sky {
            (Kind::Environment, emitter)
        } else {
            (Kind::Punctual, emitter + sky)
        };
        let chance = chances[kind as usize];
        // Below 1 even after rounding.
        let u = ((u - low) / chance).clamp(0.0, 1.0 - f32::EPSILON);
        let mut sample = match kind {
            Kind::Emitter => {
                let on = self.emitters.sample(scene, from, u, u2)?;
                let wi = (on.position - from).try_normalize()?;
                LightSample {
                    wi,
                    target: Some(on.position),
                    radiance: on.radiance,
                    pdf: on.pdf,
                    delta: false,
                }
            }
            Kind::Environment => {
                let (wi, radiance, pdf) = self.environment.sample(u2)?;
                LightSample { wi, target: None, radiance, pdf, delta: false }
            }
            Kind::Punctual => self.sample_punctual(from, u)?,
        };
        sample.pdf *= chance;
        Some(sample)
    }

    /// Density per solid angle with which [`Lights::sample`] finds a point of a triangle, seen from a
    /// squared distance under a cosine to its normal; 0 when it is no emitter.
    pub fn pdf_emitter(&self, primitive: u32, distance2: f32, cosine: f32) -> f32 {
        self.chances[Kind::Emitter as usize] * self.emitters.pdf(primitive, distance2, cosine)
    }

    /// Radiance of the environment along a unit direction that leaves the scene, and the density per
    /// solid angle with which [`Lights::sample`] finds this direction.
    pub fn sky(&self, direction: Vec3) -> (Vec3, f32) {
        let chance = self.chances[Kind::Environment as usize];
        let (radiance, pdf) = self.environment.look(direction);
        (radiance, if chance > 0.0 { chance * pdf } else { 0.0 })
    }
}

impl LightSample {
    /// The shadow ray from a surface to this light.
    pub fn ray(&self, at: &Interaction) -> Ray {
        let origin = at.origin(at.raised, self.wi);
        match self.target {
            None => Ray::new(origin, self.wi),
            Some(target) => {
                let towards = target - origin;
                let length = towards.length();
                let ray = Ray::new(origin, towards / length);
                Ray { t_max: length * (1.0 - SHORT), ..ray }
            }
        }
    }
}
