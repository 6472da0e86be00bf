//! What steers a unit that is under way.

use raystream::picture::Watch;
use raystream::schedule::Priority;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// Steers a unit and knows how far it is.
#[derive(Debug)]
pub struct UnitWatch {
    priority: Mutex<Priority>,
    is_stopped: AtomicBool,
    /// The bits of the share of the unit that is done.
    share: AtomicU64,
    rays: AtomicU64,
    /// When something last happened to it.
    moved: Mutex<Instant>,
}

impl UnitWatch {
    /// Of a unit that begins now.
    pub fn new(priority: Priority) -> Self {
        Self {
            priority: Mutex::new(priority),
            is_stopped: AtomicBool::new(false),
            share: AtomicU64::new(0),
            rays: AtomicU64::new(0),
            moved: Mutex::new(Instant::now()),
        }
    }

    /// Stops the unit soon.
    pub fn stop(&self) {
        self.is_stopped.store(true, Relaxed);
    }

    /// Changes how urgent it is.
    pub fn set_priority(&self, priority: Priority) {
        *self.priority.lock().expect("no holder panics") = priority;
    }

    /// The share of the unit that is done.
    pub fn share(&self) -> f64 {
        f64::from_bits(self.share.load(Relaxed))
    }

    /// True if it is to stop.
    pub fn is_stopped_now(&self) -> bool {
        self.is_stopped.load(Relaxed)
    }

    /// Rays that it has traced.
    pub fn rays(&self) -> u64 {
        self.rays.load(Relaxed)
    }

    /// Returns the time for which nothing has happened to it.
    pub fn still_for(&self) -> Duration {
        self.moved.lock().expect("no holder panics").elapsed()
    }
}

impl Watch for UnitWatch {
    fn priority(&self) -> Priority {
        *self.priority.lock().expect("no holder panics")
    }

    fn is_stopped(&self) -> bool {
        self.is_stopped.load(Relaxed)
    }

    fn traced(&self, rays: u64, seconds: f64) {
        self.rays.fetch_add(rays, Relaxed);
        metrics::counter!("raystream_rays_total").increment(rays);
        metrics::histogram!("raystream_unit_seconds").record(seconds);
    }

    fn progress(&self, share: f64) {
        let bits = share.clamp(0.0, 1.0).to_bits();
        if self.share.swap(bits, Relaxed) != bits {
            *self.moved.lock().expect("no holder panics") = Instant::now();
        }
    }
}
