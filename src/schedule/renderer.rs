//! What a job runs (RA section 3.1): spawns camera rays, shades batches.

use super::{AnyRenderer, RayCounts, SceneId, rows};
use crate::stream::{Hit, Ray, RayAppender, Tracer};
use bytemuck::Pod;
use std::sync::Arc;

/// Spawns rays and shades their hits.
///
/// The scheduler calls a renderer from many host threads at once, and calls it with each tile and each batch exactly
/// once, in no particular order. The result must not depend on that order: accumulate in ways that commute, as `film`
/// does.
pub trait Renderer: Send + Sync {
    /// What travels with every ray, the path's state for instance. Any size and alignment; streams keep payloads in a
    /// vector of their own.
    type Payload: Pod + Send + Sync;
    /// What travels with every shadow ray.
    type ShadowPayload: Pod + Send + Sync;

    /// Number of tiles to spawn. Tiles are numbered from 0 and spawned once each, roughly in order.
    fn tiles(&self) -> u64;

    /// The most rays, and the most shadow rays, that [`Renderer::spawn`] emits for one tile; at least 1.
    fn tile_rays(&self) -> usize;

    /// The most shadow rays that [`Renderer::shade`] emits for each ray of its batch.
    fn shadow_rays_per_ray(&self) -> usize;

    /// The most paths in flight that the renderer has memory for: loop stacks grow with them. Spawning waits while
    /// there are as many. At least [`Renderer::tile_rays`], or the job is refused; `usize::MAX` for a renderer that
    /// needs no memory of its own for a path.
    ///
    /// Required, although most renderers have no bound: a renderer that wraps another must forward it.
    fn most_in_flight(&self) -> usize;

    /// Emits the camera rays of one tile.
    fn spawn(&self, tile: u64, out: &mut Output<'_, Self::Payload, Self::ShadowPayload>);

    /// Shades a batch of at most [`super::JobOptions::batch_rays`] traced rays. Emits at most one ray, and at most
    /// [`Renderer::shadow_rays_per_ray`] shadow rays, for each ray of the batch. (RA's hit shader; loop shaders run
    /// inside it, RA 3.3.)
    fn shade(
        &self,
        batch: Batch<'_, Self::Payload>,
        out: &mut Output<'_, Self::Payload, Self::ShadowPayload>,
    );

    /// The scene whose primitives this renderer shades. Jobs with the tracers of another scene are refused. `None`
    /// accepts any tracers. A renderer that wraps another should forward it.
    fn scene_id(&self) -> Option<SceneId> {
        None
    }

    /// The number of rays before this one on its path. Used for the report only ([`super::JobReport::depths`]).
    fn depth(&self, _payload: &Self::Payload) -> u32 {
        0
    }

    /// What a user should know of the result, for [`super::JobReport::warnings`]. Called once, when the job has ended.
    ///
    /// A renderer that wraps another must forward it.
    fn warnings(&self) -> Vec<String> {
        Vec::new()
    }

    /// The rays of a traced batch that pass what they have hit: their places, in ascending order. They are emitted
    /// again as they were, from just behind their hits, and [`Renderer::shade`] does not get them.
    ///
    /// The answer about a ray may depend on the ray, its hit and its payload alone, so that it is the same in any
    /// batch.
    ///
    /// A renderer that wraps another must forward it.
    fn passing(&self, _batch: &Batch<'_, Self::Payload>) -> Vec<u32> {
        Vec::new()
    }

    /// The surfaces that shadow rays may pass, if there are any. Shadow rays that meet something are then traced on, by
    /// the host, until something stops them.
    ///
    /// A renderer that wraps another must forward it.
    fn see_through(&self) -> Option<&dyn SeeThrough> {
        None
    }

    /// The tiles whose rays are traced where they are, if all tiles are of this kind.
    ///
    /// A renderer that wraps another may forward it: without it the rays are spawned, for the same result.
    fn in_place(&self) -> Option<&dyn InPlace> {
        None
    }

    /// The renderer without its type. One that is part of a library may define this as the default does, with
    /// `#[inline(never)]`: the scheduler's code for it is then compiled in that library, not in each crate that submits
    /// it.
    fn erased(self: Arc<Self>) -> AnyRenderer
    where
        Self: Sized + 'static,
    {
        AnyRenderer::new(self)
    }

    /// Receives traced shadow rays: `occluded[i]` is 1 if `rays[i]` hits anything between its ends, else 0. Called for
    /// all shadow rays of a stream before any of its rays is shaded.
    fn shadow(&self, rays: &[Ray], payloads: &[Self::ShadowPayload], occluded: &[u32]);
}

/// Surfaces that shadow rays may pass, or that mirror them.
pub trait SeeThrough {
    /// The shadow rays that are occluded, and may be by such a surface: their places, in ascending order. What others
    /// meet stops them. `occluded[i]` is 1 if `rays[i]` hits anything, else 0.
    fn may_meet(&self, _rays: &[Ray], occluded: &[u32]) -> Vec<u32> {
        (0..occluded.len() as u32).filter(|&i| occluded[i as usize] != 0).collect()
    }

