//! Drives a renderer without a scheduler, one tile after the other, and traces by brute force: the
//! plainest thing that keeps the renderer's contract.

use crate::geom::CanonicalRay;
use crate::scene::Scene;
use crate::schedule::{Batch, Output, Renderer};
use crate::stream::{Hit, Ray};

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

/// The nearest hit, canonically.
pub fn closest(scene: &Scene, ray: &Ray) -> Hit {
    let reach = scene.bounds().max_abs();
    let mut best = Hit::NONE;
    let mut canonical = CanonicalRay::new(ray.origin, ray.t_min, ray.direction, ray.t_max, reach);
    for primitive in 0..scene.mesh.triangles.len() as u32 {
        let [a, b, c] = scene.mesh.corners(primitive);
        if let Some(hit) = canonical.triangle(a, b, c)
            && hit.t < best.t
        {
            best = Hit { t: hit.t, u: hit.u, v: hit.v, primitive };
            canonical.t_max = hit.t;
        }
    }
    best
}

/// Renders all tiles with batches of at most `batch` rays.
pub fn render<R: Renderer>(renderer: &R, batch: usize, trace: impl Fn(&Ray) -> Hit) -> Counts {
    let mut counts = Counts::default();
    for tile in 0..renderer.tiles() {
        let (mut rays, mut payloads) = (Vec::new(), Vec::new());
        let (mut shadow_rays, mut shadow_payloads) = (Vec::new(), Vec::new());
        renderer.spawn(
            tile,
            &mut Output {
                rays: &mut rays,
                payloads: &mut payloads,
                shadow_rays: &mut shadow_rays,
                shadow_payloads: &mut shadow_payloads,
            },
        );
        assert!(rays.len() <= renderer.tile_rays() && shadow_rays.len() <= renderer.tile_rays());
        counts.camera += rays.len() as u64;
        while !rays.is_empty() {
            let occluded: Vec<u32> = shadow_rays.iter().map(|ray| u32::from(!trace(ray).is_miss())).collect();
            renderer.shadow(&shadow_rays, &shadow_payloads, &occluded);
            counts.shadow += shadow_rays.len() as u64;
            shadow_rays.clear();
            shadow_payloads.clear();
            let hits: Vec<Hit> = rays.iter().map(&trace).collect();
            let (mut next, mut next_payloads) = (Vec::new(), Vec::new());
            for start in (0..rays.len()).step_by(batch) {
                let part = start..(start + batch).min(rays.len());
                let (before, shadows_before) = (next.len(), shadow_rays.len());
                renderer.shade(
                    Batch {
                        rays: &rays[part.clone()],
                        hits: &hits[part.clone()],
                        payloads: &payloads[part.clone()],
                    },
                    &mut Output {
                        rays: &mut next,
                        payloads: &mut next_payloads,
                        shadow_rays: &mut shadow_rays,
                        shadow_payloads: &mut shadow_payloads,
                    },
                );
                assert!(next.len() - before <= part.len());
                assert!(shadow_rays.len() - shadows_before <= part.len() * renderer.shadow_rays_per_ray());
            }
            (rays, payloads) = (next, next_payloads);
            counts.continuation += rays.len() as u64;
        }
        let occluded: Vec<u32> = shadow_rays.iter().map(|ray| u32::from(!trace(ray).is_miss())).collect();
        renderer.shadow(&shadow_rays, &shadow_payloads, &occluded);
        counts.shadow += shadow_rays.len() as u64;
    }
    counts
}
