//! Visits of nodes and leaf blocks by lists of packets.
//!
//! Unsafe code, because lists, packets and nodes are accessed without bounds checks. Invariants 2 to 7 are those of
//! `substream` and `child_lists`, with packet entries in the place of ids, and:
//! 8. Every entry in a list (padding included) names a packet of the sub-stream, which [`PacketVisitor::packets`]
//!    holds.
//! 9. Tests of rays with triangles have room for all parts of a batch with all triangles, and for a vector beyond them.
#![allow(unsafe_code, reason = "the invariants above")]

use super::super::child_lists::ChildLists;
use super::super::interval::PlaneDistances;
use super::super::slabs::Faces;
use super::super::substream::{Answers, DONE, Entry, OctantStack, Visitor, Widths};
use super::super::tree_view::TreeView;
use super::super::triangle::{LaneHits, Limits};
use super::super::visit_order::VisitOrder;
use super::columns::{Column, Origin, PACKET_RAYS, Packet, PacketEntry};
use super::triangles::BlockTriangles;
use crate::bvh::{LeafBlock, MASKED, PRIMITIVE, WIDTH};
use crate::lanes::{LaneBits, Lanes, MAX_LANES, spill, splat};
use crate::stream::{Hit, MISS};
use std::mem::MaybeUninit;

/// Packets that are tested coarsely before any of them is tested further.
const BATCH: usize = 32;

/// The most vectors that the rays of a packet take.
const MAX_PARTS: usize = PACKET_RAYS / WIDTH;

/// The slots of a node, or the rows of a block, in lanes.
static SLOTS: [u32; WIDTH] = [0, 1, 2, 3, 4, 5, 6, 7];

/// Follows packets of one origin.
pub struct PacketVisitor<'a, W, E, const ANY: bool> {
    pub widths: Widths<W, E>,
    pub tree: &'a TreeView<'a>,
    pub origin: Origin,
    /// The packets of the sub-stream.
    pub packets: *mut Packet,
}

/// Writes the hits of packets as the answers of their rays, which are misses beforehand.
pub fn write_answers(answers: Answers<'_>, packets: &[Packet]) {
    match answers {
        Answers::Hits(hits) => {
            for packet in packets {
                for lane in 0..PACKET_RAYS {
                    if packet.primitive[lane] == MISS {
                        continue;
                    }
                    hits[packet.rays[lane] as usize] = Hit {
                        t: packet.limit.0[lane],
                        u: packet.u.0[lane],
                        v: packet.v.0[lane],
                        primitive: packet.primitive[lane],
                    };
                }
            }
        }
        Answers::Occluded(occluded) => {
            for packet in packets {
                for lane in 0..PACKET_RAYS {
                    if packet.primitive[lane] == MISS {
                        continue;
                    }
                    occluded[packet.rays[lane] as usize] = 1;
                }
            }
        }
    }
}

impl<W: Lanes, E: Lanes, const ANY: bool> Visitor for PacketVisitor<'_, W, E, ANY> {
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn step(&self, octant: usize, stack: &mut OctantStack) -> bool {
        let Some(entry) = stack.entries.pop() else { return false };
        // SAFETY: the caller's contract: invariants 2 to 4 and 8.
        unsafe {
            if entry.child.is_block() {
                let block = self.tree.block(entry.child);
                let list = stack.arena.as_ptr().add(entry.start as usize);
                let list = std::slice::from_raw_parts(list, entry.len as usize);
                self.visit_block(block, octant, list);
            } else if ANY {
                self.visit_node(VisitOrder::LIKELY_FIRST, octant, stack, entry);
            } else {
                let order = VisitOrder::front_to_back(self.tree.node(entry.child), octant);
                self.visit_node(order, octant, stack, entry);
            }
        }
        true
    }
}

