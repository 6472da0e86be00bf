//! One kernel, and how rays get to it and answers back.
//!
//! | rays lie | the kernel reads and writes | copied a ray |
//! |---|---|---|
//! | in lent memory, which the kernel reaches | them, where they are | nothing |
//! | in lent memory of the host | a lane on the device; the device copies to and fro | 32 + answer |
//! | in anybody's memory | a lane; wgpu stages the rays, and the answers are mapped and copied | 32 + answer |

use super::kernel_kind::KernelKind;
use super::layout::{Params, WORKGROUP_SIZE};
use super::shared_buffer::SharedBuffer;
use super::{Gpu, unchecked_module};
use crate::stream::{DeviceMemory as _, Ray};
use bytemuck::Pod;
use std::fmt::Debug;
use std::ops::Range;
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// A kernel made for a scene, and the buffers that no call is using.
#[derive(Debug)]
pub(super) struct Dispatch {
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    /// Bytes of one ray's answer.
    answer_bytes: usize,
    shared_memory: bool,
    idle: Mutex<Vec<Staging>>,
    idle_params: Mutex<Vec<wgpu::Buffer>>,
}

/// How long another thread may take between seeing a submission done and telling whom it was for.
const CALLBACK_PATIENCE: Duration = Duration::from_secs(10);

/// What one call asks: its rays, and places for their answers. When it has landed these hold what the kernel
/// answered, bit by bit.
#[derive(Debug)]
pub(super) enum Submission<'a, A> {
    /// In memory of anybody's.
    InHostMemory { rays: &'a [Ray], answers: &'a mut [A] },
    /// In memory lent by the device: of the places, these.
    InDeviceMemory { rays: &'a mut SharedBuffer<Ray>, answers: &'a mut SharedBuffer<A>, range: Range<usize> },
}

/// Buffers on the device for one call.
#[derive(Debug)]
struct Staging {
    capacity: usize,
    rays: wgpu::Buffer,
    answers: wgpu::Buffer,
    /// Where the host reads answers, unless they are copied to where it wants them.
    readback: wgpu::Buffer,
}

/// A call whose work has been recorded. Kept until that is done.
#[derive(Debug)]
pub(super) struct InFlight {
    params: wgpu::Buffer,
    lane: Option<Staging>,
    bytes: u64,
}

impl<A: Pod + Debug + Send + Sync> Submission<'_, A> {
    /// How many rays.
    pub fn len(&self) -> usize {
        match self {
            Self::InHostMemory { rays, .. } => rays.len(),
            Self::InDeviceMemory { range, .. } => range.len(),
        }
    }

    /// The rays and the places of their answers.
    pub fn slices(&mut self) -> (&[Ray], &mut [A]) {
        match self {
            Self::InHostMemory { rays, answers } => (rays, answers),
            Self::InDeviceMemory { rays, answers, range } => {
                (&rays.as_slice()[range.clone()], &mut answers.as_mut_slice()[range.clone()])
            }
        }
    }
}

impl Dispatch {
    /// Compiles a kernel from its source; `scene` lays out group 0.
    pub fn new(
        device: &wgpu::Device,
        kernel: KernelKind,
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
            module: &unchecked_module::module(device, kernel.name(), source),
            entry_point: Some(kernel.name()),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        let answer_bytes = kernel.answer_bytes();
        let (idle, idle_params) = (Mutex::default(), Mutex::default());
        Self { pipeline, layout, answer_bytes, shared_memory, idle, idle_params }
    }

    /// Bytes that are copied between host and device for a call.
    pub fn copied<A: Pod + Debug + Send + Sync>(&self, call: &Submission<'_, A>) -> u64 {
        match call {
            Submission::InDeviceMemory { .. } if self.shared_memory => 0,
            _ => (call.len() * (size_of::<Ray>() + self.answer_bytes)) as u64,
        }
    }

