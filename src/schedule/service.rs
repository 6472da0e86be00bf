//! The service: owns the threads, takes jobs from any thread.

use super::any_renderer::Start;
use super::pool::Pool;
use super::result::ResultSlot;
use super::state::{Effects, Next, Receiver, State, Submission};
use super::task::Work;
use super::workers::{Role, Workers, in_role};
use super::{
    AnyRenderer, JobControl, JobHandle, JobOptions, Limits, LimitsError, Renderer, ServiceOptions, Tracers,
    Unit,
};
use crate::stream::{ChunkScratch, drop_quietly, panic_message};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, PoisonError, Weak};
use std::thread::JoinHandle;
use std::time::Instant;

/// Reason why a service could not be started.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ServiceError {
    /// There are no host threads, or no job may run.
    #[error("a service needs at least one {0}")]
    None(&'static str),
    /// The operating system refused a thread.
    #[error("cannot start thread {index} of {threads}: {source}; ask for fewer threads")]
    Thread {
        /// Index of the thread.
        index: usize,
        /// How many threads were requested.
        threads: usize,
        /// The system's error.
        source: std::io::Error,
    },
}

/// Stack of each thread of a service. Kernels and shaders compiled without optimisation keep every temporary on the
/// stack, which overflows the usual 2 MiB. Address space only: pages are committed when they are first touched.
pub(super) const STACK_BYTES: usize = 16 << 20;

/// Runs jobs: frames of any integrator, batches of ray queries. Its threads are started once and
/// shared by all jobs. The service may be shared between threads. Dropping it cancels all jobs and waits for its
/// threads.
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
/// let service = Service::new(ServiceOptions::default().with_host_threads(2))?;
/// let down = Ray { origin: [0.0, 3.0, 0.0], direction: [0.0, -1.0, 0.0], ..Ray::default() };
/// let up = Ray { direction: [0.0, 1.0, 0.0], ..down };
/// let tracers = Tracers::cpu(Arc::new(Floor));
/// let query = service.closest(tracers, Arc::new([down, up]), JobOptions::default())?;
/// let (hits, report) = query.wait()?;
/// assert_eq!((hits[0].t, hits[1].is_miss(), report.rays.camera), (3.0, true, 2));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Service {
    pub(super) inner: Arc<Inner>,
    threads: Vec<JoinHandle<()>>,
}

/// What threads and handles share.
pub(super) struct Inner {
    state: Mutex<State>,
    /// One for each thread, so that threads can be woken one by one.
    wakers: Vec<Condvar>,
    pub(super) pool: Pool,
    /// Of the jobs for which a thread may be waiting.
    results: Mutex<Vec<Weak<ResultSlot>>>,
    pub(super) hosts: usize,
    /// The host threads, if they are a pool's workers.
    pub(super) workers: Option<Workers>,
    epoch: Instant,
}

impl std::fmt::Debug for Service {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (hosts, device_thread) = self.inner.threads();
        let mut fields = f.debug_struct("Service");
        fields.field("host_threads", &hosts).field("device_thread", &device_thread).finish_non_exhaustive()
    }
}

