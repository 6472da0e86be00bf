//! Where the geometry of a tree stands: in the world, or in a space of its own from which it is moved, corner by corner
//! and box by box, each time that rays visit it. A visit serves a list of rays, which shares the cost; and the
//! rays stay what they are, so every hit is that of the moved triangles, to the bit ([`Placement`]).

use super::triangle::Vector;
use crate::bvh::{LeafBlock, WIDTH, WideNode};
use crate::geom::Placement;
use crate::lanes::{Lanes, keep, load, splat_row};

/// Boxes of a node, as they lie in it.
pub(super) type Boxes = [[[f32; WIDTH]; 3]; 2];

/// Corners of a block as `[vertex][axis][row]`.
pub(super) type Corners = [[[f32; WIDTH]; 3]; 3];

/// Gives nodes and blocks in the world. Boxes that are moved lie in `room`.
pub(super) trait Space: Copy {
    /// The boxes of a node; those of vacant slots are inverted.
    fn boxes<'a, E: Lanes>(self, e: E, node: &'a WideNode, room: &'a mut Boxes) -> &'a Boxes;
    /// The corners of blocks, one in each eight lanes; with eight lanes only the first counts.
    fn triangles<L: Lanes>(self, l: L, blocks: &[LeafBlock<'_>; 2]) -> [Vector<L>; 3];
    /// A corner as it lies in a block, where it stands.
    fn place<E: Lanes>(self, e: E, corner: Vector<E>) -> Vector<E>;
    /// What a block stores as id, with the scene's primitive index.
    fn id(self, stored: u32) -> u32;
    /// The octant by which children are in order for rays of a world octant.
    fn order(self, octant: usize) -> usize;
}

/// The world itself.
#[derive(Clone, Copy)]
pub(super) struct World;

impl Space for World {
    #[inline(always)]
    fn boxes<'a, E: Lanes>(self, _: E, node: &'a WideNode, _: &'a mut Boxes) -> &'a Boxes {
        &node.faces
    }

    #[inline(always)]
    fn triangles<L: Lanes>(self, l: L, blocks: &[LeafBlock<'_>; 2]) -> [Vector<L>; 3] {
        LeafBlock::vertices_of(l, blocks)
    }

    #[inline(always)]
    fn place<E: Lanes>(self, _: E, corner: Vector<E>) -> Vector<E> {
        corner
    }

    #[inline(always)]
    fn id(self, stored: u32) -> u32 {
        stored
    }

    #[inline(always)]
    fn order(self, octant: usize) -> usize {
        octant
    }
}

/// The space of an instance, as rays of one octant see it.
#[derive(Clone, Copy)]
pub(super) struct Own<'a> {
    placement: &'a Placement,
    first: u32,
    order: usize,
}

impl<'a> Own<'a> {
    pub fn new(placement: &'a Placement, first: u32, octant: usize) -> Self {
        Self { placement, first, order: placement.octant(octant) }
    }
}

/// [`Placement::point`] in lanes.
#[inline(always)]
fn moved<E: Lanes>(e: E, placement: &Placement, p: Vector<E>) -> Vector<E> {
    let [x, y, z] = placement.rows;
    [along(e, x, p), along(e, y, p), along(e, z, p)]
}

#[inline(always)]
fn along<E: Lanes>(e: E, [a, b, c, d]: [f32; 4], [x, y, z]: Vector<E>) -> E::F {
    let sum = e.add(e.mul(e.splat(a), x), e.mul(e.splat(b), y));
    e.add(e.add(sum, e.mul(e.splat(c), z)), e.splat(d))
}

/// [`Placement::bounds`] in lanes, one face across one axis: `low` where the element is not negative, else `high`.
#[inline(always)]
fn face<E: Lanes>(e: E, row: [f32; 4], low: Vector<E>, high: Vector<E>) -> E::F {
    let x = if row[0] >= 0.0 { low[0] } else { high[0] };
    let y = if row[1] >= 0.0 { low[1] } else { high[1] };
    let z = if row[2] >= 0.0 { low[2] } else { high[2] };
    along(e, row, [x, y, z])
}

impl Space for Own<'_> {
    #[inline(always)]
    fn boxes<'a, E: Lanes>(self, e: E, node: &'a WideNode, room: &'a mut Boxes) -> &'a Boxes {
        let [x, y, z] = self.placement.rows;
        let (low, high) = (load(e, &node.faces[0]), load(e, &node.faces[1]));
        // The product of a vacant slot's infinity and zero is no number.
        let there = e.le(0xff, low[0], high[0]);
        let (last, first) = (e.splat(f32::INFINITY), e.splat(f32::NEG_INFINITY));
        room[0] = keep(
            e,
            [
                e.select(there, face(e, x, low, high), last),
                e.select(there, face(e, y, low, high), last),
                e.select(there, face(e, z, low, high), last),
            ],
        );
        room[1] = keep(
            e,
            [
                e.select(there, face(e, x, high, low), first),
                e.select(there, face(e, y, high, low), first),
                e.select(there, face(e, z, high, low), first),
            ],
        );
        room
    }

    #[inline(always)]
    fn triangles<L: Lanes>(self, l: L, blocks: &[LeafBlock<'_>; 2]) -> [Vector<L>; 3] {
        let [a, b, c] = World.triangles(l, blocks);
        [self.place(l, a), self.place(l, b), self.place(l, c)]
    }

    #[inline(always)]
    fn place<E: Lanes>(self, e: E, corner: Vector<E>) -> Vector<E> {
        moved(e, self.placement, corner)
    }

    #[inline(always)]
    fn id(self, stored: u32) -> u32 {
        // Ids have 30 bits, the flags above stay.
        stored + self.first
    }

    #[inline(always)]
    fn order(self, _: usize) -> usize {
        self.order
    }
}

/// Row `row` of a block's corners, in every lane.
#[inline(always)]
pub(super) fn triangle<L: Lanes>(l: L, corners: &Corners, row: usize) -> [Vector<L>; 3] {
    [splat_row(l, &corners[0], row), splat_row(l, &corners[1], row), splat_row(l, &corners[2], row)]
}
