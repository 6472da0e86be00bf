//! What tasks cost on a modelled machine.

use super::frame::{GRAIN, Rays};

/// What the rays of a scene cost a host thread, in nanoseconds of a core that it has to itself.
#[derive(Clone, Copy, Debug)]
pub struct Scene {
    pub name: &'static str,
    pub rays: Rays,
    /// Tracing a ray.
    pub trace_ns: f64,
    /// Shading a ray, shadow rays included.
    pub shade_ns: f64,
    /// Making a hit of what a device has written.
    pub resolve_ns: f64,
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
    /// Processor time of a submission.
    pub submit_ns: f64,
    /// Rays of a bundle.
    pub bundle_rays: usize,
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

    /// The same with the bundles that calibration would choose (`trace::gpu::calibration`): the fixed cost is an
    /// eighth.
    pub fn calibrated(mut self) -> Self {
        let fixed_ns = self.submit_ns + self.latency_ns;
        let ray_ns = self.stages([1, 0]).iter().sum::<f64>();
        let rays = (7.0 * fixed_ns / ray_ns) as usize;
        self.bundle_rays = rays.clamp(GRAIN, 1 << 18).next_multiple_of(GRAIN);
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