impl Service {
    /// Starts the threads.
    ///
    /// # Errors
    /// [`ServiceError`] when a number is zero or the operating system refuses a thread.
    pub fn new(options: ServiceOptions) -> Result<Self, ServiceError> {
        let &ServiceOptions { host_threads, device_thread, max_jobs, max_queries, .. } = &options;
        let needed =
            [(host_threads, "host thread"), (max_jobs, "job at a time"), (max_queries, "query at a time")];
        if let Some((_, what)) = needed.into_iter().find(|(number, _)| *number == 0) {
            return Err(ServiceError::None(what));
        }
        let threads = host_threads + usize::from(device_thread);
        let mut state = State::new(&options);
        if options.rayon_pool.is_some() {
            // No worker has a seat before there is work.
            (0..host_threads).for_each(|seat| drop(state.next(seat, 0)));
        }
        let inner = Arc::new_cyclic(|inner| Inner {
            workers: options.rayon_pool.map(|pool| Workers::new(pool, Weak::clone(inner), host_threads)),
            state: Mutex::new(state),
            wakers: (0..threads).map(|_| Condvar::new()).collect(),
            pool: Pool::new(max_jobs),
            results: Mutex::default(),
            hosts: host_threads,
            epoch: Instant::now(),
        });
        let mut service = Self { inner, threads: Vec::with_capacity(threads) };
        let first = if service.inner.workers.is_some() { host_threads } else { 0 };
        for index in first..threads {
            let inner = Arc::clone(&service.inner);
            let name = if index < host_threads { format!("host {index}") } else { "device".to_owned() };
            let thread = std::thread::Builder::new().name(name).stack_size(STACK_BYTES);
            let thread = thread.spawn(move || inner.serve(index));
            // An error drops the service, which stops the threads that have started.
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

    /// Frees the streams that are kept for the next job.
    pub fn free_streams(&self) {
        self.inner.pool.clear();
    }

    /// Submits a job. It begins at once, or when fewer than `max_jobs` run. The service's threads call `renderer` until
    /// the job has ended.
    ///
    /// # Errors
    /// [`LimitsError`] when sizes do not fit each other, or when the renderer and the tracers have different scenes.
    pub fn submit<R: Renderer + 'static>(
        &self,
        renderer: Arc<R>,
        tracers: Tracers,
        options: JobOptions,
    ) -> Result<JobHandle, LimitsError> {
        self.submit_any(renderer.erased(), tracers, &options, false)
    }

    pub(super) fn submit_any(
        &self,
        renderer: AnyRenderer,
        tracers: Tracers,
        options: &JobOptions,
        is_query: bool,
    ) -> Result<JobHandle, LimitsError> {
        let inner = &self.inner;
        let result = Arc::new(ResultSlot::default());
        let receiver = Arc::clone(&result) as _;
        let submission = Submission {
            is_query,
            ..prepare(renderer, tracers, options, inner.threads(), &inner.pool, receiver)?
        };
        inner.track(&result);
        let id = inner.change(|state, now_ns| state.submit(submission, now_ns));
        if id.is_none() {
            result.give_up("it broke earlier");
        }
        Ok(JobHandle::new(JobControl::new(id, options.name.clone(), Arc::clone(inner), result)))
    }
}

/// Makes a job that runs a renderer.
pub(super) fn prepare(
    renderer: AnyRenderer,
    tracers: Tracers,
    options: &JobOptions,
    (hosts, device_thread): (usize, bool),
    pool: &Pool,
    receiver: Arc<dyn Receiver>,
) -> Result<Submission, LimitsError> {
    if let (Some(traced), Some(shaded)) = (&tracers.scene, renderer.scene_id())
        && *traced != shaded
    {
        return Err(LimitsError::OtherScene);
    }
    let device_name = tracers.device.as_ref().map_or_else(String::new, |device| device.name().to_owned());
    let (unit, event) = unit_used(&tracers, &device_name, device_thread);
    let bundle_rays = tracers.device.as_ref().and_then(|device| device.bundle_rays());
    let limits = Limits::derive(options, renderer.demand(hosts, unit != Unit::Cpu, bundle_rays))?;
    let threads = hosts + usize::from(device_thread);
    let events = event.into_iter().collect();
    let start = Start { tracers, device_name, limits, unit, hosts, threads, events };
    let (job, work) = renderer.job(start, options, pool);
    Ok(Submission { job, work, receiver, priority: options.priority, is_query: false })
}

/// What traces a job's rays on a service with or without a device thread, and what there is to say about it.
pub(super) fn unit_used(tracers: &Tracers, device: &str, device_thread: bool) -> (Unit, Option<String>) {
    match (tracers.unit, &tracers.device) {
        (Unit::Cpu, _) => (Unit::Cpu, None),
        (_, None) => (Unit::Cpu, Some("there is no GPU; host threads trace alone".to_owned())),
        (_, Some(_)) if !device_thread => {
            (Unit::Cpu, Some(format!("{device} is not used: the service has no device thread")))
        }
        (unit, Some(_)) => (unit, None),
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        self.inner.change(|state, now_ns| state.close(now_ns));
        let this = std::thread::current().id();
        for thread in self.threads.drain(..) {
            // A renderer may hold the last reference to the service. Then one of the service's own threads runs this,
            // and it cannot wait for itself.
            if thread.thread().id() != this
                && let Err(payload) = thread.join()
            {
                drop_quietly(payload);
            }
        }
        if let Some(workers) = &self.inner.workers {
            workers.wait();
        }
        // Handles may live on.
        self.inner.pool.close();
    }
}

impl Inner {
    pub fn now_ns(&self) -> u64 {
        self.epoch.elapsed().as_nanos() as u64
    }

