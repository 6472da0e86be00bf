//! A frame whose rays stand for many: what a renderer, a host's tracer and a device do with them is counted, not done.

use super::super::super::{Batch, Output, Renderer};
use crate::stream::{
    DeviceError, DeviceReport, DeviceStream, DeviceTracer, Hit, Ray, Resolve, Ticket, Tracer,
};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

/// Rays that one stands for: the smallest chunk. All sizes of a simulated job are counted in these.
pub const GRAIN: usize = 1024;

/// Rays of a tile (`render::pass`).
pub const TILE_RAYS: usize = 4096;

/// The rays of a frame, by kind.
#[derive(Clone, Copy, Debug)]
pub struct Rays {
    pub camera: f64,
    pub continuation: f64,
    pub shadow: f64,
}

impl Rays {
    pub fn total(self) -> f64 {
        self.camera + self.continuation + self.shadow
    }

    pub fn scaled(self, by: f64) -> Self {
        Self { camera: self.camera * by, continuation: self.continuation * by, shadow: self.shadow * by }
    }
}

/// What a task has done, in rays.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Done {
    pub spawned: u64,
    pub traced: u64,
    pub shaded: u64,
}

/// A frame: every camera ray goes on with the same probability, spread evenly over batches, and so do shadow rays.
pub struct Frame {
    tiles: u64,
    /// Rays, and shadow rays, emitted for each ray shaded.
    emitted: [f64; 2],
    /// The fractions that batches have left.
    rest: Mutex<[f64; 2]>,
    spawned: AtomicU64,
    traced: AtomicU64,
    shaded: AtomicU64,
}

impl Frame {
    pub fn new(rays: Rays) -> Self {
        let shaded = rays.camera + rays.continuation;
        Self {
            tiles: (rays.camera / TILE_RAYS as f64).ceil() as u64,
            emitted: [rays.continuation / shaded, rays.shadow / shaded],
            rest: Mutex::default(),
            spawned: AtomicU64::new(0),
            traced: AtomicU64::new(0),
            shaded: AtomicU64::new(0),
        }
    }

    /// What has been done since this was called last.
    pub fn take_done(&self) -> Done {
        let take = |count: &AtomicU64| count.swap(0, Relaxed) * GRAIN as u64;
        Done { spawned: take(&self.spawned), traced: take(&self.traced), shaded: take(&self.shaded) }
    }
}

impl Renderer for Frame {
    type Payload = ();
    type ShadowPayload = ();

    fn tiles(&self) -> u64 {
        self.tiles
    }

    fn tile_rays(&self) -> usize {
        TILE_RAYS / GRAIN
    }

    fn shadow_rays_per_ray(&self) -> usize {
        self.emitted[1].ceil() as usize
    }

    fn most_in_flight(&self) -> usize {
        usize::MAX
    }

    fn spawn(&self, _: u64, out: &mut Output<'_, (), ()>) {
        self.spawned.fetch_add((TILE_RAYS / GRAIN) as u64, Relaxed);
        (0..TILE_RAYS / GRAIN).for_each(|_| out.ray(Ray::default(), ()));
    }

    fn shade(&self, batch: Batch<'_, ()>, out: &mut Output<'_, (), ()>) {
        self.shaded.fetch_add(batch.rays.len() as u64, Relaxed);
        let mut rest = self.rest.lock().unwrap();
        let mut count = |kind: usize| {
            rest[kind] += batch.rays.len() as f64 * self.emitted[kind];
            let whole = rest[kind].floor().min(batch.rays.len() as f64 * self.emitted[kind].ceil());
            rest[kind] -= whole;
            whole as usize
        };
        (0..count(0)).for_each(|_| out.ray(Ray::default(), ()));
        (0..count(1)).for_each(|_| out.shadow(Ray::default(), ()));
    }

    fn shadow(&self, rays: &[Ray], _: &[()], _: &[u32]) {
        self.shaded.fetch_add(rays.len() as u64, Relaxed);
    }
}

impl Tracer for Frame {
    fn closest(&self, rays: &[Ray], _: &mut [Hit]) {
        self.traced.fetch_add(rays.len() as u64, Relaxed);
    }

    fn occluded(&self, rays: &[Ray], _: &mut [u32]) {
        self.traced.fetch_add(rays.len() as u64, Relaxed);
    }
}

/// The device of a frame: what is submitted is counted, and done when the clock says so.
#[derive(Default)]
pub struct Queue {
    state: Arc<Mutex<QueueState>>,
    pub bundle_rays: usize,
}

#[derive(Default)]
pub struct QueueState {
    /// What has been submitted since the clock looked last.
    pub submitted: Option<[u64; 2]>,
    /// What a thread waits for since then: the bundle's number, and the most nanoseconds.
    pub waited: Option<(usize, f64)>,
    /// When each bundle can be read.
    pub readable: Vec<f64>,
    pub now: f64,
    /// Rays resolved since the clock looked last.
    pub resolved: u64,
    bundles: usize,
}

impl Queue {
    pub fn new(bundle_rays: usize) -> Self {
        Self { bundle_rays, ..Self::default() }
    }

    pub fn state(&self) -> MutexGuard<'_, QueueState> {
        self.state.lock().unwrap()
    }
}

struct Bundle {
    number: usize,
    streams: Vec<u64>,
    state: Arc<Mutex<QueueState>>,
}

impl DeviceTracer for Queue {
    fn name(&self) -> &str {
        "a modelled device"
    }

    fn bundle_rays(&self) -> Option<usize> {
        Some(self.bundle_rays)
    }

    fn submit(&self, bundle: Vec<DeviceStream>) -> Result<Box<dyn Ticket>, DeviceError> {
        let grains = |rays: &[Ray]| (rays.len() * GRAIN) as u64;
        let counts: Vec<_> = bundle.iter().map(|s| [grains(s.rays()), grains(s.shadow_rays())]).collect();
        let mut state = self.state();
        state.submitted = Some([0, 1].map(|kind| counts.iter().map(|count| count[kind]).sum()));
        state.bundles += 1;
        let streams = counts.iter().map(|count| count.iter().sum()).collect();
        Ok(Box::new(Bundle { number: state.bundles - 1, streams, state: Arc::clone(&self.state) }))
    }
}

impl Ticket for Bundle {
    fn wait(&mut self, timeout: Duration) -> Result<Option<Vec<Box<dyn Resolve>>>, DeviceError> {
        let mut state = self.state.lock().unwrap();
        if state.readable[self.number] > state.now {
            state.waited = Some((self.number, timeout.as_nanos() as f64));
            return Ok(None);
        }
        state.waited = Some((self.number, 0.0));
        let of = |rays: u64| Box::new(Answer { rays, state: Arc::clone(&self.state) }) as Box<dyn Resolve>;
        Ok(Some(self.streams.iter().map(|&rays| of(rays)).collect()))
    }
}

struct Answer {
    rays: u64,
    state: Arc<Mutex<QueueState>>,
}

impl Resolve for Answer {
    fn resolve(self: Box<Self>, _: &DeviceStream) -> Result<DeviceReport, DeviceError> {
        self.state.lock().unwrap().resolved += self.rays;
        Ok(DeviceReport::default())
    }
}
