//! Contenders, and the rays of each.

use super::{Kind, Order, Workload};
use raystream::stream::{DeviceError, Ray};
use std::sync::Arc;
use std::time::Instant;

/// The rays of a kind in one order.
pub struct InOrder {
    pub order: Order,
    all: Arc<[Ray]>,
    /// One chunk of 1024 rays in eight, for slow contenders.
    few: Arc<[Ray]>,
}

impl InOrder {
    pub fn new(workload: &Workload, kind: Kind, order: Order) -> Self {
        let all = workload.rays(kind, order);
        let few = all.chunks(1024).step_by(8).flatten().copied().collect();
        Self { order, all: all.into(), few }
    }
}

/// Traces rays once and returns the seconds that took.
pub type Round<'a> = Box<dyn FnMut(&Arc<[Ray]>) -> Result<f64, DeviceError> + 'a>;

/// A participant.
pub struct Contender<'a> {
    pub name: String,
    pub threads: usize,
    pub simd: Option<&'static str>,
    /// True if it is watertight.
    pub is_robust: bool,
    /// True if it gets one ray in eight.
    pub is_slow: bool,
    /// Measures one round. Work that a user would not do for each call (converting rays, allocating) is outside its
    /// seconds.
    pub round: Round<'a>,
}

impl Contender<'_> {
    /// Its rays.
    pub fn rays<'r>(&self, rays: &'r InOrder) -> &'r Arc<[Ray]> {
        if self.is_slow { &rays.few } else { &rays.all }
    }

    /// Traces its rays once; returns the seconds that took.
    pub fn trace(&mut self, rays: &InOrder) -> Result<f64, DeviceError> {
        let rays = self.rays(rays);
        (self.round)(rays)
    }
}

/// Times work on a pool.
#[derive(Clone, Copy)]
pub struct Clock<'a> {
    pub pool: &'a rayon::ThreadPool,
}

impl Clock<'_> {
    pub fn threads(self) -> usize {
        self.pool.current_num_threads()
    }

    /// Seconds that `work` takes on the pool.
    pub fn seconds(self, work: impl FnOnce() + Send) -> f64 {
        self.pool.install(|| {
            // Sleeping threads are woken first: that may take a millisecond where the system puts two threads on one
            // core.
            rayon::broadcast(|_| ());
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64()
        })
    }
}
