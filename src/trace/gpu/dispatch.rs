//! One kernel and its buffers: encodes a dispatch, maps its answers and reads them back.
//!
//! | rays lie in | the kernel reads and writes | bytes copied a ray |
//! |---|---|---|
//! | device memory that kernels reach | the stream's own memory | 0 |
//! | device memory that only copies reach | staging buffers; the device copies to and from them | 32 + answer |
//! | host memory | staging buffers; wgpu stages the rays, the answers are mapped and copied | 32 + answer |

use super::exact::Layouts;
use super::kernel::Kernel;
use super::kernel_clock::KernelClock;
use super::layout::{Params, WORKGROUP_SIZE};
use super::shared_buffer::SharedBuffer;
use super::unchecked_module;
use super::undecided::{Mapped, Undecided, UndecidedList};
use crate::device::{CALLBACK_PATIENCE, Gpu, bind_whole};
use crate::stream::{DeviceMemory as _, Ray};
use bytemuck::Pod;
use std::fmt::Debug;
use std::ops::Range;
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Mutex, PoisonError};

/// A kernel compiled for a scene, and the buffers that no dispatch uses at the moment.
#[derive(Debug)]
pub(super) struct KernelPipeline {
    pipeline: wgpu::ComputePipeline,
    answers: Answers,
    layout: wgpu::BindGroupLayout,
    /// Bytes of one ray's answer.
    answer_bytes: usize,
    shared_memory: bool,
    idle_staging: Mutex<Vec<StagingBuffers>>,
    idle_lists: Mutex<Vec<UndecidedList>>,
    idle_params: Mutex<Vec<wgpu::Buffer>>,
}

/// The answers of a kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Answers {
    /// Candidates: the host makes the hits.
    Candidates,
    /// Hits, and a list of rays that it leaves to the host.
    Hits,
}

/// The rays that one kernel traces in a dispatch, and the memory of their answers. Once read back, that memory holds
/// the kernel's answers, bit by bit.
#[derive(Debug)]
pub(super) enum Request<'a, A> {
    /// In any host memory.
    InHostMemory { rays: &'a [Ray], answers: &'a mut [A] },
    /// A range of memory that this device shares with the host.
    InDeviceMemory { rays: &'a SharedBuffer<Ray>, answers: &'a mut SharedBuffer<A>, range: Range<usize> },
}

/// Buffers on the device for the rays and answers of one dispatch.
#[derive(Debug)]
struct StagingBuffers {
    /// In rays.
    capacity: usize,
    rays: wgpu::Buffer,
    answers: wgpu::Buffer,
    /// Where the host reads answers, unless the device copies them to the stream's memory.
    readback: wgpu::Buffer,
}

/// A request that has been encoded: the buffers that its commands use.
#[derive(Debug)]
pub(super) struct Encoded {
    params: wgpu::Buffer,
    list: UndecidedList,
    staging: Option<StagingBuffers>,
    answer_bytes: u64,
}

/// A request that has been submitted.
#[derive(Debug)]
pub(super) struct InFlight {
    encoded: Encoded,
    /// Receives when the answers can be read, if they have to be mapped.
    mapped: Option<Receiver<Result<(), wgpu::BufferAsyncError>>>,
    /// The same for the list of undecided rays, if kernels write one.
    listed: Option<Mapped>,
}

/// The bindings of kernels: rays, parameters and the list of undecided rays, answers.
type Bindings<'a> =
    (wgpu::BindingResource<'a>, (&'a wgpu::Buffer, &'a UndecidedList), wgpu::BindingResource<'a>);

