//! What the scheduler asks of a renderer (RA section 3.1): spawn camera rays, shade batches.

use crate::stream::{Hit, Ray, RayAppender};
use bytemuck::Pod;

/// A job's own half: it creates rays and says what their hits mean. The scheduler calls it from many
/// host threads at once, each batch exactly once, in no particular order; results that depend on
/// order break promise 1, so accumulate in ways that commute (see `film`).
pub trait Renderer: Send + Sync + 'static {
    /// What travels with every ray (path state). Alignment at most 4, any size that is a multiple of 4.
    type Payload: Pod + Send + Sync;
    /// What travels with every shadow ray.
    type ShadowPayload: Pod + Send + Sync;

    /// Number of tiles to spawn; tile numbers run from 0 and are spawned once each, about in order.
    fn tiles(&self) -> u64;

    /// The most rays (and the most shadow rays) that [`Renderer::spawn`] emits for one tile; ≥ 1.
    fn tile_rays(&self) -> usize;

    /// The most shadow rays that [`Renderer::shade`] emits per ray of its batch.
    fn shadow_rays_per_ray(&self) -> usize;

    /// The most paths in flight that there is memory for (loop stacks, say); spawning waits until there are
    /// fewer. At least [`Renderer::tile_rays`], or the job is refused.
    fn most_in_flight(&self) -> usize {
        usize::MAX
    }

    /// Emits the camera rays of one tile.
    fn spawn(&self, tile: u64, out: &mut Output<'_, Self::Payload, Self::ShadowPayload>);

    /// Shades a batch of at most 8192 traced rays. Emits at most one ray per ray of the batch, and at
    /// most [`Renderer::shadow_rays_per_ray`] shadow rays per ray. (RA's hit shader; loop shaders run
    /// inside it, RA 3.3.)
    fn shade(
        &self,
        batch: Batch<'_, Self::Payload>,
        out: &mut Output<'_, Self::Payload, Self::ShadowPayload>,
    );

    /// How many rays came before this one on its path; for the report alone.
    fn depth(&self, _payload: &Self::Payload) -> u32 {
        0
    }

    /// Receives traced shadow rays: `occluded[i]` is 1 when something lies between the ends of
    /// `rays[i]`, else 0. Called for all shadow rays of a stream before any of its rays is shaded.
    fn shadow(&self, rays: &[Ray], payloads: &[Self::ShadowPayload], occluded: &[u32]);
}

/// Traced rays to shade: three slices of one length.
#[derive(Debug)]
pub struct Batch<'a, P> {
    /// The rays as they were emitted.
    pub rays: &'a [Ray],
    /// Their nearest hits.
    pub hits: &'a [Hit],
    /// What travelled with them.
    pub payloads: &'a [P],
}

/// Where a renderer emits rays.
#[derive(Debug)]
pub struct Output<'a, P, S> {
    pub(crate) rays: RayAppender<'a>,
    pub(crate) payloads: &'a mut Vec<P>,
    pub(crate) shadow_rays: RayAppender<'a>,
    pub(crate) shadow_payloads: &'a mut Vec<S>,
}

impl<P, S> Output<'_, P, S> {
    /// Emits a ray whose nearest hit will come back in a batch.
    pub fn ray(&mut self, ray: Ray, payload: P) {
        self.rays.push(ray);
        self.payloads.push(payload);
    }

    /// Emits rays, each with its payload.
    ///
    /// # Panics
    /// Unless there are as many of both.
    pub fn rays(&mut self, rays: &[Ray], payloads: impl Iterator<Item = P>) {
        self.rays.extend_from_slice(rays);
        self.payloads.extend(payloads);
        assert_eq!(self.rays.len(), self.payloads.len(), "every ray has a payload");
    }

    /// Emits the first `count` rays of a row, each with its payload: rows are what lanes write.
    #[inline(always)]
    pub fn ray_row(&mut self, count: usize, rays: &[Ray], payloads: &[P])
    where
        P: Copy,
    {
        self.rays.extend_from_row(rays, count);
        extend_from_row(self.payloads, payloads, count);
    }

    /// Emits a ray of which only occlusion matters; it comes back in [`Renderer::shadow`].
    pub fn shadow(&mut self, ray: Ray, payload: S) {
        self.shadow_rays.push(ray);
        self.shadow_payloads.push(payload);
    }

    /// Emits the first `count` rays of a row of which only occlusion matters, each with its payload.
    #[inline(always)]
    pub fn shadow_row(&mut self, count: usize, rays: &[Ray], payloads: &[S])
    where
        S: Copy,
    {
        self.shadow_rays.extend_from_row(rays, count);
        extend_from_row(self.shadow_payloads, payloads, count);
    }
}

/// Appends the first `count` of a row, copying all where there is room: see [`RayAppender::extend_from_row`].
#[inline(always)]
fn extend_from_row<T: Copy>(to: &mut Vec<T>, row: &[T], count: usize) {
    let len = to.len();
    if to.capacity() - len < row.len() {
        return to.extend_from_slice(&row[..count]);
    }
    to.extend_from_slice(row);
    to.truncate(len + count);
}
