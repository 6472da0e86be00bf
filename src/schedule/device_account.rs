//! What is known of a job's device: how fast it is, and what it costs the host.

use super::policy::{DevicePace, Line, Pace};

/// What a bundle with the device counts for.
pub(super) struct BundleAccount {
    pub submitted_ns: u64,
    /// Rays and shadow rays of this job that the device had before.
    pub ahead: u64,
    /// The time at which each stream became full, if it waited in TRACE.
    pub full_ns: Vec<Option<u64>>,
}

/// How long bundles took from their submission to their answer, by the rays that the device had then: the line of least
/// squares.
#[derive(Default)]
struct Turnaround {
    bundles: f64,
    rays: f64,
    ns: f64,
    rays_squared: f64,
    rays_ns: f64,
}

impl Turnaround {
    fn note(&mut self, rays: f64, ns: f64) {
        self.bundles += 1.0;
        self.rays += rays;
        self.ns += ns;
        self.rays_squared += rays * rays;
        self.rays_ns += rays * ns;
    }

    /// The line. All of the time is the rays' until there are bundles of several sizes.
    fn line(&self) -> Line {
        let Self { bundles, rays, ns, rays_squared, rays_ns } = *self;
        if bundles == 0.0 {
            return Line::default();
        }
        let spread = bundles * rays_squared - rays * rays;
        let mut slope = ns / rays;
        if spread > 1e-3 * rays * rays {
            slope = ((bundles * rays_ns - rays * ns) / spread).clamp(0.0, slope);
        }
        Line { ns_for_1024: (1024.0 * slope) as u64, latency_ns: ((ns - slope * rays) / bundles) as u64 }
    }
}

/// What is known of a job's device.
#[derive(Default)]
pub(super) struct DeviceAccount {
    /// The times at which the streams of the bundle that is being submitted became full.
    pub full_ns: Vec<Option<u64>>,
    /// When the last bundle was traced.
    last_ns: u64,
    /// Bundles submitted, and the thread's time.
    pub submitted: u64,
    pub submitting_ns: u64,
    /// Rays resolved, and the threads' time.
    pub resolving: Pace,
    turnaround: Turnaround,
}

impl DeviceAccount {
    /// True until a bundle has been submitted.
    pub fn is_new(&self) -> bool {
        self.submitted == 0
    }

    /// True once a bundle has been resolved.
    pub fn is_known(&self) -> bool {
        self.resolving.rays > 0
    }

    /// Notes a bundle that the device has traced; returns when the device turned to it.
    pub fn note(&mut self, rays: u64, bundle: &BundleAccount, end_ns: u64) -> u64 {
        let &BundleAccount { submitted_ns, ahead, .. } = bundle;
        self.turnaround.note((rays + ahead) as f64, (end_ns - submitted_ns) as f64);
        let start_ns = submitted_ns.max(self.last_ns);
        self.last_ns = end_ns;
        start_ns
    }

    pub fn view(&self) -> DevicePace {
        DevicePace {
            bundles: self.submitted,
            submit_ns: self.submitting_ns / self.submitted.max(1),
            resolving: self.resolving,
            turnaround: self.turnaround.line(),
        }
    }
}
