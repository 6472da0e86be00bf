//! Path-traced pictures of one scene with a seed for each round, and the reference that they are compared with.

use super::frame::FrameError;
use raystream::engine::PreparedScene;
use raystream::render::{PathTracer, ROULETTE_BOUNCES, Settings};
use raystream::scene::Camera;
use raystream::schedule::{JobHandle, JobOptions, LimitsError, Policy, Renderer, Service};
use std::sync::Arc;

/// A prepared scene, the service that renders it, and the pictures.
#[derive(Clone, Debug)]
pub struct Pictures<'a> {
    /// The scene with its tree and tracers.
    pub prepared: &'a PreparedScene,
    /// The service; for adaptive pictures it must take two jobs at a time.
    pub service: &'a Service,
    /// Size, samples and depth of the pictures; the seeds of the rounds count from theirs.
    pub settings: Settings,
    /// The camera.
    pub camera: Camera,
    /// Samples per pixel of the reference, which has a seed that no round has.
    pub reference_spp: u32,
    /// Rounds, each with another seed.
    pub rounds: usize,
    /// The scheduling policy; by default the one for the units in use.
    pub policy: Option<Policy>,
}

impl Pictures<'_> {
    /// The path tracer of a round's picture.
    pub(super) fn of_round(&self, round: usize, roulette: Option<u32>) -> Result<PathTracer, FrameError> {
        self.path_tracer(round, self.settings.spp, roulette)
    }

    /// The path tracer of the reference.
    pub(super) fn reference(&self) -> Result<PathTracer, FrameError> {
        self.path_tracer(self.rounds, self.reference_spp, Some(ROULETTE_BOUNCES))
    }

    fn path_tracer(&self, round: usize, spp: u32, roulette: Option<u32>) -> Result<PathTracer, FrameError> {
        let seed = self.settings.seed.wrapping_add(round as u64);
        let settings = self.settings.with_seed(seed).with_spp(spp);
        Ok(PathTracer::new(self.prepared.scene.clone(), &self.camera, settings, roulette)?)
    }

    /// Submits a picture, or a pass of one.
    pub(super) fn submit<R: Renderer + 'static>(&self, renderer: &Arc<R>) -> Result<JobHandle, LimitsError> {
        let options = JobOptions::default().with_policy(self.policy);
        self.service.submit(Arc::clone(renderer), self.prepared.tracers.clone(), options)
    }
}
