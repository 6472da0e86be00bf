//! Boxes for a device that has a tree of its own over them: one around each pair of triangles.
//!
//! How far a box is pushed out, in units of 2^-24 times the larger of the scene's largest coordinate and the ray's, for each
//! plane: the canonical hit lies within the planes of its triangle's box but for the pad, 32, and the rounding of the
//! canonical crossing, less than 16 (`shaders/shared/ray.wgsl`). So with 48 a ray has a point of the box at the hit's
//! distance, exactly. Vulkan demands that such a box is reported, and lets devices compute in floats: a test of slabs that
//! subtracts, multiplies by a reciprocal (which may be off by 2.5 ulp) or fuses these is off by 14 at most; another 48 are
//! for that.

use super::super::layout::{Identities, Pair};
use super::pairs::{self, Laid, Triangle};
use crate::bvh::Bvh;
use crate::geom::SLACK;
use crate::stream::MISS;
use bytemuck::{Pod, Zeroable};

/// The rays that a query may be asked about come from at most so many times as far as the scene goes.
pub const REACH: f32 = 4.0;

/// What boxes are pushed out by, as a part of the scene's largest coordinate: 96 units at the farthest.
pub const MARGIN: f32 = 3.0 * SLACK * REACH;

/// A box, as Vulkan reads it.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Box {
    pub min: [f32; 3],
    pub max: [f32; 3],
}

/// Lays a scene out, trees that are placed several times as often: devices move rays in their own way. Pairs of which alpha
/// decides about some come last; gives the index of the first of those.
pub fn lay(
    bvh: &Bvh,
    in_pairs: bool,
    boxes: &mut Vec<Box>,
    pairs: &mut Vec<Pair>,
    identities: &mut Vec<Identities>,
) -> u32 {
    let mut all: Vec<Laid> = Vec::new();
    let mut add = |tree: &Bvh, first: u32| {
        for block in tree.wide().each_block() {
            let triangle = |row| {
                let primitive = first + block.primitive(row);
                Triangle { primitive, corners: bvh.corners(primitive), is_masked: block.is_masked(row) }
            };
            let triangles: Vec<Triangle> = (0..block.len()).map(triangle).collect();
            all.extend(pairs::of(&triangles, in_pairs));
        }
    };
    match bvh.instances() {
        [] => add(bvh, 0),
        members => members.iter().for_each(|member| add(&member.tree, member.first_primitive)),
    }
    // In the order of the tree otherwise.
    all.sort_by_key(Laid::is_masked);
    let margin = bvh.scene_max_abs() * MARGIN;
    let bounds = |pair: &Laid| {
        let bounds = pair.bounds();
        let min = bounds.min.to_array().map(|x| (x - margin).next_down());
        let max = bounds.max.to_array().map(|x| (x + margin).next_up());
        Box { min, max }
    };
    boxes.extend(all.iter().map(bounds));
    for pair in &all {
        pair.push(pairs, identities);
    }
    if boxes.is_empty() {
        // A tree has to have something: a pair of no triangles.
        boxes.push(Box::zeroed());
        pairs.push(Pair::zeroed());
        identities.push([MISS; 2]);
    }
    all.partition_point(|pair| !pair.is_masked()) as u32
}
