//! A scene's trees as the kernels read them.

mod binary;
mod boxes;
mod pairs;
mod wide;

use super::kernel_kind::TreeKind;
use super::layout::{BinaryNode, Identities, LEAF, Pair, TreeInstance, WideNode};
use super::pages::Pages;
use crate::bvh::{Bvh, FlatTree};
use crate::geom::Placement;
use boxes::Box;
pub(super) use boxes::REACH as QUERY_REACH;
use pairs::Triangle;
use std::collections::HashMap;
use std::fmt;
use std::sync::Arc;

/// How a scene is laid out on a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Variant {
    /// The trees.
    pub tree: TreeKind,
    /// Whether triangles of a leaf that share an edge share its corners.
    pub pairs: bool,
}

impl Variant {
    /// All there are.
    pub const ALL: [Self; 5] = [
        Self { tree: TreeKind::Wide, pairs: true },
        Self { tree: TreeKind::Wide, pairs: false },
        Self { tree: TreeKind::Binary, pairs: true },
        Self { tree: TreeKind::Binary, pairs: false },
        Self { tree: TreeKind::Device, pairs: true },
    ];
}

impl fmt::Display for Variant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let tree = match self.tree {
            TreeKind::Binary => "binary",
            TreeKind::Wide => "wide",
            TreeKind::Device => "ray query",
        };
        write!(f, "{tree}, {}", if self.pairs { "pairs" } else { "no pairs" })
    }
}

impl Default for Variant {
    fn default() -> Self {
        Self { tree: TreeKind::Wide, pairs: true }
    }
}

/// Nodes of trees of a kind; members' trees follow each other.
#[derive(Debug)]
pub(super) enum Nodes {
    Binary(Vec<BinaryNode>),
    Wide(Vec<WideNode>),
    /// The device makes its own over these.
    Device(Vec<Box>),
}

impl Nodes {
    pub fn len(&self) -> usize {
        match self {
            Self::Binary(nodes) => nodes.len(),
            Self::Wide(nodes) => nodes.len(),
            Self::Device(boxes) => boxes.len(),
        }
    }