    /// Records all that a call needs: its rays on their way, the kernel, the answers on theirs.
    pub fn encode<A: Pod + Debug + Send + Sync>(
        &self,
        (device, queue): (&wgpu::Device, &wgpu::Queue),
        encoder: &mut wgpu::CommandEncoder,
        scene: &wgpu::BindGroup,
        scene_max_abs: f32,
        call: &mut Submission<'_, A>,
    ) -> Option<InFlight> {
        debug_assert_eq!(size_of::<A>(), self.answer_bytes);
        let count = call.len();
        if count == 0 {
            return None;
        }
        let params = self.params(device);
        let told = Params { count: count as u32, scene_max_abs, zero: 0, spare: 0 };
        queue.write_buffer(&params, 0, bytemuck::bytes_of(&told));
        let (ray_bytes, bytes) = ((count * size_of::<Ray>()) as u64, (count * self.answer_bytes) as u64);
        let lane = match call {
            Submission::InDeviceMemory { rays, answers, range } if self.shared_memory => {
                let at = |size: usize| (range.start * size) as u64;
                let rays = part(rays.hand_out(), at(size_of::<Ray>()), ray_bytes);
                let answers = part(answers.hand_out(), at(self.answer_bytes), bytes);
                self.encode_pass(device, encoder, scene, (rays, &params, answers), count);
                None
            }
            Submission::InDeviceMemory { rays, answers, range } => {
                let at = |size: usize| (range.start * size) as u64;
                let lane = self.take(device, count);
                encoder.copy_buffer_to_buffer(
                    rays.hand_out(),
                    at(size_of::<Ray>()),
                    &lane.rays,
                    0,
                    ray_bytes,
                );
                self.encode_pass(device, encoder, scene, lane.bindings(&params, ray_bytes, bytes), count);
                let answers = answers.hand_out();
                encoder.copy_buffer_to_buffer(&lane.answers, 0, answers, at(self.answer_bytes), bytes);
                Some(lane)
            }
            Submission::InHostMemory { rays, .. } => {
                let lane = self.take(device, count);
                queue.write_buffer(&lane.rays, 0, bytemuck::cast_slice(rays));
                self.encode_pass(device, encoder, scene, lane.bindings(&params, ray_bytes, bytes), count);
                encoder.copy_buffer_to_buffer(&lane.answers, 0, &lane.readback, 0, bytes);
                Some(lane)
            }
        };
        if let Submission::InDeviceMemory { answers, .. } = call {
            // What the device has written is to be seen by the host.
            let (buffer, state) = (answers.hand_out(), wgpu::BufferUses::MAP_READ);
            encoder.transition_resources(
                [wgpu::BufferTransition { buffer, state }].into_iter(),
                std::iter::empty(),
            );
        }
        Some(InFlight { params, lane, bytes })
    }

