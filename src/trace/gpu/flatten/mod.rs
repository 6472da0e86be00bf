//! Flattens a scene's trees into the records that kernels read (`layout.rs`).

mod binary;
mod boxes;
mod pairs;
mod wide;

use super::layout::{BinaryNode, Identities, LEAF, Pair, TreeInstance, WideNode};
use super::pages::{Pages, Records};
use super::variant::{TreeKind, Variant};
use crate::bvh::{Bvh, FlatTree};
use crate::geom::{Aabb, Placement};
use boxes::QueryBox;
use pairs::Triangle;
use std::collections::HashMap;
use std::sync::Arc;

/// A child as its parent stores it: reference and box.
type ChildBox = (u32, Aabb);

/// Nodes of all trees, one tree after the other.
#[derive(Debug)]
pub(super) enum Nodes {
    Binary(Vec<BinaryNode>),
    Wide(Vec<WideNode>),
    /// The device builds its own tree over these boxes.
    Device(Vec<QueryBox>),
}

impl Nodes {
    fn records(&self) -> Records {
        let (count, bytes) = match self {
            Self::Binary(nodes) => (nodes.len(), size_of::<BinaryNode>()),
            Self::Wide(nodes) => (nodes.len(), size_of::<WideNode>()),
            Self::Device(boxes) => (boxes.len(), size_of::<QueryBox>()),
        };
        Records { count, bytes }
    }

    /// The bytes of each page.
    pub fn split(&self, pages: Pages) -> Vec<&[u8]> {
        match self {
            Self::Binary(nodes) => pages.split(nodes).map(bytemuck::cast_slice).collect(),
            Self::Wide(nodes) => pages.split(nodes).map(bytemuck::cast_slice).collect(),
            Self::Device(boxes) => pages.split(boxes).map(bytemuck::cast_slice).collect(),
        }
    }
}

/// A scene for a device: nodes, the root first; triangles in leaf order, in pairs; tree instances.
#[derive(Debug)]
pub(super) struct FlatScene {
    pub nodes: Nodes,
    pub pairs: Vec<Pair>,
    pub identities: Vec<Identities>,
    pub members: Vec<TreeInstance>,
    /// The most entries that a traversal has on its stack.
    pub stack: usize,
    /// Index of the first pair about which the filter decides. Used with a device's own tree only.
    pub first_masked: u32,
}

impl FlatScene {
    /// Flattens a scene: its tree of triangles; or its top-level tree, and each instanced tree once.
    pub fn of(bvh: &Bvh, variant: Variant) -> Self {
        let nodes = match variant.tree {
            TreeKind::Binary => Nodes::Binary(Vec::new()),
            TreeKind::Wide => Nodes::Wide(Vec::new()),
            TreeKind::Device => Nodes::Device(Vec::new()),
        };
        let (pairs, identities, members) = (Vec::new(), Vec::new(), Vec::new());
        let mut flat = Self { nodes, pairs, identities, members, stack: 0, first_masked: 0 };
        if bvh.instances().is_empty() || variant.tree == TreeKind::Device {
            flat.stack = flat.append_tree(bvh, variant).1;
            return flat;
        }
        let top_level_stack = flat.append_top_level(bvh);
        let mut roots = HashMap::new();
        for instance in bvh.instances() {
            let root = *roots.entry(Arc::as_ptr(&instance.tree)).or_insert_with(|| {
                let (root, stack) = flat.append_tree(&instance.tree, variant);
                flat.stack = flat.stack.max(top_level_stack + stack);
                root
            });
            let rows = instance.placement.unwrap_or(Placement::IDENTITY).rows;
            let column = |i: usize| rows.map(|row| row[i]);
            flat.members.push(TreeInstance {
                x: column(0),
                root,
                y: column(1),
                first: instance.first_primitive,
                z: column(2),
                spare_0: 0,
                shift: column(3),
                spare_1: 0,
            });
        }
        flat
    }

    /// The records of nodes, pairs and identities.
    pub fn records(&self) -> [Records; 3] {
        let pairs = Records { count: self.pairs.len(), bytes: size_of::<Pair>() };
        let identities = Records { count: self.identities.len(), bytes: size_of::<Identities>() };
        [self.nodes.records(), pairs, identities]
    }

    /// Appends a tree of triangles; returns its root's reference and the entries of a traversal's stack.
    fn append_tree(&mut self, bvh: &Bvh, variant: Variant) -> (u32, usize) {
        let Self { nodes, pairs, identities, .. } = self;
        match nodes {
            Nodes::Binary(nodes) => {
                let tree = bvh.to_flat_tree();
                let leaf = |index: usize| {
                    let leaf = pairs::pack(&subtree_triangles(bvh, &tree, index), variant.pairs);
                    pairs::append_leaf(&leaf, pairs, identities)
                };
                binary::append_tree(&tree, binary::LEAF_TRIANGLES, nodes, leaf)
            }
            Nodes::Wide(nodes) => wide::append_tree(bvh.wide(), variant.pairs, nodes, pairs, identities),
            Nodes::Device(boxes) => {
                self.first_masked = boxes::append_scene(bvh, variant.pairs, boxes, pairs, identities);
                (0, 0)
            }
        }
    }

