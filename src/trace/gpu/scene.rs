//! A scene on the device: its buffers, and the kernels compiled for it.

use super::alpha;
use super::dispatch::{Answers, KernelPipeline};
use super::exact::{ExactKernels, Form, Layouts, Refusal};
use super::flatten::FlatScene;
use super::kernel::{Kernel, Shape};
use super::layout::TreeInstance;
use super::pages::ScenePages;
use super::resolve::Resolver;
use crate::device::{Fault, Gpu, GpuError, bind_whole};
use std::hash::{DefaultHasher, Hash, Hasher};

/// Bytes uploaded at once. wgpu allocates staging memory of this size.
const UPLOAD_BYTES: usize = 16 << 20;

/// The stack of a kernel has a multiple of this many entries.
const STACK_STEP: usize = 8;

/// Makes the source of a kernel of candidates for scenes of a shape.
type Source = fn(Kernel, &Shape) -> String;

/// The kernels that a scene gets.
#[derive(Clone, Copy, Debug)]
pub(super) enum Kernels {
    /// Those of exact hits if the device can have them, else those of candidates.
    Best,
    /// Those of candidates, with this source.
    #[cfg(test)]
    Candidates(Source),
    /// Those of exact hits in this form, or none.
    #[cfg(test)]
    Exact(Form),
}

/// A scene on the device.
#[derive(Debug)]
pub(super) struct DeviceScene {
    /// Group 0: the pages of nodes, pairs and identities, members, the alpha test.
    pub group: wgpu::BindGroup,
    /// The shape for which kernels are compiled, and the layouts of both groups.
    shape: Shape,
    layouts: [wgpu::BindGroupLayout; 2],
    pub trace_closest: KernelPipeline,
    pub trace_any: KernelPipeline,
    /// The form in which the device makes hits, or the reason why the host does.
    pub exact_hits: Result<Form, Refusal>,
    /// A hash of the words of the alpha test.
    alpha: u64,
    /// Bytes of the scene's buffers.
    pub bytes: u64,
}

impl DeviceScene {
    /// Uploads a tree and compiles the kernels for it. The device decides about masked triangles where the
    /// filter has a table.
    ///
    /// # Errors
    /// When the scene exceeds what the adapter can bind (before anything is allocated), the device refuses it, or the
    /// device is lost.
    pub fn new(gpu: &Gpu, resolver: &Resolver, kernels: Kernels) -> Result<Self, GpuError> {
        let adapter = || gpu.info().to_string();
        let flat = FlatScene::of(&resolver.bvh);
        let pages = ScenePages::new(gpu.info(), flat.records())?;
        let FlatScene { nodes, pairs, identities, members, stack } = flat;

        let node_pages = pages.nodes.split(&nodes).map(|page| ("nodes", bytemuck::cast_slice(page)));
        let pair_pages = pages.pairs.split(&pairs).map(|page| ("pairs", bytemuck::cast_slice(page)));
        let identity_pages =
            pages.identities.split(&identities).map(|page| ("identities", bytemuck::cast_slice(page)));
        let alpha = alpha_words(gpu, resolver);
        let last: [(&str, &[u8]); 2] = [
            ("members", bytemuck::cast_slice(&members)),
            ("alpha test", alpha.as_deref().map_or(&[], bytemuck::cast_slice)),
        ];
        let contents: Vec<(&str, &[u8])> =
            node_pages.chain(pair_pages).chain(identity_pages).chain(last).collect();
        let bytes = contents.iter().map(|(_, page)| buffer_size(page)).sum();
        let out_of_memory = |reason| GpuError::OutOfMemory { required: bytes, adapter: adapter(), reason };
        let store = || -> Result<_, GpuError> {
            let buffers = allocate(gpu, &contents).map_err(GpuError::Lost)?.map_err(out_of_memory)?;
            for (buffer, (_, page)) in buffers.iter().zip(&contents) {
                upload(gpu, buffer, page)?;
            }
            Ok(buffers)
        };
        // Scenes of about the same depth have the same kernels.
        let stack = stack.next_multiple_of(STACK_STEP);
        let shape =
            Shape { stack, members: !members.is_empty(), pages, counts: false, alpha: alpha.is_some() };
        let refused = |reason| GpuError::Kernel { adapter: adapter(), reason };
        let layouts = gpu.attempt(|device, _| layouts(device, pages.bindings()));
        let (layout, request) = layouts.map_err(GpuError::Lost)?.map_err(refused)?;
        let layouts = Layouts { scene: &layout, request: &request };
        // Drivers take half a second for the kernels.
        let (compiled, stored) = rayon::join(|| kernels.compile(gpu, &shape, layouts), store);
        let Compiled { trace_closest, trace_any, exact_hits } = compiled?;
        let buffers = stored?;
        let bound = gpu.attempt(|device, _| {
            let entries: Vec<_> =
                (0..).zip(&buffers).map(|(binding, buffer)| bind_whole(binding, buffer)).collect();
            let (label, layout) = (Some("scene"), &layout);
            device.create_bind_group(&wgpu::BindGroupDescriptor { label, layout, entries: &entries })
        });
        let group = bound.map_err(GpuError::Lost)?.map_err(out_of_memory)?;
        let layouts = [layout, request];
        let alpha = hashed(&alpha);
        Ok(Self { group, shape, layouts, trace_closest, trace_any, exact_hits, alpha, bytes })
    }

