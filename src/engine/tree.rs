//! Builds the tree over a scene: one tree over all triangles, or a two-level tree if instances save enough triangles.

use crate::bvh::{Bvh, PrimitiveIds, TreeInstance};
use crate::scene::{Scene, Shape};
use rayon::prelude::*;
use std::sync::Arc;

/// A two-level tree does not pay if it saves fewer triangles. Rays visit overlapping instances one after the other,
/// and the box of a rotated tree is looser than a box around the rotated triangles.
pub const MIN_SAVED_TRIANGLES: usize = 1 << 16;

/// Builds the tree of a scene. A shape stays shared if its instances together save at least `min_saved_triangles`
/// triangles. The hits are the same to the bit either way.
pub fn build(scene: &Scene, min_saved_triangles: usize) -> Bvh {
    let masked = scene.masked_materials();
    let is_masked = |primitive: u32| masked[scene.mesh.materials[primitive as usize] as usize];
    let saved = |shape: &&Shape| shape.triangles.len() * (shape.instances.len() - 1);
    let kept: Vec<&Shape> = scene.shapes.iter().filter(|shape| saved(shape) >= min_saved_triangles).collect();
    if kept.is_empty() {
        return Bvh::build(&scene.mesh.positions, &scene.mesh.triangles, is_masked);
    }

    let mut taken: Vec<_> = kept.iter().flat_map(|shape| shape.primitives()).collect();
    taken.sort_unstable_by_key(|range| range.start);
    let end = scene.mesh.triangles.len() as u32;
    let starts = std::iter::once(0).chain(taken.iter().map(|range| range.end));
    let ends = taken.iter().map(|range| range.start).chain([end]);
    let rest: Vec<_> = starts.zip(ends).map(|(start, end)| start..end).collect();

    let numbering = PrimitiveIds::from_ranges(rest.iter().cloned());
    let ids = rest.into_iter().flatten();
    let triangles: Vec<[u32; 3]> = ids.map(|id| scene.mesh.triangles[id as usize]).collect();
    let single = Bvh::build(&scene.mesh.positions, &triangles, |place| is_masked(numbering.primitive(place)));
    let mut members = vec![TreeInstance::in_world(Arc::new(single.with_primitive_ids(numbering)))];
    for shape in kept {
        let mask = |place: u32| is_masked(shape.instances[0].first + place);
        let tree = Arc::new(Bvh::build(&shape.positions, &shape.triangles, mask));
        let placed = shape.instances.par_iter();
        members.par_extend(placed.map(|at| TreeInstance::placed(tree.clone(), at.placement, at.first)));
    }
    Bvh::from_instances(members)
}