    /// Appends the tree over members; returns the entries of a traversal's stack.
    fn append_top_level(&mut self, bvh: &Bvh) -> usize {
        match &mut self.nodes {
            Nodes::Binary(nodes) => {
                let tree = bvh.to_flat_tree();
                binary::append_tree(&tree, 1, nodes, |index| LEAF | tree.nodes()[index].index).1
            }
            Nodes::Wide(nodes) => wide::append_top_level(bvh.wide(), nodes),
            Nodes::Device(_) => unreachable!("a device's own tree has no instances"),
        }
    }
}

/// The triangles of a subtree.
fn subtree_triangles(bvh: &Bvh, tree: &FlatTree, index: usize) -> Vec<Triangle> {
    let nodes = tree.nodes();
    let subtree = &nodes[index..index + 2 * nodes[index].count as usize - 1];
    let triangle = |primitive| {
        let (corners, is_masked) = bvh.corners_and_mask(primitive);
        Triangle { primitive, corners, is_masked }
    };
    subtree.iter().filter(|node| node.is_leaf()).map(|leaf| triangle(leaf.index)).collect()
}

#[cfg(test)]
mod tests {
    use super::super::layout::{MASKED, PAIR_INDEX, PAIRS_SHIFT, PRIMITIVE, TURN_SHIFT};
    use super::*;
    use crate::stream::MISS;
    use glam::Vec3;

    /// A strip of quads, and loose triangles.
    fn build(quads: u32, loose: u32) -> Bvh {
        let corner = |i: u32| Vec3::new((i / 2) as f32, 1e3 + (i * 7 % 5) as f32, (i % 2) as f32);
        let mut positions: Vec<Vec3> = (0..2 * quads + 2).map(corner).collect();
        let mut triangles: Vec<[u32; 3]> = Vec::new();
        for i in 0..quads {
            triangles.push([2 * i, 2 * i + 1, 2 * i + 2]);
            triangles.push([2 * i + 3, 2 * i + 2, 2 * i + 1]);
        }
        for i in 0..loose {
            let p = Vec3::new((i * 7 % 31) as f32, (i * 13 % 17) as f32, (i * 5 % 23) as f32);
            triangles.push([0, 1, 2].map(|k| positions.len() as u32 + k));
            positions.extend([p, p + Vec3::X, p + Vec3::Y * 2.0]);
        }
        Bvh::build(&positions, &triangles, |p| p % 16 == 0)
    }

    /// A node's children, as kernels decode them.
    fn children(nodes: &Nodes, index: usize) -> Vec<ChildBox> {
        match nodes {
            Nodes::Binary(nodes) => {
                let BinaryNode { left_min, left, left_max, right_min, right, right_max, .. } = nodes[index];
                let all = [(left, left_min, left_max), (right, right_min, right_max)];
                let boxes = all.map(|(child, min, max)| (child, Aabb { min: min.into(), max: max.into() }));
                boxes.into_iter().filter(|(_, bounds)| bounds.min.x <= bounds.max.x).collect()
            }
            Nodes::Wide(nodes) => {
                let n = &nodes[index];
                let corner = |slot: usize, faces: [&[u8; 8]; 3]| {
                    Vec3::from_array([0, 1, 2].map(|axis| {
                        let step = f32::from_bits((n.shape >> (8 * axis) & 255) << 23);
                        f32::from(faces[axis][slot]).mul_add(step, n.origin[axis])
                    }))
                };
                let bounds = |slot| Aabb {
                    min: corner(slot, [&n.lower_x, &n.lower_y, &n.lower_z]),
                    max: corner(slot, [&n.upper_x, &n.upper_y, &n.upper_z]),
                };
                let used = (0..8).filter(|slot| n.shape >> (24 + slot) & 1 == 1);
                used.map(|slot| (n.children[slot], bounds(slot))).collect()
            }
            Nodes::Device(_) => panic!("no nodes"),
        }
    }

    /// The triangles of a leaf as kernels read them: primitive and corners in the canonical order.
    fn triangles(flat: &FlatScene, reference: u32) -> Vec<(u32, [Vec3; 3])> {
        let first = (reference & PAIR_INDEX) as usize;
        let count = (reference >> PAIRS_SHIFT & 7) as usize + 1;
        let both = (first..first + count).flat_map(|index| {
            let Pair { a, d_x, b, d_y, c, d_z } = flat.pairs[index];
            let [one, other] = flat.identities[index];
            [(one, [a, b, c]), (other, [c, b, [d_x, d_y, d_z]])]
        });
        let there = both.filter(|&(identity, _)| identity != MISS);
        let turned = there.map(|(identity, corners)| {
            let turn = (identity >> TURN_SHIFT) as usize;
            (identity & PRIMITIVE, [0, 1, 2].map(|i| Vec3::from(corners[(i + turn) % 3])))
        });
        turned.collect()
    }

    /// The layouts without a device's own tree.
    fn trees() -> impl Iterator<Item = Variant> {
        Variant::ALL.into_iter().filter(|variant| variant.tree != TreeKind::Device)
    }

