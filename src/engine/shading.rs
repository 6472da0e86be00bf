//! Which unit computes shaders of surfaces in WGSL.

use super::Units;
use super::units::Gpus;
use crate::program::gpu::{ShadingReport, attach, shading_report};
use crate::scene::{ScatteringSurface, Scene};
use crate::trace::gpu::AdapterKind;
use std::any::Any;

/// Operations of a hit from which a kernel is compiled for a device that may compute it: fewer are computed by the host
/// while their operands are copied.
const WORTH: usize = 1000;

/// Which unit computes patterns and BSDFs in WGSL. The picture is the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Shading {
    /// The CPU.
    #[default]
    Cpu,
    /// The GPU, even if it is a software adapter.
    Gpu,
    /// The GPU if it is hardware, for shaders of many operations, as far as rates measured in each job say that it
    /// pays.
    Auto,
}

impl Units {
    /// Gives the patterns and BSDFs of a scene to the GPU, as requested. Returns why some stay on the CPU.
    pub(super) fn attach_shaders(&self, scene: &Scene) -> Vec<String> {
        let gpu = match (self.shading, &self.gpu) {
            (Shading::Cpu, _) | (_, Gpus::NotRequested) => return Vec::new(),
            (_, Gpus::Unavailable(reason)) => return vec![reason.clone()],
            (Shading::Auto, Gpus::Open(gpu)) if gpu.info().kind == AdapterKind::Software => {
                return Vec::new();
            }
            (_, Gpus::Open(gpu)) => gpu,
        };
        let least = if self.shading == Shading::Auto { WORTH } else { 0 };
        surfaces(scene).filter_map(|surface| attach(gpu, surface, least)?.err()).collect()
    }
}

/// What devices have shaded of each pattern of a scene, then of each BSDF.
pub(super) fn reports(scene: &Scene) -> Vec<ShadingReport> {
    surfaces(scene).filter_map(shading_report).collect()
}

/// The surfaces that a device may compute.
fn surfaces(scene: &Scene) -> impl Iterator<Item = &dyn Any> {
    let patterns = scene.procedurals.iter().filter_map(|surface| Some(surface.in_blocks()?.as_any()));
    patterns.chain(scene.scatterings.iter().map(ScatteringSurface::as_any))
}
