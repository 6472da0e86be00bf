//! A scene on the device: its buffers, and the kernels made for its tree.

use super::flatten::{Flat, Variant};
use super::kernel::{Kernel, Shape};
use super::layout::Member;
use super::pages::ScenePages;
use super::pass::{Pass, entry};
use super::{Gpu, GpuError};
use crate::bvh::Bvh;

/// Bytes uploaded at once: each piece passes through staging memory of its size.
const UPLOAD_BYTES: usize = 16 << 20;

/// Gives a kernel's source for a shape of scene.
pub(super) type Source = fn(Kernel, &Shape) -> String;

/// A scene on the device.
#[derive(Debug)]
pub(super) struct DeviceScene {
    /// Binds the pages of nodes, pairs and identities, and members: group 0.
    pub group: wgpu::BindGroup,
    pub closest: Pass,
    pub any: Pass,
    /// Bytes of all of them.
    pub bytes: u64,
}

impl DeviceScene {
    /// Uploads a tree and compiles the kernels for it from `source`.
    ///
    /// # Errors
    /// When the scene exceeds what the adapter binds (told before anything is allocated), or the
    /// device refuses or is lost.
    pub fn new(gpu: &Gpu, bvh: &Bvh, variant: Variant, source: Source) -> Result<Self, GpuError> {
        let flat = Flat::of(bvh, variant);
        let pages = ScenePages::new(gpu, &flat)?;
        let Flat { nodes, pairs, identities, members, stack } = flat;
        let adapter = || gpu.info().to_string();

        let shape = Shape { stack, tree: variant.tree, members: !members.is_empty(), pages };
        let shared = gpu.info().shared_memory;
        let made = gpu.attempt(|device, _| {
            let (group, call) = layouts(device, pages.bindings());
            let pass =
                |kernel| Pass::new(device, kernel, source(kernel, &shape), &group, call.clone(), shared);
            let (closest, any) = (pass(Kernel::TraceClosest), pass(Kernel::TraceAny));
            (group, closest, any)
        });
        let (layout, closest, any) = made
            .map_err(GpuError::Lost)?
            .map_err(|reason| GpuError::Kernel { adapter: adapter(), reason })?;

        let node_pages = nodes.split(pages.nodes).into_iter().map(|page| ("nodes", page));
        let pair_pages = pages.pairs.split(&pairs).map(|page| ("pairs", bytemuck::cast_slice(page)));
        let identity_pages =
            pages.identities.split(&identities).map(|page| ("identities", bytemuck::cast_slice(page)));
        let member_page = ("members", bytemuck::cast_slice(&members));
        let contents: Vec<(&str, &[u8])> =
            node_pages.chain(pair_pages).chain(identity_pages).chain([member_page]).collect();
        // A binding may not be empty.
        let size = |page: &[u8]| page.len().max(size_of::<Member>()) as u64;
        let bytes = contents.iter().map(|(_, page)| size(page)).sum();
        let made = gpu.attempt(|device, _| {
            let buffer = |&(label, page): &(&str, &[u8])| {
                device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some(label),
                    // More than any device has, when it is to refuse.
                    size: if gpu.has_no_memory() { 1 << 62 } else { size(page) },
                    usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                })
            };
            let buffers: Vec<wgpu::Buffer> = contents.iter().map(buffer).collect();
            let entries: Vec<_> =
                (0..).zip(&buffers).map(|(binding, buffer)| entry(binding, buffer)).collect();
            let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("scene"),
                layout: &layout,
                entries: &entries,
            });
            (buffers, group)
        });
        let (buffers, group) = made.map_err(GpuError::Lost)?.map_err(|reason| GpuError::OutOfMemory {
            required: bytes,
            adapter: adapter(),
            reason,
        })?;
        for (buffer, (_, page)) in buffers.iter().zip(&contents) {
            upload(gpu, buffer, page)?;
        }
        Ok(Self { group, closest, any, bytes })
    }
}

/// Group 0: the scene's pages. Group 1: rays, params, answers.
fn layouts(device: &wgpu::Device, pages: u32) -> (wgpu::BindGroupLayout, wgpu::BindGroupLayout) {
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
    (layout("scene", &vec![input; pages as usize]), layout("call", &[input, Uniform, output]))
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
