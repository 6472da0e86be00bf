//! What steers a unit that is under way.

use crate::schedule::Priority;
use crate::serve::Watch;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};

/// Steers a unit and knows how far it is.
#[derive(Debug)]
pub struct UnitWatch {
    priority: Mutex<Priority>,
    is_stopped: AtomicBool,
    /// The bits of the share of the unit that is done.
    share: AtomicU64,
    /// The share of the job that the unit is.
    weight: f64,
}

impl UnitWatch {
    /// Of a unit that is this share of its job.
    pub fn new(priority: Priority, weight: f64) -> Self {
        let (priority, is_stopped) = (Mutex::new(priority), AtomicBool::new(false));
        Self { priority, is_stopped, share: AtomicU64::new(0), weight }
    }

    /// Stops the unit soon.
    pub fn stop(&self) {
        self.is_stopped.store(true, Relaxed);
    }

    /// Changes how urgent it is.
    pub fn set_priority(&self, priority: Priority) {
        *self.priority.lock().expect("no holder panics") = priority;
    }

    /// The share of its job that the unit has done.
    pub fn share(&self) -> f64 {
        self.weight * f64::from_bits(self.share.load(Relaxed))
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
        metrics::counter!("raystream_rays_total").increment(rays);
        metrics::histogram!("raystream_unit_seconds").record(seconds);
    }

    fn progress(&self, share: f64) {
        self.share.store(share.clamp(0.0, 1.0).to_bits(), Relaxed);
    }
}