    /// The number of host threads, and true if there is a device thread.
    pub fn threads(&self) -> (usize, bool) {
        (self.hosts, self.wakers.len() > self.hosts)
    }

    /// Changes the state and applies the effects. `None` if a panic has broken the state.
    pub fn change<T>(&self, change: impl FnOnce(&mut State, u64) -> T) -> Option<T> {
        let changed = catch_unwind(AssertUnwindSafe(|| {
            let mut state = self.state.lock().ok()?;
            let value = change(&mut state, self.now_ns());
            Some((value, state.take_effects()))
        }));
        let (value, effects) = changed.unwrap_or_else(|payload| {
            self.give_up(&panic_message(payload));
            None
        })?;
        self.apply(effects);
        Some(value)
    }

    /// Remembers a job's result slot, for [`Inner::give_up`].
    fn track(&self, result: &Arc<ResultSlot>) {
        let mut results = self.results.lock().unwrap_or_else(PoisonError::into_inner);
        results.retain(|result| result.strong_count() > 0);
        results.push(Arc::downgrade(result));
    }

    /// After a panic under the lock, which is a bug of the scheduler: delivers an error to all who wait.
    fn give_up(&self, why: &str) {
        let results = self.results.lock().unwrap_or_else(PoisonError::into_inner);
        let results: Vec<_> = results.iter().filter_map(Weak::upgrade).collect();
        // A scope waits until the renderers that its jobs have borrowed are dropped.
        let jobs = self.state.lock().unwrap_or_else(PoisonError::into_inner).abandon();
        jobs.into_iter().for_each(drop_quietly);
        results.iter().for_each(|result| result.give_up(why));
        self.wakers.iter().for_each(Condvar::notify_one);
    }

    /// Wakes threads; drops the renderers of jobs that have ended, then delivers the results. Called without the lock,
    /// since a renderer's `Drop` may use the service.
    fn apply(&self, effects: Effects) {
        let Effects { wake, wake_all, ended, dropped } = effects;
        dropped.into_iter().for_each(drop_quietly);
        if wake_all {
            // Only when the service closes, which needs no worker to take a seat.
            self.wakers.iter().for_each(Condvar::notify_one);
        } else {
            wake.into_iter().flatten().for_each(|thread| match &self.workers {
                Some(workers) if thread < self.hosts => workers.seat(thread),
                _ => self.wakers[thread].notify_one(),
            });
        }
        for ended in ended {
            let Submission { job, work, receiver, .. } = ended.submission;
            let mut outcome = ended.outcome;
            if let Ok(report) = &mut outcome {
                report.warnings = work.warnings();
            }
            job.retire(&self.pool);
            drop_quietly(work);
            receiver.deliver(outcome);
        }
    }

    /// A thread's life.
    fn serve(&self, thread: usize) {
        if let Err(payload) = catch_unwind(AssertUnwindSafe(|| self.work(thread))) {
            self.give_up(&panic_message(payload));
        }
    }

