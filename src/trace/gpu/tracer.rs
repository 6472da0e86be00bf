//! The GPU tracer: whole ray streams through the kernels and back.

use super::fused::fused;
use super::kernel::Kernel;
use super::layout::Candidates;
use super::pass::{Lane, Pass, Pending, max_rays};
use super::resolve::Resolver;
use super::scene::{DeviceScene, Source};
use super::{AdapterKind, Fault, Gpu, GpuError, cross_check, fault};
use crate::bvh::{Bvh, Filter};
use crate::stream::{DeviceError, DeviceReport, DeviceTracer, Hit, Queries, Ray, Tracer};
use std::sync::Arc;

/// More rays than this in one dispatch gain nothing on any device.
const MAX_RAYS: usize = 1 << 20;

/// The same for software adapters, which may take microseconds a ray and have to stay within the
/// watchdog's patience.
const MAX_RAYS_SOFTWARE: usize = 1 << 16;

/// Traces ray streams of one scene on a GPU. The answers are canonical: candidates of the device are
/// evaluated again on the host, and rays that stay open go to the CPU tracer.
pub struct GpuTracer {
    gpu: Arc<Gpu>,
    name: String,
    scene: DeviceScene,
    resolver: Resolver,
    max_rays: usize,
}

impl GpuTracer {
    /// Uploads a scene. `filter` has its say in hits of masked triangles; `cpu` traces the same scene
    /// with the same filter, for rays whose answer the device leaves open.
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
        Self::with_source(gpu, bvh, filter, cpu, &Kernel::source)
    }

    /// Like [`GpuTracer::new`], with kernels compiled from `source`.
    pub(super) fn with_source(
        gpu: Arc<Gpu>,
        bvh: Arc<Bvh>,
        filter: Option<Arc<dyn Filter>>,
        cpu: Arc<dyn Tracer>,
        source: Source<'_>,
    ) -> Result<Self, GpuError> {
        let scene = DeviceScene::new(&gpu, &bvh, source)?;
        let name = gpu.info().name.clone();
        let most = if gpu.info().kind == AdapterKind::Software { MAX_RAYS_SOFTWARE } else { MAX_RAYS };
        let max_rays = max_rays(&gpu).min(most);
        Ok(Self { gpu, name, scene, resolver: Resolver { bvh, filter, cpu }, max_rays })
    }

    /// Bytes that the scene takes on the device.
    pub fn scene_bytes(&self) -> u64 {
        self.scene.bytes
    }

    /// One submission: both kinds of rays go out, their candidates come back.
    fn dispatch(
        &self,
        rays: &[Ray],
        shadow_rays: &[Ray],
        fault: Option<Fault>,
    ) -> Result<(Vec<Candidates>, Vec<u32>), String> {
        self.gpu.guard(|device, queue| {
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let mut send = |pass: &Pass, rays: &[Ray]| -> Option<Lane> {
                if rays.is_empty() {
                    return None;
                }
                let lane = pass.take(device, rays.len());
                pass.send(queue, &lane, rays, self.resolver.bvh.scene_max_abs());
                pass.encode(&mut encoder, &self.scene.group, &lane, rays.len());
                Some(lane)
            };
            let (closest, any) = (&self.scene.closest, &self.scene.any);
            let closest_lane = send(closest, rays);
            let any_lane = send(any, shadow_rays);
            if let Some(Fault::Hang(_)) = fault {
                return Err(self.gpu.wait_in_vain());
            }
            let submission = queue.submit([encoder.finish()]);
            if let Some(Fault::Lost(_)) = fault {
                device.destroy();
            }
            let hits_pending = closest_lane.map(|lane| (closest.map(&lane, rays.len()), lane));
            let occluded_pending = any_lane.map(|lane| (any.map(&lane, shadow_rays.len()), lane));
            self.gpu.watchdog.note(self.gpu.wait(&submission)?);
            Ok((receive(closest, hits_pending)?, receive(any, occluded_pending)?))
        })
    }

    /// Answers queries that fit one dispatch.
    fn trace_at_once(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        shadow_rays: &[Ray],
        occluded: &mut [u32],
    ) -> Result<DeviceReport, DeviceError> {
        let (number, fault) = self.gpu.next_dispatch();
        let (mut candidates, mut blocked) =
            self.dispatch(rays, shadow_rays, fault).map_err(DeviceError::Lost)?;
        if let Some(Fault::Corrupt(_)) = fault {
            fault::corrupt(&mut candidates, &mut blocked);
        }
        let mut report = fused(|| {
            let mut report = self.resolver.closest(rays, &candidates, hits);
            report += self.resolver.occluded(shadow_rays, &blocked, occluded);
            report
        });
        let copied = size_of_val(rays)
            + size_of_val(shadow_rays)
            + size_of_val(candidates.as_slice())
            + size_of_val(blocked.as_slice());
        report.bytes_copied = copied as u64;
        let cpu = &*self.resolver.cpu;
        let checked = cross_check::closest(cpu, rays, hits, number)
            .and_then(|n| Ok(n + cross_check::occluded(cpu, shadow_rays, occluded, number)?));
        report.checked = checked.map_err(|reason| DeviceError::Lost(self.gpu.condemn(reason)))?;
        Ok(report)
    }
}

/// The answers of a lane, which is then free for another call.
fn receive<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(
    pass: &Pass,
    pending: Option<(Pending, Lane)>,
) -> Result<Vec<T>, String> {
    let Some((pending, lane)) = pending else { return Ok(Vec::new()) };
    let answers = pass.receive(&lane, pending)?;
    pass.give_back(lane);
    Ok(answers)
}

impl DeviceTracer for GpuTracer {
    fn name(&self) -> &str {
        &self.name
    }

    fn max_rays(&self) -> usize {
        self.max_rays
    }

    /// Takes more than [`DeviceTracer::max_rays`] too, in several dispatches.
    ///
    /// # Panics
    /// If outputs are not as long as their rays.
    fn trace(&self, queries: Queries<'_>) -> Result<DeviceReport, DeviceError> {
        let Queries { rays, hits, shadow_rays, occluded } = queries;
        assert_eq!(rays.len(), hits.len(), "one hit per ray");
        assert_eq!(shadow_rays.len(), occluded.len(), "one answer per shadow ray");
        if let Some(reason) = self.gpu.lost() {
            return Err(DeviceError::Lost(reason.into()));
        }
        let mut report = DeviceReport::default();
        let mut parts = rays.chunks(self.max_rays).zip(hits.chunks_mut(self.max_rays));
        let mut shadow_parts = shadow_rays.chunks(self.max_rays).zip(occluded.chunks_mut(self.max_rays));
        loop {
            let (part, shadow_part) = (parts.next(), shadow_parts.next());
            if part.is_none() && shadow_part.is_none() {
                return Ok(report);
            }
            let (rays, hits) = part.unwrap_or_default();
            let (shadow_rays, occluded) = shadow_part.unwrap_or_default();
            report += self.trace_at_once(rays, hits, shadow_rays, occluded)?;
        }
    }
}
