//! The traversal for pinhole cameras and the like: rays of one origin and about one direction stay
//! together as packets of sixteen.
//!
//! What a common origin gives: edge functions are `dot(n, direction)` with `n` the same for all rays,
//! computed once a visit; box planes meet a whole packet in an interval, computed from the packet's
//! extreme reciprocal directions. Lists hold packets with a mask of the rays still in play, rays
//! stay in place as columns, and hits are taken in lanes; where few rays of a packet come to a block, each is tested
//! with all triangles at once instead. Every lane still answers by the canonical
//! operations; intervals and planes moved apart only leave out what they prove to be missed (see [`Interval`]).
//!
//! Unsafe code, because lists, packets and nodes are reached without bounds checks. The invariants of
//! `stream` hold, with entries of lists in the place of ids: every entry in a list names a packet of
//! the sub-stream.
#![allow(unsafe_code, reason = "the invariants above")]

mod form;
mod triangles;

pub(super) use form::{Formed, form, may_form};

use super::interval::{Interval, Planes};
use super::substream::{
    Answers, DONE, Entry, OctantStack, PADDING, SubStream, Visit, begin_of, fetch_children, push,
};
use super::triangle::{Faces, Hits, Range, Slabs, Vector};
use super::visit_order::Order;
use crate::bvh::{LeafBlock, MASKED, PRIMITIVE, WIDTH};
use crate::lanes::{Lanes, spill, splat};
use crate::stream::{Hit, MISS};
use std::mem::MaybeUninit;
use triangles::Triangles;

/// Rays in a packet.
pub(super) const PACKET: usize = 16;

/// Sixteen numbers, one a ray.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Column([f32; PACKET]);

impl Column {
    const ZERO: Self = Self([0.0; PACKET]);

    /// The numbers of the lanes from `at` on.
    #[inline(always)]
    fn get<L: Lanes>(&self, l: L, at: usize) -> L::F {
        debug_assert!(at + L::LANES <= PACKET);
        // SAFETY: as asserted; callers step through the packet by lanes.
        unsafe { l.load(self.0.as_ptr().add(at)) }
    }

    #[inline(always)]
    fn set<L: Lanes>(&mut self, l: L, at: usize, f: L::F) {
        debug_assert!(at + L::LANES <= PACKET);
        // SAFETY: as in `get`.
        unsafe { l.store(self.0.as_mut_ptr().add(at), f) }
    }
}

/// Up to sixteen rays of one octant and their hits so far.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Packet {
    inverse: [Column; 3],
    direction: [Column; 3],
    t_min: Column,
    /// Nearest hit so far, at first `t_max`; negative for lanes that are done or vacant.
    limit: Column,
    u: Column,
    v: Column,
    primitive: [u32; PACKET],
    /// Which rays of the sub-stream they are.
    rays: [u32; PACKET],
    interval: Interval,
}

impl Packet {
    const VACANT: Self = Self {
        inverse: [Column::ZERO; 3],
        direction: [Column::ZERO; 3],
        t_min: Column::ZERO,
        limit: Column([DONE; PACKET]),
        u: Column::ZERO,
        v: Column::ZERO,
        primitive: [MISS; PACKET],
        rays: [0; PACKET],
        interval: Interval { low: [0.0; 3], high: [0.0; 3], limit: DONE },
    };

    #[inline(always)]
    fn highest_limit<L: Lanes>(&self, l: L) -> f32 {
        let mut highest = DONE;
        for part in 0..PACKET / L::LANES {
            highest = highest.max(l.highest(self.limit.get(l, part * L::LANES)));
        }
        highest
    }
}

/// The origin of a sub-stream whose rays all start there, and what follows from it.
#[derive(Clone, Copy)]
pub(super) struct Origin {
    point: [f32; 3],
    slack: f32,
}

/// An entry of a list: a packet and the rays of it that are still in play.
#[inline(always)]
fn entry(packet: usize, mask: u32) -> u32 {
    (packet as u32) << 16 | mask
}

/// Writes the answers of all packets.
#[inline(always)]
pub(super) fn answer(job: &SubStream<'_>, packets: &[Packet]) {
    for packet in packets {
        for lane in (0..PACKET).filter(|&lane| packet.primitive[lane] != MISS) {
            let index = packet.rays[lane] as usize;
            // SAFETY: only rays of the sub-stream hit something, and they have answers.
            unsafe {
                match job.answers {
                    Answers::Hits(hits) => {
                        *hits.add(index) = Hit {
                            t: packet.limit.0[lane],
                            u: packet.u.0[lane],
                            v: packet.v.0[lane],
                            primitive: packet.primitive[lane],
                        };
                    }
                    Answers::Occluded(occluded) => *occluded.add(index) = 1,
                }
            }
        }
    }
}

