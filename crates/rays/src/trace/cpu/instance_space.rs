//! The space that a tree's geometry is stored in: world space, or the local space of an instance.
//!
//! Geometry of an instance is moved to world space corner by corner and box by box, each time that a list of rays
//! visits it; the rays of the list share that cost. Rays are never transformed, so every hit is a hit with the moved
//! triangles, to the bit ([`Placement`]).

use super::lane_math::LaneVec3;
use super::moved_nodes::MovedNodes;
use super::slabs::Boxes;
use crate::bvh::{LeafBlock, WIDTH, WideNode};
use crate::geom::Placement;
use crate::lanes::{Lanes, keep, load, splat_row};

/// The corners of a block's triangles, as `[corner][axis][row]`.
pub(super) type Corners = [[[f32; WIDTH]; 3]; 3];

/// Reads nodes and blocks of a tree in world space.
pub(super) trait Space: Copy {
    /// True if the boxes of leaf blocks are the smallest around their triangles.
    const HAS_TIGHT_BLOCKS: bool;

    /// The boxes of a node in world space; those of vacant slots are inverted. Moved boxes are written to `buffer`.
    fn boxes<'a, E: Lanes>(self, e: E, node: &'a WideNode, buffer: &'a mut Boxes) -> &'a Boxes;
    /// [`Space::boxes`] of two nodes, given with their indices. Moved boxes are kept in `moved`, or in `spare`.
    fn boxes_of_pair<'a, E: Lanes>(
        self,
        e: E,
        nodes: [(usize, &'a WideNode); 2],
        moved: &'a mut MovedNodes,
        spare: &'a mut Boxes,
    ) -> [&'a Boxes; 2];
    /// The corners of two blocks, one block in each eight lanes. With eight lanes only the first block counts.
    fn corners<L: Lanes>(self, l: L, blocks: &[LeafBlock<'_>; 2]) -> [LaneVec3<L>; 3];
    /// A point in world space.
    fn to_world<L: Lanes>(self, l: L, point: LaneVec3<L>) -> LaneVec3<L>;
    /// A block's triangle id with the primitive index of the scene.
    fn scene_id(self, stored: u32) -> u32;
    /// [`Space::scene_id`] of each lane.
    fn scene_ids<L: Lanes>(self, l: L, stored: L::I) -> L::I;
    /// The octant in the tree's space of rays of a world octant, for the order of children.
    fn order_octant(self, octant: usize) -> usize;
}

/// World space.
#[derive(Clone, Copy)]
pub(super) struct World;

impl Space for World {
    const HAS_TIGHT_BLOCKS: bool = true;

    #[inline(always)]
    fn boxes<'a, E: Lanes>(self, _: E, node: &'a WideNode, _: &'a mut Boxes) -> &'a Boxes {
        &node.faces
    }

    #[inline(always)]
    fn boxes_of_pair<'a, E: Lanes>(
        self,
        _: E,
        nodes: [(usize, &'a WideNode); 2],
        _: &'a mut MovedNodes,
        _: &'a mut Boxes,
    ) -> [&'a Boxes; 2] {
        [&nodes[0].1.faces, &nodes[1].1.faces]
    }

    #[inline(always)]
    fn corners<L: Lanes>(self, l: L, blocks: &[LeafBlock<'_>; 2]) -> [LaneVec3<L>; 3] {
        LeafBlock::vertices_of(l, blocks)
    }

    #[inline(always)]
    fn to_world<L: Lanes>(self, _: L, point: LaneVec3<L>) -> LaneVec3<L> {
        point
    }

    #[inline(always)]
    fn scene_id(self, stored: u32) -> u32 {
        stored
    }

    #[inline(always)]
    fn scene_ids<L: Lanes>(self, _: L, stored: L::I) -> L::I {
        stored
    }

    #[inline(always)]
    fn order_octant(self, octant: usize) -> usize {
        octant
    }
}

/// The local space of an instance, visited by rays of one octant.
#[derive(Clone, Copy)]
pub(super) struct InstanceSpace<'a> {
    placement: &'a Placement,
    first_primitive: u32,
    order_octant: usize,
}

impl<'a> InstanceSpace<'a> {
    /// The space of an instance whose primitives are `first_primitive` and the following, for rays of a world octant.
    #[inline]
    pub fn new(placement: &'a Placement, first_primitive: u32, octant: usize) -> Self {
        Self { placement, first_primitive, order_octant: placement.octant(octant) }
    }
}

/// One coordinate of [`Placement::point`].
#[inline(always)]
fn coordinate<L: Lanes>(l: L, [a, b, c, d]: [f32; 4], [x, y, z]: LaneVec3<L>) -> L::F {
    let sum = l.add(l.mul(l.splat(a), x), l.mul(l.splat(b), y));
    l.add(l.add(sum, l.mul(l.splat(c), z)), l.splat(d))
}

/// One face of [`Placement::bounds`]: from `low` where an element of the matrix row is not negative, else from `high`.
#[inline(always)]
fn face<E: Lanes>(e: E, row: [f32; 4], low: LaneVec3<E>, high: LaneVec3<E>) -> E::F {
    let x = if row[0] >= 0.0 { low[0] } else { high[0] };
    let y = if row[1] >= 0.0 { low[1] } else { high[1] };
    let z = if row[2] >= 0.0 { low[2] } else { high[2] };
    coordinate(e, row, [x, y, z])
}

impl Space for InstanceSpace<'_> {
    const HAS_TIGHT_BLOCKS: bool = false;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn boxes<'a, E: Lanes>(self, e: E, node: &'a WideNode, buffer: &'a mut Boxes) -> &'a Boxes {
        let [x, y, z] = self.placement.rows;
        let (low, high) = (load(e, &node.faces[0]), load(e, &node.faces[1]));
        // A vacant slot has infinite faces, and infinity times 0 is NaN: its box is set to be inverted.
        let occupied = e.le(0xff, low[0], high[0]);
        let (infinity, minus_infinity) = (e.splat(f32::INFINITY), e.splat(f32::NEG_INFINITY));
        buffer[0] = keep(
            e,
            [
                e.select(occupied, face(e, x, low, high), infinity),
                e.select(occupied, face(e, y, low, high), infinity),
                e.select(occupied, face(e, z, low, high), infinity),
            ],
        );
        buffer[1] = keep(
            e,
            [
                e.select(occupied, face(e, x, high, low), minus_infinity),
                e.select(occupied, face(e, y, high, low), minus_infinity),
                e.select(occupied, face(e, z, high, low), minus_infinity),
            ],
        );
        buffer
    }

    #[inline(always)]
    fn boxes_of_pair<'a, E: Lanes>(
        self,
        e: E,
        nodes: [(usize, &'a WideNode); 2],
        moved: &'a mut MovedNodes,
        spare: &'a mut Boxes,
    ) -> [&'a Boxes; 2] {
        let [(a, first), (b, second)] = nodes;
        if let Some(boxes) = moved.vacant(a) {
            self.boxes(e, first, boxes);
        }
        if MovedNodes::collide(a, b) {
            return [moved.boxes(a), self.boxes(e, second, spare)];
        }
        if let Some(boxes) = moved.vacant(b) {
            self.boxes(e, second, boxes);
        }
        [moved.boxes(a), moved.boxes(b)]
    }

    #[inline(always)]
    fn corners<L: Lanes>(self, l: L, blocks: &[LeafBlock<'_>; 2]) -> [LaneVec3<L>; 3] {
        let [a, b, c] = World.corners(l, blocks);
        [self.to_world(l, a), self.to_world(l, b), self.to_world(l, c)]
    }

    #[inline(always)]
    fn to_world<L: Lanes>(self, l: L, point: LaneVec3<L>) -> LaneVec3<L> {
        let [x, y, z] = self.placement.rows;
        [coordinate(l, x, point), coordinate(l, y, point), coordinate(l, z, point)]
    }

    #[inline(always)]
    fn scene_id(self, stored: u32) -> u32 {
        // Primitive indices have 30 bits: the flags above them stay.
        stored + self.first_primitive
    }

    #[inline(always)]
    fn scene_ids<L: Lanes>(self, l: L, stored: L::I) -> L::I {
        l.add_u32(stored, l.splat_u32(self.first_primitive))
    }

    #[inline(always)]
    fn order_octant(self, _: usize) -> usize {
        self.order_octant
    }
}

/// The corners of the triangle in one row of a block, in every lane.
#[inline(always)]
pub(super) fn splat_triangle<L: Lanes>(l: L, corners: &Corners, row: usize) -> [LaneVec3<L>; 3] {
    [splat_row(l, &corners[0], row), splat_row(l, &corners[1], row), splat_row(l, &corners[2], row)]
}
