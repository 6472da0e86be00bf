//! Packets of four rays and their way through the tree (RTRT, section 4.1).

use super::kd_tree::{KdTree, MAX_DEPTH, Node};
use glam::{BVec4A, Vec4};
use raystream::stream::Ray;

/// Every lane of a mask.
const ALL: u32 = 0b1111;

/// Entries of a thread's table of mailboxes (section 2.3).
const MAILBOXES: usize = 64;

/// Components of directions are at least this large, so that distances to planes are numbers.
const LEAST: f32 = 1e-30;

/// Four rays, each with the segment in which it looks for hits.
#[derive(Clone, Debug)]
pub struct Packet {
    pub(super) origin: [Vec4; 3],
    pub(super) direction: [Vec4; 3],
    inverse: [Vec4; 3],
    near: Vec4,
    far: Vec4,
    /// Lanes of rays whose directions have the same signs: each group is traced by itself.
    groups: Vec<u32>,
}

impl Packet {
    /// Rays of a packet.
    pub const RAYS: usize = 4;

    /// Packs at most four rays.
    pub fn new(rays: &[Ray]) -> Self {
        let lanes = |of: &dyn Fn(&Ray) -> f32, none: f32| {
            Vec4::from_array(std::array::from_fn(|lane| rays.get(lane).map_or(none, of)))
        };
        let origin = [0, 1, 2].map(|axis| lanes(&|ray| ray.origin[axis], 0.0));
        let direction = [0, 1, 2].map(|axis| lanes(&|ray| ray.direction[axis], 1.0));
        let apart =
            |component: f32| if component.abs() < LEAST { LEAST.copysign(component) } else { component };
        let inverse = direction.map(|lanes| Vec4::from_array(lanes.to_array().map(apart)).recip());
        let signs = |lane: usize| direction.map(|component| component[lane].is_sign_negative());
        let mut groups = Vec::new();
        let mut left: Vec<usize> = (0..rays.len()).collect();
        while let Some(&first) = left.first() {
            let (same, other): (Vec<_>, Vec<_>) = left.iter().partition(|&&lane| signs(lane) == signs(first));
            groups.push(same.into_iter().fold(0, |group, lane| group | 1_u32 << lane));
            left = other;
        }
        let near = lanes(&|ray| ray.t_min, f32::INFINITY);
        let far = lanes(&|ray| ray.t_max, f32::NEG_INFINITY);
        Self { origin, direction, inverse, near, far, groups }
    }
}

/// A subtree that is still to be visited, with the segments of the rays there.
#[derive(Clone, Copy)]
struct Pending {
    node: Node,
    near: Vec4,
    far: Vec4,
}

/// Memory that a thread writes while it traces.
struct Scratch {
    /// The last triangles that were tested, each with the number of the packet.
    mailboxes: [(u32, u32); MAILBOXES],
    packet: u32,
    pending: [Pending; MAX_DEPTH],
}

impl Scratch {
    /// True if the packet has met the triangle already; notes it.
    #[inline(always)]
    fn has_met(&mut self, triangle: u32) -> bool {
        let entry = &mut self.mailboxes[triangle as usize % MAILBOXES];
        let met = (triangle, self.packet);
        std::mem::replace(entry, met) == met
    }
}

impl KdTree {
    /// Traces packets: writes the distances of their nearest hits, or 0 where anything is hit; +∞ where nothing is.
    pub fn trace(&self, packets: &[Packet], any: bool, answers: &mut [[f32; Packet::RAYS]]) {
        let unused = Pending { node: self.root, near: Vec4::ZERO, far: Vec4::ZERO };
        let mut scratch = Scratch { mailboxes: [(0, 0); MAILBOXES], packet: 0, pending: [unused; MAX_DEPTH] };
        for (packet, answers) in packets.iter().zip(answers) {
            let (mut nearest, mut found) = (packet.far, 0);
            for &group in &packet.groups {
                // Of packet 0 there is none.
                scratch.packet += 1;
                found |= match any {
                    true => self.trace_group::<true>(packet, group, &mut nearest, &mut scratch),
                    false => self.trace_group::<false>(packet, group, &mut nearest, &mut scratch),
                };
            }
            let distances = if any { Vec4::ZERO } else { nearest };
            *answers = Vec4::select(lanes(found), distances, Vec4::INFINITY).to_array();
        }
    }