    /// Decides which shadow rays pass what they hit first: their places, in ascending order. `hits` are their nearest
    /// hits, one for each ray; those that miss pass nothing.
    ///
    /// The answer about a ray may depend on the ray and its hit alone, so that it is the same in any stream. A ray that
    /// passes comes again with `t_min` behind its hit.
    fn passing(&self, rays: &[Ray], hits: &[Hit]) -> Vec<u32>;

    /// The shadow rays that nothing occludes and that end at a mirror, in ascending order of their places, with their
    /// ways on. They count as occluded if the mirror is not there, or if something occludes the way on.
    ///
    /// The answer about a ray may depend on the ray alone.
    fn reflected(&self, _rays: &[Ray], _occluded: &[u32]) -> Vec<ReflectedRay> {
        Vec::new()
    }

    /// True if a hit of the ray's [`ReflectedRay::probe`] is on its mirror.
    fn is_mirror(&self, _ray: &ReflectedRay, hit: &Hit) -> bool {
        !hit.is_miss()
    }
}

/// A shadow ray that a mirror sends on.
#[derive(Clone, Copy, Debug)]
pub struct ReflectedRay {
    /// The ray's place among those of [`SeeThrough::reflected`].
    pub place: u32,
    /// The mirror's number.
    pub mirror: u32,
    /// The ray just before and behind its meeting with the mirror.
    pub probe: Ray,
    /// The ray on from the mirror.
    pub rest: Ray,
}

/// Tiles of rays that lie in memory already, and from whose hits no others follow. Host threads trace them there where
/// no device takes part: copying them into a stream, and their answers out of it, can take longer than to trace them.
pub trait InPlace {
    /// Traces all rays of a tile and keeps their answers, in place of [`Renderer::spawn`]. Returns how many there were,
    /// at most [`Renderer::tile_rays`].
    fn trace(&self, tile: u64, tracer: &dyn Tracer) -> RayCounts;
}

/// Traced rays to shade: slices of the same length.
#[derive(Debug)]
pub struct Batch<'a, P> {
    /// The rays as they were emitted.
    pub rays: &'a [Ray],
    /// Their nearest hits.
    pub hits: &'a [Hit],
    /// Their payloads.
    pub payloads: &'a [P],
}

/// The sink of a renderer's rays.
#[derive(Debug)]
pub struct Output<'a, P, S> {
    pub(crate) rays: RayAppender<'a>,
    pub(crate) payloads: &'a mut Vec<P>,
    pub(crate) shadow_rays: RayAppender<'a>,
    pub(crate) shadow_payloads: &'a mut Vec<S>,
}

impl<P, S> Output<'_, P, S> {
    /// Emits a ray. It comes back with its nearest hit in [`Renderer::shade`].
    pub fn ray(&mut self, ray: Ray, payload: P) {
        self.rays.push(ray);
        self.payloads.push(payload);
    }

    /// Emits rays, each with its payload.
    ///
    /// # Panics
    /// If there are not as many payloads as rays.
    pub fn rays(&mut self, rays: &[Ray], payloads: impl Iterator<Item = P>) {
        self.rays.extend_from_slice(rays);
        self.payloads.extend(payloads);
        assert_eq!(self.rays.len(), self.payloads.len(), "every ray has a payload");
    }

    /// Emits the first `count` rays of a row, each with its payload. A row is what SIMD lanes write: as many elements
    /// as there are lanes.
    #[inline(always)]
    pub fn ray_row(&mut self, count: usize, rays: &[Ray], payloads: &[P])
    where
        P: Copy,
    {
        self.rays.extend_from_row(rays, count);
        rows::extend_from_row(self.payloads, payloads, count);
    }

    /// Emits a shadow ray. It comes back in [`Renderer::shadow`].
    pub fn shadow(&mut self, ray: Ray, payload: S) {
        self.shadow_rays.push(ray);
        self.shadow_payloads.push(payload);
    }

    /// Emits the first `count` shadow rays of a row, each with its payload.
    #[inline(always)]
    pub fn shadow_row(&mut self, count: usize, rays: &[Ray], payloads: &[S])
    where
        S: Copy,
    {
        self.shadow_rays.extend_from_row(rays, count);
        rows::extend_from_row(self.shadow_payloads, payloads, count);
    }
}