    pub fn record_bytes(&self) -> usize {
        match self {
            Self::Binary(_) => size_of::<BinaryNode>(),
            Self::Wide(_) => size_of::<WideNode>(),
            Self::Device(_) => size_of::<Box>(),
        }
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

/// What a device is given of a scene: nodes, the root first; triangles in leaf order, in pairs.
#[derive(Debug)]
pub(super) struct Flat {
    pub nodes: Nodes,
    pub pairs: Vec<Pair>,
    pub identities: Vec<Identities>,
    pub members: Vec<TreeInstance>,
    /// The most entries a traversal has on its stack.
    pub stack: usize,
    /// Of a device's own tree: alpha decides about pairs from here on.
    pub first_masked: u32,
}

impl Flat {
    /// Lays a scene out: the tree of triangles; or the one over members, and theirs, each once.
    pub fn of(bvh: &Bvh, variant: Variant) -> Self {
        let nodes = match variant.tree {
            TreeKind::Binary => Nodes::Binary(Vec::new()),
            TreeKind::Wide => Nodes::Wide(Vec::new()),
            TreeKind::Device => Nodes::Device(Vec::new()),
        };
        let (pairs, identities, members) = (Vec::new(), Vec::new(), Vec::new());
        let mut flat = Self { nodes, pairs, identities, members, stack: 0, first_masked: 0 };
        if bvh.instances().is_empty() || variant.tree == TreeKind::Device {
            flat.stack = flat.lay(bvh, variant).1;
            return flat;
        }
        let above = flat.lay_top(bvh);
        let mut roots = HashMap::new();
        for member in bvh.instances() {
            let root = *roots.entry(Arc::as_ptr(&member.tree)).or_insert_with(|| {
                let (root, stack) = flat.lay(&member.tree, variant);
                flat.stack = flat.stack.max(above + stack);
                root
            });
            let rows = member.placement.unwrap_or(Placement::IDENTITY).rows;
            let column = |i: usize| rows.map(|row| row[i]);
            flat.members.push(TreeInstance {
                x: column(0),
                root,
                y: column(1),
                first: member.first_primitive,
                z: column(2),
                spare_0: 0,
                shift: column(3),
                spare_1: 0,
            });
        }
        flat
    }

    /// Lays out a tree of triangles behind what there is; gives its root and the entries of the stack.
    fn lay(&mut self, bvh: &Bvh, variant: Variant) -> (u32, usize) {
        let Self { nodes, pairs, identities, .. } = self;
        match nodes {
            Nodes::Binary(nodes) => {
                let tree = bvh.to_flat_tree();
                let leaf = |index: usize| {
                    let leaf = pairs::of(&below(bvh, &tree, index), variant.pairs);
                    pairs::lay(&leaf, pairs, identities)
                };
                binary::lay(&tree, binary::LEAF_TRIANGLES, nodes, leaf)
            }
            Nodes::Wide(nodes) => wide::lay(bvh.wide(), variant.pairs, nodes, pairs, identities),
            Nodes::Device(all) => {
                self.first_masked = boxes::lay(bvh, variant.pairs, all, pairs, identities);
                (0, 0)
            }
        }
    }

    /// Lays out the tree over members; gives the entries of the stack.
    fn lay_top(&mut self, bvh: &Bvh) -> usize {
        match &mut self.nodes {
            Nodes::Binary(nodes) => {
                let tree = bvh.to_flat_tree();
                binary::lay(&tree, 1, nodes, |index| LEAF | tree.nodes()[index].index).1
            }
            Nodes::Wide(nodes) => wide::lay_top(bvh.wide(), nodes),
            Nodes::Device(_) => unreachable!("all triangles are written out"),
        }
    }
}

/// The triangles of a subtree.
fn below(bvh: &Bvh, tree: &FlatTree, index: usize) -> Vec<Triangle> {
    let nodes = tree.nodes();
    let subtree = &nodes[index..index + 2 * nodes[index].count as usize - 1];
    let triangle = |primitive| Triangle {
        primitive,
        corners: bvh.corners(primitive),
        is_masked: bvh.is_masked(primitive),
    };
    subtree.iter().filter(|node| node.is_leaf()).map(|leaf| triangle(leaf.index)).collect()
}

#[cfg(test)]
mod tests {
    use super::super::layout::{MASKED, PAIR_INDEX, PAIRS_SHIFT, PRIMITIVE, TURN_SHIFT};
    use super::*;
    use crate::geom::Aabb;
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

    /// References of a node's children and their boxes, as kernels decode them.
    fn children(nodes: &Nodes, index: usize) -> Vec<(u32, Aabb)> {
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
    fn triangles(flat: &Flat, reference: u32) -> Vec<(u32, [Vec3; 3])> {
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

    /// Those whose trees are ours.
    fn trees() -> impl Iterator<Item = Variant> {
        Variant::ALL.into_iter().filter(|variant| variant.tree != TreeKind::Device)
    }

    #[test]
    fn every_triangle_is_reached_once_within_its_boxes_and_the_stack_suffices() {
        for variant in trees() {
            for (quads, loose) in [(0, 0), (0, 1), (1, 0), (0, 3), (9, 50), (300, 1000)] {
                let bvh = build(quads, loose);
                let flat = Flat::of(&bvh, variant);
                let mut met = Vec::new();
                let mut open = vec![(0, Aabb { min: Vec3::NEG_INFINITY, max: Vec3::INFINITY }, 0)];
                while let Some((reference, bounds, above)) = open.pop() {
                    if reference & LEAF == 0 {
                        assert!(
                            above < flat.stack,
                            "{variant}: {above} nodes above, {} promised",
                            flat.stack
                        );
                        let children = children(&flat.nodes, reference as usize);
                        open.extend(children.into_iter().map(|(child, bounds)| (child, bounds, above + 1)));
                        continue;
                    }
                    let there = triangles(&flat, reference);
                    let masked = there.iter().any(|&(primitive, _)| primitive % 16 == 0);
                    assert_eq!(reference & MASKED != 0, masked, "{variant}");
                    for (primitive, corners) in there {
                        assert_eq!(corners, bvh.corners(primitive), "{variant}");
                        assert!(
                            bounds.contains(&Aabb::around(corners)),
                            "{variant}: {bounds:?}, {corners:?}"
                        );
                        met.push(primitive);
                    }
                }
                met.sort_unstable();
                assert_eq!(met, (0..bvh.len() as u32).collect::<Vec<_>>(), "{variant}");
                let pairs = flat.identities.iter().filter(|pair| pair[1] != MISS).count();
                assert!(
                    if variant.pairs { pairs >= quads as usize / 4 } else { pairs == 0 },
                    "{pairs} pairs"
                );
            }
        }
    }

    #[test]
    fn trees_that_are_placed_several_times_are_laid_out_once() {
        let tree = Arc::new(build(20, 30));
        let count = tree.len() as u32;
        let placed = (0..3).map(|i| {
            let mut placement = Placement::IDENTITY;
            placement.rows[0][3] = 100.0 * i as f32;
            crate::bvh::TreeInstance::placed(tree.clone(), placement, i * count)
        });
        let bvh = Bvh::from_instances(placed.collect());
        for variant in trees() {
            let (flat, alone) = (Flat::of(&bvh, variant), Flat::of(&tree, variant));
            assert_eq!((flat.members.len(), flat.pairs.len()), (3, alone.pairs.len()));
            assert!(flat.stack > alone.stack && flat.members.iter().all(|m| m.root == flat.members[0].root));
            assert_eq!(flat.members.iter().map(|m| m.first).collect::<Vec<_>>(), [0, count, 2 * count]);
        }
    }

    /// What [`boxes`] promises of the boxes of a tree that the device makes.
    fn check_boxes(bvh: &Bvh) {
        let flat = Flat::of(bvh, Variant { tree: TreeKind::Device, pairs: true });
        let Nodes::Device(boxes) = &flat.nodes else { panic!("no boxes") };
        assert!(!boxes.is_empty() && boxes.len() == flat.pairs.len());
        let margin = bvh.scene_max_abs() * boxes::MARGIN;
        let mut met = Vec::new();
        for (index, bounds) in boxes.iter().enumerate() {
            let is_masked = index as u32 >= flat.first_masked;
            let there = triangles(&flat, LEAF | index as u32);
            assert_eq!(
                is_masked && !bvh.is_empty(),
                there.iter().any(|&(primitive, _)| bvh.is_masked(primitive))
            );
            for (primitive, corners) in there {
                assert_eq!(corners, bvh.corners(primitive));
                let inside = Aabb { min: bounds.min.into(), max: bounds.max.into() };
                for corner in corners {
                    // As far as the largest coordinate's rounding tells.
                    let far = margin - bvh.scene_max_abs() * f32::EPSILON;
                    let around = Aabb { min: corner - Vec3::splat(far), max: corner + Vec3::splat(far) };
                    assert!(inside.contains(&around), "{inside:?}, {corner:?}");
                }
                met.push(primitive);
            }
        }
        met.sort_unstable();
        assert_eq!(met, (0..bvh.len() as u32).collect::<Vec<_>>());
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
