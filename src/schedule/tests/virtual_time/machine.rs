//! What tasks cost on a modelled machine.

use super::frame::{GRAIN, Rays};
use crate::stream::Sizing;

/// Rays of a stream that a core's own caches hold: the threshold of host threads alone (`Limits`).
const CACHED_RAYS: f64 = 16.0 * 1024.0;

/// Rays of a stream on the H100, for which [`Scene::slowdown`] is stated.
pub const H100_STREAM: usize = 68_608;

/// What the rays of a scene cost a host thread, in nanoseconds of a core that it has to itself.
#[derive(Clone, Copy, Debug)]
pub struct Scene {
    pub name: &'static str,
    pub rays: Rays,
    /// Tracing a ray.
    pub trace_ns: f64,
    /// Shading a ray, shadow rays included.
    pub shade_ns: f64,
    /// Making a hit of a device's candidate.
    pub resolve_ns: f64,
    /// How much longer tracing and shading take in streams of [`H100_STREAM`] rays, which leave the caches.
    pub slowdown: f64,
}

impl Scene {
    /// How much longer hosts take for a ray of a stream with this many: by the share that caches do not hold.
    pub fn slowdown_at(&self, stream_rays: usize) -> f64 {
        let share = |rays: f64| (1.0 - CACHED_RAYS / rays).max(0.0);
        1.0 + (self.slowdown - 1.0) * share(stream_rays as f64) / share(H100_STREAM as f64)
    }
}

/// A modelled device.
#[derive(Clone, Copy, Debug)]
pub struct Device {
    /// The kernel's time for a ray.
    pub ray_ns: f64,
    /// From the last byte of a submission on its way to its answers in sight, besides the kernel.
    pub latency_ns: f64,
    /// Bytes a nanosecond, each way.
    pub bus: f64,
    /// Processor time of a submission, under the queue's lock.
    pub submit_ns: f64,
    /// Until a thread that waits for that lock runs, if no core is idle.
    pub handover_ns: f64,
    /// What the first dispatch of each thread takes longer: memory is pinned, buffers are made.
    pub first_ns: f64,
    pub sizing: Sizing,
}

/// Bytes that a ray takes up and its answer down; a shadow ray's answer takes 4.
const RAY_BYTES: f64 = 32.0;
const HIT_BYTES: f64 = 16.0;
const OCCLUDED_BYTES: f64 = 4.0;

impl Device {
    /// How long a dispatch of so many rays and shadow rays occupies the bus upwards, the kernels, the bus downwards.
    pub fn stages(&self, [rays, shadow_rays]: [u64; 2]) -> [f64; 3] {
        let (rays, shadow_rays) = (rays as f64, shadow_rays as f64);
        [
            (rays + shadow_rays) * RAY_BYTES / self.bus,
            (rays + shadow_rays) * self.ray_ns,
            (rays * HIT_BYTES + shadow_rays * OCCLUDED_BYTES) / self.bus,
        ]
    }

    /// The sizes that calibration would choose (`trace::gpu::calibration`), where a ray on a host thread takes
    /// `host_ns`.
    pub fn calibrated(mut self, host_ns: f64, resolve_ns: f64, cores: usize) -> Self {
        let dispatch_ns = self.submit_ns + self.latency_ns;
        let ray_ns = self.stages([1, 0]).iter().sum::<f64>() + resolve_ns;
        let within = |rays: f64| (rays as usize).clamp(GRAIN, 1 << 18).next_multiple_of(GRAIN);
        let threshold = within(7.0 * dispatch_ns / ray_ns);
        let ahead = host_ns - ray_ns;
        let least = if ahead > 0.0 { within(dispatch_ns / ahead).min(threshold) } else { threshold };
        // Streams in flight share the processor in resolving and the device in tracing; more must be faster by a tenth.
        let rays = threshold as f64;
        let serial = self.stages([threshold as u64, 0]).into_iter().fold(self.submit_ns, f64::max);
        let alone = dispatch_ns + rays * ray_ns;
        let seconds = |n: usize| (alone / n as f64).max(serial).max(rays * resolve_ns / cores as f64);
        let candidates = [1, 2, 4, 8, 16].into_iter().filter(|&n| n <= cores.max(4));
        let in_flight =
            candidates.reduce(|best, n| if seconds(n) * 1.1 < seconds(best) { n } else { best }).unwrap_or(1);
        self.sizing = Sizing { threshold, least, in_flight };
        self
    }
}

/// Threads that share cores evenly.
#[derive(Clone, Copy, Debug)]
pub struct Machine {
    pub hosts: usize,
    pub cores: usize,
    pub device: Option<Device>,
}