/// Packets of one origin: lists hold entries as [`entry`] makes them.
pub(super) struct Packets<'a, W, E, const ANY: bool> {
    pub w: W,
    pub e: E,
    pub job: &'a SubStream<'a>,
    pub origin: Origin,
    /// All packets of the sub-stream.
    pub all: *mut Packet,
}

impl<W: Lanes, E: Lanes, const ANY: bool> Visit for Packets<'_, W, E, ANY> {
    #[inline(always)]
    fn visit(&self, octant: usize, stack: &mut OctantStack, at: Entry) {
        if !at.child.is_block() {
            // SAFETY: as the module says.
            let node = unsafe { self.job.nodes.get_unchecked(at.child.index()) };
            return if ANY {
                self.inner(Order::LIKELY_FIRST, octant, stack, at)
            } else {
                self.inner(Order::front_to_back(node, octant), octant, stack, at)
            };
        }
        // SAFETY: as the module says.
        unsafe {
            let block = self.job.blocks.get_unchecked(at.child);
            let list = stack.ids.as_ptr().add(at.start as usize);
            let list = std::slice::from_raw_parts(list, at.len as usize);
            self.leaf(block, octant, list);
        }
    }

    #[inline(always)]
    fn step(&self, octant: usize, stack: &mut OctantStack) -> bool {
        let Some(entry) = stack.entries.pop() else { return false };
        self.visit(octant, stack, entry);
        true
    }
}

