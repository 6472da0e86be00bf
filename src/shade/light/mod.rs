//! Light sources: emissive triangles, punctual lights and the environment, sampled by power and, where
//! there are many, by what they may give to a point.

mod alias;
mod bounds;
mod emitter_bounds;
mod emitters;
mod environment;
mod punctual;
mod receiver;
#[cfg(test)]
mod tests;
mod tree;

pub use alias::AliasTable;
pub use bounds::LightBounds;
pub use emitter_bounds::EmitterBounds;
pub use emitters::{EmitterSample, Emitters};
pub use environment::EnvironmentLight;
pub use punctual::Punctual;
pub use receiver::Receiver;
pub use tree::LightTree;

use super::Interaction;
use crate::lanes::{Int, Lanes, Mask, Num, Vector};
use crate::scene::Scene;

/// As many lights are as well chosen by power alone: with the eight emissive triangles of a kitchen the tree takes
/// 1.5 % of the noise and costs 4 % of the time.
const FEW: usize = 16;

/// How far short of its end a shadow ray stops, as a share of its length: what rounding may move
/// the far end's own surface by.
const SHORT: f32 = 1.0 / (1u32 << 13) as f32;

/// All light of a scene.
///
/// A light is chosen in two steps: first one of the three kinds, half evenly among those that are
/// there and half by power, so that none starves however its power was misjudged (an environment
/// outside of a closed room); then within the kind: few by power, many emissive triangles or lights at points by a
/// [`LightTree`].
#[derive(Clone, Debug)]
pub struct Lights {
    emitters: Emitters,
    punctual: Punctual,
    environment: EnvironmentLight,
    glow: EmitterBounds,
    /// Power of emissive triangles, of the environment and of punctual lights.
    powers: [f64; 3],
    /// Their chances.
    chances: [f32; 3],
}

/// Light that arrives at points from one direction each, unless something is between.
#[derive(Clone, Copy, Debug)]
pub struct LightSample<L: Lanes> {
    /// Lanes that some light reaches; of the others nothing below counts.
    pub valid: Mask<L>,
    /// Unit direction the light comes from.
    pub wi: Vector<L>,
    /// Where the light is, in the lanes of `near`.
    pub target: Vector<L>,
    /// Lanes whose light is not infinitely far away.
    pub near: Mask<L>,
    /// Radiance; irradiance on a facing surface where `delta`.
    pub radiance: Vector<L>,
    /// Density per solid angle; the chance of choosing the light where `delta`.
    pub pdf: Num<L>,
    /// Lanes whose light no other way of sampling can find.
    pub delta: Mask<L>,
}

impl Lights {
    /// Prepares the lights of a scene.
    pub fn new(scene: &Scene) -> Self {
        let bounds = scene.bounds();
        let radius = bounds.radius();
        let emitters = Emitters::new(scene);
        let punctual = Punctual::new(&scene.lights, radius);
        let environment = EnvironmentLight::new(&scene.environment);
        // The disk of the scene's size, from all sides.
        let disk = std::f64::consts::PI * f64::from(radius).powi(2);
        let sky = f64::from(environment.mean()) * disk * 4.0 * std::f64::consts::PI;
        let powers = [emitters.power(), sky, punctual.power()];
        let glow = EmitterBounds::new(scene, &bounds);
        Self { emitters, punctual, environment, glow, powers, chances: chances(powers) }
    }

    /// The same for integrators that sample the BSDF beside the lights and weight both: an even sky is left
    /// to the BSDF. Sampling it by the BSDF alone leaves nothing to chance but what is in the way, which
    /// no sample of the sky knows either: it would cost a shadow ray and, under an open sky, add noise.
    pub fn without_uniform_sky(self) -> Self {
        let [emitters, sky, punctual] = self.powers;
        let powers = [emitters, if self.environment.is_even() { 0.0 } else { sky }, punctual];
        Self { powers, chances: chances(powers), ..self }
    }

    /// Whether [`Lights::sample`] ever finds any.
    pub fn are_sampled(&self) -> bool {
        self.powers.iter().any(|&power| power > 0.0)
    }

