//! What devices compute of a path tracer's hits before they are shaded.

use super::frame::Frame;
use super::path_state::PathState;
use super::path_tracer::{Dimension, States, light_sample, receiver};
use super::{hits_of, rays_of};
use crate::geom::Sampler;
use crate::lanes::{Int, Lanes, Num, Vector};
use crate::scene::{Asked, Material, Surface};
use crate::schedule::Batch;
use crate::shade::stage::HitSource;
use crate::shade::{Hits, Interaction};

/// The hits of a batch, and what their BSDFs will be asked: random numbers depend on pixel, sample and depth alone.
pub(super) struct PathHits<'a> {
    pub frame: &'a Frame,
    pub batch: &'a Batch<'a, PathState>,
}

impl HitSource for PathHits<'_> {
    const ASKS: bool = true;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn hits<L: Lanes>(&self, ids: Int<L>) -> (Vector<L>, Hits<L>, Num<L>) {
        let hits = hits_of(self.batch, ids);
        let cone = States::of(self.batch.payloads, ids).cone.at(hits.t);
        (rays_of(self.batch, ids).1, hits, cone.width)
    }

    #[inline(always)]
    fn asks(&self, ray: u32) -> bool {
        self.batch.payloads[ray as usize].depth() <= self.frame.settings().max_bounces
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn asked<L: Lanes>(&self, ids: Int<L>, material: &Material, at: &Interaction<L>) -> Option<Asked<L>> {
        let Self { frame, batch } = self;
        let Surface::Scattering(index) = material.surface else { return None };
        let state = States::of(batch.payloads, ids);
        let sampler = Sampler::of(state.pixel, state.sample, frame.settings().seed);
        let wo = at.basis.local(at.wo);
        let mut wi = wo;
        if frame.lights().are_sampled() {
            let surface = &frame.scene().scatterings[index as usize];
            let receiver = receiver(frame, at, || surface.transmits());
            wi = at.basis.local(light_sample(frame, &receiver, &sampler, state.depth).wi);
        }
        let u = sampler.one(Dimension::Lobe.at(state.depth));
        Some(Asked { wo, wi, u, u2: sampler.two(Dimension::Direction.at(state.depth)) })
    }
}
