//! One device behind one wall: nothing that happens to wgpu behind it, an error, a loss, a panic,
//! reaches the rest of the program as anything but an error value.

use super::adapter::{AdapterChoice, AdapterInfo, choose, enumerate};
use super::device_replacement::DeviceReplacement;
use super::host_memory::HostMemory;
use super::tuning_cache::TunedSizes;
use super::watchdog::Watchdog;
use super::{Fault, GpuError, device_tree, probe};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// How long a wait goes on before it looks whether the device is lost. Longer than dispatches take: wgpu 30 panics
/// ("If the queue is empty ...") when a wait has timed out and another thread sees the submission done just then.
const NAP: Duration = Duration::from_secs(2);

/// Why the device is gone; set once.
type Loss = Arc<OnceLock<String>>;

/// A GPU: adapter, device and queue. Made once, shared by all scenes and threads. When the device
/// is lost it stays lost; tracers go on with another that is opened in its place, a bounded number of times.
#[derive(Debug)]
pub struct Gpu {
    pub(super) info: AdapterInfo,
    device: wgpu::Device,
    queue: wgpu::Queue,
    loss: Loss,
    pub(super) watchdog: Watchdog,
    history: Arc<History>,
    pub(super) succession: DeviceReplacement,
    /// Whether streams may lie in memory of the device's lending.
    pub(super) lends: bool,
    /// What it likes, if that has been measured.
    pub(super) tuned: Option<TunedSizes>,
}

/// What a device and those that take its place have in common.
#[derive(Debug, Default)]
struct History {
    /// What is to go wrong on purpose.
    fault: Option<Fault>,
    /// Dispatches so far.
    dispatches: AtomicU64,
}