    #[test]
    fn every_triangle_is_reached_once_within_its_boxes_and_the_stack_suffices() {
        for variant in trees() {
            for (quads, loose) in [(0, 0), (0, 1), (1, 0), (0, 3), (9, 50), (300, 1000), (2000, 9000)] {
                let bvh = build(quads, loose);
                let flat = FlatScene::of(&bvh, variant);
                let mut reached = Vec::new();
                let mut pending = vec![(0, Aabb { min: Vec3::NEG_INFINITY, max: Vec3::INFINITY }, 0)];
                while let Some((reference, bounds, above)) = pending.pop() {
                    if reference & LEAF == 0 {
                        assert!(
                            above < flat.stack,
                            "{variant}: {above} nodes above, {} promised",
                            flat.stack
                        );
                        let children = children(&flat.nodes, reference as usize);
                        pending
                            .extend(children.into_iter().map(|(child, bounds)| (child, bounds, above + 1)));
                        continue;
                    }
                    let leaf = triangles(&flat, reference);
                    let masked = leaf.iter().any(|&(primitive, _)| primitive % 16 == 0);
                    assert_eq!(reference & MASKED != 0, masked, "{variant}");
                    for (primitive, corners) in leaf {
                        assert_eq!(corners, bvh.corners(primitive), "{variant}");
                        assert!(
                            bounds.contains(&Aabb::around(corners)),
                            "{variant}: {bounds:?}, {corners:?}"
                        );
                        reached.push(primitive);
                    }
                }
                reached.sort_unstable();
                assert_eq!(reached, (0..bvh.len() as u32).collect::<Vec<_>>(), "{variant}");
                let pairs = flat.identities.iter().filter(|pair| pair[1] != MISS).count();
                assert!(
                    if variant.pairs { pairs >= quads as usize / 4 } else { pairs == 0 },
                    "{pairs} pairs"
                );
            }
        }
    }

    #[test]
    fn trees_with_several_instances_are_stored_once() {
        let tree = Arc::new(build(20, 30));
        let count = tree.len() as u32;
        let placed = (0..3).map(|i| {
            let mut placement = Placement::IDENTITY;
            placement.rows[0][3] = 100.0 * i as f32;
            crate::bvh::TreeInstance::placed(tree.clone(), placement, i * count)
        });
        let bvh = Bvh::from_instances(placed.collect());
        for variant in trees() {
            let (flat, single) = (FlatScene::of(&bvh, variant), FlatScene::of(&tree, variant));
            assert_eq!((flat.members.len(), flat.pairs.len()), (3, single.pairs.len()));
            assert!(flat.stack > single.stack && flat.members.iter().all(|m| m.root == flat.members[0].root));
            assert_eq!(flat.members.iter().map(|m| m.first).collect::<Vec<_>>(), [0, count, 2 * count]);
        }
    }

    /// Checks what [`boxes`] promises of the boxes for a device's own tree.
    fn check_boxes(bvh: &Bvh) {
        let flat = FlatScene::of(bvh, Variant { tree: TreeKind::Device, pairs: true });
        let Nodes::Device(boxes) = &flat.nodes else { panic!("no boxes") };
        assert!(!boxes.is_empty() && boxes.len() == flat.pairs.len());
        let margin = bvh.scene_max_abs() * boxes::MARGIN;
        let mut reached = Vec::new();
        for (index, bounds) in boxes.iter().enumerate() {
            let is_masked = index as u32 >= flat.first_masked;
            let pair = triangles(&flat, LEAF | index as u32);
            assert_eq!(
                is_masked && !bvh.is_empty(),
                pair.iter().any(|&(primitive, _)| bvh.is_masked(primitive))
            );
            for (primitive, corners) in pair {
                assert_eq!(corners, bvh.corners(primitive));
                let inside = Aabb { min: bounds.min.into(), max: bounds.max.into() };
                for corner in corners {
                    // The margin, but for the rounding of the largest coordinate.
                    let least = margin - bvh.scene_max_abs() * f32::EPSILON;
                    let around = Aabb { min: corner - Vec3::splat(least), max: corner + Vec3::splat(least) };
                    assert!(inside.contains(&around), "{inside:?}, {corner:?}");
                }
                reached.push(primitive);
            }
        }
        reached.sort_unstable();
        assert_eq!(reached, (0..bvh.len() as u32).collect::<Vec<_>>());
    }

    #[test]
    fn boxes_for_the_devices_tree_hold_every_triangle_once_and_their_margin() {
        for (quads, loose) in [(0, 0), (0, 1), (1, 0), (9, 50), (300, 1000)] {
            check_boxes(&build(quads, loose));
        }
        let tree = Arc::new(build(20, 30));
        let placed = (0..3).map(|i| {
            let mut placement = Placement::IDENTITY;
            placement.rows[0][3] = 100.0 * i as f32;
            crate::bvh::TreeInstance::placed(tree.clone(), placement, i * tree.len() as u32)
        });
        check_boxes(&Bvh::from_instances(placed.collect()));
    }
}
