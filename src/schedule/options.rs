//! What a caller chooses for the service and for each job.

use super::{Policy, Priority, SceneId, Sharing, Unit};
use crate::stream::{DeviceTracer, Tracer};
use rayon::ThreadPool;
use std::sync::Arc;

/// Options of a [`super::Service`].
///
/// ```
/// use raystream::schedule::ServiceOptions;
///
/// let options = ServiceOptions::default().with_host_threads(2).with_max_jobs(3);
/// assert_eq!((options.host_threads, options.max_jobs), (2, 3));
/// ```
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct ServiceOptions {
    /// Threads that spawn, shade and trace; at least 1. As many as there are workers with [`Self::rayon_pool`].
    pub host_threads: usize,
    /// True if there is a thread that submits to devices and waits for them. Without it no job has a device.
    pub device_thread: bool,
    /// The most jobs that run at the same time, at least 1; others are queued. Bounds memory. Queries and interactive
    /// jobs do not count.
    pub max_jobs: usize,
    /// The most queries that run at the same time besides those jobs, and the most interactive jobs and queries besides
    /// both; at least 1. Others are queued. Bounds memory.
    pub max_queries: usize,
    /// The rule that shares threads between jobs of the same priority.
    pub sharing: Sharing,
    /// The pool whose workers are the host threads, instead of threads of the service's own
    /// ([`Self::with_rayon_pool`]).
    pub rayon_pool: Option<Arc<ThreadPool>>,
}

impl Default for ServiceOptions {
    /// A host thread for every hardware thread, a device thread, four jobs at the same time and 32 queries.
    fn default() -> Self {
        let host_threads = std::thread::available_parallelism().map_or(1, usize::from);
        Self {
            host_threads,
            device_thread: true,
            max_jobs: 4,
            max_queries: 32,
            sharing: Sharing::Fair,
            rayon_pool: None,
        }
    }
}

impl ServiceOptions {
    /// Sets [`Self::host_threads`].
    pub fn with_host_threads(self, host_threads: usize) -> Self {
        Self { host_threads, ..self }
    }

    /// Sets [`Self::device_thread`].
    pub fn with_device_thread(self, device_thread: bool) -> Self {
        Self { device_thread, ..self }
    }

    /// Sets [`Self::max_jobs`].
    pub fn with_max_jobs(self, max_jobs: usize) -> Self {
        Self { max_jobs, ..self }
    }

    /// Sets [`Self::max_queries`].
    pub fn with_max_queries(self, max_queries: usize) -> Self {
        Self { max_queries, ..self }
    }

    /// Sets [`Self::sharing`].
    pub fn with_sharing(self, sharing: Sharing) -> Self {
        Self { sharing, ..self }
    }

    /// Makes the workers of a rayon pool the host threads, as many as there are. A process that builds trees or traces
    /// with [`crate::query`] in the same pool has one set of busy threads then, not two:
    ///
    /// ```
    /// use raystream::schedule::{Service, ServiceOptions};
    /// use std::sync::Arc;
    ///
    /// let pool = rayon::ThreadPoolBuilder::new().num_threads(2).stack_size(16 << 20).build()?;
    /// let pool = Arc::new(pool);
    /// let service = Service::new(ServiceOptions::default().with_rayon_pool(Arc::clone(&pool)))?;
    /// assert_eq!(service.host_threads(), 2);
    /// // pool.install(|| Mesh::build(..)): a worker takes part in it as soon as it has done its task.
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// Workers are the pool's while the service has nothing for them to do, and between two tasks they do what else
    /// waits in the pool. A worker may wait for a job of the service: it does tasks meanwhile.
    pub fn with_rayon_pool(self, pool: Arc<ThreadPool>) -> Self {
        Self { host_threads: pool.current_num_threads(), rayon_pool: Some(pool), ..self }
    }
}

