//! One kernel and the buffers of its calls.

use super::kernel::Kernel;
use super::layout::{Params, WORKGROUP_SIZE};
use super::{Gpu, trusted};
use crate::stream::Ray;
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// A kernel made for a scene, and the lanes that no call is using.
#[derive(Debug)]
pub(super) struct Pass {
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    /// Bytes of one ray's answer.
    answer_bytes: usize,
    idle: Mutex<Vec<Lane>>,
}

/// How long another thread may take between seeing a submission done and telling whom it was for.
const CALLBACK_PATIENCE: Duration = Duration::from_secs(10);

/// Buffers of one call: its rays go in, its answers come out.
///
/// Copies go through staging memory. Where host and device share memory, `rays` and `answers` could
/// be mapped in place behind the same steps: send, encode, map, receive.
#[derive(Debug)]
pub(super) struct Lane {
    capacity: usize,
    rays: wgpu::Buffer,
    params: wgpu::Buffer,
    answers: wgpu::Buffer,
    readback: wgpu::Buffer,
    /// Binds rays, params and answers: group 1.
    group: wgpu::BindGroup,
}

/// Answers on their way back.
#[derive(Debug)]
pub(super) struct Pending {
    bytes: u64,
    mapped: Receiver<Result<(), wgpu::BufferAsyncError>>,
}

impl Pass {
    /// Compiles a kernel from its source; `scene` lays out group 0.
    pub fn new(
        device: &wgpu::Device,
        kernel: Kernel,
        source: String,
        scene: &wgpu::BindGroupLayout,
        layout: wgpu::BindGroupLayout,
    ) -> Self {
        let both = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(kernel.name()),
            bind_group_layouts: &[Some(scene), Some(&layout)],
            immediate_size: 0,
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(kernel.name()),
            layout: Some(&both),
            module: &trusted::module(device, kernel.name(), source),
            entry_point: Some(kernel.name()),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        Self { pipeline, layout, answer_bytes: kernel.answer_bytes(), idle: Mutex::default() }
    }

    /// Takes the smallest lane that has room for `rays`, or makes one of a power of two.
    pub fn take(&self, device: &wgpu::Device, rays: usize) -> Lane {
        let mut idle = self.idle();
        let fits = (0..idle.len()).filter(|&i| idle[i].capacity >= rays).min_by_key(|&i| idle[i].capacity);
        if let Some(index) = fits {
            return idle.swap_remove(index);
        }
        // A lane that has become too small makes way for a larger one.
        let outgrown = idle.pop();
        drop((idle, outgrown));
        self.lane(device, rays.next_power_of_two())
    }

    /// Gives a lane back whose answers have been received.
    pub fn give_back(&self, lane: Lane) {
        self.idle().push(lane);
    }

    /// Writes the rays into the lane.
    pub fn send(&self, queue: &wgpu::Queue, lane: &Lane, rays: &[Ray], scene_max_abs: f32) {
        let params = Params { count: rays.len() as u32, scene_max_abs, zero: 0, spare: 0 };
        queue.write_buffer(&lane.params, 0, bytemuck::bytes_of(&params));
        queue.write_buffer(&lane.rays, 0, bytemuck::cast_slice(rays));
    }

    /// Has the kernel run over the lane's first `rays` rays, and the answers copied to the host.
    pub fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        scene: &wgpu::BindGroup,
        lane: &Lane,
        rays: usize,
    ) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, scene, &[]);
        pass.set_bind_group(1, &lane.group, &[]);
        pass.dispatch_workgroups((rays as u32).div_ceil(WORKGROUP_SIZE), 1, 1);
        drop(pass);
        let bytes = (rays * self.answer_bytes) as u64;
        encoder.copy_buffer_to_buffer(&lane.answers, 0, &lane.readback, 0, bytes);
    }

    /// Asks for the answers, once submitted.
    pub fn map(&self, lane: &Lane, rays: usize) -> Pending {
        let bytes = (rays * self.answer_bytes) as u64;
        let (sender, mapped) = sync_channel(1);
        lane.readback.map_async(wgpu::MapMode::Read, 0..bytes, move |result| {
            // Nobody listens when the call has been given up.
            let _ = sender.send(result);
        });
        Pending { bytes, mapped }
    }

    /// Takes the answers, once the submission is done.
    pub fn receive<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(
        &self,
        lane: &Lane,
        pending: Pending,
    ) -> Result<Vec<T>, String> {
        debug_assert_eq!(size_of::<T>(), self.answer_bytes);
        // The submission is done, but the callback runs on whichever thread polled first, perhaps not yet.
        match pending.mapped.recv_timeout(CALLBACK_PATIENCE) {
            Ok(Ok(())) => {}
            Ok(Err(error)) => return Err(error.to_string()),
            Err(_) => return Err("the answers were not mapped".into()),
        }
        let view = lane.readback.get_mapped_range(0..pending.bytes).map_err(|e| e.to_string())?;
        let answers = bytemuck::pod_collect_to_vec(&view);
        drop(view);
        lane.readback.unmap();
        Ok(answers)
    }

    fn lane(&self, device: &wgpu::Device, capacity: usize) -> Lane {
        use wgpu::BufferUsages as U;
        let buffer = |label, bytes: usize, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: bytes as u64,
                usage,
                mapped_at_creation: false,
            })
        };
        let answer_bytes = capacity * self.answer_bytes;
        let rays = buffer("rays", capacity * size_of::<Ray>(), U::STORAGE | U::COPY_DST);
        let params = buffer("params", size_of::<Params>(), U::UNIFORM | U::COPY_DST);
        let answers = buffer("answers", answer_bytes, U::STORAGE | U::COPY_SRC);
        let readback = buffer("readback", answer_bytes, U::MAP_READ | U::COPY_DST);
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("lane"),
            layout: &self.layout,
            entries: &[entry(0, &rays), entry(1, &params), entry(2, &answers)],
        });
        Lane { capacity, rays, params, answers, readback, group }
    }

    fn idle(&self) -> std::sync::MutexGuard<'_, Vec<Lane>> {
        self.idle.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Binds a whole buffer.
pub(super) fn entry(binding: u32, buffer: &wgpu::Buffer) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() }
}

/// The most rays of one pass on an adapter with these limits.
pub(super) fn max_rays(gpu: &Gpu) -> usize {
    let info = gpu.info();
    let bindable = info.max_binding_bytes.min(info.max_buffer_bytes) / size_of::<Ray>() as u64;
    // Lanes grow by powers of two.
    let bindable = (bindable + 1).next_power_of_two() / 2;
    let dispatchable = u64::from(info.max_workgroups) * u64::from(WORKGROUP_SIZE);
    bindable.min(dispatchable) as usize
}
