//! The GPU tracer: whole ray streams through the kernels and back.

use super::dispatch::{Submission, max_rays};
use super::flatten::Variant;
use super::kernel_kind::KernelKind;
use super::resolve::Resolver;
use super::scene::{DeviceScene, Source};
use super::shared_buffer::SharedBuffer;
use super::with_fma::fused;
use super::{AdapterKind, Fault, Gpu, GpuError, cross_check, fault, shared_buffer};
use crate::bvh::{Bvh, Filter};
use crate::stream::{
    Capacity, DeviceError, DeviceMemory, DeviceReport, DeviceTracer, Hit, InPlace, Queries, Ray, Sizing,
    StreamMemory, Tracer,
};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// More rays than this in one dispatch gain nothing on any device.
const MAX_RAYS: usize = 1 << 20;

/// The same for software adapters, which may take microseconds a ray and have to stay within the
/// watchdog's patience.
const MAX_RAYS_SOFTWARE: usize = 1 << 16;

/// Traces ray streams of one scene on a GPU. The answers are canonical: candidates of the device are
/// evaluated again on the host, and rays that stay open go to the CPU tracer.
///
/// When the device is lost, calls fail at once while another is opened and given the scene in the background;
/// after that calls are answered again.
pub struct GpuTracer {
    name: String,
    shared: Arc<Shared>,
    /// Opens another device.
    worker: Mutex<Option<JoinHandle<()>>>,
}

/// What the tracer and its worker both see.
struct Shared {
    live: Mutex<Arc<Live>>,
    variant: Variant,
    source: Source,
    resolver: Resolver,
    /// No device comes any more: none is to be had, or nobody wants one.
    over: AtomicBool,
}

/// A device that has the scene.
struct Live {
    gpu: Arc<Gpu>,
    scene: DeviceScene,
    max_rays: usize,
}

impl Live {
    fn new(gpu: Arc<Gpu>, bvh: &Bvh, variant: Variant, source: Source) -> Result<Self, GpuError> {
        let scene = DeviceScene::new(&gpu, bvh, variant, source)?;
        let most = if gpu.info().kind == AdapterKind::Software { MAX_RAYS_SOFTWARE } else { MAX_RAYS };
        let max_rays = max_rays(&gpu).min(most);
        Ok(Self { gpu, scene, max_rays })
    }
}

impl Shared {
    fn live(&self) -> Arc<Live> {
        self.live.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Opens devices until one takes the scene or no more may be opened.
    fn replace(&self, lost: &Arc<Gpu>) {
        let mut gpu = lost.clone();
        while let Some(next) = gpu.successor(&self.over) {
            match Live::new(next.clone(), &self.resolver.bvh, self.variant, self.source) {
                Ok(live) => {
                    let mut place = self.live.lock().unwrap_or_else(PoisonError::into_inner);
                    let lost = std::mem::replace(&mut *place, Arc::new(live));
                    drop(place);
                    return drop(lost);
                }
                Err(GpuError::Lost(_)) => gpu = next,
                Err(_) => break,
            }
        }
        self.over.store(true, Ordering::Relaxed);
    }
}

impl GpuTracer {
    /// Uploads a scene, laid out as the device likes it, to another device if this one is lost. `filter` has its say in hits of masked triangles;
    /// `cpu` traces the same scene with the same filter, for rays whose answer the device leaves open.
    ///
    /// # Errors
    /// When the scene exceeds what the adapter can bind, with both sizes, or the device refuses the
    /// scene or is lost. The caller goes on with the CPU.
    pub fn new(
        gpu: Arc<Gpu>,
        bvh: Arc<Bvh>,
        filter: Option<Arc<dyn Filter>>,
        cpu: Arc<dyn Tracer>,
    ) -> Result<Self, GpuError> {
        let tracer = |variant| {
            let (gpu, bvh, filter, cpu) = (gpu.clone(), bvh.clone(), filter.clone(), cpu.clone());
            Self::with_source(gpu, bvh, filter, cpu, variant, KernelKind::source)
        };
        let (liked, usual) = (gpu.variant(), Variant::default());
        match tracer(liked) {
            // The usual way takes the least memory.
            Err(GpuError::TooLarge { .. } | GpuError::OutOfMemory { .. }) if liked != usual => tracer(usual),
            answer => answer,
        }
    }

