//! What a caller chooses for the service and for each job.

use super::{Policy, Sharing, Unit};
use crate::stream::{DeviceTracer, Tracer};
use std::sync::Arc;

/// How a [`super::Service`] is made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServiceOptions {
    /// Threads that spawn, shade and trace; at least 1.
    pub host_threads: usize,
    /// Threads that wait for devices. 0 if no job will have a device.
    pub dispatch_threads: usize,
    /// The most jobs that run at the same time, at least 1; others are queued. Bounds memory.
    pub max_jobs: usize,
    /// How threads are shared between jobs.
    pub sharing: Sharing,
}

impl Default for ServiceOptions {
    /// A host thread for every hardware thread, RA's four dispatch threads, four jobs at the same time.
    fn default() -> Self {
        let host_threads = std::thread::available_parallelism().map_or(1, usize::from);
        Self { host_threads, dispatch_threads: 4, max_jobs: 4, sharing: Sharing::Fair }
    }
}

/// How a job is run. The picture does not depend on these options.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct JobOptions {
    /// N, the most paths in flight.
    ///
    /// Default without a device: 64k for each host thread, or twice `threshold` if that is more. Default with a device:
    /// RA's 256k, or as many full streams as threads trace them if that is more. Never fewer than a tile's, nor more
    /// than the renderer has memory for ([`super::Renderer::most_in_flight`]).
    pub in_flight: Option<usize>,
    /// Paths from which a stream counts as full.
    ///
    /// Default without a device: 16k, less for small jobs. Default with a device: its measured size
    /// ([`DeviceTracer::sizing`]), less for small jobs, or RA's 11k if the device has not been measured.
    pub threshold: Option<usize>,
    /// The most rays of a batch (RA: 8192).
    pub batch_rays: usize,
    /// Rays that a host thread traces at once for a job with a device, and the fewest otherwise (RA: 1024).
    pub chunk_rays: usize,
    /// The most rays that a host thread traces at once.
    pub chunk_rays_most: usize,
    /// Whether streams become full earlier at the tail, so that the last ones keep all host threads busy. Turned off
    /// only to measure the gain.
    pub shrink_streams: bool,
    /// The order of the rules. Default: RA's for the unit, [`Policy::of`].
    pub policy: Option<Policy>,
    /// Whether the report gets a record of every task.
    pub timeline: bool,
}

impl Default for JobOptions {
    fn default() -> Self {
        Self {
            in_flight: None,
            threshold: None,
            batch_rays: 8192,
            chunk_rays: 1024,
            chunk_rays_most: 64 * 1024,
            shrink_streams: true,
            policy: None,
            timeline: false,
        }
    }
}

/// What traces a job's rays.
#[derive(Clone)]
pub struct Tracers {
    /// Traces on host threads.
    pub host: Arc<dyn Tracer>,
    /// Traces on a device; it may be lost at any time.
    pub device: Option<Arc<dyn DeviceTracer>>,
    /// Which of the two trace. Without a device host threads trace in any case, and the report says so.
    pub unit: Unit,
}

impl Tracers {
    /// Host threads alone.
    pub fn cpu(host: Arc<dyn Tracer>) -> Self {
        Self { host, device: None, unit: Unit::Cpu }
    }
}
