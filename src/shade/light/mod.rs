//! Light sources: emissive triangles, punctual lights and the environment. Lights are sampled by power. Where
//! there are many, they are sampled by the light that each may contribute at a point.

mod alias;
mod bounds;
mod emitters;
mod environment;
mod lit_scene;
mod punctual;
mod receiver;
mod reflectors;
#[cfg(test)]
mod tests;
mod tree;

pub use alias::AliasTable;
pub use bounds::LightBounds;
pub use emitters::{EmitterSample, Emitters};
pub use environment::EnvironmentLight;
pub use lit_scene::LitScene;
pub use punctual::Punctual;
pub use receiver::Receiver;
pub use reflectors::{ReflectedSample, Reflection, Reflectors};
pub use tree::LightTree;

use super::{Interaction, SurfaceBounds, sought_materials};
use crate::geom::Aabb;
use crate::lanes::{Int, Lanes, Mask, Num, OutlinedTask, Vector};
use crate::scene::{Emission, Material, Scene, Surface};
use glam::Vec3;
use std::sync::Arc;

/// Up to this many lights, sampling by power alone is good enough. With the eight emissive triangles of a
/// kitchen, the light tree removes 1.5 % of the noise and costs 4 % of the time.
const FEW: usize = 16;

/// A shadow ray ends short of its light by this share of its length. Rounding may move the surface of the
/// light by that much.
const SHADOW_MARGIN: f32 = 1.0 / (1u32 << 13) as f32;

/// True if a material emits light. Rays that will not be continued must reach it.
fn shines(scene: &Scene, material: &Material) -> bool {
    let emits = |emission: &Emission| emission.radiance.factor != Vec3::ZERO;
    let computes = match material.surface {
        Surface::Procedural(index) => scene.procedurals[index as usize].effects().emits(),
        _ => false,
    };
    computes || material.emission.as_ref().is_some_and(emits)
}

/// Bounds of all surfaces that emit light, of those too that light sampling leaves out.
fn emitter_bounds(scene: &Scene, bounds: &Aabb) -> SurfaceBounds {
    SurfaceBounds::new(scene, bounds, &sought_materials(scene, |material| shines(scene, material)))
}

/// All lights of a scene.
///
/// A light is chosen in two steps. The first chooses one of the three kinds, half uniformly among the kinds
/// that exist and half by power. So each kind gets samples even if its power was misjudged, as that of an
/// environment outside of a closed room. The second chooses a light of that kind: among few by power, among
/// many emissive triangles or point and spot lights by a [`LightTree`].
#[derive(Clone, Debug)]
pub struct Lights {
    /// Bounds of the scene.
    bounds: Aabb,
    emitters: Arc<Emitters>,
    punctual: Arc<Punctual>,
    environment: Arc<EnvironmentLight>,
    emitter_bounds: Arc<SurfaceBounds>,
    /// Power of the emissive triangles, the environment and the punctual lights.
    powers: [f64; 3],
    /// Probabilities of choosing these kinds.
    probabilities: [f32; 3],
    /// True if [`Lights::without_uniform_sky`] was called.
    skips_uniform_sky: bool,
}

/// Light that arrives at points from one direction each, if nothing occludes it.
#[derive(Clone, Copy, Debug)]
pub struct LightSample<L: Lanes> {
    /// Lanes that some light reaches; the other fields mean nothing in the other lanes.
    pub valid: Mask<L>,
    /// Unit direction towards the light.
    pub wi: Vector<L>,
    /// Position of the light; meaningful in the lanes of `near`.
    pub target: Vector<L>,
    /// Lanes whose light is at a finite distance.
    pub near: Mask<L>,
    /// Radiance; where `delta`, irradiance on a surface that faces the light.
    pub radiance: Vector<L>,
    /// Density per solid angle; where `delta`, the probability of choosing the light.
    pub pdf: Num<L>,
    /// Lanes whose light only light sampling can find.
    pub delta: Mask<L>,
}

