//! Flattens a scene's trees into the records that kernels read (`layout.rs`).

mod pairs;
mod wide;

use super::layout::{Identities, Pair, TreeInstance, WideNode};
use super::pages::Records;
use crate::bvh::Bvh;
use crate::geom::{Aabb, Placement};
use std::collections::HashMap;
use std::sync::Arc;

/// A child as its parent stores it: reference and box.
type ChildBox = (u32, Aabb);

/// A scene for a device: nodes, the root first; triangles in leaf order, in pairs; tree instances.
#[derive(Debug, Default)]
pub(super) struct FlatScene {
    /// Nodes of all trees, one tree after the other.
    pub nodes: Vec<WideNode>,
    pub pairs: Vec<Pair>,
    pub identities: Vec<Identities>,
    pub members: Vec<TreeInstance>,
    /// The most entries that a traversal has on its stack.
    pub stack: usize,
}

impl FlatScene {
    /// Flattens a scene: its tree of triangles; or its top-level tree, and each instanced tree once.
    pub fn of(bvh: &Bvh) -> Self {
        let mut flat = Self::default();
        if bvh.instances().is_empty() {
            flat.stack = flat.append_tree(bvh).1;
            return flat;
        }
        let top_level_stack = wide::append_top_level(bvh.wide(), &mut flat.nodes);
        let mut roots = HashMap::new();
        for instance in bvh.instances() {
            let root = *roots.entry(Arc::as_ptr(&instance.tree)).or_insert_with(|| {
                let (root, stack) = flat.append_tree(&instance.tree);
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
        let nodes = Records { count: self.nodes.len(), bytes: size_of::<WideNode>() };
        let pairs = Records { count: self.pairs.len(), bytes: size_of::<Pair>() };
        let identities = Records { count: self.identities.len(), bytes: size_of::<Identities>() };
        [nodes, pairs, identities]
    }

    /// Appends a tree of triangles; returns its root's reference and the entries of a traversal's stack.
    fn append_tree(&mut self, bvh: &Bvh) -> (u32, usize) {
        wide::append_tree(bvh.wide(), &mut self.nodes, &mut self.pairs, &mut self.identities)
    }
}

#[cfg(test)]
mod tests {
    use super::super::layout::{LEAF, MASKED, PAIR_INDEX, PAIRS_SHIFT, PRIMITIVE, TURN_SHIFT};
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
    fn children(n: &WideNode) -> Vec<ChildBox> {
        let shape = n.corner[3];
        let corner = |slot: usize, faces: [&[u8; 8]; 3]| {
            Vec3::from_array([0, 1, 2].map(|axis| {
                let step = f32::from_bits((shape >> (8 * axis) & 255) << 23);
                f32::from(faces[axis][slot]).mul_add(step, f32::from_bits(n.corner[axis]))
            }))
        };
        let bounds = |slot| Aabb {
            min: corner(slot, [&n.x[0], &n.y[0], &n.z[0]]),
            max: corner(slot, [&n.x[1], &n.y[1], &n.z[1]]),
        };
        let used = (0..8).filter(|slot| shape >> (24 + slot) & 1 == 1);
        used.map(|slot| (n.children[slot], bounds(slot))).collect()
    }

    /// The triangles of a leaf as kernels read them: primitive and corners in the canonical order.
    fn triangles(flat: &FlatScene, reference: u32) -> Vec<(u32, [Vec3; 3])> {
        let first = (reference & PAIR_INDEX) as usize;
        let count = (reference >> PAIRS_SHIFT & 7) as usize + 1;
        let both = (first..first + count).flat_map(|index| {
            let [a, b, c, d] = flat.pairs[index].corners();
            let [one, other] = flat.identities[index];
            [(one, [a, b, c]), (other, [c, b, d])]
        });
        let there = both.filter(|&(identity, _)| identity != MISS);
        let turned = there.map(|(identity, corners)| {
            let turn = (identity >> TURN_SHIFT) as usize;
            (identity & PRIMITIVE, [0, 1, 2].map(|i| Vec3::from(corners[(i + turn) % 3])))
        });
        turned.collect()
    }

    #[test]
    fn every_triangle_is_reached_once_within_its_boxes_and_the_stack_suffices() {
        for (quads, loose) in [(0, 0), (0, 1), (1, 0), (0, 3), (9, 50), (300, 1000), (2000, 9000)] {
            let bvh = build(quads, loose);
            let flat = FlatScene::of(&bvh);
            let mut reached = Vec::new();
            let mut pending = vec![(0, Aabb { min: Vec3::NEG_INFINITY, max: Vec3::INFINITY }, 0)];
            while let Some((reference, bounds, above)) = pending.pop() {
                if reference & LEAF == 0 {
                    assert!(above < flat.stack, "{above} nodes above, {} promised", flat.stack);
                    let children = children(&flat.nodes[reference as usize]);
                    pending.extend(children.into_iter().map(|(child, bounds)| (child, bounds, above + 1)));
                    continue;
                }
                let leaf = triangles(&flat, reference);
                let masked = leaf.iter().any(|&(primitive, _)| primitive % 16 == 0);
                assert_eq!(reference & MASKED != 0, masked);
                for (primitive, corners) in leaf {
                    assert_eq!(corners, bvh.corners(primitive));
                    assert!(bounds.contains(&Aabb::around(corners)), "{bounds:?}, {corners:?}");
                    reached.push(primitive);
                }
            }
            reached.sort_unstable();
            assert_eq!(reached, (0..bvh.len() as u32).collect::<Vec<_>>());
            let pairs = flat.identities.iter().filter(|pair| pair[1] != MISS).count();
            assert!(pairs >= quads as usize / 4, "{pairs} pairs");
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
        let (flat, single) = (FlatScene::of(&bvh), FlatScene::of(&tree));
        assert_eq!((flat.members.len(), flat.pairs.len()), (3, single.pairs.len()));
        assert!(flat.stack > single.stack && flat.members.iter().all(|m| m.root == flat.members[0].root));
        assert_eq!(flat.members.iter().map(|m| m.first).collect::<Vec<_>>(), [0, count, 2 * count]);
    }
}
