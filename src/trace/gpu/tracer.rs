//! The GPU tracer: traces whole ray streams, replaces lost devices.

use super::bundle::Bundle;
use super::cross_check::{LEAST, Sampling};
use super::dispatch::{Request, max_rays};
use super::exact::Refusal;
use super::resolve::Resolver;
use super::scene::{DeviceScene, Kernels};
use super::undecided::Undecided;
use super::{corruption, cross_check, shared_buffer};
use crate::bvh::{Bvh, Filter};
use crate::device::{AdapterKind, Fault, Gpu, GpuError};
use crate::stream::{
    BlockingTracer, Capacity, DeviceError, DeviceMemory, DeviceReport, DeviceStream, DeviceTracer, Hit,
    Queries, Ray, StreamMemory, Ticket, Tracer, Visits,
};
use std::fmt;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

/// More rays than this in one dispatch gain nothing on any device.
const MAX_RAYS: usize = 1 << 20;

/// The same for software adapters, which may take microseconds a ray and must not exceed the watchdog's limit.
const MAX_RAYS_SOFTWARE: usize = 1 << 16;

/// Traces ray streams of one scene on a GPU. The answers are canonical: the device's own where its arithmetic has the
/// host's bits, else the host evaluates its candidates. The CPU tracer traces undecided rays.
///
/// When the device is lost, calls fail at once while another device is opened in the background and gets the scene;
/// from then on calls are answered again.
pub struct GpuTracer {
    name: String,
    shared: Arc<Shared>,
}

impl fmt::Debug for GpuTracer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("GpuTracer").finish_non_exhaustive()
    }
}

/// What the tracer, its worker and its bundles share.
pub(super) struct Shared {
    device: Mutex<Arc<SceneDevice>>,
    /// Opens a replacement of a lost device.
    worker: Mutex<Option<JoinHandle<()>>>,
    kernels: Kernels,
    pub resolver: Resolver,
    /// No replacement will come: none can be opened, or the tracer is being dropped.
    is_final: AtomicBool,
}

/// A device that has the scene.
pub(super) struct SceneDevice {
    pub gpu: Arc<Gpu>,
    pub scene: DeviceScene,
    /// Of one dispatch.
    pub max_rays: usize,
}

impl SceneDevice {
    fn new(gpu: Arc<Gpu>, resolver: &Resolver, kernels: Kernels) -> Result<Self, GpuError> {
        let scene = DeviceScene::new(&gpu, resolver, kernels)?;
        let most = if gpu.info().kind == AdapterKind::Software { MAX_RAYS_SOFTWARE } else { MAX_RAYS };
        let max_rays = max_rays(&gpu).min(most);
        Ok(Self { gpu, scene, max_rays })
    }

    /// The parts of so many rays and shadow rays that fit one dispatch.
    pub fn ranges(
        &self,
        rays: usize,
        shadow_rays: usize,
    ) -> impl Iterator<Item = (Range<usize>, Range<usize>)> + use<> {
        let most = self.max_rays;
        let part = move |start: usize, len: usize| start.min(len)..(start + most).min(len);
        (0..rays.max(shadow_rays))
            .step_by(most)
            .map(move |start| (part(start, rays), part(start, shadow_rays)))
    }
}

impl Shared {
    fn device(&self) -> Arc<SceneDevice> {
        self.device.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub fn scene_max_abs(&self) -> f32 {
        self.resolver.bvh.scene_max_abs()
    }

    /// Starts to replace a lost device, unless that is under way, has been done or cannot be done.
    pub fn replace(this: &Arc<Self>, lost: &Arc<Gpu>) {
        let mut worker = this.worker.lock().unwrap_or_else(PoisonError::into_inner);
        let is_under_way = worker.as_ref().is_some_and(|worker| !worker.is_finished());
        let is_current = Arc::ptr_eq(&this.device().gpu, lost);
        if is_under_way || this.is_final.load(Ordering::Relaxed) || !is_current {
            return;
        }
        let (shared, lost) = (Arc::clone(this), lost.clone());
        let work = move || shared.open_successor(&lost);
        // Without a thread there is no replacement, and the CPU goes on.
        *worker = std::thread::Builder::new().name("gpu replacement".into()).spawn(work).ok();
    }

    /// Opens devices until one takes the scene or no more may be opened.
    fn open_successor(&self, lost: &Arc<Gpu>) {
        let mut gpu = lost.clone();
        while let Some(next) = gpu.successor(&self.is_final) {
            match SceneDevice::new(next.clone(), &self.resolver, self.kernels) {
                Ok(device) => {
                    let mut current = self.device.lock().unwrap_or_else(PoisonError::into_inner);
                    let lost = std::mem::replace(&mut *current, Arc::new(device));
                    drop(current);
                    return drop(lost);
                }
                Err(GpuError::Lost(_)) => gpu = next,
                Err(_) => break,
            }
        }
        self.is_final.store(true, Ordering::Relaxed);
    }
}

impl GpuTracer {
    /// Uploads a scene. If the device is lost, its replacements get the scene too. `filter` decides about hits of
    /// masked triangles. `cpu` traces the same scene with the same filter, for undecided rays.
    ///
    /// # Errors
    /// When the scene exceeds what the adapter can bind (with both sizes), the device refuses the scene, or the device
    /// is lost. The caller goes on with the CPU.
    pub fn new(
        gpu: Arc<Gpu>,
        bvh: Arc<Bvh>,
        filter: Option<Arc<dyn Filter>>,
        cpu: Arc<dyn Tracer>,
    ) -> Result<Self, GpuError> {
        Self::with_kernels(gpu, bvh, filter, cpu, Kernels::Best)
    }

