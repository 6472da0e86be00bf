//! A scene on the device: its buffers, and the kernels compiled for it.

use super::dispatch::{KernelPipeline, bind_whole};
use super::exact::{ExactKernels, Layouts, Refusal, Route};
use super::flatten::FlatScene;
use super::kernel::{Kernel, Shape};
use super::layout::TreeInstance;
use super::pages::ScenePages;
use super::{Fault, Gpu, GpuError};
use crate::bvh::Bvh;

/// Bytes uploaded at once. wgpu allocates staging memory of this size.
const UPLOAD_BYTES: usize = 16 << 20;

/// Makes a kernel's source for scenes of a shape.
pub(super) type Source = fn(Kernel, &Shape) -> String;

/// A scene on the device.
#[derive(Debug)]
pub(super) struct DeviceScene {
    /// Group 0: the pages of nodes, pairs and identities, and members.
    pub group: wgpu::BindGroup,
    /// The shape for which kernels are compiled, and the layouts of both groups.
    shape: Shape,
    layouts: [wgpu::BindGroupLayout; 2],
    pub trace_closest: KernelPipeline,
    pub trace_any: KernelPipeline,
    /// How the device makes hits of candidates, or why the host does.
    pub exact_hits: Result<Route, Refusal>,
    /// Bytes of the scene's buffers.
    pub bytes: u64,
}

impl DeviceScene {
    /// Uploads a tree and compiles the kernels for it from `source`.
    ///
    /// # Errors
    /// When the scene exceeds what the adapter can bind (before anything is allocated), the device refuses it, or the
    /// device is lost.
    pub fn new(gpu: &Gpu, bvh: &Bvh, source: Source) -> Result<Self, GpuError> {
        let adapter = || gpu.info().to_string();
        let flat = FlatScene::of(bvh);
        let pages = ScenePages::new(gpu.info(), flat.records())?;
        let FlatScene { nodes, pairs, identities, members, stack } = flat;

        let node_pages = pages.nodes.split(&nodes).map(|page| ("nodes", bytemuck::cast_slice(page)));
        let pair_pages = pages.pairs.split(&pairs).map(|page| ("pairs", bytemuck::cast_slice(page)));
        let identity_pages =
            pages.identities.split(&identities).map(|page| ("identities", bytemuck::cast_slice(page)));
        let last: (&str, &[u8]) = ("members", bytemuck::cast_slice(&members));
        let contents: Vec<(&str, &[u8])> =
            node_pages.chain(pair_pages).chain(identity_pages).chain([last]).collect();
        let bytes = contents.iter().map(|(_, page)| buffer_size(page)).sum();
        let out_of_memory = |reason| GpuError::OutOfMemory { required: bytes, adapter: adapter(), reason };
        let store = || -> Result<_, GpuError> {
            let buffers = allocate(gpu, &contents).map_err(GpuError::Lost)?.map_err(out_of_memory)?;
            for (buffer, (_, page)) in buffers.iter().zip(&contents) {
                upload(gpu, buffer, page)?;
            }
            Ok(buffers)
        };
        let shape = Shape { stack, members: !members.is_empty(), pages, exact: false, counts: false };
        let refused = |reason| GpuError::Kernel { adapter: adapter(), reason };
        let layouts = gpu.attempt(|device, _| layouts(device, pages.bindings()));
        let (layout, request) = layouts.map_err(GpuError::Lost)?.map_err(refused)?;
        let layouts = Layouts { scene: &layout, request: &request };
        // Drivers take half a second for the kernels.
        let (kernels, stored) = rayon::join(|| Kernels::compile(gpu, &shape, layouts, source), store);
        let Kernels { trace_closest, trace_any, exact_hits } = kernels?;
        let buffers = stored?;
        let bound = gpu.attempt(|device, _| {
            let entries: Vec<_> =
                (0..).zip(&buffers).map(|(binding, buffer)| bind_whole(binding, buffer)).collect();
            let (label, layout) = (Some("scene"), &layout);
            device.create_bind_group(&wgpu::BindGroupDescriptor { label, layout, entries: &entries })
        });
        let group = bound.map_err(GpuError::Lost)?.map_err(out_of_memory)?;
        let layouts = [layout, request];
        Ok(Self { group, shape, layouts, trace_closest, trace_any, exact_hits, bytes })
    }

