//! A renderer whose batches are single rays.

use crate::schedule::{Batch, Output, Renderer, SceneId, SeeThrough};
use crate::stream::Ray;
use std::sync::Arc;

/// The same renderer, shading ray by ray, to measure what batches gain (RA section 5, RA SINGLERAY).
#[derive(Debug)]
pub struct RayByRay<R>(pub Arc<R>);

impl<R: Renderer> Renderer for RayByRay<R> {
    type Payload = R::Payload;
    type ShadowPayload = R::ShadowPayload;

    fn tiles(&self) -> u64 {
        self.0.tiles()
    }

    fn tile_rays(&self) -> usize {
        self.0.tile_rays()
    }

    fn shadow_rays_per_ray(&self) -> usize {
        self.0.shadow_rays_per_ray()
    }

    fn most_in_flight(&self) -> usize {
        self.0.most_in_flight()
    }

    fn spawn(&self, tile: u64, out: &mut Output<'_, R::Payload, R::ShadowPayload>) {
        self.0.spawn(tile, out);
    }

    fn shade(&self, batch: Batch<'_, R::Payload>, out: &mut Output<'_, R::Payload, R::ShadowPayload>) {
        for i in 0..batch.rays.len() {
            let (rays, hits, payloads) = (&batch.rays[i..=i], &batch.hits[i..=i], &batch.payloads[i..=i]);
            self.0.shade(Batch { rays, hits, payloads }, out);
        }
    }

    fn scene_id(&self) -> Option<SceneId> {
        self.0.scene_id()
    }

    #[inline]
    fn depth(&self, payload: &R::Payload) -> u32 {
        self.0.depth(payload)
    }

    fn warnings(&self) -> Vec<String> {
        self.0.warnings()
    }

    fn passing(&self, batch: &Batch<'_, R::Payload>) -> Vec<u32> {
        self.0.passing(batch)
    }

    fn see_through(&self) -> Option<&dyn SeeThrough> {
        self.0.see_through()
    }

    fn shadow(&self, rays: &[Ray], payloads: &[R::ShadowPayload], occluded: &[u32]) {
        self.0.shadow(rays, payloads, occluded);
    }
}
