//! A scene made ready: its tree and the units that trace it.

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
    /// What is rendered.
    pub scene: Arc<Scene>,
    /// The tree over its triangles.
    pub bvh: Arc<Bvh>,
    /// The units that trace it.
    pub tracers: Tracers,
    /// The alpha test of its masked triangles, if it has any.
    pub filter: Option<Arc<dyn Filter>>,
    /// The CPU's tracer for those who have but one ray at a time.
    pub single_ray: Arc<SingleRayTracer>,
    /// The GPU adapter in use.
    pub adapter: Option<String>,
    /// Why the GPU does not help although it was asked to; the CPU does its work.
    pub degraded: Option<String>,
}

impl PreparedScene {
    /// Builds the tree and the tracers. A GPU that cannot take the scene is no error: the CPU does its
    /// work, and [`PreparedScene::degraded`] says why.
    pub fn new(scene: Arc<Scene>, units: &Units) -> Self {
        let bvh = Arc::new(tree::build(&scene, tree::WORTH_SAVING));
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

    /// The GPU's tracers with each kind of kernel, for comparison; none where there is no GPU.
    ///
    /// # Errors
    /// Why it cannot take the scene.
    pub fn variants(&self, units: &Units) -> Result<Vec<Arc<dyn DeviceTracer>>, String> {
        units.variants(&self.bvh, self.filter.clone(), &self.tracers.host)
    }
}