    /// The punctual lights.
    pub fn punctual(&self) -> &Punctual {
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

    /// Where surfaces shine.
    pub fn glow(&self) -> &EmitterBounds {
        &self.glow
    }

    /// Whether there are so many that choosing one takes a number of its own, and looks at the receiver's facing.
    pub fn are_many(&self) -> bool {
        self.emitters.are_many() || self.punctual.are_many()
    }

    /// Samples one light of all: `u` chooses it, `u2` a point or direction of it. Without `u` the first of `u2`
    /// chooses as well, which keeps what `u2` is stratified in, unless the lights [are many](Lights::are_many).
    #[inline(always)]
    pub fn sample<L: Lanes>(
        &self,
        scene: &Scene,
        to: &Receiver<L>,
        u: Option<Num<L>>,
        u2: [Num<L>; 2],
    ) -> LightSample<L> {
        self.sample_kinds(scene, to, u, u2, &self.chances)
    }

    /// As [`Lights::sample`], without the punctual lights.
    #[inline(always)]
    pub fn sample_surfaces<L: Lanes>(
        &self,
        scene: &Scene,
        to: &Receiver<L>,
        u: Num<L>,
        u2: [Num<L>; 2],
    ) -> LightSample<L> {
        let [emitter, sky, _] = self.chances;
        let sum = emitter + sky;
        if sum <= 0.0 {
            return LightSample::none(to.position);
        }
        self.sample_kinds(scene, to, Some(u), u2, &[emitter / sum, sky / sum, 0.0])
    }

    /// Samples one punctual light.
    #[inline(always)]
    pub fn sample_punctual<L: Lanes>(&self, to: &Receiver<L>, u: Num<L>) -> LightSample<L> {
        let Some((index, chance)) = self.punctual.choose(to, u) else {
            return LightSample::none(to.position);
        };
        let light = self.punctual.illuminate(index, to.position);
        LightSample { valid: light.valid & chance.above(0.0), pdf: chance, ..light }
    }

    /// The light of punctual light `index` at points.
    #[inline(always)]
    pub fn illuminate<L: Lanes>(&self, index: usize, from: Vector<L>) -> LightSample<L> {
        self.punctual.illuminate(Int::splat(from.lanes(), index as u32), from)
    }

    #[inline(always)]
    fn sample_kinds<L: Lanes>(
        &self,
        scene: &Scene,
        to: &Receiver<L>,
        number: Option<Num<L>>,
        mut u2: [Num<L>; 2],
        chances: &[f32; 3],
    ) -> LightSample<L> {
        let from = to.position;
        let l = from.lanes();
        let [emitter, sky, point] = *chances;
        let (mut u, mut chance) = (number.unwrap_or(u2[0]), Num::splat(l, 1.0));
        let emits = u.below(emitter);
        let shines = u.below(emitter + sky) & !emits;
        let points = !(emits | shines);
        if !chances.contains(&1.0) {
            let low = Num::select(emits, Num::splat(l, 0.0), Num::splat(l, emitter));
            let low = Num::select(points, Num::splat(l, emitter + sky), low);
            chance = Num::select(emits, Num::splat(l, emitter), Num::splat(l, sky));
            chance = Num::select(points, Num::splat(l, point), chance);
            // Below 1 even after rounding.
            u = ((u - low) / chance).clamp(0.0, 1.0 - f32::EPSILON);
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
        sample.pdf *= chance;
        sample
    }

    /// Density per solid angle with which [`Lights::sample`] finds a point of a triangle for a receiver,
    /// seen from a squared distance under a cosine to its normal; 0 when it is no emitter.
    #[inline(always)]
    pub fn pdf_emitter<L: Lanes>(
        &self,
        to: &Receiver<L>,
        primitive: Int<L>,
        distance2: Num<L>,
        cosine: Num<L>,
    ) -> Num<L> {
        self.emitters.pdf(to, primitive, distance2, cosine) * self.chances[0]
    }

    /// Radiance of the environment along unit directions that leave the scene, and the density per
    /// solid angle with which [`Lights::sample`] finds these directions.
    #[inline(always)]
    pub fn sky<L: Lanes>(&self, direction: Vector<L>) -> (Vector<L>, Num<L>) {
        let [_, chance, _] = self.chances;
        let (radiance, pdf) = self.environment.look(direction);
        (radiance, if chance > 0.0 { pdf * chance } else { Num::zero(pdf.lanes()) })
    }
}

/// Half evenly among those that are there, half by power.
fn chances<const N: usize>(powers: [f64; N]) -> [f32; N] {
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

    /// The shadow rays from surfaces to these lights: where they start, their direction, and how far they go. To lights
    /// that are near the direction is as long as the way: such a ray needs no unit.
    #[inline(always)]
    pub fn rays(&self, at: &Interaction<L>) -> (Vector<L>, Vector<L>, Num<L>) {
        let origin = at.scattered_origin(self.wi);
        let direction = Vector::select(self.near, self.target - origin, self.wi);
        let (far, whole) =
            (Num::splat(origin.lanes(), f32::INFINITY), Num::splat(origin.lanes(), 1.0 - SHORT));
        (origin, direction, Num::select(self.near, whole, far))
    }
}