impl Lights {
    /// Prepares the lights of a scene.
    pub fn new(scene: &Scene) -> Self {
        Self::under(scene, Arc::new(EnvironmentLight::new(&scene.environment)))
    }

    /// Prepares the lights of a scene beside its environment.
    fn under(scene: &Scene, environment: Arc<EnvironmentLight>) -> Self {
        let bounds = scene.bounds();
        let emitters = Arc::new(Emitters::new(scene));
        let punctual = Arc::new(Punctual::new(&scene.lights, bounds.radius()));
        let emitter_bounds = Arc::new(emitter_bounds(scene, &bounds));
        Self::of_parts(bounds, emitters, punctual, environment, emitter_bounds)
    }

    fn of_parts(
        bounds: Aabb,
        emitters: Arc<Emitters>,
        punctual: Arc<Punctual>,
        environment: Arc<EnvironmentLight>,
        emitter_bounds: Arc<SurfaceBounds>,
    ) -> Self {
        // A disk of the scene's size, lit from all sides.
        let disk = std::f64::consts::PI * f64::from(bounds.radius()).powi(2);
        let sky = f64::from(environment.mean()) * disk * 4.0 * std::f64::consts::PI;
        let powers = [emitters.power(), sky, punctual.power()];
        let probabilities = probabilities(powers);
        let skips_uniform_sky = false;
        Self {
            bounds,
            emitters,
            punctual,
            environment,
            emitter_bounds,
            powers,
            probabilities,
            skips_uniform_sky,
        }
    }

    /// The same lights for integrators that combine BSDF and light sampling by MIS: a uniform environment is
    /// sampled by the BSDF alone. The BSDF's direction then leaves nothing to chance but occlusion. A
    /// sample of the environment does not know the occlusion either. It would cost a shadow ray and, under an
    /// open sky, add noise.
    pub fn without_uniform_sky(self) -> Self {
        let [emitters, sky, punctual] = self.powers;
        let powers = [emitters, if self.environment.is_even() { 0.0 } else { sky }, punctual];
        Self { powers, probabilities: probabilities(powers), skips_uniform_sky: true, ..self }
    }

    /// True if [`Lights::sample`] can return any light.
    #[inline]
    pub fn are_sampled(&self) -> bool {
        self.powers.iter().any(|&power| power > 0.0)
    }

    /// The punctual lights.
    #[inline]
    pub fn punctual(&self) -> &Punctual {
        &self.punctual
    }

    /// The emissive triangles.
    pub fn emitters(&self) -> &Emitters {
        &self.emitters
    }

    /// The environment.
    #[inline]
    pub fn environment(&self) -> &EnvironmentLight {
        &self.environment
    }

    /// Bounds of all emissive surfaces.
    #[inline]
    pub fn emitter_bounds(&self) -> &SurfaceBounds {
        &self.emitter_bounds
    }

    /// True if there are so many lights that a light tree chooses among them. The choice then takes a random
    /// number of its own and depends on the receiver's normal.
    #[inline]
    pub fn are_many(&self) -> bool {
        self.emitters.are_many() || self.punctual.are_many()
    }

    /// Samples one of all lights. `u` chooses the light, `u2` a point or direction on it. If `u` is `None`,
    /// the first number of `u2` also chooses the light; this keeps the stratification of `u2`. Pass `u` if
    /// the lights [are many](Lights::are_many).
    #[inline(always)]
    pub fn sample<L: Lanes>(
        &self,
        scene: &Scene,
        to: &Receiver<L>,
        u: Option<Num<L>>,
        u2: [Num<L>; 2],
    ) -> LightSample<L> {
        self.sample_kinds(scene, to, u, u2, &self.probabilities)
    }

