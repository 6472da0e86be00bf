//! The space that a tree's geometry is stored in: world space, or the local space of an instance.
//!
//! Geometry of an instance is moved to world space corner by corner and box by box, each time that a list of rays
//! visits it; the rays of the list share that cost. Rays are never transformed, so every hit is a hit with the moved
//! triangles, to the bit ([`Placement`]).

use super::lane_math::LaneVec3;
use super::moved_nodes::MovedNodes;
use super::slabs::Boxes;
use crate::bvh::{Cone, LeafBlock, NodeDiagonals, TurnedBoxes, WIDTH, WideNode};
use crate::geom::Placement;
use crate::lanes::{Lanes, keep, load, load_one, splat_row, store_one};

/// The corners of a block's triangles, as `[corner][axis][row]`.
pub(super) type Corners = [[[f32; WIDTH]; 3]; 3];

/// Reads nodes and blocks of a tree in world space.
pub(super) trait Space: Copy {
    /// True if the boxes of leaf blocks are the smallest around their triangles.
    const HAS_TIGHT_BLOCKS: bool;

    /// The boxes of a node in world space, given with its index; those of vacant slots are inverted. Moved boxes are
    /// written to `buffer`.
    fn boxes<'a, E: Lanes>(self, e: E, index: usize, node: &'a WideNode, buffer: &'a mut Boxes) -> &'a Boxes;
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
    fn boxes<'a, E: Lanes>(self, _: E, _: usize, node: &'a WideNode, _: &'a mut Boxes) -> &'a Boxes {
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
    turned: Option<&'a TurnedBoxes<'a>>,
}

impl<'a> InstanceSpace<'a> {
    /// The space of an instance whose primitives are `first_primitive` and the following, for rays of a world octant.
    /// `turned`, of its tree and its placement, makes boxes smaller; it takes longer to make than one ray saves.
    #[inline]
    pub fn new(
        placement: &'a Placement,
        first_primitive: u32,
        octant: usize,
        turned: Option<&'a TurnedBoxes<'a>>,
    ) -> Self {
        Self { placement, first_primitive, order_octant: placement.octant(octant), turned }
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

/// The boxes of a node, moved by the sums of extents that are the placement's rows: see [`TurnedBoxes`].
#[inline(always)]
fn turned_boxes<'a, E: Lanes>(
    e: E,
    cones: &[Cone; 3],
    node: &WideNode,
    diagonals: &NodeDiagonals,
    buffer: &'a mut Boxes,
) -> &'a Boxes {
    let [lower, upper] = [load_one(e, &node.faces[0][0]), load_one(e, &node.faces[1][0])];
    let (occupied, inverted) = (e.le(0xff, lower, upper), [f32::INFINITY, f32::NEG_INFINITY]);
    for (axis, cone) in cones.iter().enumerate() {
        let [of_axis, of_face, of_cube] = cone.weights;
        for side in 0..2 {
            // Of the opposite direction the lower extent is the upper one.
            let extent = |weight: f32| side ^ usize::from(weight < 0.0);
            let along_axis = load_one(e, &node.faces[extent(of_axis)][cone.axis]);
            let along_face = load_one(e, &diagonals.extents[cone.diagonals[0]][extent(of_face)]);
            let along_cube = load_one(e, &diagonals.extents[cone.diagonals[1]][extent(of_cube)]);
            let sum = e.fma(e.splat(of_axis), along_axis, e.splat(cone.offsets[side]));
            let sum = e.fma(e.splat(of_face), along_face, sum);
            let sum = e.fma(e.splat(of_cube), along_cube, sum);
            buffer[side][axis] = store_one(e, e.select(occupied, sum, e.splat(inverted[side])));
        }
    }
    buffer
}

impl Space for InstanceSpace<'_> {
    const HAS_TIGHT_BLOCKS: bool = false;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn boxes<'a, E: Lanes>(self, e: E, index: usize, node: &'a WideNode, buffer: &'a mut Boxes) -> &'a Boxes {
        if let Some(TurnedBoxes { diagonals, cones }) = self.turned
            && let Some(diagonals) = diagonals.get(index)
        {
            return turned_boxes(e, cones, node, diagonals, buffer);
        }
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
            self.boxes(e, a, first, boxes);
        }
        if MovedNodes::collide(a, b) {
            return [moved.boxes(a), self.boxes(e, b, second, spare)];
        }
        if let Some(boxes) = moved.vacant(b) {
            self.boxes(e, b, second, boxes);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::{Bvh, Child, TreeInstance};
    use crate::geom::{Aabb, mix};
    use crate::lanes::{Eight, LaneTask, SimdLevel};
    use glam::Vec3;

    /// For each node the boxes of its children, moved as instances are: with extents along diagonals and without.
    struct MoveBoxes<'a> {
        tree: &'a Bvh,
        placement: &'a Placement,
    }

