//! Exact hits: kernels behind the traversal that run the canonical test where rounding could not judge, with the host's
//! bits, so that the host reads hits instead of making them.
//!
//! Their arithmetic is words (`shaders/operations.wgsl`), no driver may contract or reorder it (`crate::device`), and
//! the fused multiply-add of the test is made by one of three routes. A device is not trusted: each module has entry
//! points that compare the route and the whole test with the host's before the module is used (once a process: a driver
//! compiles the same words alike). What the kernels leave
//! undecided they list for the host; a sample of every dispatch is checked as ever.

mod cases;
mod probe;
mod route;
#[cfg(test)]
mod tests;
mod verdicts;

use super::kernel::{LAYOUT, Shape};
use super::{Fault, Gpu, layout};
use crate::device::{FloatControls, OPERATIONS, float_controls, module, spirv};
use crate::geom::{DIRECTION_RANGE, MAX_COORDINATE, MIN_COMPONENT, SLACK};
use crate::stream::MISS;
pub(super) use route::Route;
use std::fmt::Write as _;

/// The kernels of one scene on one device, compared with the host.
#[derive(Debug)]
pub(super) struct ExactKernels {
    pub route: Route,
    pub closest: wgpu::ComputePipeline,
    /// `None` for scenes of members, where an answer has no room for a place.
    pub any: Option<wgpu::ComputePipeline>,
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
            match Self::by_route(gpu, shape, layouts, (route, controls)) {
                Ok(kernels) => {
                    log::debug!("{} makes hits by {route}", gpu.info().name);
                    return Ok(kernels);
                }
                Err(reason) => reasons.push(format!("{route}: {reason}")),
            }
        }
        Err(Refusal::Inexact { adapter: gpu.info().name.clone(), reasons: reasons.join("; ") })
    }

    fn by_route(
        gpu: &Gpu,
        shape: &Shape,
        layouts: Layouts<'_>,
        (route, controls): (Route, FloatControls),
    ) -> Result<Self, String> {
        let mut source = source(shape, route);
        if gpu.fault() == Some(Fault::Inexact) {
            source = with_inexact_fma(&source);
        }
        let key = verdicts::key(gpu, &source);
        let known = verdicts::find(key);
        if let Some(Err(reason)) = known {
            return Err(reason);
        }
        let module = Module::new(gpu, &source, (route, controls))?;
        if known.is_none() {
            let found = module.check(gpu);
            if gpu.lost().is_none() {
                verdicts::keep(key, found.clone());
            }
            found?;
        }
        let kernel = |entry| {
            gpu.attempt(|device, _| {
                let groups = [Some(layouts.scene), Some(layouts.request)];
                module.pipeline(device, entry, &groups)
            })
            .and_then(|made| made)
        };
        let any = if shape.members { None } else { Some(kernel("resolve_any")?) };
        Ok(Self { route, closest: kernel("resolve_closest")?, any })
    }
}

/// A compiled module.
struct Module(wgpu::ShaderModule);

/// What the probe of the fused multiply-add needs, and the layout of all probes.
struct Probes {
    fma: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
}

const ENTRIES: [&str; 4] = ["resolve_closest", "resolve_any", "probe_fma", "probe_pairs"];

impl Module {
    fn new(gpu: &Gpu, source: &str, (route, controls): (Route, FloatControls)) -> Result<Self, String> {
        let words = spirv(source, controls, route.fma())?;
        let made = gpu.attempt(|device, _| module(device, "exact", &words, &ENTRIES));
        Ok(Self(made.and_then(|made| made)?))
    }

    /// Compares the module's arithmetic with the host's.
    ///
    /// # Errors
    /// When it differs, or the device is lost.
    fn check(&self, gpu: &Gpu) -> Result<(), String> {
        let probes = self.probes(gpu)?;
        probe::check_fma(gpu, &probes.fma)?;
        probe::check_pairs(gpu, &self.pairs_probe(gpu, &probes)?)
    }

    fn pipeline(
        &self,
        device: &wgpu::Device,
        entry: &str,
        groups: &[Option<&wgpu::BindGroupLayout>],
    ) -> wgpu::ComputePipeline {
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(entry),
            bind_group_layouts: groups,
            immediate_size: 0,
        });
        device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(entry),
            layout: Some(&layout),
            module: &self.0,
            entry_point: Some(entry),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        })
    }

    /// The probe of the fused multiply-add, which takes little time to compile.
    fn probes(&self, gpu: &Gpu) -> Result<Probes, String> {
        let made = gpu.attempt(|device, _| {
            let layout = probe::layout(device);
            let fma = self.pipeline(device, "probe_fma", &[None, None, Some(&layout)]);
            Probes { fma, layout }
        });
        made.and_then(|made| made)
    }

    /// The probe of the canonical test.
    fn pairs_probe(&self, gpu: &Gpu, probes: &Probes) -> Result<wgpu::ComputePipeline, String> {
        let groups = [None, None, Some(&probes.layout)];
        gpu.attempt(|device, _| self.pipeline(device, "probe_pairs", &groups)).and_then(|made| made)
    }
}

/// The module's WGSL.
fn source(shape: &Shape, route: Route) -> String {
    let pages = shape.pages.source();
    let whole = "fn in_world(corners: Corners, number: u32) -> Corners {\n    return corners;\n}\n";
    let member = if shape.members { include_str!("../../../../shaders/exact/member.wgsl") } else { whole };
    [
        &constants(shape),
        OPERATIONS,
        route.source(),
        include_str!("../../../../shaders/exact/canonical.wgsl"),
        LAYOUT,
        &pages,
        include_str!("../../../../shaders/exact/resolve.wgsl"),
        member,
        include_str!("../../../../shaders/exact/resolve_closest.wgsl"),
        include_str!("../../../../shaders/exact/resolve_any.wgsl"),
        include_str!("../../../../shaders/exact/probe.wgsl"),
    ]
    .join("\n")
}

/// Declarations of the constants that host and device share. Numbers are words.
fn constants(shape: &Shape) -> String {
    // Any device may flush subnormal numbers, and none has to say so.
    let mut text = format!("const FLUSHES: bool = true;\nconst MEMBERS: bool = {};\n", shape.members);
    let words = [
        ("WORKGROUP_SIZE", layout::WORKGROUP_SIZE),
        ("CASE_WORDS", cases::PAIR_WORDS as u32),
        ("PRIMITIVE", layout::PRIMITIVE),
        ("TURN_SHIFT", layout::TURN_SHIFT),
        ("PLACE_MASKED", layout::PLACE_MASKED),
        ("MISS", MISS),
        ("OCCLUDED", layout::OCCLUDED),
        ("UNDECIDED", layout::UNDECIDED),
        ("MORE", layout::MORE),
        ("MASKED_RAY", layout::MASKED_RAY),
        ("LARGEST_FLOAT", f32::MAX.to_bits()),
        ("MAX_COORDINATE", MAX_COORDINATE.to_bits()),
        ("DIRECTION_MIN", DIRECTION_RANGE.start().to_bits()),
        ("DIRECTION_MAX", DIRECTION_RANGE.end().to_bits()),
        ("MIN_COMPONENT", MIN_COMPONENT.to_bits()),
        ("SLACK", SLACK.to_bits()),
    ];
    for (name, word) in words {
        let _ = writeln!(text, "const {name}: u32 = {word}u;");
    }
    text
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
