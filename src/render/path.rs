//! Path tracing: a hit shader only.

use super::Integrator;
use super::frame::{CAMERA_DIMENSION, Frame, Settings, SettingsError};
use crate::film::Film;
use crate::geom::Sampler;
use crate::scene::{Camera, Material, Scene};
use crate::schedule::{Batch, Output, Renderer};
use crate::shade::bsdf::MIN_ROUGHNESS;
use crate::shade::{Bsdf, Interaction, lookup, sort};
use crate::stream::{Hit, Ray};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use std::sync::Arc;

/// Bounces after which Russian roulette may end a path, unless chosen otherwise.
pub const ROULETTE_BOUNCES: u32 = 3;

/// The most bounces.
const MAX_BOUNCES: u32 = 1 << 10;

/// Greatest chance of surviving a roulette.
const MAX_SURVIVAL: f32 = 0.95;

/// Unidirectional path tracing with next-event estimation: at each hit up to depth `max_bounces` one
/// light and one direction of the BSDF are sampled, weighted against each other by the power
/// heuristic; the ray beyond the last bounce only collects what shines.
#[derive(Debug)]
pub struct Path {
    frame: Frame,
    roulette_bounces: Option<u32>,
}

/// The state of a path.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct PathState {
    /// What radiance along the ray counts for its pixel.
    throughput: [f32; 3],
    /// Squared index of refraction where the ray is, relative to where the path began.
    index2: f32,
    pixel: u32,
    sample: u32,
    depth: u32,
    /// Density per solid angle of the ray's direction; +∞ when no light sample could have found it.
    pdf: f32,
}

/// What an unoccluded shadow ray adds.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Contribution {
    radiance: [f32; 3],
    pixel: u32,
}

/// Sampler dimensions that each depth uses, from [`Dimension::at`] on.
#[derive(Clone, Copy)]
enum Dimension {
    Light = 0,
    LightPoint = 1,
    Lobe = 2,
    Direction = 3,
    Roulette = 4,
}

impl Dimension {
    const COUNT: u32 = 5;

    fn at(self, depth: u32) -> u32 {
        CAMERA_DIMENSION + 1 + depth * Self::COUNT + self as u32
    }
}

impl Path {
    /// A path tracer for one frame. Paths may end by Russian roulette, which does not bias, after
    /// `roulette_bounces` bounces; `None` leaves it out.
    ///
    /// # Errors
    /// When a setting is out of range.
    pub fn new(
        scene: Arc<Scene>,
        camera: &Camera,
        settings: Settings,
        roulette_bounces: Option<u32>,
    ) -> Result<Self, SettingsError> {
        // At each depth one splat of emission and one of a light sample.
        let splats = |max_bounces: u32| 2 * (u64::from(max_bounces) + 2);
        let frame = Frame::new(scene, camera, settings, MAX_BOUNCES, splats)?;
        Ok(Self { frame, roulette_bounces })
    }

    /// Where radiance is added up.
    pub fn film(&self) -> &Arc<Film> {
        self.frame.film()
    }

    /// A ray that left the scene sees the environment.
    fn shade_miss(&self, ray: &Ray, state: &PathState) {
        let lights = self.frame.lights();
        let direction = Vec3::from_array(ray.direction);
        let (radiance, found) = lights.sky(direction);
        if radiance == Vec3::ZERO {
            return;
        }
        let weight = power_heuristic(state.pdf, found);
        self.frame.film().splat(state.pixel, Vec3::from_array(state.throughput) * radiance * weight);
    }

    fn shade_hit(
        &self,
        material: &Material,
        ray: &Ray,
        hit: &Hit,
        state: &PathState,
        out: &mut Output<'_, PathState, Contribution>,
    ) {
        let scene = self.frame.scene();
        let at = Interaction::new(scene, material, ray, hit);
        let throughput = Vec3::from_array(state.throughput);
        let emitted = lookup::emission(scene, material.emission.as_ref(), at.uv, at.front);
        if emitted != Vec3::ZERO {
            let cosine = at.normal.dot(at.wo);
            let found = self.frame.lights().pdf_emitter(hit.primitive, hit.t * hit.t, cosine);
            let weight = power_heuristic(state.pdf, found);
            self.frame.film().splat(state.pixel, throughput * emitted * weight);
        }
        if state.depth > self.frame.settings().max_bounces {
            return;
        }
        let bsdf = Bsdf::new(scene, &material.surface, &at, MIN_ROUGHNESS);
        let sampler = self.frame.sampler(state.pixel, state.sample);
        self.sample_light(&at, &bsdf, state, &sampler, out);
        self.sample_bsdf(&at, &bsdf, state, &sampler, out);
    }