    /// Like [`GpuTracer::new`], with these kernels.
    pub(super) fn with_kernels(
        gpu: Arc<Gpu>,
        bvh: Arc<Bvh>,
        filter: Option<Arc<dyn Filter>>,
        cpu: Arc<dyn Tracer>,
        kernels: Kernels,
    ) -> Result<Self, GpuError> {
        let gpu = gpu.latest();
        let name = gpu.info().name.clone();
        let resolver = Resolver { bvh, filter, cpu };
        let device = Mutex::new(Arc::new(SceneDevice::new(gpu, &resolver, kernels)?));
        let (worker, is_final) = (Mutex::default(), AtomicBool::new(false));
        let shared = Arc::new(Shared { device, worker, kernels, resolver, is_final });
        Ok(Self { name, shared })
    }

    /// A tracer of the same scene with another filter. `cpu` traces the scene with that filter. The scene is uploaded
    /// anew where the device decides what the filter decides, and that has changed.
    ///
    /// # Errors
    /// Those of [`GpuTracer::new`].
    pub fn with_filter(
        &self,
        filter: Option<Arc<dyn Filter>>,
        cpu: Arc<dyn Tracer>,
    ) -> Result<Self, GpuError> {
        let Shared { kernels, resolver, .. } = &*self.shared;
        let (kernels, device) = (*kernels, self.shared.device());
        let resolver = Resolver { bvh: Arc::clone(&resolver.bvh), filter, cpu };
        if !device.scene.decides_alike(&device.gpu, &resolver) {
            return Self::with_kernels(
                device.gpu.clone(),
                resolver.bvh,
                resolver.filter,
                resolver.cpu,
                kernels,
            );
        }
        let (device, worker, is_final) = (Mutex::new(device), Mutex::default(), AtomicBool::new(false));
        let shared = Arc::new(Shared { device, worker, kernels, resolver, is_final });
        Ok(Self { name: self.name.clone(), shared })
    }

    /// Bytes that the scene takes on the device.
    pub fn scene_bytes(&self) -> u64 {
        self.shared.device().scene.bytes
    }

    /// How the device makes exact hits; `None` if the host makes them of the device's candidates.
    pub fn exact_hits(&self) -> Option<String> {
        self.shared.device().scene.exact_hits.as_ref().ok().map(|form| form.route.to_string())
    }

    /// Why the host makes hits of the device's candidates, if a probe refused the device's own.
    pub fn refused_hits(&self) -> Option<String> {
        match &self.shared.device().scene.exact_hits {
            Err(refusal @ Refusal::Inexact { .. }) => Some(refusal.to_string()),
            _ => None,
        }
    }

    /// The number of attempts to replace a lost device before the device in use was opened.
    pub fn replacements(&self) -> u32 {
        self.shared.device().gpu.replacements()
    }

    /// Runs `work` on a device, unless it is lost. If it is, or becomes so, starts to replace it.
    fn with<T>(
        &self,
        device: &SceneDevice,
        work: impl FnOnce() -> Result<T, DeviceError>,
    ) -> Result<T, DeviceError> {
        let answer = match device.gpu.lost() {
            Some(reason) => Err(DeviceError::Lost(reason.into())),
            None => work(),
        };
        if answer.is_err() {
            Shared::replace(&self.shared, &device.gpu);
        }
        answer
    }
}

impl Drop for GpuTracer {
    /// Waits for a device that is being opened: a process should not exit while a driver opens one.
    fn drop(&mut self) {
        self.shared.is_final.store(true, Ordering::Relaxed);
        let worker = self.shared.worker.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(worker) = worker {
            // Only the driver could panic there, and `Gpu::guard` catches that.
            let _ = worker.join();
        }
    }
}

/// The rays, and the shadow rays, that a device left undecided, if it answers with hits.
type Answered = (Option<Undecided>, Option<Undecided>);

impl SceneDevice {
    /// Encodes, submits, maps and reads back the rays of both kinds, in one submission.
    fn dispatch(
        &self,
        closest: &mut Request<'_, Hit>,
        any: &mut Request<'_, u32>,
        scene_max_abs: f32,
        fault: Option<Fault>,
    ) -> Result<Answered, String> {
        self.gpu.guard(|device, queue| {
            let DeviceScene { group, trace_closest, trace_any, .. } = &self.scene;
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let both = (device, queue);
            let hits = trace_closest.encode(both, &mut encoder, group, scene_max_abs, closest, None);
            let occluded = trace_any.encode(both, &mut encoder, group, scene_max_abs, any, None);
            if let Some(Fault::Hang(_)) = fault {
                return Err(self.gpu.simulate_hang());
            }
            let submission = queue.submit([encoder.finish()]);
            if let Some(Fault::Lost(_)) = fault {
                device.destroy();
            }
            let hits = hits.map(|encoded| encoded.map(true, trace_closest.is_exact()));
            let occluded = occluded.map(|encoded| encoded.map(true, trace_any.is_exact()));
            self.gpu.watchdog.record(self.gpu.wait(&submission)?);
            let closest = hits.map_or(Ok(None), |in_flight| trace_closest.read_back(closest, in_flight))?;
            let any = occluded.map_or(Ok(None), |in_flight| trace_any.read_back(any, in_flight))?;
            Ok((closest, any))
        })
    }

