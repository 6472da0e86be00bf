//! The eight-wide tree as kernels read it: the host's tree, with boxes in bytes.

use super::super::layout::{Identities, LEAF, Pair, WideNode};
use super::ChildBox;
use super::pairs::{self, PackedPair, Triangle};
use crate::bvh::{Child, LeafBlock, WIDTH, WideNode as HostNode, WideTree};
use crate::geom::Aabb;
use glam::Vec3;
use rayon::prelude::*;

/// The most pairs of a leaf.
const LEAF_PAIRS: usize = 2;

/// The least biased exponent of a step. With smaller steps products with reciprocals could underflow.
const LEAST_EXPONENT: u32 = 127 - 60;

/// The most steps between two faces.
const STEPS: f32 = 255.0;

/// Faces of a node's boxes along one axis, in steps from `origin`.
struct Axis {
    origin: f32,
    exponent: u32,
    lower: [u8; WIDTH],
    upper: [u8; WIDTH],
}

impl Axis {
    /// Chooses the step, and counts steps so that `fma(count, step, origin)`, rounded once, is not inside the exact
    /// face.
    fn of(lower: &[f32; WIDTH], upper: &[f32; WIDTH], used: u32) -> Self {
        let slots = || (0..WIDTH).filter(move |slot| used & 1 << slot != 0);
        let origin = slots().map(|slot| lower[slot]).fold(f32::INFINITY, f32::min);
        let most = slots().map(|slot| upper[slot]).fold(f32::NEG_INFINITY, f32::max);
        // Of a node without children.
        let origin = if used == 0 { 0.0 } else { origin };
        let mut exponent = (((most - origin) / STEPS).max(0.0).to_bits() >> 23).max(LEAST_EXPONENT);
        loop {
            let step = f32::from_bits(exponent << 23);
            let face = |count: f32| count.mul_add(step, origin);
            let mut axis = Self { origin, exponent, lower: [0; WIDTH], upper: [0; WIDTH] };
            let mut fits = true;
            for slot in slots() {
                let mut below = ((lower[slot] - origin) / step).floor().min(STEPS);
                while face(below) > lower[slot] {
                    below -= 1.0;
                }
                let mut above = ((upper[slot] - origin) / step).ceil().max(0.0);
                while face(above) < upper[slot] && above <= STEPS {
                    above += 1.0;
                }
                fits &= above <= STEPS;
                (axis.lower[slot], axis.upper[slot]) = (below as u8, above as u8);
            }
            if fits {
                return axis;
            }
            exponent += 1;
        }
    }
}

/// A node with children in these slots.
fn node(slots: [Option<ChildBox>; WIDTH]) -> WideNode {
    let used = (0..WIDTH).filter(|&slot| slots[slot].is_some()).fold(0, |used, slot| used | 1 << slot);
    let axis = |axis: usize| {
        let face =
            |face: fn(&Aabb) -> Vec3| slots.map(|slot| slot.map_or(0.0, |(_, bounds)| face(&bounds)[axis]));
        Axis::of(&face(|bounds| bounds.min), &face(|bounds| bounds.max), used)
    };
    let (x, y, z) = (axis(0), axis(1), axis(2));
    let shape = x.exponent | y.exponent << 8 | z.exponent << 16 | used << 24;
    WideNode {
        corner: [x.origin.to_bits(), y.origin.to_bits(), z.origin.to_bits(), shape],
        x: [x.lower, x.upper],
        y: [y.lower, y.upper],
        z: [z.lower, z.upper],
        // Slots that are not in use are never visited.
        children: slots.map(|slot| slot.map_or(LEAF, |(reference, _)| reference)),
    }
}

/// The children of a node of the host's tree.
fn children(host: &HostNode, mut reference: impl FnMut(Child) -> u32) -> Vec<ChildBox> {
    let used = (0..WIDTH).filter(|&slot| host.children[slot] != Child::NONE);
    used.map(|slot| (reference(host.children[slot]), host.bounds(slot))).collect()
}

/// Assigns slots to at most eight children, so that a ray whose direction has the sign bits `octant` (x is bit 0) meets
/// them roughly front to back in the order of `slot ^ octant`. Greedy: the child that lies farthest in the direction of
/// a free slot's octant gets the slot first.
fn assign_slots(children: &[ChildBox]) -> [Option<ChildBox>; WIDTH] {
    let centre = children.iter().fold(Aabb::EMPTY, |all, (_, bounds)| all.union(*bounds)).centre();
    let mut gains = [[0.0; WIDTH]; WIDTH];
    for ((_, bounds), gains) in children.iter().zip(&mut gains) {
        let offset = bounds.centre() - centre;
        for (slot, gain) in gains.iter_mut().enumerate() {
            let along = |axis: usize| if slot >> axis & 1 == 1 { offset[axis] } else { -offset[axis] };
            *gain = along(0) + along(1) + along(2);
        }
    }
    let mut slots = [None; WIDTH];
    let mut left: Vec<usize> = (0..children.len()).collect();
    while !left.is_empty() {
        let (mut most, mut best) = (f32::NEG_INFINITY, (0, 0));
        for (at, &child) in left.iter().enumerate() {
            for slot in (0..WIDTH).filter(|&slot| slots[slot].is_none()) {
                if gains[child][slot] > most {
                    (most, best) = (gains[child][slot], (at, slot));
                }
            }
        }
        let (at, slot) = best;
        slots[slot] = Some(children[left.remove(at)]);
    }
    slots
}

/// Host nodes that one thread flattens at a time.
const NODES_AT_ONCE: usize = 256;

/// The leaves of some consecutive nodes, child by child.
#[derive(Default)]
struct Leaves {
    pairs: Vec<PackedPair>,
    /// Pairs of each leaf.
    lengths: Vec<usize>,
}