    /// What a worker of a rayon pool does in a seat. Returns when there is no work, or when the worker cannot have the
    /// seat.
    pub fn serve_seat(&self, seat: usize) {
        let role = Role::Seated(std::ptr::from_ref(self) as usize);
        let serve =
            AssertUnwindSafe(|| in_role(role, |former| self.sit(seat, former == role, former == Role::Free)));
        if let Err(payload) = catch_unwind(serve) {
            self.give_up(&panic_message(payload));
        }
    }

    /// Does tasks in a seat: all that there are if the worker is `free`, else one, since the worker has something else
    /// to come back to.
    fn sit(&self, seat: usize, has_seat: bool, is_free: bool) -> Option<()> {
        let workers = self.workers.as_ref()?;
        if has_seat {
            // This worker has another seat of this service, which it has left between two tasks: it goes back to that.
            self.state.lock().ok()?.decline(seat, self.now_ns());
            return None;
        }
        loop {
            let mut state = self.state.lock().ok()?;
            let next = state.next(seat, self.now_ns());
            let effects = state.take_effects();
            drop(state);
            self.apply(effects);
            let Next::Work(work) = next else { return None };
            let has_woken = self.do_work(workers, seat, work)?;
            if !is_free {
                workers.seat(seat);
                return None;
            }
            // Another worker is to take the seat that has just been woken.
            if !has_woken {
                workers.pause(seat);
            }
        }
    }

    /// Does one task in a seat that this worker has left, if there is one.
    pub fn do_task(&self, seat: usize) -> Option<()> {
        let workers = self.workers.as_ref()?;
        let mut state = self.state.lock().ok()?;
        let work = state.try_next(seat, self.now_ns());
        let effects = state.take_effects();
        drop(state);
        self.apply(effects);
        let role = Role::Seated(std::ptr::from_ref(self) as usize);
        in_role(role, |_| self.do_work(workers, seat, work?)).map(|_| ())
    }

    /// Does a seat's task; tells whether that has woken another seat.
    fn do_work(&self, workers: &Workers, seat: usize, work: Arc<dyn Work>) -> Option<bool> {
        let cpu_ns = work.work(seat, &mut workers.scratch(seat));
        drop(work);
        let mut state = self.state.lock().ok()?;
        state.finish(seat, self.now_ns(), cpu_ns);
        state.pause(self.now_ns());
        let effects = state.take_effects();
        drop(state);
        let has_woken = effects.wake[0].is_some();
        self.apply(effects);
        Some(has_woken)
    }

    /// Returns when the service closes or is broken.
    fn work(&self, thread: usize) -> Option<()> {
        let mut scratch = ChunkScratch::default();
        let mut state = self.state.lock().ok()?;
        loop {
            let next = state.next(thread, self.now_ns());
            let effects = state.take_effects();
            drop(state);
            self.apply(effects);
            match next {
                Next::Work(work) => {
                    let cpu_ns = work.work(thread, &mut scratch);
                    drop(work);
                    state = self.state.lock().ok()?;
                    state.finish(thread, self.now_ns(), cpu_ns);
                }
                Next::Sleep => {
                    let state_now = self.state.lock().ok()?;
                    state =
                        self.wakers[thread].wait_while(state_now, |state| state.is_asleep(thread)).ok()?;
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
    fn a_broken_scheduler_keeps_no_caller_waiting() {
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

    #[test]
    fn a_scope_ends_when_the_scheduler_breaks() {
        let service = Service::new(ServiceOptions { host_threads: 2, ..Default::default() }).unwrap();
        let gated = Gated::new();
        let broken = service.scope(|scope| {
            let jobs = [0, 1].map(|_| scope.submit(&*gated, blind(), JobOptions::default()).unwrap());
            wait_until(|| gated.spawned.load(Relaxed) > 0);
            service.inner.change(|_, _| std::panic::resume_unwind(Box::new("a bug")));
            gated.open();
            jobs.map(|job| job.wait().unwrap_err())
        });
        assert_eq!(broken, [0, 1].map(|_| JobError::Broken("a bug".to_owned())));
    }
}