impl<A: Pod + Debug + Send + Sync> Request<'_, A> {
    /// Number of rays.
    pub fn len(&self) -> usize {
        match self {
            Self::InHostMemory { rays, .. } => rays.len(),
            Self::InDeviceMemory { range, .. } => range.len(),
        }
    }

    /// The rays and the memory of their answers.
    pub fn slices(&mut self) -> (&[Ray], &mut [A]) {
        match self {
            Self::InHostMemory { rays, answers } => (rays, answers),
            Self::InDeviceMemory { rays, answers, range } => {
                (&rays.as_slice()[range.clone()], &mut answers.as_mut_slice()[range.clone()])
            }
        }
    }
}

impl KernelPipeline {
    /// A kernel that answers with candidates, compiled from its source.
    pub fn of_source(
        device: &wgpu::Device,
        kernel: Kernel,
        source: String,
        layouts: Layouts<'_>,
        shared_memory: bool,
    ) -> Self {
        let both = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(kernel.name()),
            bind_group_layouts: &[Some(layouts.scene), Some(layouts.request)],
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
        Self::new(kernel, (pipeline, Answers::Candidates), layouts, shared_memory)
    }

    /// A kernel that has been compiled.
    pub fn new(
        kernel: Kernel,
        (pipeline, answers): (wgpu::ComputePipeline, Answers),
        layouts: Layouts<'_>,
        shared_memory: bool,
    ) -> Self {
        Self {
            pipeline,
            answers,
            layout: layouts.request.clone(),
            answer_bytes: kernel.answer_bytes(),
            shared_memory,
            idle_staging: Mutex::default(),
            idle_lists: Mutex::default(),
            idle_params: Mutex::default(),
        }
    }

    /// True if the device answers with hits.
    pub fn is_exact(&self) -> bool {
        self.answers == Answers::Hits
    }

    /// Bytes that are copied between host and device for a request.
    pub fn bytes_copied<A: Pod + Debug + Send + Sync>(&self, request: &Request<'_, A>) -> u64 {
        match request {
            Request::InDeviceMemory { .. } if self.shared_memory => 0,
            _ => (request.len() * (size_of::<Ray>() + self.answer_bytes)) as u64,
        }
    }

    /// Encodes all commands of a request: copies of its rays, the kernel, copies of the answers. `clock` times the
    /// kernel. `None` if the request has no rays.
    pub fn encode<A: Pod + Debug + Send + Sync>(
        &self,
        (device, queue): (&wgpu::Device, &wgpu::Queue),
        encoder: &mut wgpu::CommandEncoder,
        scene: &wgpu::BindGroup,
        scene_max_abs: f32,
        request: &mut Request<'_, A>,
        clock: Option<&KernelClock>,
    ) -> Option<Encoded> {
        debug_assert_eq!(size_of::<A>(), self.answer_bytes);
        let count = request.len();
        if count == 0 {
            return None;
        }
        let (params, list) = (self.take_params(device), self.take_list(device, count));
        let lent = (&params, &list);
        let values = Params { count: count as u32, scene_max_abs, zero: 0, spare: 0 };
        queue.write_buffer(&params, 0, bytemuck::bytes_of(&values));
        let ray_bytes = (count * size_of::<Ray>()) as u64;
        let answer_bytes = (count * self.answer_bytes) as u64;
        let staging = match request {
            Request::InDeviceMemory { rays, answers, range } if self.shared_memory => {
                let offset = |size: usize| (range.start * size) as u64;
                let rays = bind_part(rays.buffer(), offset(size_of::<Ray>()), ray_bytes);
                let answers = bind_part(answers.give_to_device(), offset(self.answer_bytes), answer_bytes);
                self.encode_kernel(device, encoder, scene, (rays, lent, answers), count, clock);
                None
            }
            Request::InDeviceMemory { rays, answers, range } => {
                let offset = |size: usize| (range.start * size) as u64;
                let staging = self.take_staging(device, count);
                let (rays, ray_offset) = (rays.buffer(), offset(size_of::<Ray>()));
                encoder.copy_buffer_to_buffer(rays, ray_offset, &staging.rays, 0, ray_bytes);
                let bindings = staging.bindings(lent, ray_bytes, answer_bytes);
                self.encode_kernel(device, encoder, scene, bindings, count, clock);
                let (answers, answer_offset) = (answers.give_to_device(), offset(self.answer_bytes));
                encoder.copy_buffer_to_buffer(&staging.answers, 0, answers, answer_offset, answer_bytes);
                Some(staging)
            }
            Request::InHostMemory { rays, .. } => {
                let staging = self.take_staging(device, count);
                queue.write_buffer(&staging.rays, 0, bytemuck::cast_slice(rays));
                let bindings = staging.bindings(lent, ray_bytes, answer_bytes);
                self.encode_kernel(device, encoder, scene, bindings, count, clock);
                encoder.copy_buffer_to_buffer(&staging.answers, 0, &staging.readback, 0, answer_bytes);
                Some(staging)
            }
        };
        if let Request::InDeviceMemory { answers, .. } = request {
            // Makes the device's writes visible to the host.
            let (buffer, state) = (answers.give_to_device(), wgpu::BufferUses::MAP_READ);
            encoder.transition_resources(
                [wgpu::BufferTransition { buffer, state }].into_iter(),
                std::iter::empty(),
            );
        }
        if self.is_exact() {
            list.encode_copy(encoder);
        }
        Some(Encoded { params, list, staging, answer_bytes })
    }

