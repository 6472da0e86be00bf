//! The scalar reference.

use super::accept::Filtered;
use super::scalar::{prepare, trace};
use crate::bvh::{Bvh, Filter};
use crate::geom::{CanonicalHit, CanonicalRay};
use crate::stream::{Hit, Ray, Tracer};
use std::fmt;
use std::slice;
use std::sync::Arc;

/// The scalar reference: one ray at a time through the tree, with the canonical test of [`CanonicalRay`]. Every tracer
/// gives the same bits.
#[derive(Clone)]
pub struct Oracle {
    bvh: Arc<Bvh>,
    filter: Option<Arc<dyn Filter>>,
}

impl Oracle {
    /// A reference for this tree. Without a filter masked triangles are hit everywhere.
    pub fn new(bvh: Arc<Bvh>, filter: Option<Arc<dyn Filter>>) -> Self {
        Self { bvh, filter }
    }

    /// The nearest hit of a ray.
    pub fn closest_one(&self, ray: &Ray) -> Hit {
        let mut hit = Hit::NONE;
        self.closest(slice::from_ref(ray), slice::from_mut(&mut hit));
        hit
    }

    /// True if a ray hits anything.
    pub fn occluded_one(&self, ray: &Ray) -> bool {
        let mut occluded = 0;
        self.occluded(slice::from_ref(ray), slice::from_mut(&mut occluded));
        occluded != 0
    }

    /// The nearest hit, found by testing every triangle.
    pub fn brute_force(&self, ray: &Ray) -> Hit {
        let prepared = prepare(&self.bvh, ray);
        (0..self.bvh.len() as u32)
            .filter_map(|primitive| self.test(&prepared, primitive))
            .min_by(|a, b| a.t.total_cmp(&b.t).then(a.primitive.cmp(&b.primitive)))
            .unwrap_or(Hit::NONE)
    }

    /// The canonical hit of a ray and one triangle, filter included, whatever lies before it. Confirms candidates that
    /// other units have found.
    ///
    /// # Panics
    /// If there is no such primitive.
    pub fn canonical_hit(&self, ray: &Ray, primitive: u32) -> Option<Hit> {
        self.test(&prepare(&self.bvh, ray), primitive)
    }

    pub(super) fn bvh(&self) -> &Bvh {
        &self.bvh
    }

    pub(super) fn filter(&self) -> Option<&dyn Filter> {
        self.filter.as_deref()
    }

    fn test(&self, ray: &CanonicalRay, primitive: u32) -> Option<Hit> {
        let CanonicalHit { t, u, v } = self.bvh.accepted_hit(ray, primitive, self.filter())?;
        Some(Hit { t, u, v, primitive })
    }
}

impl fmt::Debug for Oracle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (triangles, filtered) = (self.bvh.len(), self.filter.is_some());
        let mut output = f.debug_struct("Oracle");
        output.field("triangles", &triangles).field("filtered", &filtered).finish_non_exhaustive()
    }
}

impl Tracer for Oracle {
    fn closest(&self, rays: &[Ray], hits: &mut [Hit]) {
        assert_eq!(rays.len(), hits.len(), "one hit per ray");
        trace::<_, false>(&self.bvh, rays, Filtered(self.filter()), |i, hit| hits[i] = hit);
    }

    fn occluded(&self, rays: &[Ray], occluded: &mut [u32]) {
        assert_eq!(rays.len(), occluded.len(), "one answer per ray");
        let answer = |i, hit: Hit| occluded[i] = u32::from(!hit.is_miss());
        trace::<_, true>(&self.bvh, rays, Filtered(self.filter()), answer);
    }
}
