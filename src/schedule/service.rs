//! The service: threads made once, jobs taken from any thread.

use super::handle::{JobHandle, ResultSlot};
use super::job::TypedJob;
use super::limits::Demand;
use super::pool::Pool;
use super::state::{Aftermath, Next, Receiver, State, Submission};
use super::task::{TaskSlot, Work, Workplace};
use super::{JobOptions, Limits, LimitsError, Renderer, ServiceOptions, Tracers, Unit};
use crate::stream::{ChunkScratch, drop_quietly, panic_message};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Condvar, Mutex, PoisonError, Weak};
use std::thread::JoinHandle;
use std::time::Instant;

/// Why a service could not be made.
#[derive(Debug, thiserror::Error)]
pub enum ServiceError {
    /// A number that must not be zero is.
    #[error("a service needs at least one {0}")]
    None(&'static str),
    /// The system gave no thread.
    #[error("cannot start thread {index} of {threads}: {source}; ask for fewer threads")]
    Thread {
        /// Which thread.
        index: usize,
        /// How many were asked for.
        threads: usize,
        /// What the system said.
        source: std::io::Error,
    },
}

/// Runs jobs: frames of any integrator, batches of ray queries. Host and dispatch threads are made
/// once and shared by all jobs; may itself be shared between threads. Dropping it cancels all jobs
/// and waits for its threads.
///
/// ```
/// use raystream::schedule::{JobOptions, Service, ServiceOptions, Tracers};
/// use raystream::stream::{Hit, Ray, Tracer};
/// use std::sync::Arc;
///
/// /// The plane y = 0, seen from above.
/// struct Floor;
///
/// impl Tracer for Floor {
///     fn closest(&self, rays: &[Ray], hits: &mut [Hit]) {
///         for (ray, hit) in rays.iter().zip(hits) {
///             let t = -ray.origin[1] / ray.direction[1];
///             *hit = if t >= 0.0 { Hit { t, u: 0.0, v: 0.0, primitive: 0 } } else { Hit::NONE };
///         }
///     }
///
///     fn occluded(&self, rays: &[Ray], occluded: &mut [u32]) {
///         for (ray, occluded) in rays.iter().zip(occluded) {
///             *occluded = u32::from(ray.direction[1] < 0.0);
///         }
///     }
/// }
///
/// let service = Service::new(ServiceOptions { host_threads: 2, ..ServiceOptions::default() })?;
/// let down = Ray { origin: [0.0, 3.0, 0.0], direction: [0.0, -1.0, 0.0], ..Ray::default() };
/// let up = Ray { direction: [0.0, 1.0, 0.0], ..down };
/// let tracers = Tracers::cpu(Arc::new(Floor));
/// let query = service.closest(tracers, Arc::new([down, up]), JobOptions::default())?;
/// let (hits, report) = query.wait()?;
/// assert_eq!((hits[0].t, hits[1].is_miss(), report.rays.camera), (3.0, true, 2));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Service {
    inner: Arc<Inner>,
    threads: Vec<JoinHandle<()>>,
}

/// What threads and handles share.
pub(super) struct Inner {
    state: Mutex<State>,
    /// One for each thread, to be woken singly.
    bells: Vec<Condvar>,
    pool: Pool,
    /// Of the jobs whose owners may be waiting.
    letterboxes: Mutex<Vec<Weak<ResultSlot>>>,
    hosts: usize,
    epoch: Instant,
}

impl Service {
    /// Starts the threads.
    ///
    /// # Errors
    /// [`ServiceError`] when a number is zero or the system gives no more threads.
    pub fn new(options: ServiceOptions) -> Result<Self, ServiceError> {
        let ServiceOptions { host_threads, dispatch_threads, max_jobs, sharing } = options;
        if host_threads == 0 {
            return Err(ServiceError::None("host thread"));
        }
        if max_jobs == 0 {
            return Err(ServiceError::None("job at a time"));
        }
        let threads = host_threads + dispatch_threads;
        let inner = Arc::new(Inner {
            state: Mutex::new(State::new(host_threads, dispatch_threads, max_jobs, sharing)),
            bells: (0..threads).map(|_| Condvar::new()).collect(),
            pool: Pool::new(max_jobs),
            letterboxes: Mutex::default(),
            hosts: host_threads,
            epoch: Instant::now(),
        });
        let mut service = Self { inner, threads: Vec::with_capacity(threads) };
        for index in 0..threads {
            let inner = Arc::clone(&service.inner);
            let name = match index.checked_sub(host_threads) {
                None => format!("host {index}"),
                Some(index) => format!("dispatch {index}"),
            };
            let thread = std::thread::Builder::new().name(name).spawn(move || inner.serve(index));
            // An error drops the service, which sends those home that have started.
            service.threads.push(thread.map_err(|source| ServiceError::Thread { index, threads, source })?);
        }
        Ok(service)
    }

