//! The GPU tracer: whole ray streams through the kernels and back.

use super::layout::{Params, WORKGROUP_SIZE};
use super::scene::SceneBuffers;
use super::slot::{PARAMS_STRIDE, Slot};
use super::{Gpu, GpuError, resolve};
use crate::bvh::Bvh;
use crate::stream::{DeviceError, DeviceReport, DeviceTracer, Queries, Ray, Tracer};
use std::sync::mpsc::sync_channel;
use std::sync::{Arc, Mutex, PoisonError};

/// More rays than this in one dispatch gain nothing on any device.
const MAX_RAYS: usize = 1 << 20;

/// Traces ray streams of one scene on a GPU. The answers are canonical: candidates of the device are
/// evaluated again on the host, and undecided rays go to the CPU tracer.
pub struct GpuTracer {
    gpu: Arc<Gpu>,
    name: String,
    bvh: Arc<Bvh>,
    cpu: Arc<dyn Tracer>,
    scene: SceneBuffers,
    max_rays: usize,
    /// Buffers that no call is using.
    slots: Mutex<Vec<Slot>>,
}

impl GpuTracer {
    /// Uploads a scene. `cpu` traces the same scene (and its alpha) for rays that stay undecided.
    ///
    /// # Errors
    /// When the scene exceeds what the adapter can bind, with both sizes, or the device refuses the
    /// scene or is lost. The caller goes on with the CPU.
    pub fn new(gpu: Arc<Gpu>, bvh: Arc<Bvh>, cpu: Arc<dyn Tracer>) -> Result<Self, GpuError> {
        let scene = SceneBuffers::new(&gpu, &bvh)?;
        let info = gpu.info();
        // One buffer holds the rays of both kinds.
        let bindable = info.max_binding_bytes.min(info.max_buffer_bytes) / (2 * size_of::<Ray>() as u64);
        let dispatchable = u64::from(info.max_workgroups) * u64::from(WORKGROUP_SIZE);
        let max_rays = MAX_RAYS.min(bindable.min(dispatchable) as usize);
        let name = info.name.clone();
        Ok(Self { gpu, name, bvh, cpu, scene, max_rays, slots: Mutex::new(Vec::new()) })
    }

    /// Bytes that the scene takes on the device.
    pub fn scene_bytes(&self) -> u64 {
        self.scene.bytes
    }

    /// The device's answers for the rays of both kinds, one after the other.
    fn dispatch(&self, rays: &[Ray], shadow_rays: &[Ray]) -> Result<Vec<u32>, String> {
        self.gpu.guard(|device, queue| {
            let slot = self.take_slot(device, rays.len() + shadow_rays.len());
            self.send(queue, &slot, rays, shadow_rays);
            let answers = self.receive(device, queue, &slot, rays.len(), shadow_rays.len())?;
            self.lock_slots().push(slot);
            Ok(answers)
        })
    }

    fn send(&self, queue: &wgpu::Queue, slot: &Slot, rays: &[Ray], shadow_rays: &[Ray]) {
        let split = rays.len();
        for (first, part, params) in [(0, rays, 0), (split, shadow_rays, PARAMS_STRIDE)] {
            if part.is_empty() {
                continue;
            }
            queue.write_buffer(&slot.rays, (first * size_of::<Ray>()) as u64, bytemuck::cast_slice(part));
            let told = Params {
                first: first as u32,
                count: part.len() as u32,
                scene_max_abs: self.bvh.scene_max_abs(),
                zero: 0,
            };
            queue.write_buffer(&slot.params, params.into(), bytemuck::bytes_of(&told));
        }
    }

    fn receive(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        slot: &Slot,
        rays: usize,
        shadow_rays: usize,
    ) -> Result<Vec<u32>, String> {
        let bytes = ((rays + shadow_rays) * size_of::<u32>()) as u64;
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_bind_group(0, &self.scene.scene, &[]);
            for (pipeline, count, params) in
                [(&self.scene.closest, rays, 0), (&self.scene.any, shadow_rays, PARAMS_STRIDE)]
            {
                if count > 0 {
                    pass.set_pipeline(pipeline);
                    pass.set_bind_group(1, &slot.call, &[params]);
                    pass.dispatch_workgroups((count as u32).div_ceil(WORKGROUP_SIZE), 1, 1);
                }
            }
        }
        encoder.copy_buffer_to_buffer(&slot.answers, 0, &slot.readback, 0, bytes);
        let submission = queue.submit([encoder.finish()]);
        let (sender, receiver) = sync_channel(1);
        slot.readback.map_async(wgpu::MapMode::Read, 0..bytes, move |mapped| {
            let _ = sender.send(mapped);
        });
        self.gpu.wait(&submission)?;
        match receiver.try_recv() {
            Ok(Ok(())) => {}
            Ok(Err(error)) => return Err(error.to_string()),
            Err(_) => return Err("the answers were not mapped".into()),
        }
        let view = slot.readback.get_mapped_range(0..bytes).map_err(|e| e.to_string())?;
        let answers = bytemuck::pod_collect_to_vec(&view);
        drop(view);
        slot.readback.unmap();
        Ok(answers)
    }

    /// The smallest slot that fits, or a new one.
    fn take_slot(&self, device: &wgpu::Device, rays: usize) -> Slot {
        let mut slots = self.lock_slots();
        let fits = (0..slots.len()).filter(|&i| slots[i].capacity >= rays).min_by_key(|&i| slots[i].capacity);
        match fits {
            Some(index) => slots.swap_remove(index),
            None => {
                // A slot that has become too small makes way for a larger one.
                slots.pop();
                drop(slots);
                Slot::new(device, &self.scene, rays.next_power_of_two().min(2 * self.max_rays))
            }
        }
    }

    fn lock_slots(&self) -> std::sync::MutexGuard<'_, Vec<Slot>> {
        self.slots.lock().unwrap_or_else(PoisonError::into_inner)
    }
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
        let Queries { mut rays, mut hits, mut shadow_rays, mut occluded } = queries;
        assert_eq!(rays.len(), hits.len(), "one hit per ray");
        assert_eq!(shadow_rays.len(), occluded.len(), "one answer per shadow ray");
        if let Some(reason) = self.gpu.lost() {
            return Err(DeviceError::Lost(reason.into()));
        }
        let mut report = DeviceReport::default();
        while !(rays.is_empty() && shadow_rays.is_empty()) {
            let (now, shadow_now) = (rays.len().min(self.max_rays), shadow_rays.len().min(self.max_rays));
            let (these, hits_of_these, these_shadows, occluded_of_these);
            (these, rays) = rays.split_at(now);
            (hits_of_these, hits) = hits.split_at_mut(now);
            (these_shadows, shadow_rays) = shadow_rays.split_at(shadow_now);
            (occluded_of_these, occluded) = occluded.split_at_mut(shadow_now);
            let answers = self.dispatch(these, these_shadows).map_err(DeviceError::Lost)?;
            let (nearest, blocked) = answers.split_at(now);
            report += resolve::closest(&self.bvh, &*self.cpu, these, nearest, hits_of_these);
            report += resolve::occluded(&*self.cpu, these_shadows, blocked, occluded_of_these);
            report.bytes_copied += ((now + shadow_now) * (size_of::<Ray>() + size_of::<u32>())) as u64;
        }
        Ok(report)
    }
}
