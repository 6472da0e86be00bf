//! A node of Whitted's tree of rays: the shading of a hit, shared by the loop shader and the recursive one.

use super::NewRays;
use super::frame::{CAMERA_DIMENSION, Frame};
use crate::geom::Sampler;
use crate::lanes::{Int, Lanes, Mask, Num, SingleLane, Vector};
use crate::scene::{BlockFinishes, Material};
use crate::shade::bsdf::{Smooth, Smoothness};
use crate::shade::light::Receiver;
use crate::shade::{Bsdf, Cone, Hits, Interaction, LightSample, lookup, medium};
use crate::stream::Ray;
use glam::Vec3;

/// Maximum number of bounces. More would let a sample's tree of rays exceed the film's exact sums.
pub(super) const MAX_BOUNCES: u32 = 16;

/// Up to this many punctual lights are all sampled at every hit; of more, one is chosen.
const ALL_PUNCTUAL: usize = 3;

/// Maximum shadow rays of a hit: one to each punctual light, and one to an emissive triangle or the environment.
pub(super) const SHADOW_RAYS: usize = ALL_PUNCTUAL + 1;

/// Glossy reflections below this perceptual roughness are followed as mirrors; rougher ones show direct light only.
/// Transparent bodies are clear.
const SMOOTHNESS: Smoothness = Smoothness::followed(0.25);

/// Maximum splats of a sample: every node of its tree adds emission and direct light.
pub(super) fn splats(max_bounces: u32) -> u64 {
    (SHADOW_RAYS as u64 + 1) << (max_bounces + 1)
}

/// Hits of rays of the tree on one material.
pub(super) struct Node<'a, L: Lanes> {
    frame: &'a Frame,
    at: Interaction<L>,
    bsdf: Bsdf<'a, L>,
    /// Transmittance of the medium between the hit and the ray's origin.
    left: Option<Vector<L>>,
    /// Emitted radiance towards the ray's origin.
    pub emitted: Vector<L>,
}

/// Rays that a node emits.
#[derive(Clone, Copy)]
pub(super) struct Sent<L: Lanes> {
    /// Lanes that emit a ray.
    pub lanes: Mask<L>,
    pub origin: Vector<L>,
    pub direction: Vector<L>,
    pub t_max: Num<L>,
    /// Weight of the radiance along the ray; for shadow rays, the weighted radiance itself.
    pub radiance: Vector<L>,
}

impl<'a, L: Lanes> Node<'a, L> {
    /// `cone` is the rays' cone at their origins; `finishes` are those of a block.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn new(
        frame: &'a Frame,
        material: &Material,
        direction: Vector<L>,
        hits: &Hits<L>,
        cone: Cone<L>,
        finishes: Option<BlockFinishes<'_>>,
    ) -> Self {
        let scene = frame.scene();
        let width = cone.at(hits.t).width;
        let mut at = Interaction::without_finish(scene, material, direction, hits, width);
        at.set_finish(scene, material, finishes);
        let mut emitted = match &material.emission {
            None => Vector::zero(direction.lanes()),
            Some(emission) => lookup::emission(scene, emission, &at.texture, at.front),
        };
        if let Some(computed) = at.computed_emission(scene, material) {
            emitted += computed;
        }
        let bsdf = Bsdf::new(scene, &material.surface, &at, SMOOTHNESS);
        let mut left = None;
        if let Some(medium) = &material.medium {
            let share = medium::passed(medium, &at, hits.t);
            emitted = emitted * share;
            left = Some(share);
        }
        Self { frame, at, bsdf, left, emitted }
    }

    /// The weight of light from here at the ray's origin, given the weight there.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn dimmed(&self, throughput: Vector<L>) -> Vector<L> {
        match self.left {
            None => throughput,
            Some(left) => throughput * left,
        }
    }

    /// Number of lights that are sampled for direct light.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn lights(&self) -> usize {
        match self.frame.lights().punctual().len() {
            _ if self.bsdf.is_smooth() => 0,
            few @ 0..=ALL_PUNCTUAL => 1 + few,
            _ => 2,
        }
    }

    /// The shadow rays to one of [`Node::lights`]. `branch` is the node's position in the tree: 1 for the camera ray's,
    /// 2n and 2n + 1 for the reflection and the refraction of node n. It selects the branch's random numbers.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn lit(&self, light: usize, sampler: &Sampler<L>, branch: Int<L>, throughput: Vector<L>) -> Sent<L> {
        let (at, lights) = (&self.at, self.frame.lights());
        let dimension = branch * 2 + (CAMERA_DIMENSION + 1);
        let light: LightSample<L> = if light == 0 {
            let (u, u2) = (sampler.one(dimension), sampler.two(dimension));
            lights.sample_surfaces(self.frame.scene(), &Receiver::of(at), u, u2)
        } else if lights.punctual().len() <= ALL_PUNCTUAL {
            lights.illuminate(light - 1, at.raised)
        } else {
            lights.sample_punctual(&Receiver::of(at), sampler.one(dimension + 1))
        };
        let (value, _) = self.bsdf.evaluate(at.basis.local(at.wo), at.basis.local(light.wi));
        let (origin, direction, t_max) = light.rays(at);
        Sent {
            lanes: light.valid & at.is_above(light.wi) & !value.is_zero(),
            origin,
            direction,
            t_max,
            radiance: self.dimmed(throughput) * value * light.radiance / light.pdf,
        }
    }

    /// The reflected and the refracted rays.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn secondary(&self, throughput: Vector<L>) -> [Sent<L>; 2] {
        let Smooth { reflected, reflection, transmitted, transmission, .. } =
            self.bsdf.smooth(self.at.basis.local(self.at.wo));
        let throughput = self.dimmed(throughput);
        let l = throughput.lanes();
        [
            self.way(reflected, Mask::splat(l, false), throughput * reflection),
            self.way(transmitted, Mask::splat(l, true), throughput * transmission),
        ]
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn way(&self, local: Vector<L>, crosses: Mask<L>, throughput: Vector<L>) -> Sent<L> {
        let direction = self.at.smooth_direction(local, crosses);
        Sent {
            lanes: !throughput.is_zero(),
            origin: self.at.origin(self.at.position, direction),
            direction,
            t_max: Num::splat(direction.lanes(), f32::INFINITY),
            radiance: throughput,
        }
    }
}

impl<L: Lanes> Sent<L> {
    /// The rays of all lanes.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn rays(&self) -> NewRays<L> {
        NewRays { origin: self.origin, direction: self.direction, t_max: self.t_max }
    }
}

impl Sent<SingleLane> {
    /// Ray and weight of a single lane; `None` if it emits none.
    pub fn one(self) -> Option<(Ray, Vec3)> {
        let (origin, direction) = (Vec3::from(self.origin), Vec3::from(self.direction));
        let ray = Ray { t_max: self.t_max.get(), ..Ray::new(origin, direction) };
        self.lanes.get().then(|| (ray, self.radiance.into()))
    }
}