    /// Threads that spawn, shade and trace.
    pub fn host_threads(&self) -> usize {
        self.inner.hosts
    }

    /// The moment from which [`super::JobReport::begin_ns`] counts.
    pub fn began(&self) -> Instant {
        self.inner.epoch
    }

    /// Frees the storage of streams that is kept for the next job.
    pub fn free_streams(&self) {
        self.inner.pool.clear();
    }

    /// Takes a job in. It begins at once or when its turn comes; `renderer` is called from the
    /// service's threads until the job has ended.
    ///
    /// # Errors
    /// [`LimitsError`] when sizes do not fit each other.
    pub fn submit<R: Renderer>(
        &self,
        renderer: Arc<R>,
        tracers: Tracers,
        options: JobOptions,
    ) -> Result<JobHandle, LimitsError> {
        let inner = &self.inner;
        let threads = (inner.hosts, inner.bells.len() - inner.hosts);
        let result = Arc::new(ResultSlot::default());
        let receiver = Arc::clone(&result) as _;
        let submission = prepare(renderer, tracers, &options, threads, &inner.pool, receiver)?;
        inner.expect(&result);
        let id = inner.change(|state, now_ns| state.submit(submission, now_ns));
        if id.is_none() {
            result.give_up("it broke earlier");
        }
        Ok(JobHandle::new(id, Arc::clone(inner), result))
    }
}

/// Makes a job of a renderer.
pub(super) fn prepare<R: Renderer>(
    renderer: Arc<R>,
    tracers: Tracers,
    options: &JobOptions,
    (hosts, dispatchers): (usize, usize),
    pool: &Pool,
    receiver: Arc<dyn Receiver>,
) -> Result<Submission, LimitsError> {
    let device_name = tracers.device.as_ref().map_or_else(String::new, |device| device.name().to_owned());
    let (unit, event) = match (tracers.unit, &tracers.device) {
        (Unit::Cpu, _) => (Unit::Cpu, None),
        (_, None) => (Unit::Cpu, Some("there is no GPU; host threads trace alone".to_owned())),
        (_, Some(_)) if dispatchers == 0 => {
            (Unit::Cpu, Some(format!("{device_name} is not used: the service has no dispatch threads")))
        }
        (unit, Some(_)) => (unit, None),
    };
    let tiles = renderer.tiles();
    let demand = Demand {
        tiles,
        tile_rays: renderer.tile_rays(),
        shadow_rays_per_ray: renderer.shadow_rays_per_ray(),
        most_in_flight: renderer.most_in_flight(),
        host_threads: hosts,
        dispatch_threads: if unit == Unit::Cpu { 0 } else { dispatchers },
        device: tracers.device.as_ref().and_then(|device| device.sizing()),
    };
    let place = Arc::new(Workplace {
        limits: Limits::derive(options, demand)?,
        renderer,
        tracers,
        device_name,
        hosts,
        desks: (0..hosts + dispatchers).map(|_| Mutex::new(TaskSlot::Clear)).collect(),
        abandoned: AtomicBool::new(false),
    });
    let work: Arc<dyn Work> = Arc::clone(&place) as Arc<dyn Work>;
    let events = event.into_iter().collect();
    let job = TypedJob::new(place, pool.take(), options, unit, tiles, events);
    Ok(Submission { job: Box::new(job), work, receiver })
}

impl Drop for Service {
    fn drop(&mut self) {
        self.inner.change(|state, now_ns| state.close(now_ns));
        let this = std::thread::current().id();
        for thread in self.threads.drain(..) {
            // A renderer may hold the last reference to the service: then one of its own threads is
            // here, which cannot wait for itself.
            if thread.thread().id() != this
                && let Err(payload) = thread.join()
            {
                drop_quietly(payload);
            }
        }
    }
}

