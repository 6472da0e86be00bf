//! What a device is given: how full its queue is, and under [`super::Policy::MeasuredRate`] what its rays cost.

use super::super::limits::BUNDLE_STREAMS;
use super::{Load, Pace, Rule, View};

/// Bundles with a device: it traces one, and the next is there when it is done.
pub const QUEUED: usize = 2;

/// How fast a job's device has been so far, and what it has cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DevicePace {
    /// Bundles submitted.
    pub bundles: u64,
    /// Nanoseconds of the device thread to submit one.
    pub submit_ns: u64,
    /// Host threads that resolved streams.
    pub resolving: Pace,
    /// How long a bundle takes.
    pub turnaround: Line,
}

/// Nanoseconds from a bundle's submission to its answer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Line {
    /// For each 1024 rays that the device then has, those of the bundle included.
    pub ns_for_1024: u64,
    /// Besides.
    pub latency_ns: u64,
}

impl Line {
    fn ns_for(self, rays: u64) -> u64 {
        scaled(rays, self.ns_for_1024, 1024).saturating_add(self.latency_ns)
    }
}

impl View {
    /// What host threads do before anything else under [`super::Policy::MeasuredRate`]: trace the first rays that there
    /// are, to know how fast they are, and fill the next bundle while the device has others.
    pub(super) fn before_measured(&self, load: Load) -> Option<Rule> {
        if self.cpu.rays == 0 {
            return Some(Rule::Flush);
        }
        (self.trace_rays < self.bundle_rays && self.device_pays(load)).then_some(Rule::Spawn)
    }

    /// True if there is room for a bundle: the device has none, or it has one and the next is full or will not be.
    pub(super) fn has_room(&self, load: Load) -> bool {
        load.queued == 0
            || load.queued < QUEUED && (self.trace_rays >= self.bundle_rays || self.no_more_is_to_come(load))
    }

    /// True if the lists have full streams for which the device will have no room soon.
    pub(super) fn exceeds_the_device(&self, load: Load) -> bool {
        load.queued >= QUEUED && (self.trace_rays > self.bundle_rays || self.no_more_is_to_come(load))
    }

    /// True if host threads would have traced one more stream before the device had traced its first bundle, which is
    /// half done on average, or if it is not known how late the device will be.
    pub(super) fn hosts_are_sooner(&self, load: Load) -> bool {
        if self.device.resolving.rays == 0 {
            return true;
        }
        let stream = self.trace_rays as u64 / self.trace.max(1) as u64;
        let hosts_ns = self.cpu.ns_for(stream).unwrap_or(0) / load.hosts.max(1) as u64;
        let bundle = self.on_device_rays / self.on_device.max(1) as u64;
        hosts_ns <= self.device.turnaround.ns_for(bundle) / 2
    }

    /// True if host threads that have nothing else to do may take a stream from the device: no other work is to come,
    /// and as far as is known they have traced it sooner than the device its bundles, which are half done on average.
    pub(super) fn may_be_reclaimed(&self, load: Load) -> bool {
        let others = self.slot || self.trace > 0 || self.need_more > 0;
        if self.with_device == 0 || others || !self.no_more_is_to_come(load) {
            return false;
        }
        if self.device.resolving.rays == 0 {
            return true;
        }
        let stream = self.on_device_rays / self.with_device.max(1) as u64;
        let hosts_ns = self.cpu.ns_for(stream).map(|ns| ns / load.hosts.max(1) as u64);
        hosts_ns.is_some_and(|ns| ns <= self.device.turnaround.ns_for(self.on_device_rays) / 2)
    }

    /// No task would fill a stream, until a device has traced one.
    fn no_more_is_to_come(&self, load: Load) -> bool {
        self.shade == 0 && self.answered == 0 && !self.allows(Rule::Spawn, load)
    }

    /// True if the device is to have a bundle: its rays cost host threads less than tracing them would, and it answers
    /// so early that host threads need not wait for it. Host threads have traced before, and until a first bundle
    /// is resolved, which is one stream, there is no second.
    pub(super) fn device_pays(&self, load: Load) -> bool {
        if self.cpu.rays == 0 || self.device.resolving.rays == 0 {
            return self.cpu.rays > 0 && self.device.bundles == 0;
        }
        let waiting = if self.trace > 0 { self.trace_rays } else { self.need_more_rays };
        let rays = waiting.min(self.bundle_rays) as u64;
        let cost_ns = self.device.resolving.ns_for(rays).unwrap_or(0).saturating_add(self.device.submit_ns);
        self.cpu.ns_for(rays).is_some_and(|ns| cost_ns < ns) && self.device_answers_in_time(rays, load)
    }

    /// True if host threads that leave these rays to the device do not wait for work longer than they would trace them
    /// themselves.
    fn device_answers_in_time(&self, rays: u64, load: Load) -> bool {
        let (ahead, hosts) = (self.on_device_rays, load.hosts.max(1) as u64);
        let trace_ns = |rays| self.cpu.ns_for(rays).unwrap_or(0);
        let shade_ns = |rays| self.shading.ns_for(rays).unwrap_or(0);
        // Of host threads, for all that follows from rays.
        let rest_ns = |rays| trace_ns(rays).saturating_add(shade_ns(rays)) / hosts;
        let after_ns = |rays| rest_ns(self.lengths.rays_from(rays)).saturating_sub(trace_ns(rays) / hosts);
        let given = self.lengths.rays_from(ahead + rays);
        let others_ns = rest_ns(self.lengths.rays_of(self.paths_left).saturating_sub(given));
        // One thread shades a stream, and the others wait for what it emits.
        let stream = rays / self.trace.clamp(1, BUNDLE_STREAMS) as u64;
        let alone_ns = (hosts - 1) * shade_ns(stream) / hosts;
        let turnaround = self.device.turnaround;
        let (mut idle_ns, mut busy_ns) = (0, others_ns);
        if ahead > 0 {
            let ahead_ns = turnaround.ns_for(ahead);
            idle_ns = ahead_ns.saturating_sub(others_ns);
            busy_ns = ahead_ns.max(others_ns).saturating_add(after_ns(ahead));
        }
        idle_ns += (turnaround.ns_for(ahead + rays) + alone_ns).saturating_sub(busy_ns);
        idle_ns <= trace_ns(rays) / hosts
    }
}

/// How long a job's paths are, by what has become of rays so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PathLengths {
    /// Rays shaded, without shadow rays.
    pub shaded: u64,
    /// Rays that these were followed by, without shadow rays.
    pub continued: u64,
    /// Rays emitted, without shadow rays.
    pub rays: u64,
    /// Shadow rays emitted.
    pub shadow_rays: u64,
}

impl PathLengths {
    /// Rays and shadow rays that so many paths still have.
    fn rays_of(self, paths: u64) -> u64 {
        self.rays_from(scaled(paths, self.rays + self.shadow_rays, self.rays))
    }

    /// Rays and shadow rays that will follow from so many, these included: rays end with the same probability at any
    /// hit.
    fn rays_from(self, rays: u64) -> u64 {
        scaled(rays, self.shaded, self.shaded - self.continued.min(self.shaded))
    }
}

/// `count` × `by` / `of`, or `count` if it is not known.
fn scaled(count: u64, by: u64, of: u64) -> u64 {
    let scaled = u128::from(count) * u128::from(by) / u128::from(of.max(1));
    if of == 0 { count } else { scaled.min(u128::from(u64::MAX)) as u64 }
}