    /// Compiles a kernel that answers with what rays visit on their way to the closest hit.
    ///
    /// # Errors
    /// When the device refuses the kernel or is lost.
    pub fn counting_kernel(&self, gpu: &Gpu) -> Result<KernelPipeline, String> {
        let [scene, request] = &self.layouts;
        let (shape, layouts) = (Shape { counts: true, ..self.shape }, Layouts { scene, request });
        let compiled = gpu.attempt(|device, _| {
            let kernel = Kernel::TraceClosest;
            KernelPipeline::new(device, kernel, kernel.source(&shape), layouts, gpu.info().shared_memory)
        });
        compiled.and_then(|compiled| compiled)
    }
}

/// The kernels of a scene.
struct Kernels {
    trace_closest: KernelPipeline,
    trace_any: KernelPipeline,
    exact_hits: Result<Route, Refusal>,
}

impl Kernels {
    /// Compiles the kernels for scenes of a shape, and those that make exact hits where the device can.
    fn compile(gpu: &Gpu, shape: &Shape, layouts: Layouts<'_>, source: Source) -> Result<Self, GpuError> {
        let shared = gpu.info().shared_memory;
        let compile = |kernel: Kernel, shape: &Shape| {
            if gpu.fault() == Some(Fault::Refused) {
                let (adapter, reason) = (gpu.info().to_string(), "refused, as requested".to_owned());
                return Err(GpuError::Kernel { adapter, reason });
            }
            let compiled = gpu.attempt(|device, _| {
                let source = source(kernel, shape);
                KernelPipeline::new(device, kernel, source, layouts, shared)
            });
            let refused = |reason| GpuError::Kernel { adapter: gpu.info().to_string(), reason };
            compiled.map_err(GpuError::Lost)?.map_err(refused)
        };
        let both = |exact: bool| {
            let shape = Shape { exact, ..*shape };
            let (closest, any) =
                rayon::join(|| compile(Kernel::TraceClosest, &shape), || compile(Kernel::TraceAny, &shape));
            Ok((closest?, any?))
        };
        let is_possible = Refusal::unless_possible(gpu);
        let wants_exact = is_possible.is_ok();
        let make_exact = || is_possible.and_then(|_| ExactKernels::new(gpu, shape, layouts));
        let (exact, traversals) = rayon::join(make_exact, || both(wants_exact));
        let (mut trace_closest, mut trace_any) = traversals?;
        let exact_hits = match exact {
            Ok(ExactKernels { route, closest, any }) => {
                trace_closest.make_exact(Some(closest));
                trace_any.make_exact(any);
                Ok(route)
            }
            Err(refusal) => {
                if wants_exact {
                    (trace_closest, trace_any) = both(false)?;
                }
                Err(refusal)
            }
        };
        Ok(Self { trace_closest, trace_any, exact_hits })
    }
}

/// Bytes of the buffer for a page. A binding must not be empty.
fn buffer_size(page: &[u8]) -> u64 {
    page.len().max(size_of::<TreeInstance>()) as u64
}

/// Allocates a buffer for each page, which has a label.
fn allocate(gpu: &Gpu, pages: &[(&str, &[u8])]) -> Result<Result<Vec<wgpu::Buffer>, String>, String> {
    gpu.attempt(|device, _| {
        let buffer = |&(label, page): &(&str, &[u8])| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                // More than any device has, if the fault is injected.
                size: if gpu.has_no_memory() { 1 << 62 } else { buffer_size(page) },
                usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::STORAGE,
                mapped_at_creation: false,
            })
        };
        pages.iter().map(buffer).collect()
    })
}

/// The layouts of group 0 (the scene's pages, then members) and of group 1 (rays, params, answers, undecided rays).
fn layouts(device: &wgpu::Device, pages: u32) -> (wgpu::BindGroupLayout, wgpu::BindGroupLayout) {
    use wgpu::BindingType::Buffer;
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
    let scene = vec![input; pages as usize];
    (layout("scene", &scene), layout("request", &[input, buffer(Uniform), output, output]))
}

/// Writes a buffer piece by piece and waits for each, so that staging memory stays small.
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
