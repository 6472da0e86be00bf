//! A scene with its tree and the units that trace it.

use super::alpha_filter::filter;
use super::{Units, tree};
use crate::bvh::{Bvh, Filter};
use crate::scene::Scene;
use crate::schedule::Tracers;
use crate::stream::{DeviceTracer, Tracer};
use crate::trace::cpu::{CpuTracer, SingleRayTracer};
use std::sync::Arc;

/// A scene with its tree and tracers, ready for any number of jobs.
pub struct PreparedScene {
    /// The scene.
    pub scene: Arc<Scene>,
    /// The tree over the scene's triangles.
    pub bvh: Arc<Bvh>,
    /// The tracers of all units.
    pub tracers: Tracers,
    /// The alpha test of triangles that are not opaque. `None` if all are opaque.
    pub filter: Option<Arc<dyn Filter>>,
    /// The CPU tracer for callers that trace one ray at a time.
    pub single_ray: Arc<SingleRayTracer>,
    /// Name of the GPU adapter in use.
    pub adapter: Option<String>,
    /// Why a requested GPU is not used. The CPU does its work.
    pub degraded: Option<String>,
}

impl PreparedScene {
    /// Builds the tree and the tracers. It is no error if a GPU cannot trace the scene: the CPU does its work, and
    /// [`PreparedScene::degraded`] gives the reason.
    pub fn new(scene: Arc<Scene>, units: &Units) -> Self {
        let bvh = Arc::new(tree::build(&scene, tree::MIN_SAVED_TRIANGLES));
        let filter = filter(&scene);
        let host = CpuTracer::new(bvh.clone(), filter.clone(), units.simd());
        let host: Arc<dyn Tracer> = Arc::new(host.expect("the units have checked the instruction set"));
        let single_ray = SingleRayTracer::new(bvh.clone(), filter.clone(), units.simd());
        let single_ray = Arc::new(single_ray.expect("the units have checked the instruction set"));
        let (device, degraded) = match units.device(&bvh, filter.clone(), &host) {
            Ok(device) => (device, None),
            Err(reason) => (None, Some(reason)),
        };
        let (tracers, adapter) = match device {
            Some(device) => (Tracers { host, device: Some(device), unit: units.unit() }, units.adapter()),
            None => (Tracers::cpu(host), None),
        };
        Self { scene, bvh, tracers, filter, single_ray, adapter, degraded }
    }

    /// The GPU's tracers with each kind of kernel, for comparison. Empty without a GPU.
    ///
    /// # Errors
    /// Why the GPU cannot trace the scene.
    pub fn variants(&self, units: &Units) -> Result<Vec<Arc<dyn DeviceTracer>>, String> {
        units.variants(&self.bvh, self.filter.clone(), &self.tracers.host)
    }
}
