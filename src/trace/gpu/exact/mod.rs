//! Exact hits: a traversal that tests triangles canonically, with the host's bits, so that the host reads hits instead
//! of making them.
//!
//! Its arithmetic is words (`shaders/operations.wgsl`), no driver may contract or reorder it (`crate::device`), and the
//! fused multiply-add of the test is made by one of three routes. Where the device's own is fused and subnormal numbers
//! stay what they are, triangles are rejected by the signs of exact edge functions. Elsewhere edge functions with
//! margins reject them first, since emulated arithmetic is slow, and rays that come near subnormal numbers are left to
//! the host. Boxes have their pads everywhere: one that is entered a little too early changes no answer.
//!
//! A device is not trusted: entry points compare the route and the whole test with the host's before the kernels of the
//! same text are used (once a process for all scenes of a kind: a driver compiles the same words alike). Each entry
//! point is a module of its own, since drivers optimise all of a module for each pipeline. A sample of every dispatch
//! is checked as ever.

mod cases;
mod probe;
mod route;
#[cfg(test)]
mod tests;
mod verdicts;

use super::alpha;
use super::kernel::{Arithmetic, Kernel, Shape, Sides, traversal};
use crate::device::{Checks, Fault, FloatControls, Gpu, float_controls, module, spirv};
pub(super) use route::Route;

/// The way in which kernels make exact hits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Form {
    pub route: Route,
    pub sides: Sides,
    /// Rays that come near subnormal numbers are left to the host.
    pub flushes: bool,
}

impl Form {
    /// The form for a device with these controls.
    fn of(route: Route, controls: FloatControls) -> Self {
        // A device may flush subnormal numbers unless it promises to keep them, and the probe sees whether it does.
        let flushes = !controls.subnormals;
        let sides = if route == Route::Fused && !flushes { Sides::Exact } else { Sides::WithinMargins };
        Self { route, sides, flushes }
    }
}

/// The kernels of one scene on one device, compared with the host.
#[derive(Debug)]
pub(super) struct ExactKernels {
    pub form: Form,
    pub closest: wgpu::ComputePipeline,
    pub any: wgpu::ComputePipeline,
}

/// Why hits are left to the host.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum Refusal {
    /// The device cannot forbid that arithmetic is reordered.
    #[error("{backend} cannot forbid that arithmetic is reordered; Vulkan can")]
    NoVulkan {
        /// The graphics interface.
        backend: String,
    },
    /// No route has the host's bits.
    #[error("{adapter} makes no exact hits, so the CPU makes them of its candidates ({reasons})")]
    Inexact {
        /// The adapter's name.
        adapter: String,
        /// Each route with the reason.
        reasons: String,
    },
    /// The device was lost.
    #[error("the device was lost: {0}")]
    Lost(String),
}

impl Refusal {
    /// Why a device cannot have such kernels, whatever the scene.
    ///
    /// # Errors
    /// When the device forbids nothing to its compiler.
    pub fn unless_possible(gpu: &Gpu) -> Result<FloatControls, Self> {
        let controls = gpu.guard(|device, _| Ok(float_controls(device))).map_err(Self::Lost)?;
        controls.ok_or_else(|| Self::NoVulkan { backend: gpu.info().backend.clone() })
    }
}

/// The layouts of a scene's buffers and of a request.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layouts<'a> {
    pub scene: &'a wgpu::BindGroupLayout,
    pub request: &'a wgpu::BindGroupLayout,
}

impl ExactKernels {
    /// Kernels by the first route that has the host's bits.
    ///
    /// # Errors
    /// With the reason for each route, if there is none.
    pub fn new(gpu: &Gpu, shape: &Shape, layouts: Layouts<'_>) -> Result<Self, Refusal> {
        let controls = Refusal::unless_possible(gpu)?;
        let mut reasons = Vec::new();
        for route in Route::ALL {
            match Self::of_form(gpu, shape, layouts, (Form::of(route, controls), controls)) {
                Ok(kernels) => {
                    log::debug!("{} makes hits by {route}", gpu.info().name);
                    return Ok(kernels);
                }
                Err(reason) => reasons.push(format!("{route}: {reason}")),
            }
        }
        Err(Refusal::Inexact { adapter: gpu.info().name.clone(), reasons: reasons.join("; ") })
    }

