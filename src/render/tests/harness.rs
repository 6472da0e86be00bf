//! Drives a renderer without a scheduler, one tile after the other: the plainest thing that keeps the
//! renderer's contract.

use crate::bvh::{Bvh, Filter};
use crate::scene::Scene;
use crate::schedule::{Output, Renderer, pass_or_shade, trace_on};
use crate::stream::{Hit, Ray, RayArray, TracedRays, Tracer};
use crate::trace::cpu::{CpuTracer, SimdLevel};
use std::sync::Arc;

/// Rays counted while rendering.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Rays from [`Renderer::spawn`].
    pub camera: u64,
    /// Rays from [`Renderer::shade`].
    pub continuation: u64,
    /// Shadow rays.
    pub shadow: u64,
}

/// A tracer for a scene.
pub fn tracer(scene: &Scene) -> CpuTracer {
    let mesh = &scene.mesh;
    let is_masked = |triangle| scene.is_masked(triangle);
    let bvh = Arc::new(Bvh::build(&mesh.positions, &mesh.triangles, is_masked));
    let filter = scene.masked_materials().contains(&true).then(|| Arc::new(scene.clone()) as Arc<dyn Filter>);
    CpuTracer::new(bvh, filter, SimdLevel::detect()).expect("the detected level is available")
}

/// Renders all tiles with batches of at most `batch` rays.
pub fn render<R: Renderer>(renderer: &R, batch: usize, tracer: &dyn Tracer) -> Counts {
    let mut counts = Counts::default();
    for tile in 0..renderer.tiles() {
        let (mut rays, mut payloads) = (Vec::new(), Vec::new());
        let (mut shadow_rays, mut shadow_payloads) = (Vec::new(), Vec::new());
        spawn(renderer, tile, &mut rays, &mut payloads);
        counts.camera += rays.len() as u64;
        while !rays.is_empty() {
            occlude(renderer, tracer, &mut shadow_rays, &mut shadow_payloads, &mut counts);
            let mut hits = vec![Hit::NONE; rays.len()];
            tracer.closest(&rays, &mut hits);
            let (mut next, mut next_payloads) = (Vec::new(), Vec::new());
            for start in (0..rays.len()).step_by(batch) {
                let part = start..(start + batch).min(rays.len());
                // Panics if the renderer emits more than it promised.
                let mut new_rays = RayArray::with_capacity(part.len());
                let mut new_shadow_rays =
                    RayArray::with_capacity(part.len() * renderer.shadow_rays_per_ray());
                pass_or_shade(
                    renderer,
                    TracedRays {
                        rays: &mut rays[part.clone()],
                        hits: &mut hits[part.clone()],
                        payloads: &mut payloads[part.clone()],
                    },
                    &mut Output {
                        rays: new_rays.appender(),
                        payloads: &mut next_payloads,
                        shadow_rays: new_shadow_rays.appender(),
                        shadow_payloads: &mut shadow_payloads,
                    },
                );
                next.extend_from_slice(&new_rays);
                shadow_rays.extend_from_slice(&new_shadow_rays);
            }
            (rays, payloads) = (next, next_payloads);
            counts.continuation += rays.len() as u64;
        }
        occlude(renderer, tracer, &mut shadow_rays, &mut shadow_payloads, &mut counts);
    }
    counts
}

/// Spawns one tile of a renderer whose camera rays come without shadow rays.
pub fn spawn<R: Renderer>(renderer: &R, tile: u64, rays: &mut Vec<Ray>, payloads: &mut Vec<R::Payload>) {
    let (mut column, mut shadow_rays) = (RayArray::with_capacity(renderer.tile_rays()), RayArray::default());
    let mut shadow_payloads = Vec::new();
    let appenders = (column.appender(), shadow_rays.appender());
    renderer.spawn(
        tile,
        &mut Output {
            rays: appenders.0,
            payloads,
            shadow_rays: appenders.1,
            shadow_payloads: &mut shadow_payloads,
        },
    );
    rays.extend_from_slice(&column);
}

fn occlude<R: Renderer>(
    renderer: &R,
    tracer: &dyn Tracer,
    rays: &mut Vec<Ray>,
    payloads: &mut Vec<R::ShadowPayload>,
    counts: &mut Counts,
) {
    let mut occluded = vec![0; rays.len()];
    tracer.occluded(rays, &mut occluded);
    if let Some(surfaces) = renderer.see_through() {
        trace_on(surfaces, tracer, rays, &mut occluded);
    }
    renderer.shadow(rays, payloads, &occluded);
    counts.shadow += rays.len() as u64;
    rays.clear();
    payloads.clear();
}
