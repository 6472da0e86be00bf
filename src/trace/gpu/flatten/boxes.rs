//! Boxes for a device's own tree: one around each pair of triangles.
//!
//! How far each plane of a box is pushed out, in units of 2^-24 times the larger of the scene's largest coordinate and
//! the ray's: the canonical hit lies within the planes of its triangle's box but for the pad (32 units) and the
//! rounding of the canonical crossing (less than 16 units; `shaders/shared/ray.wgsl`). So with 48 units a ray has a
//! point of the box at the hit's distance, in exact arithmetic. Vulkan demands that such a box is reported, and lets
//! devices compute in floats. A test of slabs that subtracts, multiplies by a reciprocal (which may be off by 2.5 ulp)
//! or fuses the two is off by at most 14 units; another 48 units are for that.

use super::super::layout::{Identities, Pair, QUERY_REACH};
use super::pairs::{self, PackedPair, Triangle};
use crate::bvh::Bvh;
use crate::geom::SLACK;
use crate::stream::MISS;
use bytemuck::{Pod, Zeroable};

/// How far boxes are pushed out, in units of the scene's largest coordinate: 96 of the units above, for rays that begin
/// as far away as [`QUERY_REACH`] allows.
pub const MARGIN: f32 = 3.0 * SLACK * QUERY_REACH;

/// A box as Vulkan reads it.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct QueryBox {
    pub min: [f32; 3],
    pub max: [f32; 3],
}

/// Appends a scene. A tree is appended once for each of its instances, because devices transform rays in ways of their
/// own. Pairs about which the filter decides come last; returns the index of the first of them.
pub fn append_scene(
    bvh: &Bvh,
    in_pairs: bool,
    boxes: &mut Vec<QueryBox>,
    pairs: &mut Vec<Pair>,
    identities: &mut Vec<Identities>,
) -> u32 {
    let mut all: Vec<PackedPair> = Vec::new();
    let mut add = |tree: &Bvh, first: u32| {
        for block in tree.wide().each_block() {
            let triangle = |row| {
                let primitive = first + block.primitive(row);
                Triangle { primitive, corners: bvh.corners(primitive), is_masked: block.is_masked(row) }
            };
            let triangles: Vec<Triangle> = (0..block.len()).map(triangle).collect();
            all.extend(pairs::pack(&triangles, in_pairs));
        }
    };
    match bvh.instances() {
        [] => add(bvh, 0),
        instances => instances.iter().for_each(|instance| add(&instance.tree, instance.first_primitive)),
    }
    // Stable: otherwise in the order of the tree.
    all.sort_by_key(PackedPair::is_masked);
    let margin = bvh.scene_max_abs() * MARGIN;
    let bounds = |pair: &PackedPair| {
        let bounds = pair.bounds();
        let min = bounds.min.to_array().map(|x| (x - margin).next_down());
        let max = bounds.max.to_array().map(|x| (x + margin).next_up());
        QueryBox { min, max }
    };
    boxes.extend(all.iter().map(bounds));
    for pair in &all {
        pair.append(pairs, identities);
    }
    if boxes.is_empty() {
        // A device's tree must not be empty: a pair without triangles.
        boxes.push(QueryBox::zeroed());
        pairs.push(Pair::zeroed());
        identities.push([MISS; 2]);
    }
    all.partition_point(|pair| !pair.is_masked()) as u32
}