impl Inner {
    fn now_ns(&self) -> u64 {
        self.epoch.elapsed().as_nanos() as u64
    }

    /// Changes the state and does what follows from it; none if a panic has broken the state.
    pub fn change<T>(&self, change: impl FnOnce(&mut State, u64) -> T) -> Option<T> {
        let changed = catch_unwind(AssertUnwindSafe(|| {
            let mut state = self.state.lock().ok()?;
            let value = change(&mut state, self.now_ns());
            Some((value, state.take_aftermath()))
        }));
        let (value, aftermath) = changed.unwrap_or_else(|payload| {
            self.give_up(&panic_message(payload));
            None
        })?;
        self.conclude(aftermath);
        Some(value)
    }

    fn expect(&self, result: &Arc<ResultSlot>) {
        let mut letterboxes = self.letterboxes.lock().unwrap_or_else(PoisonError::into_inner);
        letterboxes.retain(|result| result.strong_count() > 0);
        letterboxes.push(Arc::downgrade(result));
    }

    /// A panic under the lock is a bug of the scheduler: let nobody wait for ever.
    fn give_up(&self, why: &str) {
        let letterboxes = self.letterboxes.lock().unwrap_or_else(PoisonError::into_inner);
        letterboxes.iter().filter_map(Weak::upgrade).for_each(|result| result.give_up(why));
        self.bells.iter().for_each(Condvar::notify_one);
    }

    /// Wakes threads, and delivers results once their jobs' own code has been let go of. Not under
    /// the lock: that code may use the service.
    fn conclude(&self, aftermath: Aftermath) {
        let Aftermath { wake, wake_all, ended } = aftermath;
        if wake_all {
            self.bells.iter().for_each(Condvar::notify_one);
        } else {
            wake.into_iter().flatten().for_each(|thread| self.bells[thread].notify_one());
        }
        for ended in ended {
            let Submission { job, work, receiver } = ended.submission;
            job.retire(&self.pool);
            drop_quietly(work);
            receiver.receive(ended.last, ended.outcome);
        }
    }

    /// A thread's life.
    fn serve(&self, thread: usize) {
        if let Err(payload) = catch_unwind(AssertUnwindSafe(|| self.work(thread))) {
            self.give_up(&panic_message(payload));
        }
    }

    /// Returns when the service closes, or is broken.
    fn work(&self, thread: usize) -> Option<()> {
        let mut scratch = ChunkScratch::default();
        let mut state = self.state.lock().ok()?;
        loop {
            let next = state.next(thread, self.now_ns());
            let aftermath = state.take_aftermath();
            drop(state);
            self.conclude(aftermath);
            match next {
                Next::Work(work) => {
                    work.work(thread, &mut scratch);
                    drop(work);
                    state = self.state.lock().ok()?;
                    state.finish(thread, self.now_ns());
                }
                Next::Sleep => {
                    let state_now = self.state.lock().ok()?;
                    state = self.bells[thread].wait_while(state_now, |state| state.is_asleep(thread)).ok()?;
                }
                Next::Exit => return None,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::JobError;
    use super::super::tests::{Gated, blind, wait_until};
    use super::*;
    use std::sync::atomic::Ordering::Relaxed;

    #[test]
    fn nobody_waits_for_a_broken_scheduler() {
        let service = Service::new(ServiceOptions { host_threads: 2, ..Default::default() }).unwrap();
        let gated = Gated::new();
        let submit = || service.submit(Arc::clone(&gated), blind(), JobOptions::default()).unwrap();
        let job = submit();
        wait_until(|| gated.spawned.load(Relaxed) > 0);
        let bug = || std::panic::resume_unwind(Box::new("a bug"));
        assert!(service.inner.change(|_, _| bug()).is_none());
        assert_eq!(job.progress(), Default::default());
        assert_eq!(job.wait(), Err(JobError::Broken("a bug".to_owned())));
        assert_eq!(submit().wait(), Err(JobError::Broken("it broke earlier".to_owned())));
        gated.open();
    }
}