    /// Traces rays that fit one dispatch: dispatches, resolves and cross-checks.
    fn trace(
        &self,
        resolver: &Resolver,
        mut closest: Request<'_, Hit>,
        mut any: Request<'_, u32>,
    ) -> Result<DeviceReport, DeviceError> {
        let (number, fault) = self.gpu.next_dispatch();
        let DeviceScene { trace_closest, trace_any, .. } = &self.scene;
        let bytes_copied = trace_closest.bytes_copied(&closest) + trace_any.bytes_copied(&any);
        let answered = self.dispatch(&mut closest, &mut any, resolver.bvh.scene_max_abs(), fault);
        let (undecided, undecided_shadows) = answered.map_err(DeviceError::Lost)?;
        let ((rays, hits), (shadow_rays, occluded)) = (closest.slices(), any.slices());
        let mut report =
            resolver.resolve((rays, hits, undecided), (shadow_rays, occluded, undecided_shadows));
        if let Some(Fault::Corrupt(_)) = fault {
            corruption::corrupt(hits, occluded);
        }
        report.bytes_copied = bytes_copied;
        let cpu = &*resolver.cpu;
        let sampling = Sampling { number, least: LEAST };
        let checked = cross_check::closest(cpu, rays, hits, sampling)
            .and_then(|n| Ok(n + cross_check::occluded(cpu, shadow_rays, occluded, sampling)?));
        report.checked = checked.map_err(|reason| DeviceError::Lost(self.gpu.mark_untrusted(reason)))?;
        Ok(report)
    }
}

impl DeviceTracer for GpuTracer {
    fn name(&self) -> &str {
        &self.name
    }

    fn bundle_rays(&self) -> Option<usize> {
        self.shared.device().gpu.bundle_rays()
    }

    fn kernel_seconds(&self, rays: &[Ray], any_hit: bool) -> Result<Option<f64>, DeviceError> {
        let device = self.shared.device();
        self.with(&device, || device.kernel_seconds(rays, any_hit, self.shared.scene_max_abs()))
    }

    fn visits(&self, rays: &[Ray]) -> Result<Option<Vec<Visits>>, DeviceError> {
        self.shared.device().visits(rays, self.shared.scene_max_abs()).map(Some)
    }

    fn stream_memory(&self, capacity: Capacity, now: Option<&dyn DeviceMemory<Ray>>) -> Option<StreamMemory> {
        shared_buffer::stream_memory(&self.shared.device().gpu, capacity, now)
    }

    fn submit(&self, bundle: Vec<DeviceStream>) -> Result<Box<dyn Ticket>, DeviceError> {
        let device = self.shared.device();
        let submitted =
            self.with(&device, || Bundle::submit(&self.shared, &device, bundle).map_err(DeviceError::Lost))?;
        Ok(Box::new(submitted))
    }
}

impl BlockingTracer for GpuTracer {
    fn name(&self) -> &str {
        &self.name
    }

    fn max_rays(&self) -> usize {
        self.shared.device().max_rays
    }

    /// More than [`BlockingTracer::max_rays`] rays take several dispatches.
    ///
    /// # Panics
    /// If there are not as many answers as rays.
    fn trace(&self, queries: Queries<'_>) -> Result<DeviceReport, DeviceError> {
        let Queries { rays, hits, shadow_rays, occluded } = queries;
        assert_eq!(rays.len(), hits.len(), "one hit per ray");
        assert_eq!(shadow_rays.len(), occluded.len(), "one answer per shadow ray");
        let device = self.shared.device();
        let most = device.max_rays;
        self.with(&device, || {
            let mut parts = rays.chunks(most).zip(hits.chunks_mut(most));
            let mut shadow_parts = shadow_rays.chunks(most).zip(occluded.chunks_mut(most));
            let mut report = DeviceReport::default();
            loop {
                let (part, shadow_part) = (parts.next(), shadow_parts.next());
                if part.is_none() && shadow_part.is_none() {
                    return Ok(report);
                }
                let (rays, answers) = part.unwrap_or_default();
                let closest = Request::InHostMemory { rays, answers };
                let (rays, answers) = shadow_part.unwrap_or_default();
                report +=
                    device.trace(&self.shared.resolver, closest, Request::InHostMemory { rays, answers })?;
            }
        })
    }
}