    /// Encodes the kernel's run over `count` rays.
    fn encode_kernel(
        &self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        scene: &wgpu::BindGroup,
        (rays, (params, list), answers): Bindings<'_>,
        count: usize,
        clock: Option<&KernelClock>,
    ) {
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("request"),
            layout: &self.layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: rays },
                bind_whole(1, params),
                wgpu::BindGroupEntry { binding: 2, resource: answers },
                wgpu::BindGroupEntry { binding: 3, resource: list.binding() },
            ],
        });
        if self.is_exact() {
            list.encode_clear(encoder);
        }
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            timestamp_writes: clock.map(KernelClock::writes),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, scene, &[]);
        pass.set_bind_group(1, &group, &[]);
        pass.dispatch_workgroups((count as u32).div_ceil(WORKGROUP_SIZE), 1, 1);
    }

    /// Takes the smallest idle list for dispatches of `rays`, or allocates one for a power of two.
    fn take_list(&self, device: &wgpu::Device, rays: usize) -> UndecidedList {
        let mut idle = self.idle_lists.lock().unwrap_or_else(PoisonError::into_inner);
        // Without exact kernels nothing is written to it.
        let rays = if self.is_exact() { rays } else { 0 };
        let fits = (0..idle.len()).filter(|&i| idle[i].capacity >= rays).min_by_key(|&i| idle[i].capacity);
        if let Some(index) = fits {
            return idle.swap_remove(index);
        }
        let outgrown = idle.pop();
        drop((idle, outgrown));
        UndecidedList::new(device, rays.next_power_of_two())
    }

    /// Takes the smallest idle staging buffers that have room for `rays`, or allocates some for a power of two.
    fn take_staging(&self, device: &wgpu::Device, rays: usize) -> StagingBuffers {
        let mut idle = self.idle_staging.lock().unwrap_or_else(PoisonError::into_inner);
        let fits = (0..idle.len()).filter(|&i| idle[i].capacity >= rays).min_by_key(|&i| idle[i].capacity);
        if let Some(index) = fits {
            return idle.swap_remove(index);
        }
        // Larger buffers replace some that have become too small.
        let outgrown = idle.pop();
        drop((idle, outgrown));
        StagingBuffers::new(device, rays.next_power_of_two(), self.answer_bytes)
    }

    fn take_params(&self, device: &wgpu::Device) -> wgpu::Buffer {
        use wgpu::BufferUsages as U;
        let idle = self.idle_params.lock().unwrap_or_else(PoisonError::into_inner).pop();
        idle.unwrap_or_else(|| buffer(device, "params", size_of::<Params>(), U::UNIFORM | U::COPY_DST))
    }

    /// Reads the answers back into the request's memory, once the submission is done, and frees the buffers for the
    /// next dispatch. Returns the undecided rays, if the device answers with hits.
    pub fn read_back<A: Pod + Debug + Send + Sync>(
        &self,
        request: &mut Request<'_, A>,
        in_flight: InFlight,
    ) -> Result<Option<Undecided>, String> {
        let InFlight { encoded: Encoded { params, list, staging, answer_bytes }, mapped, listed } = in_flight;
        let undecided = listed.map(|listed| list.read(&listed, request.len())).transpose()?;
        match request {
            Request::InDeviceMemory { answers, .. } => answers.return_to_host(),
            Request::InHostMemory { answers, .. } => {
                let readback = &staging.as_ref().expect("rays of host memory are staged").readback;
                // The submission is done, but the callback runs on the thread that polled first, perhaps not yet.
                match mapped.map(|mapped| mapped.recv_timeout(CALLBACK_PATIENCE)) {
                    Some(Ok(Ok(()))) => {}
                    Some(Ok(Err(error))) => return Err(error.to_string()),
                    _ => return Err("the answers were not mapped".into()),
                }
                let view = readback.get_mapped_range(0..answer_bytes).map_err(|e| e.to_string())?;
                answers.copy_from_slice(bytemuck::cast_slice(&view));
                drop(view);
                readback.unmap();
            }
        }
        self.idle_params.lock().unwrap_or_else(PoisonError::into_inner).push(params);
        self.idle_lists.lock().unwrap_or_else(PoisonError::into_inner).push(list);
        self.idle_staging.lock().unwrap_or_else(PoisonError::into_inner).extend(staging);
        Ok(undecided)
    }
}