    /// True if the device decides what a resolver's filter decides, or nothing.
    pub fn decides_alike(&self, gpu: &Gpu, resolver: &Resolver) -> bool {
        self.exact_hits.is_err() || self.alpha == hashed(&alpha_words(gpu, resolver))
    }

    /// Compiles a kernel that answers with what rays visit on their way to the closest hit.
    ///
    /// # Errors
    /// When the device refuses the kernel or is lost.
    pub fn counting_kernel(&self, gpu: &Gpu) -> Result<KernelPipeline, String> {
        let [scene, request] = &self.layouts;
        let (shape, layouts) = (Shape { counts: true, ..self.shape }, Layouts { scene, request });
        let (kernel, shared) = (Kernel::TraceClosest, gpu.info().shared_memory);
        if let Ok(form) = self.exact_hits {
            let controls = Refusal::unless_possible(gpu).map_err(|refusal| refusal.to_string())?;
            let closest = ExactKernels::of_form(gpu, &shape, layouts, (form, controls))?.closest;
            return Ok(KernelPipeline::new(kernel, (closest, Answers::Hits), layouts, shared));
        }
        let compiled = gpu.attempt(|device, _| {
            KernelPipeline::of_source(device, kernel, kernel.source(&shape), layouts, shared)
        });
        compiled.and_then(|compiled| compiled)
    }
}

/// The kernels of a scene.
struct Compiled {
    trace_closest: KernelPipeline,
    trace_any: KernelPipeline,
    exact_hits: Result<Form, Refusal>,
}

impl Kernels {
    /// Compiles the kernels for scenes of a shape.
    fn compile(self, gpu: &Gpu, shape: &Shape, layouts: Layouts<'_>) -> Result<Compiled, GpuError> {
        let refused = |reason| GpuError::Kernel { adapter: gpu.info().to_string(), reason };
        if gpu.fault() == Some(Fault::Refused) {
            return Err(refused("refused, as requested".to_owned()));
        }
        let (exact, source): (Result<ExactKernels, Refusal>, Source) = match self {
            Self::Best => (ExactKernels::new(gpu, shape, layouts), Kernel::source),
            #[cfg(test)]
            Self::Candidates(source) => (Err(Refusal::Lost("candidates, as requested".into())), source),
            #[cfg(test)]
            Self::Exact(form) => {
                let controls = Refusal::unless_possible(gpu).expect("Vulkan");
                let kernels = ExactKernels::of_form(gpu, shape, layouts, (form, controls));
                (Ok(kernels.map_err(refused)?), Kernel::source)
            }
        };
        let shared = gpu.info().shared_memory;
        let refusal = match exact {
            Ok(ExactKernels { form, closest, any }) => {
                let exact = |kernel, pipeline| {
                    KernelPipeline::new(kernel, (pipeline, Answers::Hits), layouts, shared)
                };
                return Ok(Compiled {
                    trace_closest: exact(Kernel::TraceClosest, closest),
                    trace_any: exact(Kernel::TraceAny, any),
                    exact_hits: Ok(form),
                });
            }
            Err(refusal) => refusal,
        };
        let compile = |kernel: Kernel| {
            let compiled = gpu.attempt(|device, _| {
                KernelPipeline::of_source(device, kernel, source(kernel, shape), layouts, shared)
            });
            compiled.map_err(GpuError::Lost)?.map_err(refused)
        };
        let (closest, any) = rayon::join(|| compile(Kernel::TraceClosest), || compile(Kernel::TraceAny));
        Ok(Compiled { trace_closest: closest?, trace_any: any?, exact_hits: Err(refusal) })
    }
}

/// The words of the filter's table, if it has one, for this scene, that is no larger than a binding.
fn alpha_words(gpu: &Gpu, resolver: &Resolver) -> Option<Vec<u32>> {
    let table = resolver.filter.as_ref()?.alpha_table()?;
    let words = (table.rows().len() == resolver.bvh.len()).then(|| alpha::words(&table))?;
    let most = gpu.info().max_binding_bytes.min(gpu.info().max_buffer_bytes);
    let fits = size_of_val(&*words) as u64 <= most;
    if !fits {
        log::info!("the alpha test is larger than a binding of {}; the CPU decides", gpu.info().name);
    }
    fits.then_some(words)
}

fn hashed(words: &Option<Vec<u32>>) -> u64 {
    let mut hasher = DefaultHasher::new();
    words.hash(&mut hasher);
    hasher.finish()
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

/// The layouts of group 0 (the scene's pages, members, the alpha test) and of group 1 (rays, params, answers, undecided
/// rays).
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
