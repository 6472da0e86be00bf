//! One device and its containment: errors, losses and panics of wgpu reach the rest of the program as an error value
//! and as nothing else.

use super::adapter::{AdapterChoice, AdapterInfo, FoundAdapter};
use super::host_memory::HostMemory;
use super::kernel_cache::KernelCache;
use super::replacement::DeviceReplacement;
use super::watchdog::Watchdog;
use super::{Fault, GpuError, probe};
use crate::stream::panic_message;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// How long one call of `poll` waits; between calls the thread looks whether the device is lost. Longer than
/// dispatches take: wgpu 30 panics ("If the queue is empty ...") when a wait has timed out and another thread sees the
/// submission done at the same moment.
const POLL_INTERVAL: Duration = Duration::from_secs(2);

/// How long a thread sleeps between two looks at a submission.
const LOOK_INTERVAL: Duration = Duration::from_micros(50);

/// Why the device is lost; set once.
type LossReason = Arc<OnceLock<String>>;

/// A GPU: adapter, device and queue. Opened once, shared by all scenes and threads. A lost device stays lost; tracers
/// go on with a replacement, a bounded number of times.
#[derive(Debug)]
pub struct Gpu {
    pub(crate) info: AdapterInfo,
    device: wgpu::Device,
    queue: wgpu::Queue,
    loss: LossReason,
    pub(crate) watchdog: Watchdog,
    history: Arc<AdapterHistory>,
    pub(super) replacement: DeviceReplacement,
    /// The kernels of exact hits of the scenes so far.
    pub(crate) kernels: KernelCache,
    /// True if streams may lie in memory that the device shares with the host.
    pub(crate) can_share_memory: bool,
    /// Rays of a bundle, if that has been measured.
    pub(crate) bundle_rays: Option<usize>,
}

/// What a device and its replacements have in common.
#[derive(Debug, Default)]
struct AdapterHistory {
    /// The fault to inject.
    fault: Option<Fault>,
    /// Dispatches of rays so far.
    dispatches: AtomicU64,
}

impl Gpu {
    /// Opens the adapter that fits the choice, with the adapter's own limits.
    ///
    /// # Errors
    /// When no adapter fits, or the driver refuses; the message lists the adapters found.
    pub fn open(choice: &AdapterChoice) -> Result<Self, GpuError> {
        Self::open_found(FoundAdapter::find(choice)?)
    }