    fn encode_pass(
        &self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        scene: &wgpu::BindGroup,
        (rays, params, answers): (wgpu::BindingResource<'_>, &wgpu::Buffer, wgpu::BindingResource<'_>),
        count: usize,
    ) {
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("call"),
            layout: &self.layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: rays },
                entry(1, params),
                wgpu::BindGroupEntry { binding: 2, resource: answers },
            ],
        });
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, scene, &[]);
        pass.set_bind_group(1, &group, &[]);
        pass.dispatch_workgroups((count as u32).div_ceil(WORKGROUP_SIZE), 1, 1);
    }

    /// Takes the smallest lane that has room for `rays`, or makes one of a power of two.
    fn take(&self, device: &wgpu::Device, rays: usize) -> Staging {
        let mut idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let fits = (0..idle.len()).filter(|&i| idle[i].capacity >= rays).min_by_key(|&i| idle[i].capacity);
        if let Some(index) = fits {
            return idle.swap_remove(index);
        }
        // A lane that has become too small makes way for a larger one.
        let outgrown = idle.pop();
        drop((idle, outgrown));
        Staging::new(device, rays.next_power_of_two(), self.answer_bytes)
    }

    fn params(&self, device: &wgpu::Device) -> wgpu::Buffer {
        use wgpu::BufferUsages as U;
        let idle = self.idle_params.lock().unwrap_or_else(PoisonError::into_inner).pop();
        idle.unwrap_or_else(|| buffer(device, "params", size_of::<Params>(), U::UNIFORM | U::COPY_DST))
    }

    /// Brings the answers to where the call wants them, once the submission is done, and frees the buffers.
    pub fn land<A: Pod + Debug + Send + Sync>(
        &self,
        call: &mut Submission<'_, A>,
        encoded: Encoded,
    ) -> Result<(), String> {
        let Encoded { in_flight: InFlight { params, lane, bytes }, mapped } = encoded;
        match call {
            Submission::InDeviceMemory { rays, answers, .. } => {
                rays.take_back();
                answers.take_back();
            }
            Submission::InHostMemory { answers, .. } => {
                let readback = &lane.as_ref().expect("rays from anywhere go through a lane").readback;
                // The submission is done, but the callback runs on whichever thread polled first, perhaps not yet.
                match mapped.map(|mapped| mapped.recv_timeout(CALLBACK_PATIENCE)) {
                    Some(Ok(Ok(()))) => {}
                    Some(Ok(Err(error))) => return Err(error.to_string()),
                    _ => return Err("the answers were not mapped".into()),
                }
                let view = readback.get_mapped_range(0..bytes).map_err(|e| e.to_string())?;
                answers.copy_from_slice(bytemuck::cast_slice(&view));
                drop(view);
                readback.unmap();
            }
        }
        self.idle_params.lock().unwrap_or_else(PoisonError::into_inner).push(params);
        self.idle.lock().unwrap_or_else(PoisonError::into_inner).extend(lane);
        Ok(())
    }
}

/// A call that has been submitted.
#[derive(Debug)]
pub(super) struct Encoded {
    in_flight: InFlight,
    /// Tells that answers can be read, where they have to be mapped.
    mapped: Option<Receiver<Result<(), wgpu::BufferAsyncError>>>,
}

impl InFlight {
    /// Asks for the answers, once submitted.
    pub fn ask<A>(self, call: &Submission<'_, A>) -> Encoded {
        let mapped = match (call, &self.lane) {
            (Submission::InHostMemory { .. }, Some(lane)) => {
                let (sender, mapped) = sync_channel(1);
                // Nobody listens when the call has been given up.
                let told = move |result| drop(sender.send(result));
                lane.readback.map_async(wgpu::MapMode::Read, 0..self.bytes, told);
                Some(mapped)
            }
            _ => None,
        };
        Encoded { in_flight: self, mapped }
    }
}

impl Staging {
    fn new(device: &wgpu::Device, capacity: usize, answer_bytes: usize) -> Self {
        use wgpu::BufferUsages as U;
        let answer_bytes = capacity * answer_bytes;
        Self {
            capacity,
            rays: buffer(device, "rays", capacity * size_of::<Ray>(), U::STORAGE | U::COPY_DST),
            answers: buffer(device, "answers", answer_bytes, U::STORAGE | U::COPY_SRC),
            readback: buffer(device, "readback", answer_bytes, U::MAP_READ | U::COPY_DST),
        }
    }

    fn bindings<'a>(
        &'a self,
        params: &'a wgpu::Buffer,
        ray_bytes: u64,
        bytes: u64,
    ) -> (wgpu::BindingResource<'a>, &'a wgpu::Buffer, wgpu::BindingResource<'a>) {
        (part(&self.rays, 0, ray_bytes), params, part(&self.answers, 0, bytes))
    }
}

fn buffer(device: &wgpu::Device, label: &str, bytes: usize, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    let (label, size) = (Some(label), bytes as u64);
    device.create_buffer(&wgpu::BufferDescriptor { label, size, usage, mapped_at_creation: false })
}

/// Binds a whole buffer.
pub(super) fn entry(binding: u32, buffer: &wgpu::Buffer) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() }
}

/// Binds part of a buffer.
fn part(buffer: &wgpu::Buffer, offset: u64, bytes: u64) -> wgpu::BindingResource<'_> {
    let size = std::num::NonZeroU64::new(bytes);
    wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset, size })
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
