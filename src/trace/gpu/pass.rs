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
    shared_memory: bool,
    idle: Mutex<Vec<Lane>>,
}

/// How long another thread may take between seeing a submission done and telling whom it was for.
const CALLBACK_PATIENCE: Duration = Duration::from_secs(10);

/// Buffers of one call: its rays go in, its answers come out.
///
/// Where host and device share memory, both are mapped in place: rays are written where the kernel reads them. Elsewhere
/// they pass through staging memory.
#[derive(Debug)]
pub(super) struct Lane {
    capacity: usize,
    /// Mapped for writing while no call is using the lane, if memory is shared.
    rays: wgpu::Buffer,
    params: wgpu::Buffer,
    answers: wgpu::Buffer,
    /// Where answers are copied to for the host to read; `None` if memory is shared.
    readback: Option<wgpu::Buffer>,
    /// Binds rays, params and answers: group 1.
    group: wgpu::BindGroup,
}

/// A lane whose kernel has been submitted.
#[derive(Debug)]
pub(super) struct Flight<'a> {
    pass: &'a Pass,
    lane: Lane,
    bytes: u64,
    /// Answers for each buffer that is being mapped.
    mapped: Receiver<Result<(), wgpu::BufferAsyncError>>,
}

/// The answers of a lane, where they are: in memory that the device has written.
#[derive(Debug)]
pub(super) struct Answers<'a> {
    pass: &'a Pass,
    lane: Lane,
    view: wgpu::BufferView,
}

impl Pass {
    /// Compiles a kernel from its source; `scene` lays out group 0.
    pub fn new(
        device: &wgpu::Device,
        kernel: Kernel,
        source: String,
        scene: &wgpu::BindGroupLayout,
        layout: wgpu::BindGroupLayout,
        shared_memory: bool,
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
        Self { pipeline, layout, answer_bytes: kernel.answer_bytes(), shared_memory, idle: Mutex::default() }
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

    /// Writes the rays into the lane.
    pub fn send(
        &self,
        queue: &wgpu::Queue,
        lane: &Lane,
        rays: &[Ray],
        scene_max_abs: f32,
    ) -> Result<(), String> {
        let params = Params { count: rays.len() as u32, scene_max_abs, zero: 0, spare: 0 };
        queue.write_buffer(&lane.params, 0, bytemuck::bytes_of(&params));
        let bytes: &[u8] = bytemuck::cast_slice(rays);
        if self.shared_memory {
            let view = lane.rays.get_mapped_range_mut(0..bytes.len() as u64);
            view.map_err(|e| e.to_string())?.copy_from_slice(bytes);
            lane.rays.unmap();
        } else {
            queue.write_buffer(&lane.rays, 0, bytes);
        }
        Ok(())
    }

    /// Bytes that are copied between host and device for so many rays.
    pub fn copied(&self, rays: usize) -> u64 {
        (rays * (size_of::<Ray>() + if self.shared_memory { 0 } else { self.answer_bytes })) as u64
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
        if let Some(readback) = &lane.readback {
            encoder.copy_buffer_to_buffer(&lane.answers, 0, readback, 0, bytes);
        }
    }

    /// Asks for the answers, once submitted, and for the lane to be written again.
    pub fn map(&self, lane: Lane, rays: usize) -> Flight<'_> {
        let bytes = (rays * self.answer_bytes) as u64;
        let (sender, mapped) = sync_channel(2);
        let ask = |buffer: &wgpu::Buffer, mode, bytes| {
            let sender = sender.clone();
            // Nobody listens when the call has been given up.
            buffer.map_async(mode, 0..bytes, move |result| drop(sender.send(result)));
        };
        ask(lane.readable(), wgpu::MapMode::Read, bytes);
        if self.shared_memory {
            ask(&lane.rays, wgpu::MapMode::Write, lane.rays.size());
        }
        Flight { pass: self, lane, bytes, mapped }
    }

    fn lane(&self, device: &wgpu::Device, capacity: usize) -> Lane {
        use wgpu::BufferUsages as U;
        let buffer = |label, bytes: usize, usage, mapped_at_creation| {
            let size = bytes as u64;
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage,
                mapped_at_creation,
            })
        };
        let (ray_bytes, answer_bytes) = (capacity * size_of::<Ray>(), capacity * self.answer_bytes);
        let params = buffer("params", size_of::<Params>(), U::UNIFORM | U::COPY_DST, false);
        let (rays, answers, readback) = if self.shared_memory {
            let rays = buffer("rays", ray_bytes, U::STORAGE | U::MAP_WRITE, true);
            (rays, buffer("answers", answer_bytes, U::STORAGE | U::MAP_READ, false), None)
        } else {
            let readback = buffer("readback", answer_bytes, U::MAP_READ | U::COPY_DST, false);
            let answers = buffer("answers", answer_bytes, U::STORAGE | U::COPY_SRC, false);
            (buffer("rays", ray_bytes, U::STORAGE | U::COPY_DST, false), answers, Some(readback))
        };
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

impl Lane {
    /// The buffer that the host reads answers from.
    fn readable(&self) -> &wgpu::Buffer {
        self.readback.as_ref().unwrap_or(&self.answers)
    }
}

impl<'a> Flight<'a> {
    /// The answers, once the submission is done.
    pub fn land(self) -> Result<Answers<'a>, String> {
        let Self { pass, lane, bytes, mapped } = self;
        for _ in 0..if pass.shared_memory { 2 } else { 1 } {
            // The submission is done, but the callback runs on whichever thread polled first, perhaps not yet.
            match mapped.recv_timeout(CALLBACK_PATIENCE) {
                Ok(Ok(())) => {}
                Ok(Err(error)) => return Err(error.to_string()),
                Err(_) => return Err("the answers were not mapped".into()),
            }
        }
        let view = lane.readable().get_mapped_range(0..bytes).map_err(|e| e.to_string())?;
        Ok(Answers { pass, lane, view })
    }
}

impl Answers<'_> {
    /// One for each ray.
    pub fn of<T: bytemuck::AnyBitPattern>(&self) -> &[T] {
        debug_assert_eq!(size_of::<T>(), self.pass.answer_bytes);
        bytemuck::cast_slice(&self.view)
    }

    /// Frees the lane for another call.
    pub fn give_back(self) {
        let Self { pass, lane, view } = self;
        drop(view);
        lane.readable().unmap();
        pass.idle().push(lane);
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
