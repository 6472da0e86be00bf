//! A renderer whose calls wait at a gate, and a tracer that finds no hits.

use super::super::{Batch, Output, Renderer, Tracers};
use crate::stream::{Hit, Ray, Tracer};
use std::ops::Deref;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

/// Blocks until the gate is opened: in spawning, or in shading.
pub struct Gated {
    tiles: u64,
    tile_rays: usize,
    holds_shading: bool,
    gate: Mutex<bool>,
    opened: Condvar,
    pub spawned: AtomicU64,
    pub shaded: AtomicU64,
}

impl Gated {
    /// Fifty tiles of one ray.
    pub fn new() -> Arc<Self> {
        Self::with_tiles(50)
    }

    pub fn with_tiles(tiles: u64) -> Arc<Self> {
        Self::make(tiles, 1, false)
    }

    /// One tile of `tile_rays` rays, which waits in shading.
    pub fn in_shading(tile_rays: usize) -> Arc<Self> {
        Self::make(1, tile_rays, true)
    }

    fn make(tiles: u64, tile_rays: usize, holds_shading: bool) -> Arc<Self> {
        let ((gate, opened), (spawned, shaded)) = Default::default();
        Arc::new(Self { tiles, tile_rays, holds_shading, gate, opened, spawned, shaded })
    }

    fn hold(&self) {
        drop(self.opened.wait_while(self.gate.lock().unwrap(), |open| !*open).unwrap());
    }

    pub fn open(&self) {
        *self.gate.lock().unwrap() = true;
        self.opened.notify_all();
    }
}

impl Renderer for Gated {
    type Payload = u32;
    type ShadowPayload = u32;

    fn tiles(&self) -> u64 {
        self.tiles
    }

    fn tile_rays(&self) -> usize {
        self.tile_rays
    }

    fn shadow_rays_per_ray(&self) -> usize {
        0
    }

    fn most_in_flight(&self) -> usize {
        usize::MAX
    }

    fn spawn(&self, _: u64, out: &mut Output<'_, u32, u32>) {
        self.spawned.fetch_add(1, Relaxed);
        if !self.holds_shading {
            self.hold();
        }
        (0..self.tile_rays).for_each(|_| out.ray(Ray::default(), 0));
    }

    fn shade(&self, batch: Batch<'_, u32>, _: &mut Output<'_, u32, u32>) {
        self.shaded.fetch_add(batch.rays.len() as u64, Relaxed);
        if self.holds_shading {
            self.hold();
        }
    }

    fn shadow(&self, _: &[Ray], _: &[u32], _: &[u32]) {}
}

/// A gated renderer that holds something until it is dropped.
pub struct Holder<G, T> {
    pub gated: G,
    pub held: T,
}

/// What a [`Holder`] holds.
pub trait Held: Send + Sync {
    /// Called before each shading, and after each spawning.
    fn check(&self) {}
}

impl<G: Deref<Target = Gated> + Send + Sync, T: Held> Renderer for Holder<G, T> {
    type Payload = u32;
    type ShadowPayload = u32;

    fn tiles(&self) -> u64 {
        self.gated.tiles()
    }

    fn tile_rays(&self) -> usize {
        self.gated.tile_rays()
    }

    fn shadow_rays_per_ray(&self) -> usize {
        self.gated.shadow_rays_per_ray()
    }

    fn most_in_flight(&self) -> usize {
        self.gated.most_in_flight()
    }

    fn spawn(&self, tile: u64, out: &mut Output<'_, u32, u32>) {
        self.gated.spawn(tile, out);
        self.held.check();
    }

    fn shade(&self, batch: Batch<'_, u32>, out: &mut Output<'_, u32, u32>) {
        self.held.check();
        self.gated.shade(batch, out);
    }

    fn shadow(&self, _: &[Ray], _: &[u32], _: &[u32]) {}
}

pub struct Blind;

impl Tracer for Blind {
    fn closest(&self, _: &[Ray], hits: &mut [Hit]) {
        hits.fill(Hit::NONE);
    }

    fn occluded(&self, _: &[Ray], occluded: &mut [u32]) {
        occluded.fill(0);
    }
}

pub fn blind() -> Tracers {
    Tracers::cpu(Arc::new(Blind))
}

pub fn wait_until(what: impl Fn() -> bool) {
    while !what() {
        std::thread::sleep(Duration::from_micros(100));
    }
}