impl<W: Lanes, E: Lanes, const ANY: bool> PacketVisitor<'_, W, E, ANY> {
    /// The packet that an entry names.
    ///
    /// # Safety
    /// Invariant 8, and no other reference to the packet is in use.
    #[inline(always)]
    #[allow(clippy::mut_from_ref, reason = "the packets are reached by a pointer, not by the visitor")]
    unsafe fn packet(&self, entry: PacketEntry) -> &mut Packet {
        // SAFETY: invariant 8.
        unsafe { &mut *self.packets.add(entry.packet()) }
    }

    /// Tests a list of packets against the boxes of a node: first each packet's interval against all boxes, then the
    /// rays of each packet against the boxes that remain. Done packet by packet, the number of remaining boxes would be
    /// a mispredicted branch each time.
    ///
    /// # Safety
    /// Invariants 2 to 4 and 6 to 8 hold for the stack and the entry, whose child is an inner node.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn visit_node(&self, order: VisitOrder, octant: usize, stack: &mut OctantStack, at: Entry) {
        let Self { widths: Widths { wide: w, eight: e }, tree, ref origin, .. } = *self;
        let len = at.len as usize;
        let lists = ChildLists::reserve(stack, at, order);
        let ids = stack.arena.as_mut_ptr();
        let mut ends = lists.ends(ids);
        let mut boxes = [const { MaybeUninit::<u32>::uninit() }; WIDTH * BATCH + WIDTH];
        let boxes: *mut u32 = boxes.as_mut_ptr().cast();
        // SAFETY: invariant 4 for the node; 2 and 8 for the list and its packets; 7 for the children's lists; 3 and 6
        // for pushing. `boxes` has room for all slots of a batch and a vector beyond them; its first `count` are
        // written.
        unsafe {
            let node = tree.node(at.child);
            let list = ids.add(at.start as usize);
            // If children were prefetched only once they are known to be entered, the first would be waited for.
            tree.prefetch_children(node);
            let faces = Faces::new(&node.faces, octant);
            let planes = PlaneDistances::new(e, [origin.point; 2], origin.slack, &faces, octant);
            for first in (0..len).step_by(BATCH) {
                let mut count = 0;
                for i in first..len.min(first + BATCH) {
                    let packet = &*self.packet(PacketEntry::from_bits(*list.add(i)));
                    let slots = planes.slots_entered(e, &packet.interval);
                    let here = e.add_u32(e.load_u32(SLOTS.as_ptr()), e.splat_u32((i * WIDTH) as u32));
                    e.append(boxes.add(count), slots, here);
                    count += slots.count_ones() as usize;
                }
                for i in 0..count {
                    let packed = *boxes.add(i) as usize;
                    let (i, slot) = (packed / WIDTH, packed % WIDTH);
                    let entry = PacketEntry::from_bits(*list.add(i));
                    let packet = &*self.packet(entry);
                    let mut inside = 0;
                    for part in 0..PACKET_RAYS / W::LANES {
                        let at = part * W::LANES;
                        let (inverse, limit) = (packet.inverse(w, at), packet.limit.get(w, at));
                        inside |= planes.rays_entering(w, entry.lanes::<W>(at), slot, inverse, limit) << at;
                    }
                    *ends[slot] = PacketEntry::new(entry.packet(), inside).bits();
                    ends[slot] = ends[slot].add(usize::from(inside != 0));
                }
            }
            lists.push::<W, false, false>(w, tree, node, stack, &ends);
        }
    }

    /// Tests a list of packets against the triangles of a block: first the edge values, then the rest of the test for
    /// the packets and triangles that some line passes through. Done at once, that would be a mispredicted branch for
    /// each triangle; to compute some edge values twice costs less.
    ///
    /// # Safety
    /// Invariant 8 holds for the list.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn visit_block(&self, block: LeafBlock<'_>, octant: usize, list: &[u32]) {
        let Self { widths: Widths { wide: w, eight: e }, tree, ref origin, .. } = *self;
        let triangles = BlockTriangles::new(e, origin, block);
        let parts = PACKET_RAYS / W::LANES;
        let mut tests = [const { MaybeUninit::<u32>::uninit() }; MAX_PARTS * WIDTH * BATCH + WIDTH];
        let tests: *mut u32 = tests.as_mut_ptr().cast();
        for list in list.chunks(BATCH) {
            let mut count = 0;
            for (i, &bits) in list.iter().enumerate() {
                let entry = PacketEntry::from_bits(bits);
                // SAFETY: invariant 8.
                let packet = unsafe { self.packet(entry) };
                if is_few::<W>(entry.mask(), block.len()) {
                    self.test_rays(packet, entry.mask(), &triangles, block, octant);
                    continue;
                }
                for part in 0..parts {
                    let at = part * W::LANES;
                    let (direction, mut passed) = (packet.direction(w, at), 0);
                    for k in 0..block.len() {
                        let inside = triangles.edge_values(w, k, direction).inside(w, entry.lanes::<W>(at));
                        passed |= u32::from(inside != 0) << k;
                    }
                    // SAFETY: invariant 9.
                    unsafe {
                        let here = e.splat_u32(((i * parts + part) * WIDTH) as u32);
                        let here = e.add_u32(e.load_u32(SLOTS.as_ptr()), here);
                        e.append(tests.add(count), passed, here);
                    }
                    count += passed.count_ones() as usize;
                }
            }
            for i in 0..count {
                // SAFETY: the first `count` tests were written, with indices of the list; invariant 8.
                let (packed, entry, packet) = unsafe {
                    let packed = *tests.add(i) as usize;
                    let entry = PacketEntry::from_bits(*list.get_unchecked(packed / WIDTH / parts));
                    (packed, entry, self.packet(entry))
                };
                let (k, at) = (packed % WIDTH, packed / WIDTH % parts * W::LANES);
                let direction = packet.direction(w, at);
                let edges = triangles.edge_values(w, k, direction);
                let inside = edges.inside(w, entry.lanes::<W>(at));
                let (slabs, t_min) = (origin.slabs(w, packet.inverse(w, at)), packet.t_min.get(w, at));
                let limits = Limits { slabs: &slabs, octant, t_min, limit: packet.limit.get(w, at) };
                let mut hits = triangles.hits(w, k, inside, &edges, direction, &limits);
                packet.reject_hits(w, tree, at, block.id(k), &mut hits);
                packet.record::<W, ANY>(w, at, block.id(k) & PRIMITIVE, &hits);
                packet.interval.limit = packet.max_limit(w);
            }
        }
    }

    /// Tests some rays of a packet, each against all triangles of a block.
    #[inline(always)]
    fn test_rays(
        &self,
        packet: &mut Packet,
        mut rays: LaneBits,
        triangles: &BlockTriangles,
        block: LeafBlock<'_>,
        octant: usize,
    ) {
        let mut taken = false;
        while rays != 0 {
            let lane = rays.trailing_zeros() as usize % PACKET_RAYS;
            rays &= rays - 1;
            taken |= self.test_ray(packet, lane, triangles, block, octant);
        }
        if taken {
            packet.interval.limit = packet.max_limit(self.widths.wide);
        }
    }

    /// Tests one ray of a packet against all triangles of a block. Returns whether a hit was recorded.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn test_ray(
        &self,
        packet: &mut Packet,
        lane: usize,
        triangles: &BlockTriangles,
        block: LeafBlock<'_>,
        octant: usize,
    ) -> bool {
        let Self { widths: Widths { eight: e, .. }, tree, ref origin, .. } = *self;
        let ray = |columns: &[Column; 3]| [columns[0].0[lane], columns[1].0[lane], columns[2].0[lane]];
        let direction = splat(e, ray(&packet.direction));
        let edges = triangles.edge_values_of_ray(e, direction);
        let inside = edges.inside(e, (1 << block.len()) - 1);
        if inside == 0 {
            return false;
        }
        let slabs = origin.slabs(e, splat(e, ray(&packet.inverse)));
        let (t_min, limit) = (e.splat(packet.t_min.0[lane]), e.splat(packet.limit.0[lane]));
        let limits = Limits { slabs: &slabs, octant, t_min, limit };
        let LaneHits { mask: mut left, t, u, v } =
            triangles.hits_of_ray(e, inside, &edges, direction, &limits);
        if left == 0 {
            return false;
        }
        // One by one: as a tuple they would be written twice.
        let t = spill(e, t);
        let u = spill(e, u);
        let v = spill(e, v);
        let mut taken = false;
        while left != 0 && !(ANY && taken) {
            let k = left.trailing_zeros() as usize % WIDTH;
            left &= left - 1;
            let (limit, stored) = (packet.limit.0[lane], block.id(k));
            // Of equal hits the one with the lowest primitive id wins.
            let is_nearest = t[k] < limit || t[k] == limit && stored & PRIMITIVE < packet.primitive[lane];
            if is_nearest
                && (stored & MASKED == 0 || filter_hits(tree, stored & PRIMITIVE, 1 << k, &u, &v) != 0)
            {
                packet.limit.0[lane] = if ANY { DONE } else { t[k] };
                (packet.u.0[lane], packet.v.0[lane]) = (u[k], v[k]);
                packet.primitive[lane] = stored & PRIMITIVE;
                taken = true;
            }
        }
        taken
    }
}