    impl LaneTask for MoveBoxes<'_> {
        type Output = Vec<[Boxes; 2]>;

        fn run<L: Lanes>(self, l: L) -> Vec<[Boxes; 2]> {
            let turned = self.tree.turned(self.placement);
            let nodes = self.tree.wide().nodes().iter().enumerate();
            let boxes = |(index, node), turned| {
                let mut buffer = [[[0.0; WIDTH]; 3]; 2];
                *InstanceSpace::new(self.placement, 0, 0, turned).boxes(l, index, node, &mut buffer)
            };
            nodes.map(|node| [boxes(node, turned.as_ref()), boxes(node, None)]).collect()
        }
    }

    /// The smallest box around the moved triangles below a child.
    fn smallest(tree: &Bvh, child: Child, placement: &Placement) -> Aabb {
        if child.is_block() {
            let block = tree.wide().blocks().get(child);
            let corners = (0..block.len()).flat_map(|row| block.corners(row));
            return Aabb::around(corners.map(|corner| placement.point(corner)));
        }
        let children = tree.wide().nodes()[child.index()].children;
        let occupied = children.into_iter().filter(|&child| child != Child::NONE);
        occupied.fold(Aabb::EMPTY, |all, child| all.union(smallest(tree, child, placement)))
    }

    fn signed(i: u32) -> f32 {
        (mix(i) >> 8) as f32 / (1 << 23) as f32 - 1.0
    }

    /// Random motions; some elements are 0, equal or tiny, some translations far.
    fn placement(seed: u32) -> Placement {
        let mut rows = [[0.0; 4]; 3];
        for (k, element) in (1u32..).zip(rows.as_flattened_mut()) {
            let far = if k % 4 == 0 && seed.is_multiple_of(3) { 1e5 } else { 1.0 };
            *element = match mix(seed + k) % 10 {
                0 => 0.0,
                1 => 0.25,
                2 => -0.25,
                3 => 1e-30 * signed(100 * seed + k),
                4 => f32::MIN_POSITIVE * signed(100 * seed + k),
                _ => far * signed(100 * seed + k),
            };
        }
        Placement { rows }
    }

    #[test]
    fn moved_boxes_hold_what_they_held_and_extents_make_them_smaller() {
        let corner = |i: u32| {
            let around = Vec3::new(signed(9 * (i / 30)), signed(9 * (i / 30) + 1), signed(9 * (i / 30) + 2));
            let p = around + 0.1 * Vec3::new(signed(3 * i), signed(3 * i + 1), signed(3 * i + 2));
            Vec3::new(3.0, 1.0, 0.5) * p + Vec3::splat(2.0)
        };
        let positions: Vec<Vec3> = (0..1500).map(corner).collect();
        let triangles: Vec<[u32; 3]> = (0..500).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let tree = std::sync::Arc::new(Bvh::build(&positions, &triangles, |_| false));
        let mut areas = [0.0f64; 3];
        for seed in 0..150 {
            let placement = placement(seed);
            let _ = TreeInstance::placed(tree.clone(), placement, 0);
            let task = || MoveBoxes { tree: &tree, placement: &placement };
            for moved in [SimdLevel::run_eight(task()), task().run(Eight)] {
                for (node, boxes) in tree.wide().nodes().iter().zip(moved) {
                    for slot in 0..WIDTH {
                        let bounds = |boxes: &Boxes| Aabb {
                            min: Vec3::from_array([0, 1, 2].map(|axis| boxes[0][axis][slot])),
                            max: Vec3::from_array([0, 1, 2].map(|axis| boxes[1][axis][slot])),
                        };
                        let [turned, plain] = [bounds(&boxes[0]), bounds(&boxes[1])];
                        if node.children[slot] == Child::NONE {
                            assert_eq!([turned, plain], [Aabb::EMPTY; 2]);
                            continue;
                        }
                        let least = smallest(&tree, node.children[slot], &placement);
                        assert!(plain.contains(&least), "{seed}: {plain:?} {least:?}");
                        assert!(turned.contains(&least), "{seed}: {turned:?} {least:?}");
                        for (sum, bounds) in areas.iter_mut().zip([least, turned, plain]) {
                            *sum += f64::from(bounds.half_area());
                        }
                    }
                }
            }
        }
        let [least, turned, plain] = areas;
        assert!(turned < 1.25 * least && turned < 0.85 * plain, "{least} {turned} {plain}");
    }
}
