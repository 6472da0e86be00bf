//! A renderer, tracer and device for tests that keep count: they know every ray, its answer, and how often it has been
//! traced and shaded. All rays are a pure function of a seed.

use super::super::{Batch, Output, Renderer};
use crate::stream::{
    DeviceError, DeviceReport, DeviceState, DeviceStream, DeviceTracer, Hit, Ray, Resolve, Ticket, Tracer,
};
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// A good mix of 64 bits (splitmix64's finaliser).
pub fn mix(value: u64) -> u64 {
    let value = value.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let value = (value ^ (value >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let value = (value ^ (value >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    value ^ (value >> 31)
}

/// What determines a ledger's rays.
#[derive(Clone, Copy, Debug)]
pub struct Script {
    pub seed: u64,
    pub tiles: u64,
    pub tile_rays: usize,
    /// No ray is deeper than this.
    pub max_depth: usize,
    pub shadow_rays_per_ray: usize,
    /// The call of the renderer or of the host's tracer that panics, numbered from 0.
    pub panic_at: Option<u64>,
}

/// Counts for each ray. A complete job leaves a 1 for every ray emitted.
pub struct Ledger {
    script: Script,
    calls: AtomicU64,
    spawned: Vec<AtomicU8>,
    traced: Vec<AtomicU8>,
    shaded: Vec<AtomicU8>,
    shadow_traced: Vec<AtomicU8>,
    shadow_answered: Vec<AtomicU8>,
}

/// A ray's name: its path, its depth, and for a shadow ray its number among the shadow rays emitted at that depth.
/// Shadow rays of a tile have the depth `max_depth`.
type Name = [u32; 3];

fn counters(len: usize) -> Vec<AtomicU8> {
    (0..len).map(|_| AtomicU8::new(0)).collect()
}

fn to_ray(name: Name) -> Ray {
    Ray { origin: name.map(|number| number as f32), ..Ray::default() }
}

fn to_name(ray: &Ray) -> Name {
    ray.origin.map(|number| number as u32)
}

impl Ledger {
    pub fn new(script: Script) -> Arc<Self> {
        let paths = script.tiles as usize * script.tile_rays;
        let shadows = paths * (script.max_depth + 1) * script.shadow_rays_per_ray.max(1);
        Arc::new(Self {
            script,
            calls: AtomicU64::new(0),
            spawned: counters(script.tiles as usize),
            traced: counters(paths * script.max_depth),
            shaded: counters(paths * script.max_depth),
            shadow_traced: counters(shadows),
            shadow_answered: counters(shadows),
        })
    }

    fn random(&self, name: Name) -> u64 {
        let [path, depth, number] = name.map(u64::from);
        mix(mix(mix(self.script.seed ^ path) ^ depth) ^ number)
    }

    fn ray_index(&self, [path, depth, _]: Name) -> usize {
        path as usize * self.script.max_depth + depth as usize
    }

    fn shadow_index(&self, [path, depth, number]: Name) -> usize {
        let per_ray = self.script.shadow_rays_per_ray.max(1);
        (path as usize * (self.script.max_depth + 1) + depth as usize) * per_ray + number as usize
    }

    fn hit(&self, name: Name) -> Hit {
        let random = self.random([name[0], name[1], 1000]);
        Hit { t: (random >> 40) as f32, u: 0.25, v: 0.5, primitive: random as u32 }
    }

    fn is_occluded(&self, name: Name) -> u32 {
        (self.random(name) >> 7) as u32 & 1
    }

    /// The paths of a tile's camera rays and of its shadow rays.
    fn camera(&self, tile: u64) -> (impl Iterator<Item = u32>, impl Iterator<Item = u32>) {
        let most = self.script.tile_rays as u64;
        let random = mix(self.script.seed ^ mix(tile + 77));
        // Some tiles are full, some empty, some in between.
        let count = |random: u64| if random.is_multiple_of(3) { most } else { random % (most + 1) };
        let start = (tile * most) as u32;
        let paths = move |count: u64| start..start + count as u32;
        let shadows = if (random >> 60).is_multiple_of(4) { count(random >> 32) } else { 0 };
        (paths(count(random >> 8)), paths(shadows))
    }

    fn continues(&self, [path, depth, _]: Name) -> bool {
        (depth as usize) + 1 < self.script.max_depth && !self.random([path, depth, 2000]).is_multiple_of(4)
    }

    fn shadows(&self, [path, depth, _]: Name) -> u32 {
        (self.random([path, depth, 3000]) % (self.script.shadow_rays_per_ray as u64 + 1)) as u32
    }

    fn call(&self) {
        if Some(self.calls.fetch_add(1, Relaxed)) == self.script.panic_at {
            resume_unwind(Box::new("as the script says"));
        }
    }

    /// Whether everything that follows from the tiles spawned has happened exactly once. Returns the
    /// camera, continuation and shadow rays expected.
    pub fn check_complete(&self) -> [u64; 3] {
        let mut expected = [vec![0; self.traced.len()], vec![0; self.shadow_traced.len()]];
        let mut counts = [0; 3];
        for tile in (0..self.script.tiles).filter(|&tile| self.spawned[tile as usize].load(Relaxed) == 1) {
            let (rays, shadows) = self.camera(tile);
            for path in shadows {
                expected[1][self.shadow_index([path, self.script.max_depth as u32, 0])] = 1;
                counts[2] += 1;
            }
            for path in rays {
                counts[0] += 1;
                for depth in 0.. {
                    let name = [path, depth, 0];
                    expected[0][self.ray_index(name)] = 1;
                    counts[1] += u64::from(depth > 0);
                    for number in 0..self.shadows(name) {
                        expected[1][self.shadow_index([path, depth, number])] = 1;
                        counts[2] += 1;
                    }
                    if !self.continues(name) {
                        break;
                    }
                }
            }
        }
        let read = |counters: &[AtomicU8]| -> Vec<u8> { counters.iter().map(|c| c.load(Relaxed)).collect() };
        assert!(read(&self.traced) == expected[0], "every ray is traced once");
        assert!(read(&self.shaded) == expected[0], "every ray is shaded once");
        assert!(read(&self.shadow_traced) == expected[1], "every shadow ray is traced once");
        assert!(read(&self.shadow_answered) == expected[1], "every shadow ray is answered once");
        counts
    }

    pub fn tiles_spawned(&self) -> u64 {
        self.spawned.iter().map(|count| u64::from(count.load(Relaxed))).sum()
    }

    fn trace(&self, rays: &[Ray], hits: &mut [Hit]) {
        for (ray, hit) in rays.iter().zip(hits) {
            let name = to_name(ray);
            assert_eq!(self.traced[self.ray_index(name)].fetch_add(1, Relaxed), 0, "traced once");
            *hit = self.hit(name);
        }
    }

    fn trace_shadows(&self, rays: &[Ray], occluded: &mut [u32]) {
        for (ray, occluded) in rays.iter().zip(occluded) {
            let name = to_name(ray);
            assert_eq!(self.shadow_traced[self.shadow_index(name)].fetch_add(1, Relaxed), 0, "traced once");
            *occluded = self.is_occluded(name);
        }
    }
}

impl Renderer for Ledger {
    type Payload = Name;
    type ShadowPayload = Name;

    fn tiles(&self) -> u64 {
        self.script.tiles
    }

    fn tile_rays(&self) -> usize {
        self.script.tile_rays
    }

    fn shadow_rays_per_ray(&self) -> usize {
        self.script.shadow_rays_per_ray
    }

    fn most_in_flight(&self) -> usize {
        usize::MAX
    }

    fn spawn(&self, tile: u64, out: &mut Output<'_, Name, Name>) {
        self.call();
        assert_eq!(self.spawned[tile as usize].fetch_add(1, Relaxed), 0, "a tile is spawned once");
        let (rays, shadows) = self.camera(tile);
        rays.for_each(|path| out.ray(to_ray([path, 0, 0]), [path, 0, 0]));
        let depth = self.script.max_depth as u32;
        shadows.for_each(|path| out.shadow(to_ray([path, depth, 0]), [path, depth, 0]));
    }

    fn shade(&self, batch: Batch<'_, Name>, out: &mut Output<'_, Name, Name>) {
        self.call();
        assert!(batch.rays.len() == batch.hits.len() && batch.rays.len() == batch.payloads.len());
        for ((ray, hit), &name) in batch.rays.iter().zip(batch.hits).zip(batch.payloads) {
            assert_eq!((to_name(ray), *hit), (name, self.hit(name)), "ray, hit and payload belong together");
            assert_eq!(self.traced[self.ray_index(name)].load(Relaxed), 1, "traced before shaded");
            assert_eq!(self.shaded[self.ray_index(name)].fetch_add(1, Relaxed), 0, "shaded once");
            let [path, depth, _] = name;
            if depth > 0 {
                for number in 0..self.shadows([path, depth - 1, 0]) {
                    let shadow = self.shadow_index([path, depth - 1, number]);
                    let answered = self.shadow_answered[shadow].load(Relaxed);
                    assert_eq!(answered, 1, "shadow rays are answered before their path goes on");
                }
            }
            for number in 0..self.shadows(name) {
                out.shadow(to_ray([path, depth, number]), [path, depth, number]);
            }
            if self.continues(name) {
                out.ray(to_ray([path, depth + 1, 0]), [path, depth + 1, 0]);
            }
        }
    }

    fn shadow(&self, rays: &[Ray], payloads: &[Name], occluded: &[u32]) {
        self.call();
        assert!(rays.len() == payloads.len() && rays.len() == occluded.len());
        for ((ray, &name), &occluded) in rays.iter().zip(payloads).zip(occluded) {
            assert_eq!(
                (to_name(ray), occluded),
                (name, self.is_occluded(name)),
                "ray, answer and payload belong together"
            );
            let before = self.shadow_answered[self.shadow_index(name)].fetch_add(1, Relaxed);
            assert_eq!(before, 0, "a shadow ray is answered once");
        }
    }
}

impl Tracer for Ledger {
    fn closest(&self, rays: &[Ray], hits: &mut [Hit]) {
        self.call();
        assert_eq!(rays.len(), hits.len());
        self.trace(rays, hits);
    }

    fn occluded(&self, rays: &[Ray], occluded: &mut [u32]) {
        self.call();
        assert_eq!(rays.len(), occluded.len());
        self.trace_shadows(rays, occluded);
    }
}

/// What becomes of a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    Lives,
    /// Takes this many bundles, then refuses one.
    Refuses(u64),
    /// Answers this many bundles, then returns an error.
    Lost(u64),
    /// Answers this many bundles, then panics.
    Panics(u64),
    /// Resolves this many streams, then finds an answer wrong.
    Lies(u64),
    /// The same, and then keeps its share of a stream.
    Keeps(u64),
}

impl Fate {
    /// A device that fails after `dispatches` in one way or another.
    pub fn any(kind: u64, dispatches: u64) -> Self {
        let all = [Self::Refuses, Self::Lost, Self::Panics, Self::Lies, Self::Keeps];
        all[kind as usize % all.len()](dispatches)
    }
}

/// A device that answers from a ledger, as long as its fate lets it.
pub struct FakeDevice {
    pub ledger: Arc<Ledger>,
    pub fate: Fate,
    /// Rays of a bundle.
    pub bundle_rays: usize,
    /// How often a bundle is looked for in vain.
    pub patience: u64,
    /// How long a look takes.
    pub delay: Duration,
    /// The device is ready when it has been asked so often.
    pub ready_after: u64,
    pub counts: Arc<Counts>,
}

/// What a device has done.
#[derive(Default)]
pub struct Counts {
    asked: AtomicU64,
    pub submitted: AtomicU64,
    pub answered: AtomicU64,
    pub resolved: AtomicU64,
    kept: Mutex<Vec<DeviceStream>>,
}

impl DeviceTracer for FakeDevice {
    fn name(&self) -> &str {
        "a fake device"
    }

    fn state(&self) -> DeviceState {
        let is_ready = self.counts.asked.fetch_add(1, Relaxed) >= self.ready_after;
        if is_ready { DeviceState::Ready } else { DeviceState::Opening }
    }

    fn bundle_rays(&self) -> Option<usize> {
        Some(self.bundle_rays)
    }

    fn submit(&self, bundle: Vec<DeviceStream>) -> Result<Box<dyn Ticket>, DeviceError> {
        let number = self.counts.submitted.fetch_add(1, Relaxed);
        assert!(!bundle.is_empty(), "a bundle has streams");
        if let Fate::Refuses(last) = self.fate
            && number >= last
        {
            return Err(DeviceError::Failed("no room".to_owned()));
        }
        let (ledger, counts) = (Arc::clone(&self.ledger), Arc::clone(&self.counts));
        let (fate, patience, delay) = (self.fate, self.patience, self.delay);
        Ok(Box::new(Bundle { streams: bundle, ledger, fate, patience, delay, counts }))
    }
}

struct Bundle {
    streams: Vec<DeviceStream>,
    ledger: Arc<Ledger>,
    fate: Fate,
    patience: u64,
    delay: Duration,
    counts: Arc<Counts>,
}

impl Ticket for Bundle {
    fn wait(&mut self, _: Duration) -> Result<Option<Vec<Box<dyn Resolve>>>, DeviceError> {
        if !self.delay.is_zero() {
            std::thread::sleep(self.delay);
        }
        if self.patience > 0 {
            self.patience -= 1;
            return Ok(None);
        }
        let number = self.counts.answered.fetch_add(1, Relaxed);
        for stream in &self.streams {
            let mut answers = stream.answers();
            let (hits, occluded) = answers.slices();
            hits.fill(Hit { primitive: 12345, ..Hit::NONE });
            occluded.fill(7);
        }
        match self.fate {
            Fate::Lost(last) if number >= last => return Err(DeviceError::Lost("out of luck".to_owned())),
            Fate::Panics(last) if number >= last => resume_unwind(Box::new("the driver is gone".to_owned())),
            _ => {}
        }
        let answer = |_| {
            let (ledger, counts) = (Arc::clone(&self.ledger), Arc::clone(&self.counts));
            Box::new(Answer { ledger, fate: self.fate, counts }) as Box<dyn Resolve>
        };
        Ok(Some(std::mem::take(&mut self.streams).into_iter().map(answer).collect()))
    }
}

struct Answer {
    ledger: Arc<Ledger>,
    fate: Fate,
    counts: Arc<Counts>,
}

impl Resolve for Answer {
    fn resolve(self: Box<Self>, stream: &DeviceStream) -> Result<DeviceReport, DeviceError> {
        let number = self.counts.resolved.fetch_add(1, Relaxed);
        match self.fate {
            Fate::Lies(last) | Fate::Keeps(last) if number >= last => {
                if matches!(self.fate, Fate::Keeps(_)) {
                    self.counts.kept.lock().unwrap().push(stream.share());
                }
                return Err(DeviceError::Failed("7 of 64 rays differ".to_owned()));
            }
            _ => {}
        }
        let mut answers = stream.answers();
        let (hits, occluded) = answers.slices();
        self.ledger.trace(stream.rays(), hits);
        self.ledger.trace_shadows(stream.shadow_rays(), occluded);
        let bytes_copied = 48 * stream.rays().len() as u64;
        Ok(DeviceReport { bytes_copied, flagged: 1, retraced: 1, checked: 1, ..DeviceReport::default() })
    }
}