/// True if so few rays of a packet, one bit each, reach a block that each ray is tested against all triangles at once,
/// instead of each triangle against the packet. A test of one ray costs about as much as two of one triangle, because
/// it branches on its result.
#[inline(always)]
fn is_few<L: Lanes>(rays: LaneBits, triangles: usize) -> bool {
    2 * rays.count_ones() as usize <= triangles * (PACKET_RAYS / L::LANES)
}

impl Packet {
    /// Removes hits of rays from `at` on that lose a tie or that the filter rejects.
    #[inline(always)]
    fn reject_hits<L: Lanes>(
        &self,
        l: L,
        tree: &TreeView<'_>,
        at: usize,
        stored: u32,
        hits: &mut LaneHits<L>,
    ) {
        // Of equal hits the one with the lowest primitive id wins.
        let mut equal = l.eq(hits.mask, hits.t, self.limit.get(l, at));
        while equal != 0 {
            let lane = equal.trailing_zeros() as usize % MAX_LANES;
            equal &= equal - 1;
            if self.primitive[at + lane] < stored & PRIMITIVE {
                hits.mask &= !(1 << lane);
            }
        }
        if stored & MASKED != 0 && hits.mask != 0 {
            let (us, vs) = (spill(l, hits.u), spill(l, hits.v));
            hits.mask = filter_hits(tree, stored & PRIMITIVE, hits.mask, &us, &vs);
        }
    }

    /// Records hits of rays from `at` on.
    #[inline(always)]
    fn record<L: Lanes, const ANY: bool>(&mut self, l: L, at: usize, primitive: u32, hits: &LaneHits<L>) {
        let &LaneHits { mask, t, u, v } = hits;
        let limit = if ANY { l.splat(DONE) } else { t };
        self.limit.set(l, at, l.select(mask, limit, self.limit.get(l, at)));
        if !ANY {
            self.u.set(l, at, l.select(mask, u, self.u.get(l, at)));
            self.v.set(l, at, l.select(mask, v, self.v.get(l, at)));
        }
        self.set_primitive(l, at, mask, primitive);
    }
}

/// The lanes of `mask` whose hit the filter accepts.
#[cold]
#[inline(never)]
fn filter_hits(
    tree: &TreeView<'_>,
    primitive: u32,
    mask: LaneBits,
    u: &[f32; MAX_LANES],
    v: &[f32; MAX_LANES],
) -> LaneBits {
    (0..MAX_LANES)
        .filter(|&lane| mask >> lane & 1 == 1 && tree.filter_accepts(primitive, u[lane], v[lane]))
        .fold(0, |accepted, lane| accepted | 1 << lane)
}
