//! A kernel's pipelines and buffers: sends columns of words, runs an entry point, reads columns back.

use super::GpuProgramError;
use crate::device::{CALLBACK_PATIENCE, Gpu, WORKGROUP, bind_whole, module};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::mpsc::sync_channel;
use std::sync::{Mutex, PoisonError};

/// The most points of a dispatch.
pub(super) const MOST_POINTS: usize = 1 << 18;

/// An entry point of a kernel.
#[derive(Clone, Copy, Debug)]
pub(super) enum Entry {
    /// The shader.
    Shade,
    /// The case of this number.
    Probe(u32),
}

/// A compiled kernel.
#[derive(Debug)]
pub(super) struct Pipelines {
    shade: wgpu::ComputePipeline,
    probe: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    idle: Mutex<Vec<Buffers>>,
    /// Whether the shader has been computed before.
    is_warm: AtomicBool,
}

/// Buffers of one dispatch.
#[derive(Debug)]
struct Buffers {
    inputs: wgpu::Buffer,
    results: wgpu::Buffer,
    readback: wgpu::Buffer,
    params: wgpu::Buffer,
}

impl Buffers {
    fn new(device: &wgpu::Device, (input_bytes, result_bytes): (u64, u64)) -> Self {
        use wgpu::BufferUsages as U;
        let buffer = |label, bytes: u64, usage| {
            let size = bytes.max(16).next_power_of_two();
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage,
                mapped_at_creation: false,
            })
        };
        Self {
            inputs: buffer("inputs", input_bytes, U::STORAGE | U::COPY_DST),
            results: buffer("results", result_bytes, U::STORAGE | U::COPY_SRC),
            readback: buffer("readback", result_bytes, U::MAP_READ | U::COPY_DST),
            params: buffer("params", 16, U::UNIFORM | U::COPY_DST),
        }
    }
}

impl Pipelines {
    /// Compiles the words of a kernel.
    pub fn new(device: &wgpu::Device, words: &[u32]) -> Self {
        let buffer = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
            count: None,
        };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("shading"),
            entries: &[
                buffer(0, wgpu::BufferBindingType::Storage { read_only: true }),
                buffer(1, wgpu::BufferBindingType::Storage { read_only: false }),
                buffer(2, wgpu::BufferBindingType::Uniform),
            ],
        });
        let whole = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("shading"),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let module = module(device, "shading", words, &["shade", "probe"]);
        let pipeline = |entry| {
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry),
                layout: Some(&whole),
                module: &module,
                entry_point: Some(entry),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: None,
            })
        };
        Self {
            shade: pipeline("shade"),
            probe: pipeline("probe"),
            idle: Mutex::default(),
            is_warm: AtomicBool::new(false),
            layout,
        }
    }

    /// Runs an entry point for as many points as a column has words, at most [`MOST_POINTS`].
    ///
    /// # Errors
    /// When the device is lost, or has no memory for the points.
    pub fn run(
        &self,
        gpu: &Gpu,
        (entry, points): (Entry, usize),
        inputs: &[u32],
        results: &mut [u32],
    ) -> Result<(), GpuProgramError> {
        debug_assert!(points <= MOST_POINTS);
        let sizes = (size_of_val(inputs) as u64, size_of_val(results) as u64);
        let buffers = match self.idle(sizes) {
            Some(buffers) => buffers,
            None => {
                let made = gpu.attempt(|device, _| Buffers::new(device, sizes));
                made.map_err(GpuProgramError::Lost)?.map_err(GpuProgramError::Memory)?
            }
        };
        let answered = gpu.guard(|device, queue| {
            let (pipeline, case) = match entry {
                Entry::Shade => (&self.shade, 0),
                Entry::Probe(case) => (&self.probe, case),
            };
            queue.write_buffer(&buffers.inputs, 0, bytemuck::cast_slice(inputs));
            queue.write_buffer(&buffers.params, 0, bytemuck::cast_slice(&[points as u32, case, 0, 0]));
            let group = self.group(device, &buffers);
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.dispatch_workgroups((points as u32).div_ceil(WORKGROUP), 1, 1);
            drop(pass);
            let bytes = size_of_val(results) as u64;
            encoder.copy_buffer_to_buffer(&buffers.results, 0, &buffers.readback, 0, bytes);
            let submission = queue.submit([encoder.finish()]);
            let (sender, receiver) = sync_channel(1);
            buffers.readback.map_async(wgpu::MapMode::Read, ..bytes, move |result| {
                // The receiver is gone if the wait has failed.
                let _ = sender.send(result);
            });
            let is_first = matches!(entry, Entry::Probe(_)) || !self.is_warm.load(Relaxed);
            gpu.wait_for_shading(&submission, is_first)?;
            self.is_warm.fetch_or(matches!(entry, Entry::Shade), Relaxed);
            let mapped = receiver.recv_timeout(CALLBACK_PATIENCE).map_err(|e| e.to_string())?;
            mapped.map_err(|e| e.to_string())?;
            let view = buffers.readback.get_mapped_range(..bytes).map_err(|e| e.to_string())?;
            bytemuck::cast_slice_mut(results).copy_from_slice(&view);
            drop(view);
            buffers.readback.unmap();
            self.idle.lock().unwrap_or_else(PoisonError::into_inner).push(buffers);
            Ok(())
        });
        answered.map_err(GpuProgramError::Lost)
    }

    /// Idle buffers that are large enough for these bytes of inputs and results.
    fn idle(&self, (input_bytes, result_bytes): (u64, u64)) -> Option<Buffers> {
        let idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner).pop();
        idle.filter(|buffers| buffers.inputs.size() >= input_bytes && buffers.results.size() >= result_bytes)
    }

    fn group(&self, device: &wgpu::Device, buffers: &Buffers) -> wgpu::BindGroup {
        let bindings = [&buffers.inputs, &buffers.results, &buffers.params];
        let entries: Vec<wgpu::BindGroupEntry<'_>> =
            (0..).zip(bindings).map(|(binding, buffer)| bind_whole(binding, buffer)).collect();
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("shading"),
            layout: &self.layout,
            entries: &entries,
        })
    }
}
