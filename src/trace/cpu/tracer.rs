//! The tracer that the engine uses.

use super::{Oracle, SimdError, SimdLevel};
use crate::bvh::{Bvh, Filter};
use crate::stream::{Hit, Ray, Tracer};
use std::sync::Arc;

/// Traces ray streams on the calling thread with the instruction set chosen when it was made.
#[derive(Clone)]
pub struct CpuTracer {
    oracle: Oracle,
    simd: SimdLevel,
}

impl CpuTracer {
    /// A tracer for this tree; without a filter masked triangles are there everywhere.
    ///
    /// # Errors
    /// When this processor lacks the level.
    pub fn new(bvh: Arc<Bvh>, filter: Option<Arc<dyn Filter>>, simd: SimdLevel) -> Result<Self, SimdError> {
        Ok(Self { oracle: Oracle::new(bvh, filter), simd: simd.require()? })
    }

    /// The instruction set in use.
    pub fn simd(&self) -> SimdLevel {
        self.simd
    }

    /// The scalar reference over the same tree.
    pub fn oracle(&self) -> &Oracle {
        &self.oracle
    }

    /// The canonical hit of a ray and one triangle: see [`Oracle::canonical_hit`].
    pub fn canonical_hit(&self, ray: &Ray, primitive: u32) -> Option<Hit> {
        self.oracle.canonical_hit(ray, primitive)
    }
}

impl Tracer for CpuTracer {
    fn closest(&self, rays: &[Ray], hits: &mut [Hit]) {
        self.oracle.closest(rays, hits);
    }

    fn occluded(&self, rays: &[Ray], occluded: &mut [u32]) {
        self.oracle.occluded(rays, occluded);
    }
}