    /// Kernels of this form.
    ///
    /// # Errors
    /// When the device refuses them or has other bits than the host.
    pub fn of_form(
        gpu: &Gpu,
        shape: &Shape,
        layouts: Layouts<'_>,
        (form, controls): (Form, FloatControls),
    ) -> Result<Self, String> {
        let source = |shape: &Shape| match gpu.fault() {
            Some(Fault::Inexact) => with_inexact_fma(&source(shape, form)),
            _ => source(shape, form),
        };
        // Neither has to do with arithmetic, and a scene of another depth need not be compared again.
        let key = verdicts::key(gpu, &source(&Shape { stack: 0, counts: false, ..*shape }));
        let known = verdicts::find(key);
        if let Some(Err(reason)) = known {
            return Err(reason);
        }
        let module = Module { source: source(shape), route: form.route, controls };
        if known.is_none() {
            let found = module.check(gpu);
            if gpu.lost().is_none() {
                verdicts::keep(key, found.clone());
            }
            found?;
        }
        let groups = [Some(layouts.scene), Some(layouts.request)];
        let kernel = |kernel: Kernel| {
            let compile = || module.pipeline(gpu, kernel.name(), &groups);
            gpu.kernels.pipeline(&module.source, kernel.name(), compile)
        };
        // Drivers compile each for itself.
        let (closest, any) = rayon::join(|| kernel(Kernel::TraceClosest), || kernel(Kernel::TraceAny));
        Ok(Self { form, closest: closest?, any: any? })
    }
}

/// A module, each of whose entry points is compiled by itself.
struct Module {
    source: String,
    route: Route,
    controls: FloatControls,
}

impl Module {
    /// Compares the module's arithmetic with the host's.
    ///
    /// # Errors
    /// When it differs, or the device is lost.
    fn check(&self, gpu: &Gpu) -> Result<(), String> {
        probe::check_fma(gpu, &self.probe(gpu, "probe_fma")?)?;
        probe::check_pairs(gpu, &self.probe(gpu, "probe_pairs")?)
    }

    /// The pipeline of an entry point.
    ///
    /// # Errors
    /// When naga or the device refuses it, or the device is lost.
    fn pipeline(
        &self,
        gpu: &Gpu,
        entry: &'static str,
        groups: &[Option<&wgpu::BindGroupLayout>],
    ) -> Result<wgpu::ComputePipeline, String> {
        // `unchecked_module` has the proofs.
        let words = spirv(&self.source, Some(entry), self.controls, self.route.fma(), Checks::Proven)?;
        let made = gpu.attempt(|device, _| {
            let module = module(device, entry, &words, &[entry]);
            let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(entry),
                bind_group_layouts: groups,
                immediate_size: 0,
            });
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry),
                layout: Some(&layout),
                module: &module,
                entry_point: Some(entry),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: None,
            })
        });
        made.and_then(|made| made)
    }

    /// The pipeline of a probe.
    fn probe(&self, gpu: &Gpu, entry: &'static str) -> Result<wgpu::ComputePipeline, String> {
        let layout = gpu.attempt(|device, _| probe::layout(device)).and_then(|made| made)?;
        self.pipeline(gpu, entry, &[None, None, Some(&layout)])
    }
}

const ALPHA: &str = include_str!("../../../../shaders/exact/alpha.wgsl");
const NO_ALPHA: &str = include_str!("../../../../shaders/exact/no_alpha.wgsl");

/// The module's WGSL.
fn source(shape: &Shape, Form { route, sides, flushes }: Form) -> String {
    let case_words = format!("const CASE_WORDS: u32 = {}u;\n", cases::PAIR_WORDS);
    let traversal = traversal(shape, Arithmetic { flushes, near_fma: route.fma(), sides });
    let alpha = alpha::constants();
    let own = [
        &*case_words,
        route.source(),
        include_str!("../../../../shaders/exact/canonical.wgsl"),
        include_str!("../../../../shaders/exact/trace.wgsl"),
        &alpha,
        if shape.alpha { ALPHA } else { NO_ALPHA },
        include_str!("../../../../shaders/exact/trace_closest.wgsl"),
        include_str!("../../../../shaders/exact/trace_any.wgsl"),
        include_str!("../../../../shaders/exact/probe.wgsl"),
    ];
    traversal + &own.join("\n")
}

/// The source with a fused multiply-add whose last bit is wrong in a quarter of the cases, as on a device that lies.
fn with_inexact_fma(source: &str) -> String {
    let exact = "fn op_fma(a: u32, b: u32, c: u32) -> u32 {";
    assert!(source.contains(exact), "the fused multiply-add has another form");
    let inexact = "fn op_fma(a: u32, b: u32, c: u32) -> u32 {
    return right_fma(a, b, c) ^ select(0u, 1u, (a & 3u) == 3u);
}

fn right_fma(a: u32, b: u32, c: u32) -> u32 {";
    source.replace(exact, inexact)
}