    /// Opens an adapter that has been found, with its own limits.
    ///
    /// # Errors
    /// When the driver refuses, or its arithmetic is not what the kernels need.
    pub fn open_found(found: FoundAdapter) -> Result<Self, GpuError> {
        let FoundAdapter { adapter, info } = found;
        let request = || pollster::block_on(adapter.request_device(&descriptor(&adapter)));
        let opened = match catch_unwind(AssertUnwindSafe(request)) {
            Ok(opened) => opened.map_err(|e| e.to_string()),
            Err(panic) => Err(driver_panic(panic)),
        };
        let (device, queue) =
            opened.map_err(|reason| GpuError::Open { adapter: info.to_string(), reason })?;

        let loss = LossReason::default();
        let (on_loss, on_error) = (loss.clone(), loss.clone());
        device.set_device_lost_callback(move |reason, message| {
            let _ = on_loss.set(format!("{message} ({reason:?})").trim().to_owned());
        });
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let _ = on_error.set(error.to_string());
        }));
        let watchdog = Watchdog::of(info.kind);
        let mut gpu = Self {
            info,
            device,
            queue,
            loss,
            watchdog,
            history: Arc::default(),
            replacement: DeviceReplacement::default(),
            kernels: KernelCache::default(),
            can_share_memory: false,
            bundle_rays: None,
        };
        let refused = |reason: String| GpuError::Open { adapter: gpu.info.to_string(), reason };
        let results = gpu.guard(|device, queue| probe::compute(&gpu, device, queue)).map_err(refused)?;
        probe::judge(&results)
            .map_err(|reason| GpuError::Arithmetic { adapter: gpu.info.to_string(), reason })?;
        let shared = gpu.attempt(|device, _| HostMemory::new(device, 1).is_some());
        gpu.can_share_memory = matches!(shared, Ok(Ok(true)));
        Ok(gpu)
    }

    /// Injects a fault, once.
    pub fn with_fault(self, fault: Fault) -> Self {
        Self { history: Arc::new(AdapterHistory { fault: Some(fault), ..AdapterHistory::default() }), ..self }
    }

    /// This freshly opened device as the replacement of a lost one.
    pub(super) fn replacing(self, lost: &Self, replacement: DeviceReplacement) -> Self {
        Self { history: lost.history.clone(), replacement, bundle_rays: lost.bundle_rays, ..self }
    }

    /// The adapter in use.
    pub fn info(&self) -> &AdapterInfo {
        &self.info
    }

    /// Why the device is lost, if it is.
    pub fn lost(&self) -> Option<&str> {
        self.loss.get().map(String::as_str)
    }

    /// Destroys the device as a driver reset would. For tests and fault injection.
    pub fn simulate_loss(&self) {
        let _ = catch_unwind(AssertUnwindSafe(|| self.device.destroy()));
    }

    /// Runs `work`, which uses wgpu. Any failure loses the device for good: an error that `work` returns, an uncaptured
    /// error of wgpu, or a panic.
    ///
    /// # Errors
    /// Why the device is lost.
    pub fn guard<T>(
        &self,
        work: impl FnOnce(&wgpu::Device, &wgpu::Queue) -> Result<T, String>,
    ) -> Result<T, String> {
        if let Some(reason) = self.lost() {
            return Err(reason.to_owned());
        }
        let answer = catch_unwind(AssertUnwindSafe(|| work(&self.device, &self.queue)))
            .unwrap_or_else(|panic| Err(driver_panic(panic)));
        match (answer, self.lost()) {
            (Ok(answer), None) => Ok(answer),
            (_, Some(reason)) => Err(reason.to_owned()),
            (Err(reason), None) => Err(self.loss.get_or_init(|| reason).clone()),
        }
    }

    /// Like [`Gpu::guard`], for work that may be refused without losing the device: errors that wgpu reports meanwhile
    /// are returned as the inner error.
    pub(crate) fn attempt<T>(
        &self,
        work: impl FnOnce(&wgpu::Device, &wgpu::Queue) -> T,
    ) -> Result<Result<T, String>, String> {
        self.guard(|device, queue| {
            let filters =
                [wgpu::ErrorFilter::Internal, wgpu::ErrorFilter::OutOfMemory, wgpu::ErrorFilter::Validation];
            let scopes = filters.map(|filter| device.push_error_scope(filter));
            let done = work(device, queue);
            // Scopes are popped in reverse order. The first error is returned.
            let errors = scopes.into_iter().rev().map(|scope| pollster::block_on(scope.pop()));
            let error = errors.fold(None, |first, next| first.or(next));
            Ok(match error {
                Some(error) => Err(error.to_string()),
                None => Ok(done),
            })
        })
    }

    /// Numbers a dispatch, from 1; returns the fault to inject into it.
    pub(crate) fn next_dispatch(&self) -> (u64, Option<Fault>) {
        let number = self.history.dispatches.fetch_add(1, Ordering::Relaxed) + 1;
        (number, self.history.fault.filter(|fault| fault.dispatch() == Some(number)))
    }

    /// The fault to inject, unless it has happened or cannot happen at a dispatch.
    pub fn idle_fault(&self) -> Option<Fault> {
        let dispatches = self.history.dispatches.load(Ordering::Relaxed);
        self.history.fault.filter(|fault| fault.dispatch().is_some_and(|at| at > dispatches))
    }

    /// The fault to inject.
    pub(crate) fn fault(&self) -> Option<Fault> {
        self.history.fault
    }

    /// True if the fault is injected that the device has no memory for scenes.
    pub(crate) fn has_no_memory(&self) -> bool {
        self.history.fault == Some(Fault::OutOfMemory)
    }

    /// Gives up a device that answers wrongly, and its adapter with it; returns why the device is lost.
    pub(crate) fn mark_untrusted(&self, reason: String) -> String {
        self.replacement.forbid();
        self.loss.get_or_init(|| reason).clone()
    }

    /// Looks whether a submission is done, within [`Gpu::guard`], for at most about `timeout`. One that takes longer
    /// than the watchdog allows counts as a loss.
    pub(crate) fn look(
        &self,
        submission: &wgpu::SubmissionIndex,
        is_done: &AtomicBool,
        submitted: Instant,
        timeout: Duration,
    ) -> Result<bool, String> {
        let start = Instant::now();
        loop {
            let left = timeout.saturating_sub(start.elapsed());
            if left >= POLL_INTERVAL {
                // A driver knows how to wait; what it says is looked up below.
                let index = Some(submission.clone());
                let interval = POLL_INTERVAL.min(self.watchdog.limit());
                let wait = wgpu::PollType::Wait { submission_index: index, timeout: Some(interval) };
                match self.device.poll(wait) {
                    Ok(_) | Err(wgpu::PollError::Timeout) => {}
                    Err(error) => return Err(error.to_string()),
                }
            } else {
                self.device.poll(wgpu::PollType::Poll).map_err(|error| error.to_string())?;
            }
            if is_done.load(Ordering::Acquire) {
                return Ok(true);
            }
            if let Some(reason) = self.lost() {
                return Err(reason.to_owned());
            }
            self.watch(submitted, self.watchdog.limit())?;
            if left.is_zero() {
                return Ok(false);
            }
            if left < POLL_INTERVAL {
                std::thread::sleep(LOOK_INTERVAL.min(left));
            }
        }
    }

    /// Gives up a device whose submission takes longer than it may.
    fn watch(&self, submitted: Instant, limit: Duration) -> Result<(), String> {
        if submitted.elapsed() < limit {
            return Ok(());
        }
        // Dropping the queue would wait for the submission without end.
        std::mem::forget((self.device.clone(), self.queue.clone()));
        Err(format!("a dispatch did not return within {limit:?}"))
    }

    /// Waits for a submission, within [`Gpu::guard`]; returns how long that took. A submission that takes longer than
    /// the watchdog allows counts as a loss, and no thread waits for the device again.
    pub(crate) fn wait(&self, submission: &wgpu::SubmissionIndex) -> Result<Duration, String> {
        self.wait_within(submission, || self.watchdog.limit())
    }

    /// [`Gpu::wait`] within another limit.
    fn wait_within(
        &self,
        submission: &wgpu::SubmissionIndex,
        limit: impl Fn() -> Duration,
    ) -> Result<Duration, String> {
        let poll = |timeout| {
            let wait =
                wgpu::PollType::Wait { submission_index: Some(submission.clone()), timeout: Some(timeout) };
            match self.device.poll(wait) {
                Ok(_) => Ok(true),
                Err(wgpu::PollError::Timeout) => Ok(false),
                Err(error) => Err(error.to_string()),
            }
        };
        self.wait_until(poll, limit)
    }

    /// [`Gpu::wait`] for a dispatch of a shader; the watchdog learns how long it took. The first dispatches of a
    /// kernel have the watchdog's upper bound, because drivers may compile meanwhile.
    #[cfg(feature = "wgsl")]
    pub(crate) fn wait_for_shading(
        &self,
        submission: &wgpu::SubmissionIndex,
        is_first: bool,
    ) -> Result<(), String> {
        if is_first {
            return self.wait_within(submission, || self.watchdog.most()).map(drop);
        }
        self.watchdog.record(self.wait(submission)?);
        Ok(())
    }

    /// Waits as for a dispatch that never returns.
    pub(crate) fn simulate_hang(&self) -> String {
        let never = |timeout| {
            std::thread::sleep(timeout);
            Ok(false)
        };
        self.wait_until(never, || self.watchdog.limit()).expect_err("it never returns")
    }

    /// Polls until something is done; returns how long that took.
    fn wait_until(
        &self,
        mut poll: impl FnMut(Duration) -> Result<bool, String>,
        limit: impl Fn() -> Duration,
    ) -> Result<Duration, String> {
        let start = Instant::now();
        loop {
            if poll(POLL_INTERVAL.min(limit()))? {
                return Ok(start.elapsed());
            }
            // Another thread may have noticed a loss meanwhile.
            if let Some(reason) = self.lost() {
                return Err(reason.to_owned());
            }
            self.watch(start, limit())?;
        }
    }
}

