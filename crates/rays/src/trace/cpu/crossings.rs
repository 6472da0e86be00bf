//! Triangles near a ray, for tests other than the canonical one.

use crate::bvh::{Bvh, Child, PRIMITIVE, TreeInstance, WIDTH};
use crate::geom::CanonicalRay;
use crate::lanes::each;
use crate::stream::Ray;
use glam::Vec3;
use std::ops::ControlFlow;

/// A triangle in a visited leaf, with its corners in the world.
#[derive(Clone, Copy, Debug)]
pub struct VisitedTriangle {
    /// Its primitive id.
    pub primitive: u32,
    /// Its corners.
    pub corners: [Vec3; 3],
}

/// A child to visit: the instance (none at the top level), the child, and where the ray enters it.
type Entry<'a> = (Option<&'a TreeInstance>, Child, f32);

/// Calls `visit` with the triangles near a ray, nearest boxes first. It returns the `t` beyond which nothing is of
/// interest, or ends the search.
pub fn visit_triangles(bvh: &Bvh, ray: &Ray, mut visit: impl FnMut(VisitedTriangle) -> ControlFlow<(), f32>) {
    let instances = bvh.instances();
    let ray = CanonicalRay::new(ray.origin, ray.t_min, ray.direction, ray.t_max, bvh.scene_max_abs());
    let mut limit = ray.t_max;
    let mut stack: Vec<Entry<'_>> = Vec::with_capacity(WIDTH * bvh.wide().depth());
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
            None => (bvh.wide(), 0, None),
        };
        if child.is_block() {
            let block = wide.blocks().get(child);
            for row in 0..child.triangles() {
                let corners = block.corners(row);
                let corners = placement.map_or(corners, |place| each(corners, |corner| place.point(corner)));
                let primitive = first_primitive + (block.id(row) & PRIMITIVE);
                match visit(VisitedTriangle { primitive, corners }) {
                    ControlFlow::Continue(new) => limit = limit.min(new),
                    ControlFlow::Break(()) => return,
                }
            }
            continue;
        }
        let node = &wide.nodes()[child.index()];
        let first_pushed = stack.len();
        for slot in 0..WIDTH {
            let (child, bounds) = (node.children[slot], node.bounds(slot));
            if child == Child::NONE {
                continue;
            }
            let bounds = placement.map_or(bounds, |placement| placement.bounds(&bounds));
            let (enter, leave) = ray.slab(bounds.min, bounds.max);
            if enter <= leave && enter <= limit && leave >= ray.t_min {
                stack.push((instance, child, enter));
            }
        }
        stack[first_pushed..].sort_unstable_by(|a, b| b.2.total_cmp(&a.2));
    }
}