    /// Like [`GpuTracer::new`], with the scene laid out in another way.
    ///
    /// # Errors
    /// As there.
    pub fn with_variant(
        gpu: Arc<Gpu>,
        bvh: Arc<Bvh>,
        filter: Option<Arc<dyn Filter>>,
        cpu: Arc<dyn Tracer>,
        variant: Variant,
    ) -> Result<Self, GpuError> {
        let mut tracer = Self::with_source(gpu, bvh, filter, cpu, variant, KernelKind::source)?;
        tracer.name = format!("{}, {variant}", tracer.name);
        Ok(tracer)
    }

    /// Like [`GpuTracer::with_variant`], with kernels compiled from `source`.
    pub(super) fn with_source(
        gpu: Arc<Gpu>,
        bvh: Arc<Bvh>,
        filter: Option<Arc<dyn Filter>>,
        cpu: Arc<dyn Tracer>,
        variant: Variant,
        source: Source,
    ) -> Result<Self, GpuError> {
        let gpu = gpu.latest();
        let live = Mutex::new(Arc::new(Live::new(gpu, &bvh, variant, source)?));
        let name = live.lock().unwrap_or_else(PoisonError::into_inner).gpu.info().name.clone();
        let resolver = Resolver { bvh, filter, cpu };
        let shared = Arc::new(Shared { live, variant, source, resolver, over: AtomicBool::new(false) });
        Ok(Self { name, shared, worker: Mutex::default() })
    }

    /// Bytes that the scene takes on the device.
    pub fn scene_bytes(&self) -> u64 {
        self.shared.live().scene.bytes
    }

    /// How many devices were opened in the place of lost ones before the one in use.
    pub fn replacements(&self) -> u32 {
        self.shared.live().gpu.succession.number()
    }

    /// Has a device do something; if it is lost, or is lost over it, has another opened.
    fn with<T>(&self, live: &Live, work: impl FnOnce() -> Result<T, DeviceError>) -> Result<T, DeviceError> {
        let answer = match live.gpu.lost() {
            Some(reason) => Err(DeviceError::Lost(reason.into())),
            None => work(),
        };
        if answer.is_err() {
            self.replace(&live.gpu);
        }
        answer
    }

    /// Has another device opened in the place of a lost one, unless that is under way, has been done or is in vain.
    fn replace(&self, lost: &Arc<Gpu>) {
        let mut worker = self.worker.lock().unwrap_or_else(PoisonError::into_inner);
        let busy = worker.as_ref().is_some_and(|worker| !worker.is_finished());
        if busy || self.shared.over.load(Ordering::Relaxed) || !Arc::ptr_eq(&self.shared.live().gpu, lost) {
            return;
        }
        let (shared, lost) = (self.shared.clone(), lost.clone());
        let work = move || shared.replace(&lost);
        // Without a thread there is no other device, and the CPU goes on.
        *worker = std::thread::Builder::new().name("gpu replacement".into()).spawn(work).ok();
    }
}

impl Drop for GpuTracer {
    /// Waits for a device that is being opened: drivers do not like to be left in the middle of it.
    fn drop(&mut self) {
        self.shared.over.store(true, Ordering::Relaxed);
        let worker = self.worker.get_mut().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(worker) = worker {
            // It cannot panic but in the driver, behind the wall.
            let _ = worker.join();
        }
    }
}

/// How long a dispatch took.
struct Times {
    /// From having the rays to having submitted them.
    sent: Duration,
    /// From then to where answers can be read.
    readable: Duration,
}

impl Live {
    /// One submission: both kinds of rays go out, their candidates come back.
    fn dispatch(
        &self,
        closest: &mut Submission<'_, Hit>,
        any: &mut Submission<'_, u32>,
        scene_max_abs: f32,
        fault: Option<Fault>,
    ) -> Result<Times, String> {
        self.gpu.guard(|device, queue| {
            let start = Instant::now();
            let DeviceScene { group, closest: closest_pass, any: any_pass, .. } = &self.scene;
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let both = (device, queue);
            let hits = closest_pass.encode(both, &mut encoder, group, scene_max_abs, closest);
            let occluded = any_pass.encode(both, &mut encoder, group, scene_max_abs, any);
            if let Some(Fault::Hang(_)) = fault {
                return Err(self.gpu.wait_in_vain());
            }
            let submission = queue.submit([encoder.finish()]);
            let sent = start.elapsed();
            if let Some(Fault::Lost(_)) = fault {
                device.destroy();
            }
            let hits = hits.map(|in_flight| in_flight.ask(closest));
            let occluded = occluded.map(|in_flight| in_flight.ask(any));
            self.gpu.watchdog.note(self.gpu.wait(&submission)?);
            hits.map_or(Ok(()), |encoded| closest_pass.land(closest, encoded))?;
            occluded.map_or(Ok(()), |encoded| any_pass.land(any, encoded))?;
            Ok(Times { sent, readable: start.elapsed() - sent })
        })
    }

