//! A scene on the device: its buffers, and the kernels made for its tree.

use super::flatten::{Flat, flatten, node_count};
use super::kernel::Kernel;
use super::layout::{Node, Triangle};
use super::pass::{Pass, entry};
use super::{Gpu, GpuError};
use crate::bvh::Bvh;

/// Bytes uploaded at once: each piece passes through staging memory of its size.
const UPLOAD_BYTES: usize = 16 << 20;

/// Gives a kernel's source, with room for so many entries on the stack.
pub(super) type Source<'a> = &'a dyn Fn(Kernel, usize) -> String;

/// A scene on the device.
#[derive(Debug)]
pub(super) struct DeviceScene {
    /// Binds nodes and triangles: group 0.
    pub group: wgpu::BindGroup,
    pub closest: Pass,
    pub any: Pass,
    /// Bytes of nodes and triangles.
    pub bytes: u64,
}

impl DeviceScene {
    /// Uploads a tree and compiles the kernels for it from `source`.
    ///
    /// # Errors
    /// When a buffer exceeds what the adapter binds (told before anything is allocated), or the
    /// device refuses or is lost.
    pub fn new(gpu: &Gpu, bvh: &Bvh, source: Source<'_>) -> Result<Self, GpuError> {
        let binary = bvh.binary();
        let node_bytes = check(gpu, "BVH nodes", node_count(&binary) * size_of::<Node>())?;
        let triangle_bytes = check(gpu, "triangles", bvh.len().max(1) * size_of::<Triangle>())?;
        let Flat { nodes, triangles, stack } = flatten(bvh, &binary);
        let adapter = || gpu.info().to_string();

        let made = gpu.attempt(|device, _| {
            let (group, call) = layouts(device);
            let pass = |kernel| Pass::new(device, kernel, source(kernel, stack), &group, call.clone());
            let (closest, any) = (pass(Kernel::TraceClosest), pass(Kernel::TraceAny));
            (group, closest, any)
        });
        let (layout, closest, any) = made
            .map_err(GpuError::Lost)?
            .map_err(|reason| GpuError::Kernel { adapter: adapter(), reason })?;

        let made = gpu.attempt(|device, _| {
            let buffer = |label, size| {
                device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some(label),
                    size,
                    usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                })
            };
            // More than any device has, when it is to refuse.
            let nodes = buffer("nodes", if gpu.has_no_memory() { 1 << 62 } else { node_bytes });
            let triangles = buffer("triangles", triangle_bytes);
            let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("scene"),
                layout: &layout,
                entries: &[entry(0, &nodes), entry(1, &triangles)],
            });
            (nodes, triangles, group)
        });
        let (node_buffer, triangle_buffer, group) = made.map_err(GpuError::Lost)?.map_err(|reason| {
            GpuError::OutOfMemory { required: node_bytes + triangle_bytes, adapter: adapter(), reason }
        })?;
        upload(gpu, &node_buffer, bytemuck::cast_slice(&nodes))?;
        upload(gpu, &triangle_buffer, bytemuck::cast_slice(&triangles))?;
        Ok(Self { group, closest, any, bytes: node_bytes + triangle_bytes })
    }
}

fn check(gpu: &Gpu, what: &'static str, required: usize) -> Result<u64, GpuError> {
    let (required, available) =
        (required as u64, gpu.info().max_binding_bytes.min(gpu.info().max_buffer_bytes));
    if required > available {
        return Err(GpuError::TooLarge { what, required, available, adapter: gpu.info().to_string() });
    }
    Ok(required)
}

/// Group 0: nodes, triangles. Group 1: rays, params, answers.
fn layouts(device: &wgpu::Device) -> (wgpu::BindGroupLayout, wgpu::BindGroupLayout) {
    use wgpu::BufferBindingType::{Storage, Uniform};
    let layout = |label, types: &[wgpu::BufferBindingType]| {
        let entries: Vec<_> = (0..)
            .zip(types)
            .map(|(binding, &ty)| wgpu::BindGroupLayoutEntry {
                binding,
                visibility: wgpu::ShaderStages::COMPUTE,
                ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
                count: None,
            })
            .collect();
        device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some(label),
            entries: &entries,
        })
    };
    let (input, output) = (Storage { read_only: true }, Storage { read_only: false });
    (layout("scene", &[input, input]), layout("call", &[input, Uniform, output]))
}

/// Writes a buffer piece by piece, waiting for each, so that staging memory stays small.
fn upload(gpu: &Gpu, buffer: &wgpu::Buffer, bytes: &[u8]) -> Result<(), GpuError> {
    for (index, piece) in bytes.chunks(UPLOAD_BYTES).enumerate() {
        let sent = gpu.guard(|_, queue| {
            queue.write_buffer(buffer, (index * UPLOAD_BYTES) as u64, piece);
            gpu.wait(&queue.submit([])).map(drop)
        });
        sent.map_err(GpuError::Lost)?;
    }
    Ok(())
}
