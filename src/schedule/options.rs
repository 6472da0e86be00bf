//! What a caller chooses: for the service, and for each job.

use super::{Policy, Sharing, Unit};
use crate::stream::{DeviceTracer, Tracer};
use std::sync::Arc;

/// How a [`super::Service`] is made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServiceOptions {
    /// Threads that spawn, shade and trace; at least 1.
    pub host_threads: usize,
    /// Threads that feed devices; they mostly wait. 0 when no job will have a device.
    pub dispatch_threads: usize,
    /// Jobs that run at a time, at least 1; others wait their turn. Bounds memory.
    pub max_jobs: usize,
    /// How threads are shared between jobs.
    pub sharing: Sharing,
}

impl Default for ServiceOptions {
    /// A host thread for every hardware thread, RA's four dispatch threads, four jobs.
    fn default() -> Self {
        let host_threads = std::thread::available_parallelism().map_or(1, usize::from);
        Self { host_threads, dispatch_threads: 4, max_jobs: 4, sharing: Sharing::Fair }
    }
}

/// How a job is run. The picture does not depend on any of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct JobOptions {
    /// N, the most paths in flight. Default: with a device RA's 256k, more for many threads or one that likes large
    /// streams; without, 32k for each thread.
    pub in_flight: Option<usize>,
    /// Paths from which a stream counts as full. Default: with a device what it likes
    /// ([`DeviceTracer::sizing`]), or RA's 11k if that is unknown; up to 8k without; less for small jobs.
    pub threshold: Option<usize>,
    /// Most rays of a shade batch (RA: 8192).
    pub batch_rays: usize,
    /// Rays a host thread traces at once while a device is fed, and the fewest otherwise (RA: 1024).
    pub chunk_rays: usize,
    /// Most rays a host thread traces at once.
    pub chunk_rays_most: usize,
    /// Whether streams become full earlier at the tail, so that the last ones keep all host threads busy; only to
    /// measure what that brings.
    pub shrink_streams: bool,
    /// The order of rules. Default: RA's for the unit, [`Policy::of`].
    pub policy: Option<Policy>,
    /// Whether the report holds a record of every task.
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
    /// Which of them are used. Without a device the host is, and the report says so.
    pub unit: Unit,
}

impl Tracers {
    /// Host threads alone.
    pub fn cpu(host: Arc<dyn Tracer>) -> Self {
        Self { host, device: None, unit: Unit::Cpu }
    }
}
