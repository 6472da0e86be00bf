//! The scalar reference.

use crate::bvh::{Bvh, Child, Filter, TreeInstance, WIDTH};
use crate::geom::{Aabb, CanonicalHit, CanonicalRay};
use crate::stream::{Hit, Ray, Tracer};
use std::fmt;
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
        let mut best = Hit::NONE;
        self.traverse(ray, |hit| {
            if hit.t < best.t || hit.t == best.t && hit.primitive < best.primitive {
                best = hit;
            }
            Some(best.t)
        });
        best
    }

    /// True if a ray hits anything.
    pub fn occluded_one(&self, ray: &Ray) -> bool {
        let mut occluded = false;
        self.traverse(ray, |_| {
            occluded = true;
            None
        });
        occluded
    }

    /// The nearest hit, found by testing every triangle.
    pub fn brute_force(&self, ray: &Ray) -> Hit {
        let prepared = self.prepare(ray);
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
        self.test(&self.prepare(ray), primitive)
    }

    pub(super) fn bvh(&self) -> &Bvh {
        &self.bvh
    }

    pub(super) fn filter(&self) -> Option<&dyn Filter> {
        self.filter.as_deref()
    }

    fn prepare(&self, ray: &Ray) -> CanonicalRay {
        CanonicalRay::new(ray.origin, ray.t_min, ray.direction, ray.t_max, self.bvh.scene_max_abs())
    }

    fn test(&self, ray: &CanonicalRay, primitive: u32) -> Option<Hit> {
        let CanonicalHit { t, u, v } = self.bvh.accepted_hit(ray, primitive, self.filter())?;
        Some(Hit { t, u, v, primitive })
    }

    /// Calls `visit` with hits of the ray, in no particular order, and skips only hits that are beyond the current
    /// limit. `visit` returns the new limit, or `None` to end the search.
    fn traverse(&self, ray: &Ray, mut visit: impl FnMut(Hit) -> Option<f32>) {
        let instances = self.bvh.instances();
        let ray = self.prepare(ray);
        let mut limit = ray.t_max;
        // The instance (none at the top level), the child, and where the ray enters it.
        let mut stack: Vec<(Option<&TreeInstance>, Child, f32)> =
            Vec::with_capacity(WIDTH * self.bvh.wide().depth());
        stack.push((None, Child::ROOT, 0.0));
        while let Some((instance, child, enter)) = stack.pop() {
            if enter > limit {
                continue;
            }
            if child.is_block() && instance.is_none() && !instances.is_empty() {
                stack.push((Some(&instances[child.index()]), Child::ROOT, enter));
                continue;
            }
            let (wide, first_primitive, placement) = match instance {
                Some(instance) => (instance.tree.wide(), instance.first_primitive, instance.placement),
                None => (self.bvh.wide(), 0, None),
            };
            if child.is_block() {
                let block = wide.blocks().get(child);
                for row in 0..child.triangles() {
                    let primitive = first_primitive + block.primitive(row);
                    let Some(hit) = self.test(&ray, primitive) else { continue };
                    let Some(new_limit) = visit(hit) else { return };
                    limit = limit.min(new_limit);
                }
                continue;
            }
            let node = &wide.nodes()[child.index()];
            let first_pushed = stack.len();
            for (slot, &child) in node.children.iter().enumerate() {
                let bounds = node.bounds(slot);
                let Aabb { min, max } = placement.map_or(bounds, |placement| placement.bounds(&bounds));
                let (enter, leave) = ray.slab(min, max);
                if enter <= leave && enter <= limit && leave >= ray.t_min && child != Child::NONE {
                    stack.push((instance, child, enter));
                }
            }
            // The nearest child on top.
            stack[first_pushed..].sort_unstable_by(|a, b| b.2.total_cmp(&a.2));
        }
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
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = self.closest_one(ray);
        }
    }

    fn occluded(&self, rays: &[Ray], occluded: &mut [u32]) {
        assert_eq!(rays.len(), occluded.len(), "one answer per ray");
        for (ray, occluded) in rays.iter().zip(occluded) {
            *occluded = self.occluded_one(ray).into();
        }
    }
}
