//! A node of Whitted's tree of rays: what happens at a hit, whoever sends the rays.

use super::frame::{CAMERA_DIMENSION, Frame};
use crate::geom::Sampler;
use crate::scene::Material;
use crate::shade::single::{self, Bsdf, Interaction, LightSample, Smooth};
use crate::stream::{Hit, Ray};
use glam::Vec3;

/// The most bounces: beyond, the tree of rays of one sample outgrows the film's exact sums.
pub(super) const MAX_BOUNCES: u32 = 16;

/// Scenes with at most this many punctual lights have them all sampled at every hit, others one.
const ALL_PUNCTUAL: usize = 3;

/// The most shadow rays of a hit: the punctual lights' and one to an emissive triangle or the
/// environment.
pub(super) const SHADOW_RAYS: usize = ALL_PUNCTUAL + 1;

/// Glossy reflections of a lesser perceptual roughness are followed like a mirror; rougher ones show
/// direct light only.
const MIRROR_ROUGHNESS: f32 = 0.25;

/// The most splats of a sample: every node of its tree adds what it sees and its direct light.
pub(super) fn splats(max_bounces: u32) -> u64 {
    (SHADOW_RAYS as u64 + 1) << (max_bounces + 1)
}

/// A hit of a ray of the tree.
pub(super) struct Node<'a> {
    frame: &'a Frame,
    at: Interaction,
    bsdf: Bsdf,
    /// Radiance given off towards the ray's origin.
    pub emitted: Vec3,
}

impl<'a> Node<'a> {
    pub fn new(frame: &'a Frame, material: &Material, ray: &Ray, hit: &Hit) -> Self {
        let scene = frame.scene();
        let at = Interaction::new(scene, material, ray, hit);
        let emitted = single::emission(scene, material.emission.as_ref(), at.uv, at.front);
        let bsdf = Bsdf::new(scene, &material.surface, &at, MIRROR_ROUGHNESS);
        Self { frame, at, bsdf, emitted }
    }

    /// Emits the shadow rays of the direct light, each with what it adds if nothing is in between.
    /// `branch` is the node's place in the tree: 1 for the camera ray's, 2n and 2n + 1 for the reflection
    /// and the refraction of node n; it keeps the random numbers of branches apart.
    pub fn direct_light(
        &self,
        sampler: &Sampler,
        branch: u32,
        throughput: Vec3,
        mut emit: impl FnMut(Ray, Vec3),
    ) {
        if self.bsdf.is_smooth() {
            return;
        }
        let (scene, lights, from) = (self.frame.scene(), self.frame.lights(), self.at.raised);
        let mut add = |light: Option<LightSample>| {
            if let Some((ray, radiance)) = light.and_then(|light| self.lit(&light, throughput)) {
                emit(ray, radiance);
            }
        };
        let dimension = CAMERA_DIMENSION + 1 + 2 * branch;
        let (u, u2) = (sampler.single(dimension), sampler.pair(dimension));
        add(LightSample::surface(lights, scene, &self.at.receiver(), u, u2));
        if lights.punctual() <= ALL_PUNCTUAL {
            (0..lights.punctual()).for_each(|index| add(LightSample::of_light(lights, index, from)));
        } else {
            add(LightSample::punctual(lights, from, sampler.single(dimension + 1)));
        }
    }

    /// The shadow ray to a light and the radiance that arrives along it and is sent on.
    fn lit(&self, light: &LightSample, throughput: Vec3) -> Option<(Ray, Vec3)> {
        let at = &self.at;
        if light.wi.dot(at.normal) <= 0.0 {
            return None;
        }
        let (value, _) = self.bsdf.evaluate(at.frame.to_local(at.wo), at.frame.to_local(light.wi));
        (value != Vec3::ZERO).then(|| (light.ray(at), throughput * value * light.radiance / light.pdf))
    }

    /// The directions in which the tree goes on.
    pub fn smooth(&self) -> Smooth {
        self.bsdf.smooth(self.at.frame.to_local(self.at.wo))
    }

    /// The ray of such a direction and what its radiance counts; none if nothing.
    pub fn secondary(&self, way: Option<(Vec3, Vec3)>, throughput: Vec3) -> Option<(Ray, Vec3)> {
        let (wi, weight) = way?;
        let wi = self.at.smooth_direction(wi);
        let throughput = throughput * weight;
        let ray = Ray::new(self.at.origin(self.at.position, wi), wi);
        (throughput != Vec3::ZERO).then_some((ray, throughput))
    }
}