impl<W: Lanes, E: Lanes, const ANY: bool> Packets<'_, W, E, ANY> {
    /// Tests a list of packets against the boxes of a node: first each packet's interval with all of them, then the rays
    /// of each with those that are left. Done packet by packet, how many are left would have to be guessed for each.
    #[inline(always)]
    fn inner(&self, order: Order, octant: usize, stack: &mut OctantStack, at: Entry) {
        let Self { w, e, job, ref origin, all } = *self;
        let (len, stride) = (at.len as usize, at.len as usize + PADDING);
        let base = at.start as usize + stride;
        stack.reserve(base + WIDTH * stride + PADDING);
        // SAFETY: as the module says.
        unsafe {
            let node = job.nodes.get_unchecked(at.child.index());
            let ids = stack.ids.as_mut_ptr();
            let list = ids.add(at.start as usize);
            // Asked for when it is known who is entered, the first would be waited for.
            fetch_children(job, node);
            let faces = Faces::of(&node.faces, octant);
            let planes = Planes::new(e, [origin.point; 2], origin.slack, &faces, octant);
            let mut ends: [*mut u32; WIDTH] =
                std::array::from_fn(|slot| ids.add(begin_of(base, stride, order, slot)));
            let mut visits = [const { MaybeUninit::<u32>::uninit() }; WIDTH * AT_ONCE + WIDTH];
            let visits: *mut u32 = visits.as_mut_ptr().cast();
            for first in (0..len).step_by(AT_ONCE) {
                let mut count = 0;
                for i in first..len.min(first + AT_ONCE) {
                    let packet = &*all.add((*list.add(i) >> 16) as usize);
                    let children = planes.entered(e, &packet.interval);
                    let here = e.add_u32(e.load_u32(SLOTS.as_ptr()), e.splat_u32((i * WIDTH) as u32));
                    e.append(visits.add(count), children, here);
                    count += children.count_ones() as usize;
                }
                for i in 0..count {
                    let visit = *visits.add(i) as usize;
                    let (some, slot) = (*list.add(visit / WIDTH), visit % WIDTH);
                    let packet = &*all.add((some >> 16) as usize);
                    let mut inside = 0;
                    for part in 0..PACKET / W::LANES {
                        let at = part * W::LANES;
                        let (inverse, limit) = (packet.inverse(w, at), packet.limit.get(w, at));
                        inside |= planes.enters(w, some >> at & W::ALL, slot, inverse, limit) << at;
                    }
                    *ends[slot] = entry((some >> 16) as usize, inside);
                    ends[slot] = ends[slot].add(usize::from(inside != 0));
                }
            }
            push::<W, false, false>(w, job, node, order, stack, base, stride, &ends);
        }
    }

    /// Tests a list of packets with the triangles of a block: first where rays pass the triangles, then the rest for packets and
    /// triangles that some pass inside. Done at once, it would have to be guessed for each which they are; to make a few
    /// sums again costs less.
    #[inline(always)]
    fn leaf(&self, block: LeafBlock<'_>, octant: usize, list: &[u32]) {
        let Self { w, e, job, ref origin, all } = *self;
        let triangles = Triangles::new(e, origin, block);
        let parts = PACKET / W::LANES;
        let mut tests = [const { MaybeUninit::<u32>::uninit() }; PARTS * WIDTH * AT_ONCE + WIDTH];
        let tests: *mut u32 = tests.as_mut_ptr().cast();
        for list in list.chunks(AT_ONCE) {
            let mut count = 0;
            for (i, &some) in list.iter().enumerate() {
                // SAFETY: entries name packets of the sub-stream.
                let packet = unsafe { &mut *all.add((some >> 16) as usize) };
                if is_few::<W>(some & 0xffff, block.len()) {
                    self.each(packet, some & 0xffff, &triangles, block, octant);
                    continue;
                }
                for part in 0..parts {
                    let at = part * W::LANES;
                    let (direction, mut passed) = (packet.direction(w, at), 0);
                    for k in 0..block.len() {
                        let inside = triangles.passing(w, k, direction).inside(w, some >> at & W::ALL);
                        passed |= u32::from(inside != 0) << k;
                    }
                    // SAFETY: there is room for all parts of so many packets with all triangles.
                    unsafe {
                        let here = e.splat_u32(((i * parts + part) * WIDTH) as u32);
                        let here = e.add_u32(e.load_u32(SLOTS.as_ptr()), here);
                        e.append(tests.add(count), passed, here);
                    }
                    count += passed.count_ones() as usize;
                }
            }
            for i in 0..count {
                // SAFETY: they were written, and entries name packets of the sub-stream.
                let (test, some, packet) = unsafe {
                    let test = *tests.add(i) as usize;
                    let some = *list.get_unchecked(test / WIDTH / parts);
                    (test, some, &mut *all.add((some >> 16) as usize))
                };
                let (k, at) = (test % WIDTH, test / WIDTH % parts * W::LANES);
                let direction = packet.direction(w, at);
                let passing = triangles.passing(w, k, direction);
                let inside = passing.inside(w, some >> at & W::ALL);
                let (slabs, t_min) = (packet.slabs(w, at, origin), packet.t_min.get(w, at));
                let range = Range { slabs: &slabs, octant, t_min, limit: packet.limit.get(w, at) };
                let mut hits = triangles.hits(w, k, inside, &passing, direction, &range);
                packet.settle(w, job, at, block.id(k), &mut hits);
                packet.take::<W, ANY>(w, at, block.id(k) & PRIMITIVE, &hits);
                packet.interval.limit = packet.highest_limit(w);
            }
        }
    }

    /// Tests some rays of a packet, each with all triangles of a block.
    #[inline(always)]
    fn each(
        &self,
        packet: &mut Packet,
        mut rays: u32,
        triangles: &Triangles,
        block: LeafBlock<'_>,
        octant: usize,
    ) {
        let mut taken = false;
        while rays != 0 {
            let lane = rays.trailing_zeros() as usize & 15;
            rays &= rays - 1;
            taken |= self.one(packet, lane, triangles, block, octant);
        }
        if taken {
            packet.interval.limit = packet.highest_limit(self.w);
        }
    }

    /// Tests one ray of a packet with all triangles of a block; whether it hits.
    #[inline(always)]
    fn one(
        &self,
        packet: &mut Packet,
        lane: usize,
        triangles: &Triangles,
        block: LeafBlock<'_>,
        octant: usize,
    ) -> bool {
        let Self { e, job, ref origin, .. } = *self;
        let ray = |columns: &[Column; 3]| [columns[0].0[lane], columns[1].0[lane], columns[2].0[lane]];
        let direction = splat(e, ray(&packet.direction));
        let passing = triangles.passed(e, direction);
        let inside = passing.inside(e, (1 << block.len()) - 1);
        if inside == 0 {
            return false;
        }
        let slabs = origin.slabs(e, splat(e, ray(&packet.inverse)));
        let (t_min, limit) = (e.splat(packet.t_min.0[lane]), e.splat(packet.limit.0[lane]));
        let range = Range { slabs: &slabs, octant, t_min, limit };
        let Hits { mask: mut left, t, u, v } = triangles.hit(e, inside, &passing, direction, &range);
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
            // Among equals the lowest primitive wins.
            let is_nearest = t[k] < limit || t[k] == limit && stored & PRIMITIVE < packet.primitive[lane];
            if is_nearest && (stored & MASKED == 0 || filtered(job, stored & PRIMITIVE, 1 << k, &u, &v) != 0)
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

/// Packets that are tested coarsely before any is tested further.
const AT_ONCE: usize = 32;

/// The most registers that the rays of a packet take.
const PARTS: usize = PACKET / WIDTH;

/// The slots of a node or the triangles of a block, in lanes.
static SLOTS: [u32; WIDTH] = [0, 1, 2, 3, 4, 5, 6, 7];

/// Whether rays of a packet, a bit each, are so few that each is better tested with all triangles of a block at once than each
/// triangle with the whole packet. A test of a ray costs about two of a triangle: whether there is more to do is decided anew.
#[inline(always)]
fn is_few<L: Lanes>(rays: u32, triangles: usize) -> bool {
    2 * rays.count_ones() as usize <= triangles * (PACKET / L::LANES)
}

impl Origin {
    /// The slab test's constants, made anew from the reciprocal: that is faster than to read them.
    #[inline(always)]
    fn slabs<L: Lanes>(&self, l: L, inverse: Vector<L>) -> Slabs<L> {
        let [x, y, z] = self.point;
        let shift =
            [l.mul(l.splat(-x), inverse[0]), l.mul(l.splat(-y), inverse[1]), l.mul(l.splat(-z), inverse[2])];
        Slabs::new(l, inverse, shift, l.splat(self.slack))
    }
}

impl Packet {
    #[inline(always)]
    fn direction<L: Lanes>(&self, l: L, at: usize) -> Vector<L> {
        [self.direction[0].get(l, at), self.direction[1].get(l, at), self.direction[2].get(l, at)]
    }

    #[inline(always)]
    fn inverse<L: Lanes>(&self, l: L, at: usize) -> Vector<L> {
        [self.inverse[0].get(l, at), self.inverse[1].get(l, at), self.inverse[2].get(l, at)]
    }

    /// The slab test's constants of lanes.
    #[inline(always)]
    fn slabs<L: Lanes>(&self, l: L, at: usize, origin: &Origin) -> Slabs<L> {
        origin.slabs(l, self.inverse(l, at))
    }

    /// Strikes out hits that lose a tie or that the filter refuses.
    #[inline(always)]
    fn settle<L: Lanes>(&self, l: L, job: &SubStream<'_>, at: usize, stored: u32, hits: &mut Hits<L>) {
        // Among equals the lowest primitive wins.
        let mut equal = l.eq(hits.mask, hits.t, self.limit.get(l, at));
        while equal != 0 {
            let lane = equal.trailing_zeros() as usize & 15;
            equal &= equal - 1;
            if self.primitive[at + lane] < stored & PRIMITIVE {
                hits.mask &= !(1 << lane);
            }
        }
        if stored & MASKED != 0 && hits.mask != 0 {
            let (us, vs) = (spill(l, hits.u), spill(l, hits.v));
            hits.mask = filtered(job, stored & PRIMITIVE, hits.mask, &us, &vs);
        }
    }

    /// Writes hits.
    #[inline(always)]
    fn take<L: Lanes, const ANY: bool>(&mut self, l: L, at: usize, primitive: u32, hits: &Hits<L>) {
        let &Hits { mask, t, u, v } = hits;
        let limit = if ANY { l.splat(DONE) } else { t };
        self.limit.set(l, at, l.select(mask, limit, self.limit.get(l, at)));
        if !ANY {
            self.u.set(l, at, l.select(mask, u, self.u.get(l, at)));
            self.v.set(l, at, l.select(mask, v, self.v.get(l, at)));
        }
        debug_assert!(at + L::LANES <= PACKET);
        // SAFETY: as asserted; callers step through the packet by lanes.
        unsafe {
            let to = self.primitive.as_mut_ptr().add(at);
            l.store_u32(to, l.select_u32(mask, l.splat_u32(primitive), l.load_u32(to)));
        }
    }
}

/// The lanes of `hit` that the filter accepts.
#[cold]
#[inline(never)]
fn filtered(job: &SubStream<'_>, primitive: u32, hit: u32, u: &[f32; PACKET], v: &[f32; PACKET]) -> u32 {
    let Some(filter) = job.filter else { return hit };
    (0..PACKET)
        .filter(|&lane| hit >> lane & 1 == 1 && filter.accepts(primitive, u[lane], v[lane]))
        .fold(0, |mask, lane| mask | 1 << lane)
}
