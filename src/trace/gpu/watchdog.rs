//! The watchdog: how long a dispatch may take before its device counts as hung.
//!
//! The limit is [`SLACK`] times the slowest dispatch so far, but within bounds that the kind of adapter gives;
//! before any dispatch has returned it is the upper bound. A wait looks at the limit again and again, so one
//! that began with the upper bound shortens as other dispatches return.

use super::AdapterKind;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// How much slower than the slowest so far a dispatch may be. Streams differ by what their rays meet and
/// by how many others wait in the device's queue.
const SLACK: u64 = 64;

/// How long a dispatch may take.
#[derive(Debug)]
pub(super) struct Watchdog {
    /// No dispatch is given less.
    least: Duration,
    /// Nor more.
    most: Duration,
    slowest_ns: AtomicU64,
}

impl Watchdog {
    pub fn new(least: Duration, most: Duration) -> Self {
        Self { least, most, slowest_ns: AtomicU64::new(0) }
    }

    /// Software adapters share a busy machine's CPU.
    pub fn of(kind: AdapterKind) -> Self {
        let (least, most) = if kind == AdapterKind::Software { (5, 60) } else { (2, 10) };
        Self::new(Duration::from_secs(least), Duration::from_secs(most))
    }

    /// What a dispatch may take now.
    pub fn limit(&self) -> Duration {
        match self.slowest_ns.load(Ordering::Relaxed) {
            0 => self.most,
            ns => Duration::from_nanos(ns.saturating_mul(SLACK)).clamp(self.least, self.most),
        }
    }

    /// A dispatch has returned.
    pub fn note(&self, took: Duration) {
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
            watchdog.note(Duration::from_millis(ms));
            watchdog.limit()
        };
        assert_eq!(watchdog.limit(), Duration::from_secs(10));
        assert_eq!(after(1), Duration::from_secs(2));
        assert_eq!(after(100), Duration::from_millis(6400));
        assert_eq!(after(1), Duration::from_millis(6400));
        assert_eq!(after(60_000), Duration::from_secs(10));
    }
}
