//! The watchdog: limits how long a dispatch may take before its device counts as hung.
//!
//! The limit is [`FACTOR`] times the slowest dispatch so far, clamped between two bounds for the kind of adapter.
//! Before any dispatch has returned it is the upper bound. A waiting thread reads the limit again and again, so a wait
//! that began with the upper bound becomes shorter as other dispatches return.

use super::AdapterKind;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// How much slower than the slowest so far a dispatch may be. Streams differ by what their rays hit and by how many
/// others wait in the device's queue.
const FACTOR: u64 = 64;

/// Limits how long a dispatch may take.
#[derive(Debug)]
pub(crate) struct Watchdog {
    /// The lower bound of the limit.
    least: Duration,
    /// The upper bound of the limit.
    most: Duration,
    slowest_ns: AtomicU64,
}

impl Watchdog {
    pub fn new(least: Duration, most: Duration) -> Self {
        Self { least, most, slowest_ns: AtomicU64::new(0) }
    }

    /// Between 2 and 10 seconds; between 5 and 60 for software adapters, which share the CPU of a busy machine.
    pub fn of(kind: AdapterKind) -> Self {
        let (least, most) = if kind == AdapterKind::Software { (5, 60) } else { (2, 10) };
        Self::new(Duration::from_secs(least), Duration::from_secs(most))
    }

    /// The upper bound of the limit.
    #[cfg(feature = "wgsl")]
    pub fn most(&self) -> Duration {
        self.most
    }

    /// The time that a dispatch may take now.
    pub fn limit(&self) -> Duration {
        match self.slowest_ns.load(Ordering::Relaxed) {
            0 => self.most,
            ns => Duration::from_nanos(ns.saturating_mul(FACTOR)).clamp(self.least, self.most),
        }
    }

    /// Records a dispatch that has returned.
    pub fn record(&self, took: Duration) {
        let ns = u64::try_from(took.as_nanos()).unwrap_or(u64::MAX);
        self.slowest_ns.fetch_max(ns.max(1), Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_limit_follows_the_slowest_dispatch_within_its_bounds() {
        let watchdog = Watchdog::new(Duration::from_secs(2), Duration::from_secs(10));
        let after = |ms| {
            watchdog.record(Duration::from_millis(ms));
            watchdog.limit()
        };
        assert_eq!(watchdog.limit(), Duration::from_secs(10));
        assert_eq!(after(1), Duration::from_secs(2));
        assert_eq!(after(100), Duration::from_millis(6400));
        assert_eq!(after(1), Duration::from_millis(6400));
        assert_eq!(after(60_000), Duration::from_secs(10));
    }
}
