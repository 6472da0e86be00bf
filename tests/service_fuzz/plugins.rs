//! Renderers, tracers and devices that do well, lie, panic or die; all of them are counted while they live.

use raystream::schedule::{Batch, Output, Renderer};
use raystream::stream::{
    Capacity, DeviceError, DeviceMemory, DeviceReport, DeviceStream, DeviceTracer, Hit, Ray, Resolve,
    StreamMemory, Ticket, Tracer,
};
use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::atomic::{AtomicIsize, AtomicU64, Ordering::SeqCst};
use std::time::Duration;

/// A small seeded generator (splitmix64).
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number below `n`.
    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    pub fn one_in(&mut self, n: usize) -> bool {
        self.below(n) == 0
    }

    pub fn pick<T: Clone>(&mut self, choices: &[T]) -> T {
        choices[self.below(choices.len())].clone()
    }
}

/// What one sequence has made and not yet dropped.
#[derive(Debug, Default)]
pub struct Live {
    pub renderers: AtomicIsize,
    pub tracers: AtomicIsize,
    pub arrays: AtomicIsize,
    pub callbacks: AtomicIsize,
}

/// Counted in one of the numbers of [`Live`] until it is dropped.
#[derive(Debug)]
pub struct Counted(Arc<Live>, fn(&Live) -> &AtomicIsize);

impl Counted {
    pub fn new(live: &Arc<Live>, which: fn(&Live) -> &AtomicIsize) -> Self {
        which(live).fetch_add(1, SeqCst);
        Self(Arc::clone(live), which)
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        (self.1)(&self.0).fetch_sub(1, SeqCst);
    }
}

/// Panics at the call with this number.
#[derive(Debug)]
struct Fuse(AtomicU64, u64);

impl Fuse {
    fn new(random: &mut Random) -> Self {
        let at = if random.one_in(5) { random.next() % 12 } else { u64::MAX };
        Self(AtomicU64::new(0), at)
    }

    fn burn(&self) {
        if self.0.fetch_add(1, SeqCst) == self.1 {
            resume_unwind(Box::new("a plug-in that panics"));
        }
    }
}

/// Paths that end by chance. Counts what it shades.
#[derive(Debug)]
pub struct Script {
    tiles: u64,
    tile_rays: usize,
    shadow_rays_per_ray: usize,
    most_in_flight: usize,
    depth: u32,
    /// Rays emitted beyond what was promised.
    surplus: usize,
    fuse: Fuse,
    panics_in_drop: bool,
    pub shaded: AtomicU64,
    _counted: Counted,
}

impl Script {
    pub fn new(random: &mut Random, live: &Arc<Live>) -> Self {
        let tile_rays = random.pick(&[1, 1, 7, 64, 300]);
        Self {
            tiles: random.pick(&[0, 1, 2, 5, 40]),
            tile_rays: if random.one_in(30) { 0 } else { tile_rays },
            shadow_rays_per_ray: random.below(3),
            most_in_flight: random.pick(&[usize::MAX, usize::MAX, 500, 10]),
            depth: random.below(5) as u32,
            surplus: usize::from(random.one_in(15)),
            fuse: Fuse::new(random),
            panics_in_drop: random.one_in(20),
            shaded: AtomicU64::new(0),
            _counted: Counted::new(live, |live| &live.renderers),
        }
    }
}

impl Renderer for Script {
    type Payload = u32;
    type ShadowPayload = [u64; 2];

    fn tiles(&self) -> u64 {
        self.tiles
    }

    fn tile_rays(&self) -> usize {
        self.tile_rays
    }

    fn shadow_rays_per_ray(&self) -> usize {
        self.shadow_rays_per_ray
    }

    fn most_in_flight(&self) -> usize {
        self.most_in_flight
    }

    fn spawn(&self, tile: u64, out: &mut Output<'_, u32, [u64; 2]>) {
        self.fuse.burn();
        let odd = [f32::NAN, f32::INFINITY, 0.0, 1.0][tile as usize % 4];
        let ray = Ray { origin: [odd; 3], direction: [1.0, odd, 0.0], ..Ray::default() };
        (0..self.tile_rays + self.surplus).for_each(|number| out.ray(ray, number as u32 % 7));
        (0..self.tile_rays / 2).for_each(|_| out.shadow(ray, [tile; 2]));
    }

    fn shade(&self, batch: Batch<'_, u32>, out: &mut Output<'_, u32, [u64; 2]>) {
        self.fuse.burn();
        self.shaded.fetch_add(batch.rays.len() as u64, SeqCst);
        for (ray, &payload) in batch.rays.iter().zip(batch.payloads) {
            (0..self.shadow_rays_per_ray).for_each(|_| out.shadow(*ray, [1; 2]));
            if payload / 7 < self.depth {
                out.ray(*ray, payload + 7);
            }
        }
    }