impl Gpu {
    /// Opens the adapter that fits the choice, with the adapter's own limits.
    ///
    /// # Errors
    /// When there is none, or the driver refuses; the message lists the adapters there are.
    pub fn open(choice: &AdapterChoice) -> Result<Self, GpuError> {
        let found = enumerate();
        let infos: Vec<AdapterInfo> = found.iter().map(AdapterInfo::of).collect();
        let index = choose(&infos, choice)?;
        let mut info = infos[index].clone();
        let open = |boxes: u32| {
            let request =
                || pollster::block_on(found[index].request_device(&descriptor(&found[index], boxes)));
            match catch_unwind(AssertUnwindSafe(request)) {
                Ok(opened) => opened.map_err(|e| e.to_string()),
                Err(panic) => Err(panic_text(panic.as_ref())),
            }
        };
        let mut opened = open(info.max_query_boxes);
        if opened.is_err() && info.max_query_boxes > 0 {
            // Queries are experimental; a device without them is better than none.
            info.max_query_boxes = 0;
            opened = open(0);
        }
        let (device, queue) =
            opened.map_err(|reason| GpuError::Open { adapter: info.to_string(), reason })?;

        let loss = Loss::default();
        let (on_loss, on_error) = (loss.clone(), loss.clone());
        device.set_device_lost_callback(move |reason, message| {
            let _ = on_loss.set(format!("{message} ({reason:?})").trim().to_owned());
        });
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let _ = on_error.set(error.to_string());
        }));
        let watchdog = Watchdog::of(info.kind);
        let (history, succession) = (Arc::default(), DeviceReplacement::default());
        let mut gpu =
            Self { info, device, queue, loss, watchdog, history, succession, lends: false, tuned: None };
        let refused = |reason: String| GpuError::Open { adapter: gpu.info.to_string(), reason };
        let results = gpu.guard(|device, queue| probe::compute(&gpu, device, queue)).map_err(refused)?;
        probe::judge(&results)
            .map_err(|reason| GpuError::Arithmetic { adapter: gpu.info.to_string(), reason })?;
        let lent = gpu.attempt(|device, _| HostMemory::new(device, 1).is_some());
        gpu.lends = matches!(lent, Ok(Ok(true)));
        Ok(gpu)
    }

    /// Whether streams may lie in memory of the device's lending.
    pub(super) fn lends(&self) -> bool {
        self.lends
    }

    /// Has something go wrong on purpose, once.
    pub fn with_fault(self, fault: Fault) -> Self {
        Self { history: Arc::new(History { fault: Some(fault), ..History::default() }), ..self }
    }

    /// This device, freshly opened, in the place of another.
    pub(super) fn in_place_of(self, lost: &Self, succession: DeviceReplacement) -> Self {
        Self { history: lost.history.clone(), succession, tuned: lost.tuned, ..self }
    }

    /// The adapter in use.
    pub fn info(&self) -> &AdapterInfo {
        &self.info
    }

    /// Why the device was lost, if it was.
    pub fn lost(&self) -> Option<&str> {
        self.loss.get().map(String::as_str)
    }

    /// Destroys the device as a driver reset would. For tests and fault injection.
    pub fn simulate_loss(&self) {
        let _ = catch_unwind(AssertUnwindSafe(|| self.device.destroy()));
    }

    /// Runs `work` behind the wall. Any failure, in the answer, as an uncaptured error or as a
    /// panic, loses the device for good.
    pub(super) fn guard<T>(
        &self,
        work: impl FnOnce(&wgpu::Device, &wgpu::Queue) -> Result<T, String>,
    ) -> Result<T, String> {
        if let Some(reason) = self.lost() {
            return Err(reason.to_owned());
        }
        let answer = catch_unwind(AssertUnwindSafe(|| work(&self.device, &self.queue)))
            .unwrap_or_else(|panic| Err(panic_text(panic.as_ref())));
        match (answer, self.lost()) {
            (Ok(answer), None) => Ok(answer),
            (_, Some(reason)) => Err(reason.to_owned()),
            (Err(reason), None) => Err(self.loss.get_or_init(|| reason).clone()),
        }
    }

    /// Like [`Gpu::guard`], for work that may be refused without the device being lost: errors that
    /// wgpu reports meanwhile are the answer.
    pub(super) fn attempt<T>(
        &self,
        work: impl FnOnce(&wgpu::Device, &wgpu::Queue) -> T,
    ) -> Result<Result<T, String>, String> {
        self.guard(|device, queue| {
            let filters =
                [wgpu::ErrorFilter::Internal, wgpu::ErrorFilter::OutOfMemory, wgpu::ErrorFilter::Validation];
            let scopes = filters.map(|filter| device.push_error_scope(filter));
            let done = work(device, queue);
            // Scopes are popped in reverse; the first error of any is told.
            let errors = scopes.into_iter().rev().map(|scope| pollster::block_on(scope.pop()));
            let error = errors.fold(None, |first, next| first.or(next));
            Ok(match error {
                Some(error) => Err(error.to_string()),
                None => Ok(done),
            })
        })
    }

    /// Numbers a dispatch, from 1, and says what is to go wrong with it.
    pub(super) fn next_dispatch(&self) -> (u64, Option<Fault>) {
        let number = self.history.dispatches.fetch_add(1, Ordering::Relaxed) + 1;
        (number, self.history.fault.filter(|fault| fault.strikes(number)))
    }

    /// Whether scenes are to be refused for want of memory.
    pub(super) fn has_no_memory(&self) -> bool {
        self.history.fault == Some(Fault::OutOfMemory)
    }

    /// Gives up a device that answers, but wrongly, and its adapter with it; returns why it is lost.
    pub(super) fn mark_untrusted(&self, reason: String) -> String {
        self.succession.end();
        self.loss.get_or_init(|| reason).clone()
    }

    /// Waits for a submission, called within [`Gpu::guard`]; returns how long it took. One that takes longer than
    /// the watchdog allows counts as a loss, and the device is never waited for again.
    pub(super) fn wait(&self, submission: &wgpu::SubmissionIndex) -> Result<Duration, String> {
        self.watch(|nap| {
            let wait =
                wgpu::PollType::Wait { submission_index: Some(submission.clone()), timeout: Some(nap) };
            match self.device.poll(wait) {
                Ok(_) => Ok(true),
                Err(wgpu::PollError::Timeout) => Ok(false),
                Err(error) => Err(error.to_string()),
            }
        })
    }

    /// Waits for a dispatch that never returns.
    pub(super) fn wait_in_vain(&self) -> String {
        let never = |nap| {
            std::thread::sleep(nap);
            Ok(false)
        };
        self.watch(never).expect_err("it never returns")
    }

    /// Asks again and again whether something is done; returns how long that took.
    fn watch(&self, mut done: impl FnMut(Duration) -> Result<bool, String>) -> Result<Duration, String> {
        let start = Instant::now();
        loop {
            if done(NAP.min(self.watchdog.limit()))? {
                return Ok(start.elapsed());
            }
            // Another thread may have found out meanwhile.
            if let Some(reason) = self.lost() {
                return Err(reason.to_owned());
            }
            let limit = self.watchdog.limit();
            if start.elapsed() >= limit {
                // Dropping the queue would wait for it without end.
                std::mem::forget((self.device.clone(), self.queue.clone()));
                return Err(format!("a dispatch did not return within {limit:?}"));
            }
        }
    }
}

/// Asks for what the kernels use, as much of it as there is, and for queries through so many boxes, if any.
fn descriptor(adapter: &wgpu::Adapter, boxes: u32) -> wgpu::DeviceDescriptor<'static> {
    let there = adapter.limits();
    let asked = wgpu::DeviceDescriptor {
        label: Some("raystream"),
        required_limits: wgpu::Limits {
            max_storage_buffer_binding_size: there.max_storage_buffer_binding_size,
            max_buffer_size: there.max_buffer_size,
            max_storage_buffers_per_shader_stage: there.max_storage_buffers_per_shader_stage,
            max_buffers_and_acceleration_structures_per_shader_stage: there
                .max_buffers_and_acceleration_structures_per_shader_stage,
            max_compute_workgroups_per_dimension: there.max_compute_workgroups_per_dimension,
            ..wgpu::Limits::downlevel_defaults()
        },
        memory_hints: wgpu::MemoryHints::Performance,
        ..Default::default()
    };
    if boxes == 0 { asked } else { device_tree::with_queries(asked, boxes) }
}

fn panic_text(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
    format!("panic in the driver: {}", text.unwrap_or("without a message"))
}