    fn sample_light(
        &self,
        at: &Interaction,
        bsdf: &Bsdf,
        state: &PathState,
        sampler: &Sampler,
        out: &mut Output<'_, PathState, Contribution>,
    ) {
        if bsdf.is_smooth() {
            return;
        }
        let u = sampler.single(Dimension::Light.at(state.depth));
        let u2 = sampler.pair(Dimension::LightPoint.at(state.depth));
        let Some(light) = self.frame.lights().sample(self.frame.scene(), at.raised, u, u2) else { return };
        if light.wi.dot(at.normal) <= 0.0 {
            return;
        }
        let (wo, wi) = (at.frame.to_local(at.wo), at.frame.to_local(light.wi));
        let (value, pdf) = bsdf.evaluate(wo, wi);
        if value == Vec3::ZERO {
            return;
        }
        let weight = if light.delta { 1.0 } else { power_heuristic(light.pdf, pdf) };
        let radiance = Vec3::from_array(state.throughput) * value * light.radiance * (weight / light.pdf);
        out.shadow(light.ray(at), Contribution { radiance: radiance.into(), pixel: state.pixel });
    }

    fn sample_bsdf(
        &self,
        at: &Interaction,
        bsdf: &Bsdf,
        state: &PathState,
        sampler: &Sampler,
        out: &mut Output<'_, PathState, Contribution>,
    ) {
        let u = sampler.single(Dimension::Lobe.at(state.depth));
        let u2 = sampler.pair(Dimension::Direction.at(state.depth));
        let Some(sample) = bsdf.sample(at.frame.to_local(at.wo), u, u2) else { return };
        let wi = if sample.specular {
            at.smooth_direction(sample.wi)
        } else {
            at.frame.to_world(sample.wi).normalize()
        };
        // A bent normal may scatter light into the surface; nothing comes from there.
        if !sample.specular && wi.dot(at.normal) <= 0.0 {
            return;
        }
        let mut throughput = Vec3::from_array(state.throughput) * sample.weight;
        let index2 = state.index2 * sample.eta * sample.eta;
        let depth = state.depth + 1;
        if self.roulette_bounces.is_some_and(|bounces| depth > bounces) {
            let survival = (throughput.max_element() * index2).min(MAX_SURVIVAL);
            if sampler.single(Dimension::Roulette.at(state.depth)) >= survival {
                return;
            }
            throughput /= survival;
        }
        if throughput == Vec3::ZERO {
            return;
        }
        let from = if sample.specular { at.position } else { at.raised };
        let next = PathState {
            throughput: throughput.into(),
            index2,
            depth,
            pdf: if sample.specular { f32::INFINITY } else { sample.pdf },
            ..*state
        };
        out.ray(Ray::new(at.origin(from, wi), wi), next);
    }
}

/// Weight of a sample of density `pdf` beside another technique of density `other` (Veach's power
/// heuristic, exponent 2). An infinite density has weight 1.
fn power_heuristic(pdf: f32, other: f32) -> f32 {
    let ratio = other / pdf;
    1.0 / (1.0 + ratio * ratio)
}

impl Integrator for Path {
    fn frame(&self) -> &Frame {
        &self.frame
    }

    fn on(&self, frame: Frame) -> Self {
        Self { frame, roulette_bounces: self.roulette_bounces }
    }
}

impl Renderer for Path {
    type Payload = PathState;
    type ShadowPayload = Contribution;

    fn tiles(&self) -> u64 {
        self.frame.tiles()
    }

    fn tile_rays(&self) -> usize {
        self.frame.tile_rays()
    }

    fn shadow_rays_per_ray(&self) -> usize {
        1
    }

    fn spawn(&self, tile: u64, out: &mut Output<'_, PathState, Contribution>) {
        self.frame.camera_rays(tile, |ray, pixel, sample| {
            let state =
                PathState { throughput: [1.0; 3], index2: 1.0, pixel, sample, depth: 0, pdf: f32::INFINITY };
            out.ray(ray, state);
        });
    }

    fn shade(&self, batch: Batch<'_, PathState>, out: &mut Output<'_, PathState, Contribution>) {
        let scene = self.frame.scene();
        for run in sort(batch.hits, &scene.mesh.materials).runs() {
            let rays = run.rays.iter().map(|&i| i as usize);
            match run.material {
                None => rays.for_each(|i| self.shade_miss(&batch.rays[i], &batch.payloads[i])),
                Some(material) => {
                    let material = &scene.materials[material as usize];
                    rays.for_each(|i| {
                        self.shade_hit(material, &batch.rays[i], &batch.hits[i], &batch.payloads[i], out);
                    });
                }
            }
        }
    }

    fn shadow(&self, _rays: &[Ray], payloads: &[Contribution], occluded: &[u32]) {
        for (payload, &occluded) in payloads.iter().zip(occluded) {
            if occluded == 0 {
                self.frame.film().splat(payload.pixel, Vec3::from_array(payload.radiance));
            }
        }
    }
}