    /// Like [`Lights::sample`], without the punctual lights.
    #[inline(always)]
    pub fn sample_surfaces<L: Lanes>(
        &self,
        scene: &Scene,
        to: &Receiver<L>,
        u: Num<L>,
        u2: [Num<L>; 2],
    ) -> LightSample<L> {
        let [emitter, sky, _] = self.probabilities;
        let sum = emitter + sky;
        if sum <= 0.0 {
            return LightSample::none(to.position);
        }
        self.sample_kinds(scene, to, Some(u), u2, &[emitter / sum, sky / sum, 0.0])
    }

    /// Samples one punctual light.
    #[inline(always)]
    pub fn sample_punctual<L: Lanes>(&self, to: &Receiver<L>, u: Num<L>) -> LightSample<L> {
        u.lanes().outlined(PunctualSample { punctual: &self.punctual, receiver: *to, u })
    }

    /// The light that punctual light `index` sends to points.
    #[inline(always)]
    pub fn illuminate<L: Lanes>(&self, index: usize, from: Vector<L>) -> LightSample<L> {
        let index = Int::splat(from.lanes(), index as u32);
        from.lanes().outlined(Illumination { punctual: &self.punctual, index, from })
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn sample_kinds<L: Lanes>(
        &self,
        scene: &Scene,
        to: &Receiver<L>,
        number: Option<Num<L>>,
        mut u2: [Num<L>; 2],
        probabilities: &[f32; 3],
    ) -> LightSample<L> {
        let from = to.position;
        let l = from.lanes();
        let [emitter, sky, point] = *probabilities;
        let (mut u, mut probability) = (number.unwrap_or(u2[0]), Num::splat(l, 1.0));
        let emits = u.below(emitter);
        let shines = u.below(emitter + sky) & !emits;
        let points = !(emits | shines);
        if !probabilities.contains(&1.0) {
            let low = Num::select(emits, Num::splat(l, 0.0), Num::splat(l, emitter));
            let low = Num::select(points, Num::splat(l, emitter + sky), low);
            probability = Num::select(emits, Num::splat(l, emitter), Num::splat(l, sky));
            probability = Num::select(points, Num::splat(l, point), probability);
            // The result stays below 1 after rounding.
            u = ((u - low) / probability).clamp(0.0, 1.0 - f32::EPSILON);
        }
        let number = match number {
            Some(_) => Some(u),
            None => {
                u2[0] = u;
                None
            }
        };
        let mut sample = LightSample::none(from);
        if emits.any()
            && let Some(on) = self.emitters.sample(scene, to, number, u2)
        {
            sample = LightSample {
                valid: on.valid & emits,
                wi: on.wi,
                target: on.position,
                near: emits,
                radiance: on.radiance,
                pdf: on.pdf,
                delta: Mask::splat(l, false),
            };
        }
        if shines.any() {
            let (wi, radiance, pdf) = self.environment.sample(u2);
            sample.valid |= pdf.above(0.0) & shines;
            sample.wi = Vector::select(shines, wi, sample.wi);
            sample.radiance = Vector::select(shines, radiance, sample.radiance);
            sample.pdf = Num::select(shines, pdf, sample.pdf);
        }
        if points.any() && point > 0.0 {
            let light = self.sample_punctual(to, u);
            sample = LightSample {
                valid: Mask::select(points, light.valid, sample.valid),
                wi: Vector::select(points, light.wi, sample.wi),
                target: Vector::select(points, light.target, sample.target),
                near: Mask::select(points, light.near, sample.near),
                radiance: Vector::select(points, light.radiance, sample.radiance),
                pdf: Num::select(points, light.pdf, sample.pdf),
                delta: points,
            };
        }
        sample.pdf *= probability;
        sample
    }

    /// Density per solid angle with which [`Lights::sample`] returns a point of a triangle to a receiver.
    /// `distance2` is the squared distance, `cosine` the cosine to the triangle's normal. 0 if the triangle
    /// emits nothing.
    #[inline(always)]
    pub fn pdf_emitter<L: Lanes>(
        &self,
        to: &Receiver<L>,
        primitive: Int<L>,
        distance2: Num<L>,
        cosine: Num<L>,
    ) -> Num<L> {
        let emitters = &self.emitters;
        let pdf = EmitterPdf { emitters, receiver: *to, primitive, distance2, cosine };
        cosine.lanes().outlined(pdf) * self.probabilities[0]
    }

    /// Radiance of the environment along unit directions that leave the scene, and the density per solid
    /// angle with which [`Lights::sample`] returns these directions.
    #[inline(always)]
    pub fn sky<L: Lanes>(&self, direction: Vector<L>) -> (Vector<L>, Num<L>) {
        let [_, probability, _] = self.probabilities;
        let (radiance, pdf) = self.environment.evaluate(direction);
        (radiance, if probability > 0.0 { pdf * probability } else { Num::zero(pdf.lanes()) })
    }
}

/// [`Lights::sample_punctual`], out of line: many scenes have no such lights.
struct PunctualSample<'a, L: Lanes> {
    punctual: &'a Punctual,
    receiver: Receiver<L>,
    u: Num<L>,
}

