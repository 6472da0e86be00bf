//! The GPU tracer: whole ray streams through the kernels and back.

use super::flatten::Variant;
use super::fused::fused;
use super::kernel::Kernel;
use super::layout::Candidates;
use super::pass::{Answers, Flight, Lane, Pass, max_rays};
use super::resolve::Resolver;
use super::scene::{DeviceScene, Source};
use super::{AdapterKind, Fault, Gpu, GpuError, cross_check, fault};
use crate::bvh::{Bvh, Filter};
use crate::stream::{DeviceError, DeviceReport, DeviceTracer, Hit, Queries, Ray, Tracer};
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
    /// Uploads a scene, to another device if this one is lost. `filter` has its say in hits of masked triangles;
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
        Self::with_source(gpu, bvh, filter, cpu, Variant::default(), Kernel::source)
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
        let mut tracer = Self::with_source(gpu, bvh, filter, cpu, variant, Kernel::source)?;
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

impl Live {
    /// One submission: both kinds of rays go out, their candidates come back.
    fn dispatch(
        &self,
        rays: &[Ray],
        shadow_rays: &[Ray],
        scene_max_abs: f32,
        fault: Option<Fault>,
    ) -> Result<Landed<'_>, String> {
        self.gpu.guard(|device, queue| {
            let start = Instant::now();
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let mut send = |pass: &Pass, rays: &[Ray]| -> Result<Option<Lane>, String> {
                if rays.is_empty() {
                    return Ok(None);
                }
                let lane = pass.take(device, rays.len());
                pass.send(queue, &lane, rays, scene_max_abs)?;
                pass.encode(&mut encoder, &self.scene.group, &lane, rays.len());
                Ok(Some(lane))
            };
            let (closest, any) = (&self.scene.closest, &self.scene.any);
            let (closest_lane, any_lane) = (send(closest, rays)?, send(any, shadow_rays)?);
            if let Some(Fault::Hang(_)) = fault {
                return Err(self.gpu.wait_in_vain());
            }
            let submission = queue.submit([encoder.finish()]);
            let sent = start.elapsed();
            if let Some(Fault::Lost(_)) = fault {
                device.destroy();
            }
            let closest = closest_lane.map(|lane| closest.map(lane, rays.len()));
            let any = any_lane.map(|lane| any.map(lane, shadow_rays.len()));
            self.gpu.watchdog.note(self.gpu.wait(&submission)?);
            let hits = closest.map(Flight::land).transpose()?;
            let occluded = any.map(Flight::land).transpose()?;
            Ok(Landed { hits, occluded, sent, readable: start.elapsed() - sent })
        })
    }

    /// Answers queries that fit one dispatch.
    fn trace(
        &self,
        resolver: &Resolver,
        rays: &[Ray],
        hits: &mut [Hit],
        shadow_rays: &[Ray],
        occluded: &mut [u32],
    ) -> Result<DeviceReport, DeviceError> {
        let (number, fault) = self.gpu.next_dispatch();
        let landed = self
            .dispatch(rays, shadow_rays, resolver.bvh.scene_max_abs(), fault)
            .map_err(DeviceError::Lost)?;
        let candidates = landed.hits.as_ref().map_or(&[][..], Answers::of::<Candidates>);
        let blocked = landed.occluded.as_ref().map_or(&[][..], Answers::of::<u32>);
        let corrupt = matches!(fault, Some(Fault::Corrupt(_))).then(|| fault::corrupted(candidates, blocked));
        let (candidates, blocked) = corrupt.as_ref().map_or((candidates, blocked), |(c, b)| (c, b));
        let mut report = fused(|| {
            let mut report = resolver.closest(rays, candidates, hits);
            report += resolver.occluded(shadow_rays, blocked, occluded);
            report
        });
        report.bytes_copied =
            self.scene.closest.copied(rays.len()) + self.scene.any.copied(shadow_rays.len());
        report.sending_ns = landed.sent.as_nanos() as u64;
        report.waiting_ns = landed.readable.as_nanos() as u64;
        let given_back = self.gpu.guard(|_, _| {
            [landed.hits, landed.occluded].into_iter().flatten().for_each(Answers::give_back);
            Ok(())
        });
        given_back.map_err(DeviceError::Lost)?;
        let cpu = &*resolver.cpu;
        let checked = cross_check::closest(cpu, rays, hits, number)
            .and_then(|n| Ok(n + cross_check::occluded(cpu, shadow_rays, occluded, number)?));
        report.checked = checked.map_err(|reason| DeviceError::Lost(self.gpu.condemn(reason)))?;
        Ok(report)
    }
}

/// A dispatch that has returned.
struct Landed<'a> {
    hits: Option<Answers<'a>>,
    occluded: Option<Answers<'a>>,
    /// From having the rays to having submitted them.
    sent: Duration,
    /// From then to where answers can be read.
    readable: Duration,
}

impl DeviceTracer for GpuTracer {
    fn name(&self) -> &str {
        &self.name
    }

    fn max_rays(&self) -> usize {
        self.shared.live().max_rays
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
        if let Some(reason) = live.gpu.lost() {
            self.replace(&live.gpu);
            return Err(DeviceError::Lost(reason.into()));
        }
        let mut report = DeviceReport::default();
        let mut parts = rays.chunks(live.max_rays).zip(hits.chunks_mut(live.max_rays));
        let mut shadow_parts = shadow_rays.chunks(live.max_rays).zip(occluded.chunks_mut(live.max_rays));
        loop {
            let (part, shadow_part) = (parts.next(), shadow_parts.next());
            if part.is_none() && shadow_part.is_none() {
                return Ok(report);
            }
            let (rays, hits) = part.unwrap_or_default();
            let (shadow_rays, occluded) = shadow_part.unwrap_or_default();
            match live.trace(&self.shared.resolver, rays, hits, shadow_rays, occluded) {
                Ok(part) => report += part,
                Err(error) => {
                    self.replace(&live.gpu);
                    return Err(error);
                }
            }
        }
    }
}