/// Options of a job. The picture does not depend on them.
///
/// ```
/// use raystream::schedule::{JobOptions, Priority};
///
/// let options = JobOptions::default().with_name("left eye").with_priority(Priority::Interactive);
/// assert_eq!(options.name.as_deref(), Some("left eye"));
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct JobOptions {
    /// The name of the job in errors and reports.
    pub name: Option<Arc<str>>,
    /// The rank among jobs that want threads. [`super::JobControl::set_priority`] changes it later.
    pub priority: Priority,
    /// N, the most paths in flight.
    ///
    /// Default: 64k for each host thread, or twice `threshold` if that is more; with a device, three bundles more.
    /// Never fewer than a tile's, nor more than the renderer has memory for ([`super::Renderer::most_in_flight`]).
    pub in_flight: Option<usize>,
    /// Paths from which a stream counts as full.
    ///
    /// Default: 16k, less for small jobs. A device takes several streams at once ([`DeviceTracer::bundle_rays`]).
    pub threshold: Option<usize>,
    /// The most rays of a batch (RA: 8192).
    pub batch_rays: usize,
    /// The fewest rays that a host thread traces at once, where there are as many (RA: 1024).
    pub chunk_rays: usize,
    /// The most rays that a host thread traces at once.
    pub chunk_rays_most: usize,
    /// The most rays of a query that the calling thread traces itself, before [`super::Service::closest`] returns:
    /// faster than waking another thread. 0 leaves all rays to the service's threads.
    pub caller_rays: usize,
    /// True if streams become full earlier at the tail, so that the last ones keep all host threads busy. Turned off
    /// only to measure the gain.
    pub shrink_streams: bool,
    /// The order of the rules, and what the device is given. Default: [`Policy::of`] the unit.
    pub policy: Option<Policy>,
    /// True if the report gets a record of every task.
    pub timeline: bool,
}

impl Default for JobOptions {
    fn default() -> Self {
        Self {
            name: None,
            priority: Priority::Normal,
            in_flight: None,
            threshold: None,
            batch_rays: 8192,
            chunk_rays: 1024,
            chunk_rays_most: 64 * 1024,
            caller_rays: 512,
            shrink_streams: true,
            policy: None,
            timeline: false,
        }
    }
}

impl JobOptions {
    /// Sets [`Self::name`].
    pub fn with_name(self, name: impl Into<Arc<str>>) -> Self {
        Self { name: Some(name.into()), ..self }
    }

    /// Sets [`Self::priority`].
    pub fn with_priority(self, priority: Priority) -> Self {
        Self { priority, ..self }
    }

    /// Sets [`Self::in_flight`].
    pub fn with_in_flight(self, paths: usize) -> Self {
        Self { in_flight: Some(paths), ..self }
    }

    /// Sets [`Self::threshold`].
    pub fn with_threshold(self, paths: usize) -> Self {
        Self { threshold: Some(paths), ..self }
    }

    /// Sets [`Self::batch_rays`].
    pub fn with_batch_rays(self, batch_rays: usize) -> Self {
        Self { batch_rays, ..self }
    }

    /// Sets [`Self::chunk_rays`] and [`Self::chunk_rays_most`].
    pub fn with_chunk_rays(self, least: usize, most: usize) -> Self {
        Self { chunk_rays: least, chunk_rays_most: most, ..self }
    }

    /// Sets [`Self::caller_rays`].
    pub fn with_caller_rays(self, caller_rays: usize) -> Self {
        Self { caller_rays, ..self }
    }

    /// Sets [`Self::shrink_streams`].
    pub fn with_shrink_streams(self, shrink_streams: bool) -> Self {
        Self { shrink_streams, ..self }
    }

    /// Sets [`Self::policy`]; `None` is [`Policy::of`] the unit.
    pub fn with_policy(self, policy: impl Into<Option<Policy>>) -> Self {
        Self { policy: policy.into(), ..self }
    }

    /// Sets [`Self::timeline`].
    pub fn with_timeline(self, timeline: bool) -> Self {
        Self { timeline, ..self }
    }
}

/// The tracers of a job's rays.
#[derive(Clone)]
#[non_exhaustive]
pub struct Tracers {
    /// Traces on host threads.
    pub host: Arc<dyn Tracer>,
    /// Traces on a device; it may be lost at any time.
    pub device: Option<Arc<dyn DeviceTracer>>,
    /// The units that trace. Without a device host threads trace in any case, and the report says so.
    pub unit: Unit,
    /// The scene that they trace. `None` accepts the renderers of any scene.
    pub scene: Option<SceneId>,
}

impl Tracers {
    /// Host threads alone, for the renderers of any scene.
    pub fn cpu(host: Arc<dyn Tracer>) -> Self {
        Self { host, device: None, unit: Unit::Cpu, scene: None }
    }

    /// Adds a device.
    pub fn with_device(self, device: Arc<dyn DeviceTracer>, unit: Unit) -> Self {
        Self { device: Some(device), unit, ..self }
    }

    /// Sets [`Self::unit`].
    pub fn with_unit(self, unit: Unit) -> Self {
        Self { unit, ..self }
    }

    /// The same tracers for the renderers of this scene alone.
    pub fn for_scene(self, scene: SceneId) -> Self {
        Self { scene: Some(scene), ..self }
    }
}

impl std::fmt::Debug for Tracers {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { host: _, device, unit, scene } = self;
        let device = device.as_ref().map(|device| device.name());
        f.debug_struct("Tracers").field("device", &device).field("unit", unit).field("scene", scene).finish()
    }
}