impl<L: Lanes> OutlinedTask<L> for PunctualSample<'_, L> {
    type Output = LightSample<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> LightSample<L> {
        let Self { punctual, receiver, u } = self;
        let Some((index, probability)) = punctual.choose(&receiver, u) else {
            return LightSample::none(receiver.position);
        };
        let light = punctual.illuminate(index, receiver.position);
        LightSample { valid: light.valid & probability.above(0.0), pdf: probability, ..light }
    }
}

/// [`Punctual::illuminate`], out of line.
struct Illumination<'a, L: Lanes> {
    punctual: &'a Punctual,
    index: Int<L>,
    from: Vector<L>,
}

impl<L: Lanes> OutlinedTask<L> for Illumination<'_, L> {
    type Output = LightSample<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> LightSample<L> {
        self.punctual.illuminate(self.index, self.from)
    }
}

/// [`Emitters::pdf`], out of line: few hits are on emitters.
struct EmitterPdf<'a, L: Lanes> {
    emitters: &'a Emitters,
    receiver: Receiver<L>,
    primitive: Int<L>,
    distance2: Num<L>,
    cosine: Num<L>,
}

impl<L: Lanes> OutlinedTask<L> for EmitterPdf<'_, L> {
    type Output = Num<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> Num<L> {
        self.emitters.pdf(&self.receiver, self.primitive, self.distance2, self.cosine)
    }
}

/// Probabilities: half uniform among those of nonzero power, half by power.
fn probabilities<const N: usize>(powers: [f64; N]) -> [f32; N] {
    let total: f64 = powers.iter().sum();
    let present = powers.iter().filter(|&&p| p > 0.0).count() as f64;
    powers.map(|power| if power > 0.0 { (0.5 / present + 0.5 * power / total) as f32 } else { 0.0 })
}

impl<L: Lanes> LightSample<L> {
    #[inline(always)]
    fn none(from: Vector<L>) -> Self {
        let zero = Vector::zero(from.lanes());
        let pdf = Num::splat(from.lanes(), 1.0);
        let none = Mask::splat(from.lanes(), false);
        Self { valid: none, wi: zero, target: zero, near: none, radiance: zero, pdf, delta: none }
    }

    /// The shadow rays from surfaces to these lights: origins, directions and lengths. The direction to a
    /// light at a finite distance is as long as the distance, so the ray needs no unit direction.
    #[inline(always)]
    pub fn rays(&self, at: &Interaction<L>) -> (Vector<L>, Vector<L>, Num<L>) {
        let origin = at.scattered_origin(self.wi);
        let direction = Vector::select(self.near, self.target - origin, self.wi);
        let (far, whole) =
            (Num::splat(origin.lanes(), f32::INFINITY), Num::splat(origin.lanes(), 1.0 - SHADOW_MARGIN));
        (origin, direction, Num::select(self.near, whole, far))
    }
}
