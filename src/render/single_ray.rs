//! The plain renderer that ray streams are measured against (RA section 5, SINGLERAY), without streams or scheduler. A
//! thread follows one path to its end before it starts the next. It calls the shaders of a [`Renderer`] with batches of
//! one ray.

use crate::schedule::{Output, RayCounts, Renderer, pass_or_shade, trace_on};
use crate::stream::{Hit, Ray, RayArray, TracedRays, Tracer};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};
use std::sync::{PoisonError, RwLock};

/// Camera rays that a thread takes at once. Small, so that threads finish together.
const BLOCK: usize = 64;

/// Renders the whole frame on this many threads. `tracer` traces one ray at a time.
pub fn render_single_rays<R: Renderer>(renderer: &R, tracer: &dyn Tracer, threads: usize) -> RayCounts {
    let places: Vec<Place<R::Payload>> = (0..threads).map(|_| Place::new(renderer.tile_rays())).collect();
    let next_tile = AtomicU64::new(0);
    let work = |own: usize| {
        let mut walk = Walk::new(renderer, tracer);
        while places[own].open(&next_tile, &mut walk) {
            places[own].empty(&mut walk);
        }
        // No tile is left: help those who still have one.
        (0..threads).for_each(|other| places[(own + other) % threads].empty(&mut walk));
        walk.counts
    };
    std::thread::scope(|scope| {
        let work = &work;
        let others: Vec<_> = (1..threads).map(|own| scope.spawn(move || work(own))).collect();
        others.into_iter().fold(work(0), |sum, other| match other.join() {
            Ok(counts) => RayCounts {
                camera: sum.camera + counts.camera,
                continuation: sum.continuation + counts.continuation,
                shadow: sum.shadow + counts.shadow,
            },
            Err(payload) => std::panic::resume_unwind(payload),
        })
    })
}

/// A thread's tile, from which other threads may steal rays.
struct Place<P> {
    camera: RwLock<Camera<P>>,
    /// The first ray that no thread has taken.
    next: AtomicUsize,
}

/// Camera rays of a tile.
struct Camera<P> {
    rays: RayArray,
    payloads: Vec<P>,
}

impl<P: bytemuck::Pod> Place<P> {
    fn new(tile_rays: usize) -> Self {
        let camera = Camera { rays: RayArray::with_capacity(tile_rays), payloads: Vec::new() };
        Self { camera: RwLock::new(camera), next: AtomicUsize::new(0) }
    }

    /// Spawns the next tile here; false if there is none. The tile is chosen under the lock, so a thread that finds no
    /// tile left and steals rays finds the last tile spawned.
    fn open<R: Renderer<Payload = P>>(&self, next_tile: &AtomicU64, walk: &mut Walk<'_, R>) -> bool {
        let mut camera = self.camera.write().unwrap_or_else(PoisonError::into_inner);
        let tile = next_tile.fetch_add(1, Relaxed);
        if tile >= walk.renderer.tiles() {
            return false;
        }
        walk.spawn(tile, &mut camera);
        self.next.store(0, Relaxed);
        true
    }

    /// Follows the paths of all rays that no thread has taken.
    fn empty<R: Renderer<Payload = P>>(&self, walk: &mut Walk<'_, R>) {
        let camera = self.camera.read().unwrap_or_else(PoisonError::into_inner);
        let len = camera.rays.len();
        loop {
            let start = self.next.fetch_add(BLOCK, Relaxed);
            if start >= len {
                return;
            }
            for i in start..(start + BLOCK).min(len) {
                walk.follow(camera.rays[i], camera.payloads[i]);
            }
        }
    }
}

/// A thread that follows one path after another. It allocates for its first few paths only.
struct Walk<'a, R: Renderer> {
    renderer: &'a R,
    tracer: &'a dyn Tracer,
    /// The rays that shading one ray emits.
    rays: RayArray,
    payloads: Vec<R::Payload>,
    shadow_rays: RayArray,
    shadow_payloads: Vec<R::ShadowPayload>,
    occluded: Vec<u32>,
    counts: RayCounts,
}

impl<'a, R: Renderer> Walk<'a, R> {
    fn new(renderer: &'a R, tracer: &'a dyn Tracer) -> Self {
        Self {
            renderer,
            tracer,
            rays: RayArray::with_capacity(1),
            payloads: Vec::new(),
            shadow_rays: RayArray::with_capacity(renderer.tile_rays().max(renderer.shadow_rays_per_ray())),
            shadow_payloads: Vec::new(),
            occluded: Vec::new(),
            counts: RayCounts::default(),
        }
    }

    fn spawn(&mut self, tile: u64, camera: &mut Camera<R::Payload>) {
        camera.rays.clear();
        camera.payloads.clear();
        let (shadow_rays, shadow_payloads) = (self.shadow_rays.appender(), &mut self.shadow_payloads);
        let (rays, payloads) = (camera.rays.appender(), &mut camera.payloads);
        self.renderer.spawn(tile, &mut Output { rays, payloads, shadow_rays, shadow_payloads });
        self.counts.camera += camera.rays.len() as u64;
        self.settle_shadows();
    }

    /// Follows a path to its end.
    fn follow(&mut self, mut ray: Ray, mut payload: R::Payload) {
        loop {
            let mut hits = [Hit::NONE];
            self.tracer.closest(&[ray], &mut hits);
            let Self { renderer, rays, payloads, shadow_rays, shadow_payloads, .. } = self;
            let (rays, shadow_rays) = (rays.appender(), shadow_rays.appender());
            pass_or_shade(
                *renderer,
                TracedRays { rays: &mut [ray], hits: &mut hits, payloads: &mut [payload] },
                &mut Output { rays, payloads, shadow_rays, shadow_payloads },
            );
            self.settle_shadows();
            let (Some(next), Some(next_payload)) = (self.rays.pop(), self.payloads.pop()) else { return };
            assert!(self.rays.is_empty(), "the renderer promises at most one ray per ray");
            (ray, payload) = (next, next_payload);
            self.counts.continuation += 1;
        }
    }

    /// Traces the shadow rays just emitted and returns their answers.
    fn settle_shadows(&mut self) {
        let Self { shadow_rays, shadow_payloads, occluded, .. } = self;
        if shadow_rays.is_empty() {
            return;
        }
        occluded.resize(shadow_rays.len(), 0);
        self.tracer.occluded(shadow_rays, occluded);
        if let Some(surfaces) = self.renderer.see_through() {
            trace_on(surfaces, self.tracer, shadow_rays, occluded);
        }
        self.renderer.shadow(shadow_rays, shadow_payloads, occluded);
        self.counts.shadow += shadow_rays.len() as u64;
        shadow_rays.clear();
        shadow_payloads.clear();
    }
}
