//! Tracing without lanes: one ray after the other, against one box or triangle at a time, by [`CanonicalRay`] itself.
//! The tracers answer so on processors without vectors, where their kernels took up to twice as long.

use super::accept::Accept;
use super::crossings::{Candidate, TriangleSink, is_candidate};
use crate::bvh::{Bvh, Child, TreeInstance, WIDTH};
use crate::geom::{Aabb, CanonicalHit, CanonicalRay};
use crate::stream::{Hit, Ray};

/// A child to visit.
#[derive(Clone, Copy)]
struct Entry<'a> {
    /// The instance that it belongs to; none at the top level.
    instance: Option<&'a TreeInstance>,
    child: Child,
    /// Where the ray enters its box.
    enter: f32,
}

/// Children that are to be visited. One stack serves many rays.
pub(super) struct Stack<'a>(Vec<Entry<'a>>);

impl Stack<'_> {
    /// An empty stack for rays in a tree.
    pub fn new(bvh: &Bvh) -> Self {
        Self(Vec::with_capacity(WIDTH * bvh.wide().depth()))
    }
}

/// Prepares a ray for a tree.
pub(super) fn prepare(bvh: &Bvh, ray: &Ray) -> CanonicalRay {
    CanonicalRay::new(ray.origin, ray.t_min, ray.direction, ray.t_max, bvh.scene_max_abs())
}

/// Answers each ray with its nearest hit, or with any hit if `ANY`.
pub(super) fn trace<A: Accept, const ANY: bool>(
    bvh: &Bvh,
    rays: &[Ray],
    mut accept: A,
    mut answer: impl FnMut(usize, Hit),
) {
    let mut stack = Stack::new(bvh);
    for (i, ray) in rays.iter().enumerate() {
        let ray = prepare(bvh, ray);
        let mut best = Hit::NONE;
        visit_triangles(bvh, &mut stack, &ray, |primitive| {
            let ([v0, v1, v2], masked) = bvh.corners_and_mask(primitive);
            if let Some(CanonicalHit { t, u, v }) = ray.triangle(v0, v1, v2) {
                let hit = Hit { t, u, v, primitive };
                let nearer = t < best.t || t == best.t && primitive < best.primitive;
                if nearer && accept.accepts(i, &hit, masked) {
                    best = hit;
                    if ANY {
                        return None;
                    }
                }
            }
            Some(best.t)
        });
        answer(i, best);
    }
}

/// Hands all triangles that rays may cross to a sink, with the rays' indices.
pub(super) fn visit_candidates(bvh: &Bvh, rays: &[Ray], sink: &mut dyn TriangleSink) {
    let mut stack = Stack::new(bvh);
    for (i, ray) in rays.iter().enumerate() {
        visit_triangles(bvh, &mut stack, &prepare(bvh, ray), |primitive| {
            let (corners, _) = bvh.corners_and_mask(primitive);
            if !is_candidate(ray, &corners) {
                return Some(f32::INFINITY);
            }
            let limit = sink.take(&Candidate { ray: i, primitive, corners });
            (limit >= 0.0).then_some(limit)
        });
    }
}

/// Calls `visit` with the triangles of all leaves whose boxes the ray enters, nearest children first. It returns the
/// `t` beyond which the ray needs no more triangles, or `None` to end the search.
pub(super) fn visit_triangles<'a>(
    bvh: &'a Bvh,
    stack: &mut Stack<'a>,
    ray: &CanonicalRay,
    mut visit: impl FnMut(u32) -> Option<f32>,
) {
    let (instances, Stack(stack)) = (bvh.instances(), stack);
    let mut limit = ray.t_max;
    stack.clear();
    stack.push(Entry { instance: None, child: Child::ROOT, enter: 0.0 });
    while let Some(Entry { instance, child, enter }) = stack.pop() {
        if enter > limit {
            continue;
        }
        if child.is_block() && instance.is_none() && !instances.is_empty() {
            let instance = Some(&instances[child.index()]);
            stack.push(Entry { instance, child: Child::ROOT, enter });
            continue;
        }
        let (wide, first_primitive, placement) = match instance {
            Some(instance) => (instance.tree.wide(), instance.first_primitive, instance.placement),
            None => (bvh.wide(), 0, None),
        };
        if child.is_block() {
            let block = wide.blocks().get(child);
            for row in 0..child.triangles() {
                let Some(new_limit) = visit(first_primitive + block.primitive(row)) else { return };
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
                // The nearest child comes to lie on top.
                let nearer = stack[first_pushed..].iter().rev().take_while(|other| other.enter < enter);
                let at = stack.len() - nearer.count();
                stack.insert(at, Entry { instance, child, enter });
            }
        }
    }
}