    /// The segments of a group of rays in the bounds of the tree, empty ones for other rays, and the axes along which
    /// the group's rays descend.
    #[inline(always)]
    fn clipped(&self, packet: &Packet, group: u32) -> (Vec4, Vec4, [bool; 3]) {
        let in_group = lanes(group);
        let mut near = Vec4::select(in_group, packet.near, Vec4::INFINITY);
        let mut far = Vec4::select(in_group, packet.far, Vec4::NEG_INFINITY);
        let first = group.trailing_zeros() as usize;
        let mut is_negative = [false; 3];
        for (axis, is_negative) in is_negative.iter_mut().enumerate() {
            let low = (Vec4::splat(self.bounds.min[axis]) - packet.origin[axis]) * packet.inverse[axis];
            let high = (Vec4::splat(self.bounds.max[axis]) - packet.origin[axis]) * packet.inverse[axis];
            near = near.max(low.min(high));
            far = far.min(low.max(high));
            *is_negative = packet.direction[axis][first].is_sign_negative();
        }
        (near, far, is_negative)
    }

    /// Traces the rays of a packet whose directions have the same signs; returns those that hit something.
    #[inline(always)]
    fn trace_group<const ANY: bool>(
        &self,
        packet: &Packet,
        group: u32,
        nearest: &mut Vec4,
        scratch: &mut Scratch,
    ) -> u32 {
        let (mut near, mut far, is_negative) = self.clipped(packet, group);
        let (mut depth, mut node, mut found, mut done) = (0, self.root, 0, !group & ALL);
        if near.cmpgt(far).bitmask() == ALL {
            return 0;
        }
        loop {
            while let Some((axis, plane, place)) = node.inner() {
                let distance = (Vec4::splat(plane) - packet.origin[axis]) * packet.inverse[axis];
                let children = self.children(place);
                let side = usize::from(is_negative[axis]);
                let idle = near.cmpgt(far);
                if (distance.cmplt(near) | idle).bitmask() == ALL {
                    node = children[1 - side];
                } else if (distance.cmpgt(far) | idle).bitmask() == ALL {
                    node = children[side];
                } else {
                    scratch.pending[depth] =
                        Pending { node: children[1 - side], near: near.max(distance), far };
                    depth += 1;
                    node = children[side];
                    far = far.min(distance);
                }
            }
            for &triangle in self.leaf(node) {
                if scratch.has_met(triangle) {
                    continue;
                }
                let (t, is_hit) = self.triangle(triangle).test(packet, packet.near, *nearest);
                let hit = is_hit.bitmask() & !done;
                if hit != 0 {
                    *nearest = Vec4::select(lanes(hit), t, *nearest);
                    found |= hit;
                    if ANY {
                        done |= hit;
                    }
                }
            }
            if !ANY {
                // What lies farther than this voxel cannot be nearer.
                done |= found & near.cmple(far).bitmask() & nearest.cmple(far).bitmask();
            }
            loop {
                if done == ALL || depth == 0 {
                    return found;
                }
                depth -= 1;
                node = scratch.pending[depth].node;
                near = scratch.pending[depth].near;
                far = Vec4::select(lanes(done), Vec4::NEG_INFINITY, scratch.pending[depth].far);
                if near.cmple(far).any() {
                    break;
                }
            }
        }
    }
}

/// A mask of lanes by their bits.
#[inline(always)]
fn lanes(bits: u32) -> BVec4A {
    BVec4A::from_array([1, 2, 4, 8].map(|bit| bits & bit != 0))
}