    /// Answers what fits one dispatch.
    fn trace(
        &self,
        resolver: &Resolver,
        mut closest: Submission<'_, Hit>,
        mut any: Submission<'_, u32>,
    ) -> Result<DeviceReport, DeviceError> {
        let (number, fault) = self.gpu.next_dispatch();
        let bytes_copied = self.scene.closest.copied(&closest) + self.scene.any.copied(&any);
        let times = self
            .dispatch(&mut closest, &mut any, resolver.bvh.scene_max_abs(), fault)
            .map_err(DeviceError::Lost)?;
        let ((rays, hits), (shadow_rays, occluded)) = (closest.slices(), any.slices());
        if let Some(Fault::Corrupt(_)) = fault {
            fault::corrupt(hits, occluded);
        }
        let mut report = fused(|| {
            let mut report = resolver.closest(rays, hits);
            report += resolver.occluded(shadow_rays, occluded);
            report
        });
        report.bytes_copied = bytes_copied;
        report.sending_ns = times.sent.as_nanos() as u64;
        report.waiting_ns = times.readable.as_nanos() as u64;
        let cpu = &*resolver.cpu;
        let checked = cross_check::closest(cpu, rays, hits, number)
            .and_then(|n| Ok(n + cross_check::occluded(cpu, shadow_rays, occluded, number)?));
        report.checked = checked.map_err(|reason| DeviceError::Lost(self.gpu.mark_untrusted(reason)))?;
        Ok(report)
    }
}

impl DeviceTracer for GpuTracer {
    fn name(&self) -> &str {
        &self.name
    }

    fn max_rays(&self) -> usize {
        self.shared.live().max_rays
    }

    fn sizing(&self) -> Option<Sizing> {
        self.shared.live().gpu.sizing()
    }

    fn stream_memory(&self, capacity: Capacity, now: Option<&dyn DeviceMemory<Ray>>) -> Option<StreamMemory> {
        shared_buffer::shared_buffers(&self.shared.live().gpu, capacity, now)
    }

    fn trace_in_place(&self, stream: InPlace<'_>) -> Option<Result<DeviceReport, DeviceError>> {
        let live = self.shared.live();
        let rays = SharedBuffer::own(stream.rays, &live.gpu)?;
        let hits = SharedBuffer::own(stream.hits, &live.gpu)?;
        let shadow_rays = SharedBuffer::own(stream.shadow_rays, &live.gpu)?;
        let occluded = SharedBuffer::own(stream.occluded, &live.gpu)?;
        Some(self.with(&live, || {
            let (count, shadow_count) = (stream.ray_count, stream.shadow_ray_count);
            let mut report = DeviceReport::default();
            for start in (0..count.max(shadow_count)).step_by(live.max_rays) {
                let piece = |count: usize| start.min(count)..(start + live.max_rays).min(count);
                let closest = Submission::InDeviceMemory { rays, answers: hits, range: piece(count) };
                let any = Submission::InDeviceMemory {
                    rays: shadow_rays,
                    answers: occluded,
                    range: piece(shadow_count),
                };
                report += live.trace(&self.shared.resolver, closest, any)?;
            }
            Ok(report)
        }))
    }

    /// Takes more than [`DeviceTracer::max_rays`] too, in several dispatches.
    ///
    /// # Panics
    /// If outputs are not as long as their rays.
    fn trace(&self, queries: Queries<'_>) -> Result<DeviceReport, DeviceError> {
        let Queries { rays, hits, shadow_rays, occluded } = queries;
        assert_eq!(rays.len(), hits.len(), "one hit per ray");
        assert_eq!(shadow_rays.len(), occluded.len(), "one answer per shadow ray");
        let live = self.shared.live();
        let most = live.max_rays;
        self.with(&live, || {
            let mut parts = rays.chunks(most).zip(hits.chunks_mut(most));
            let mut shadow_parts = shadow_rays.chunks(most).zip(occluded.chunks_mut(most));
            let mut report = DeviceReport::default();
            loop {
                let (part, shadow_part) = (parts.next(), shadow_parts.next());
                if part.is_none() && shadow_part.is_none() {
                    return Ok(report);
                }
                let (rays, answers) = part.unwrap_or_default();
                let closest = Submission::InHostMemory { rays, answers };
                let (rays, answers) = shadow_part.unwrap_or_default();
                report +=
                    live.trace(&self.shared.resolver, closest, Submission::InHostMemory { rays, answers })?;
            }
        })
    }
}