impl Leaves {
    fn of(tree: &WideTree, hosts: &[HostNode]) -> Self {
        let mut leaves = Self::default();
        for child in hosts.iter().flat_map(HostNode::block_children) {
            let mut leaf = pairs::pack(&triangles(tree.blocks().get(child)));
            leaves.lengths.push(leaf.len());
            leaves.pairs.append(&mut leaf);
        }
        leaves
    }

    /// The number of those that become nodes.
    fn long(&self) -> usize {
        self.lengths.iter().filter(|&&length| length > LEAF_PAIRS).count()
    }
}

/// Where records of some consecutive nodes of the host begin.
#[derive(Clone, Copy)]
struct Place {
    /// The tree's first node.
    tree: usize,
    pair: usize,
    /// The first node of a long leaf.
    leaf_node: usize,
}

/// Flattens some consecutive nodes: the nodes, and those of long leaves.
fn flatten(hosts: &[HostNode], leaves: &Leaves, place: Place) -> (Vec<WideNode>, Vec<WideNode>) {
    let (mut nodes, mut leaf_nodes) = (Vec::with_capacity(hosts.len()), Vec::new());
    let (mut lengths, mut pairs, mut first) = (leaves.lengths.iter(), &leaves.pairs[..], place.pair);
    for host in hosts {
        let reference = |child: Child| {
            if !child.is_block() {
                return (place.tree + child.index()) as u32;
            }
            let length = *lengths.next().expect("a leaf for each block");
            let (leaf, rest) = pairs.split_at(length);
            let start = first;
            (pairs, first) = (rest, first + length);
            if length <= LEAF_PAIRS {
                return pairs::leaf_reference(leaf, start);
            }
            let child = |(at, pair): (usize, &PackedPair)| {
                (pairs::leaf_reference(std::slice::from_ref(pair), start + at), pair.bounds())
            };
            leaf_nodes.push(node(assign_slots(&leaf.iter().enumerate().map(child).collect::<Vec<_>>())));
            (place.leaf_node + leaf_nodes.len() - 1) as u32
        };
        nodes.push(node(assign_slots(&children(host, reference))));
    }
    (nodes, leaf_nodes)
}

/// Appends a tree of triangles; returns its root's reference and the entries of a traversal's stack. Leaf blocks that
/// suit the host's lanes may be long leaves for one GPU thread: those of more than [`LEAF_PAIRS`] pairs become nodes.
/// Runs on the current rayon pool; the result depends on the arguments only.
pub fn append_tree(
    tree: &WideTree,
    nodes: &mut Vec<WideNode>,
    pairs: &mut Vec<Pair>,
    identities: &mut Vec<Identities>,
) -> (u32, usize) {
    let start = nodes.len();
    let hosts = tree.nodes().par_chunks(NODES_AT_ONCE);
    let leaves: Vec<Leaves> = hosts.clone().map(|hosts| Leaves::of(tree, hosts)).collect();
    let mut next = Place { tree: start, pair: pairs.len(), leaf_node: start + tree.nodes().len() };
    let place_after = |leaves: &Leaves| {
        let place = next;
        (next.pair, next.leaf_node) = (next.pair + leaves.pairs.len(), next.leaf_node + leaves.long());
        place
    };
    let places: Vec<Place> = leaves.iter().map(place_after).collect();
    let flat = hosts.zip(&leaves).zip(places).map(|((hosts, leaves), place)| flatten(hosts, leaves, place));
    let (own, of_leaves): (Vec<_>, Vec<_>) = flat.collect::<Vec<_>>().into_iter().unzip();
    leaves.iter().flat_map(|leaves| &leaves.pairs).for_each(|pair| pair.append(pairs, identities));
    nodes.extend(own.into_iter().flatten());
    let below = usize::from(of_leaves.iter().any(|nodes| !nodes.is_empty()));
    nodes.extend(of_leaves.into_iter().flatten());
    (start as u32, tree.depth() + below)
}

/// Appends a tree over members; returns the entries of a traversal's stack.
pub fn append_top_level(tree: &WideTree, nodes: &mut Vec<WideNode>) -> usize {
    let reference = |child: Child| child.index() as u32 | if child.is_block() { LEAF } else { 0 };
    nodes.extend(tree.nodes().iter().map(|host| node(assign_slots(&children(host, reference)))));
    tree.depth()
}

fn triangles(block: LeafBlock<'_>) -> Vec<Triangle> {
    let triangle = |row| Triangle {
        primitive: block.primitive(row),
        corners: block.corners(row),
        is_masked: block.is_masked(row),
    };
    (0..block.len()).map(triangle).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_child_gets_a_slot_of_its_own_towards_its_corner() {
        let corner = |i: u32| {
            let along = |axis: usize| if i >> axis & 1 == 1 { 1.0 } else { -1.0 };
            (i, Aabb::around([Vec3::new(along(0), along(1), along(2)); 3]))
        };
        let corners: Vec<ChildBox> = (0..8).rev().map(corner).collect();
        assert_eq!(
            assign_slots(&corners).map(|entry| entry.map(|(child, _)| child)),
            [0, 1, 2, 3, 4, 5, 6, 7].map(Some)
        );
        let same: Vec<ChildBox> = (0..8).map(|i| (i, corner(0).1)).collect();
        let mut found = assign_slots(&same).map(|entry| entry.map(|(child, _)| child));
        found.sort_unstable();
        assert_eq!(found, [0, 1, 2, 3, 4, 5, 6, 7].map(Some));
        let opposite = assign_slots(&[corners[0], corners[7]]);
        assert_eq!((opposite[7], opposite[0]), (Some(corners[0]), Some(corners[7])));
        assert_eq!(assign_slots(&[]), [None; WIDTH]);
    }
}