    fn depth(&self, payload: &u32) -> u32 {
        payload / 7
    }

    fn shadow(&self, rays: &[Ray], payloads: &[[u64; 2]], occluded: &[u32]) {
        self.fuse.burn();
        assert!(rays.len() == payloads.len() && rays.len() == occluded.len());
    }
}

impl Drop for Script {
    fn drop(&mut self) {
        if self.panics_in_drop {
            resume_unwind(Box::new("a drop that panics"));
        }
    }
}

/// Finds nothing, and may panic.
pub struct Blind(Fuse, #[expect(dead_code, reason = "held to be dropped")] Counted);

impl Blind {
    pub fn new(random: &mut Random, live: &Arc<Live>) -> Self {
        Self(Fuse::new(random), Counted::new(live, |live| &live.tracers))
    }
}

impl Tracer for Blind {
    fn closest(&self, _: &[Ray], hits: &mut [Hit]) {
        self.0.burn();
        hits.fill(Hit::NONE);
    }

    fn occluded(&self, _: &[Ray], occluded: &mut [u32]) {
        self.0.burn();
        occluded.fill(0);
    }
}

/// Counted memory.
#[derive(Debug)]
struct Array<T>(Vec<T>, #[expect(dead_code, reason = "held to be dropped")] Counted);

impl<T: std::fmt::Debug + Send + Sync + 'static> DeviceMemory<T> for Array<T> {
    fn as_slice(&self) -> &[T] {
        &self.0
    }

    fn as_mut_slice(&mut self) -> &mut [T] {
        &mut self.0
    }

    fn is_sound(&self) -> bool {
        true
    }
}

/// A device that lives, is lost or panics, and may have memory of its own.
pub struct Device {
    dispatches: AtomicU64,
    last: u64,
    panics: bool,
    live: Option<Arc<Live>>,
    _counted: Counted,
}

impl Device {
    pub fn new(random: &mut Random, live: &Arc<Live>) -> Self {
        Self {
            dispatches: AtomicU64::new(0),
            last: random.pick(&[0, 1, 3, u64::MAX, u64::MAX]),
            panics: random.one_in(2),
            live: random.one_in(2).then(|| Arc::clone(live)),
            _counted: Counted::new(live, |live| &live.tracers),
        }
    }

    fn dispatch(&self) -> Result<(), DeviceError> {
        if self.dispatches.fetch_add(1, SeqCst) >= self.last {
            if self.panics {
                resume_unwind(Box::new("a driver that panics"));
            }
            return Err(DeviceError::Lost("out of luck".to_owned()));
        }
        Ok(())
    }
}

impl DeviceTracer for Device {
    fn name(&self) -> &str {
        "a device"
    }

    fn stream_memory(&self, of: Capacity, current: Option<&dyn DeviceMemory<Ray>>) -> Option<StreamMemory> {
        let live = self.live.as_ref().filter(|_| current.is_none())?;
        let counted = || Counted::new(live, |live| &live.arrays);
        Some(StreamMemory {
            rays: Box::new(Array(vec![Ray::default(); of.rays], counted())),
            hits: Box::new(Array(vec![Hit::NONE; of.rays], counted())),
            shadow_rays: Box::new(Array(vec![Ray::default(); of.shadow_rays], counted())),
            occluded: Box::new(Array(vec![0; of.shadow_rays], counted())),
        })
    }

    fn submit(&self, bundle: Vec<DeviceStream>) -> Result<Box<dyn Ticket>, DeviceError> {
        self.dispatch()?;
        Ok(Box::new(Bundle { streams: bundle.len(), waits: self.dispatches.load(SeqCst) % 3 }))
    }
}

/// Is done at one of the first looks.
struct Bundle {
    streams: usize,
    waits: u64,
}

impl Ticket for Bundle {
    fn wait(&mut self, _: Duration) -> Result<Option<Vec<Box<dyn Resolve>>>, DeviceError> {
        if self.waits > 0 {
            self.waits -= 1;
            return Ok(None);
        }
        Ok(Some((0..self.streams).map(|_| Box::new(Misses) as Box<dyn Resolve>).collect()))
    }
}

struct Misses;

impl Resolve for Misses {
    fn resolve(self: Box<Self>, stream: &DeviceStream) -> Result<DeviceReport, DeviceError> {
        let mut answers = stream.answers();
        let (hits, occluded) = answers.slices();
        hits.fill(Hit::NONE);
        occluded.fill(0);
        Ok(DeviceReport::default())
    }
}