/// Requests the adapter's own limits for what the kernels use.
fn descriptor(adapter: &wgpu::Adapter) -> wgpu::DeviceDescriptor<'static> {
    let limits = adapter.limits();
    wgpu::DeviceDescriptor {
        label: Some("raystream"),
        required_limits: wgpu::Limits {
            max_storage_buffer_binding_size: limits.max_storage_buffer_binding_size,
            max_buffer_size: limits.max_buffer_size,
            max_storage_buffers_per_shader_stage: limits.max_storage_buffers_per_shader_stage,
            max_buffers_and_acceleration_structures_per_shader_stage: limits
                .max_buffers_and_acceleration_structures_per_shader_stage,
            max_compute_workgroups_per_dimension: limits.max_compute_workgroups_per_dimension,
            ..wgpu::Limits::downlevel_defaults()
        },
        // Shaders' kernels go to the driver as they are (`program::gpu`), and kernels are timed
        // (`trace/gpu/measurement.rs`).
        required_features: adapter.features()
            & (wgpu::Features::PASSTHROUGH_SHADERS | wgpu::Features::TIMESTAMP_QUERY),
        memory_hints: wgpu::MemoryHints::Performance,
        ..Default::default()
    }
}

fn driver_panic(panic: Box<dyn std::any::Any + Send>) -> String {
    format!("panic in the driver: {}", panic_message(panic))
}