impl Encoded {
    /// Requests that the answers be mapped if they go to host memory, and if kernels write it the list of undecided
    /// rays, after the commands have been submitted.
    pub fn map(self, to_host: bool, is_exact: bool) -> InFlight {
        let mapped = match &self.staging {
            Some(staging) if to_host => {
                let (sender, mapped) = sync_channel(1);
                // The receiver is gone if the dispatch has been given up.
                let callback = move |result| drop(sender.send(result));
                staging.readback.map_async(wgpu::MapMode::Read, 0..self.answer_bytes, callback);
                Some(mapped)
            }
            _ => None,
        };
        let listed = is_exact.then(|| self.list.map());
        InFlight { encoded: self, mapped, listed }
    }
}

impl StagingBuffers {
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
        lent: (&'a wgpu::Buffer, &'a UndecidedList),
        ray_bytes: u64,
        answer_bytes: u64,
    ) -> Bindings<'a> {
        (bind_part(&self.rays, 0, ray_bytes), lent, bind_part(&self.answers, 0, answer_bytes))
    }
}

fn buffer(device: &wgpu::Device, label: &str, bytes: usize, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    let (label, size) = (Some(label), bytes as u64);
    device.create_buffer(&wgpu::BufferDescriptor { label, size, usage, mapped_at_creation: false })
}

/// Binds part of a buffer.
fn bind_part(buffer: &wgpu::Buffer, offset: u64, bytes: u64) -> wgpu::BindingResource<'_> {
    let size = std::num::NonZeroU64::new(bytes);
    wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset, size })
}

/// The most rays of one request to an adapter with these limits.
pub(super) fn max_rays(gpu: &Gpu) -> usize {
    let info = gpu.info();
    let bindable = info.max_binding_bytes.min(info.max_buffer_bytes) / size_of::<Ray>() as u64;
    // Staging buffers hold a power of two.
    let bindable = (bindable + 1).next_power_of_two() / 2;
    let dispatchable = u64::from(info.max_workgroups) * u64::from(WORKGROUP_SIZE);
    bindable.min(dispatchable) as usize
}
