//! A scene on the device: its buffers, and the kernels made for its tree.

use super::dispatch::{Dispatch, entry};
use super::flatten::{Flat, Nodes, Variant};
use super::kernel_kind::{KernelKind, Shape, TreeKind};
use super::layout::TreeInstance;
use super::pages::ScenePages;
use super::{Gpu, GpuError, device_tree};
use crate::bvh::Bvh;

/// Bytes uploaded at once: each piece passes through staging memory of its size.
const UPLOAD_BYTES: usize = 16 << 20;

/// What the device makes its own tree of.
const BOXES: &str = "boxes";

/// Gives a kernel's source for a shape of scene.
pub(super) type Source = fn(KernelKind, &Shape) -> String;

/// A scene on the device.
#[derive(Debug)]
pub(super) struct DeviceScene {
    /// Binds the pages of nodes, pairs and identities, and members or the device's own tree: group 0.
    pub group: wgpu::BindGroup,
    pub closest: Dispatch,
    pub any: Dispatch,
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
        let adapter = || gpu.info().to_string();
        let by_query = variant.tree == TreeKind::Device;
        if by_query && gpu.info().max_query_boxes == 0 {
            return Err(GpuError::KernelKind { adapter: adapter(), reason: "it has no ray queries".into() });
        }
        let flat = Flat::of(bvh, variant);
        let pages = ScenePages::new(gpu, &flat)?;
        let Flat { nodes, pairs, identities, members, stack, first_masked } = flat;

        let shape = Shape { stack, tree: variant.tree, members: !members.is_empty(), first_masked, pages };
        let shared = gpu.info().shared_memory;
        let made = gpu.attempt(|device, _| {
            let (group, call) = layouts(device, pages.bindings(), by_query);
            let pass =
                |kernel| Dispatch::new(device, kernel, source(kernel, &shape), &group, call.clone(), shared);
            let (closest, any) = (pass(KernelKind::TraceClosest), pass(KernelKind::TraceAny));
            (group, closest, any)
        });
        let (layout, closest, any) = made
            .map_err(GpuError::Lost)?
            .map_err(|reason| GpuError::KernelKind { adapter: adapter(), reason })?;

        let node_pages = nodes.split(pages.nodes).into_iter().map(|page| ("nodes", page));
        let pair_pages = pages.pairs.split(&pairs).map(|page| ("pairs", bytemuck::cast_slice(page)));
        let identity_pages =
            pages.identities.split(&identities).map(|page| ("identities", bytemuck::cast_slice(page)));
        let last: (&str, &[u8]) = match &nodes {
            Nodes::Device(boxes) => (BOXES, bytemuck::cast_slice(boxes)),
            Nodes::Binary(_) | Nodes::Wide(_) => ("members", bytemuck::cast_slice(&members)),
        };
        let contents: Vec<(&str, &[u8])> =
            node_pages.chain(pair_pages).chain(identity_pages).chain([last]).collect();
        // A binding may not be empty.
        let size = |page: &[u8]| page.len().max(size_of::<TreeInstance>()) as u64;
        let bytes = contents.iter().map(|(_, page)| size(page)).sum();
        let made = gpu.attempt(|device, _| {
            let buffer = |&(label, page): &(&str, &[u8])| {
                device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some(label),
                    // More than any device has, when it is to refuse.
                    size: if gpu.has_no_memory() { 1 << 62 } else { size(page) },
                    usage: wgpu::BufferUsages::COPY_DST
                        | match label {
                            BOXES => wgpu::BufferUsages::BLAS_INPUT,
                            _ => wgpu::BufferUsages::STORAGE,
                        },
                    mapped_at_creation: false,
                })
            };
            contents.iter().map(buffer).collect::<Vec<wgpu::Buffer>>()
        });
        let out_of_memory = |reason| GpuError::OutOfMemory { required: bytes, adapter: adapter(), reason };
        let buffers = made.map_err(GpuError::Lost)?.map_err(out_of_memory)?;
        for (buffer, (_, page)) in buffers.iter().zip(&contents) {
            upload(gpu, buffer, page)?;
        }
        let tree = match (by_query, buffers.last()) {
            (true, Some(boxes)) => Some(device_tree::build(gpu, boxes, last.1.len() as u64)?),
            _ => None,
        };
        let made = gpu.attempt(|device, _| {
            let mut entries: Vec<_> =
                (0..).zip(&buffers).map(|(binding, buffer)| entry(binding, buffer)).collect();
            if let (Some(last), Some(tree)) = (entries.last_mut(), &tree) {
                last.resource = wgpu::BindingResource::AccelerationStructure(tree);
            }
            let (label, layout) = (Some("scene"), &layout);
            device.create_bind_group(&wgpu::BindGroupDescriptor { label, layout, entries: &entries })
        });
        let group = made.map_err(GpuError::Lost)?.map_err(out_of_memory)?;
        Ok(Self { group, closest, any, bytes })
    }
}

/// Group 0: the scene's pages, the last of which may be the device's own tree. Group 1: rays, params, answers.
fn layouts(
    device: &wgpu::Device,
    pages: u32,
    by_query: bool,
) -> (wgpu::BindGroupLayout, wgpu::BindGroupLayout) {
    use wgpu::BindingType::{AccelerationStructure, Buffer};
    use wgpu::BufferBindingType::{Storage, Uniform};
    let layout = |label, types: &[wgpu::BindingType]| {
        let entries: Vec<_> = (0..)
            .zip(types)
            .map(|(binding, &ty)| wgpu::BindGroupLayoutEntry {
                binding,
                visibility: wgpu::ShaderStages::COMPUTE,
                ty,
                count: None,
            })
            .collect();
        device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some(label),
            entries: &entries,
        })
    };
    let buffer = |ty| Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
    let (input, output) = (buffer(Storage { read_only: true }), buffer(Storage { read_only: false }));
    let mut scene = vec![input; pages as usize];
    if let (true, Some(last)) = (by_query, scene.last_mut()) {
        *last = AccelerationStructure { vertex_return: false };
    }
    (layout("scene", &scene), layout("call", &[input, buffer(Uniform), output]))
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
