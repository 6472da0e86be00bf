//! The traversal for pinhole cameras and the like: rays of one origin and about one direction stay
//! together as packets of sixteen.
//!
//! What a common origin gives: edge functions are `dot(n, direction)` with `n` the same for all rays,
//! computed once a visit; box planes meet a whole packet in an interval, computed from the packet's
//! extreme reciprocal directions. Lists hold packets with a mask of the rays still in play, rays
//! stay in place as columns, and hits are taken in lanes; where few rays of a packet come to a block, each is tested
//! with all triangles at once instead. Every lane still answers by the canonical
//! operations; intervals only leave out what they prove to be missed (see [`Interval`]).
//!
//! Unsafe code, because lists, packets and nodes are reached without bounds checks. The invariants of
//! `stream` hold, with entries of lists in the place of ids: every entry in a list names a packet of
//! the sub-stream.
#![allow(unsafe_code)]

mod form;
mod triangles;

pub(super) use form::{Formed, form, may_form};
pub(super) use triangles::keep;

use super::stream::{
    Answers, DONE, Entry, FrontToBack, Job, LikelyFirst, OctantStack, Order, PADDING, Visit, begin_of,
    fetch_children, push,
};
use super::triangle::{Faces, Hits, Range, Slabs, Vector};
use crate::bvh::{Block, MASKED, PRIMITIVE, WIDTH};
use crate::lanes::{Lanes, spill, splat};
use crate::stream::{Hit, MISS};
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

/// What all rays of a packet have in common.
///
/// With the axes mirrored so that all directions are positive, a ray enters a plane at distance `x`
/// from the origin at `x * i - slack * i` and leaves it at `x * i + slack * i`, where `i` is its
/// `|inverse|`, both up to rounding. All errors of these and of the interval's own products sum to
/// less than 10 half ulps of the largest coordinate `m` times `i`, that is `2⁻²⁰ m i`, and `slack` is
/// `2⁻¹⁹ m`. So twice the slack makes `(x - 2 slack) * low` a lower bound of all entries that are not
/// negative, and `(x + 2 slack) * high` an upper bound of all leavings that are not negative.
#[derive(Clone, Copy)]
struct Interval {
    /// Least `|inverse|`.
    low: [f32; 3],
    /// Greatest `|inverse|`.
    high: [f32; 3],
    /// Greatest `limit`.
    limit: f32,
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
pub(super) fn answer(job: &Job<'_>, packets: &[Packet]) {
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
    pub job: &'a Job<'a>,
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
                self.inner(LikelyFirst(node), octant, stack, at)
            } else {
                self.inner(FrontToBack(octant), octant, stack, at)
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
    /// Tests a list of packets against the boxes of a node.
    #[inline(always)]
    fn inner<O: Order>(&self, order: O, octant: usize, stack: &mut OctantStack, at: Entry) {
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
            let planes = Planes::new(e, origin, &faces, octant);
            let mut ends: [*mut u32; WIDTH] =
                std::array::from_fn(|slot| ids.add(begin_of(base, stride, order, slot)));
            for i in 0..len {
                let some = *list.add(i);
                let packet = &*all.add((some >> 16) as usize);
                let mut children = planes.entered(e, &packet.interval);
                if W::LANES == PACKET {
                    let (slabs, limit) = (packet.slabs(w, 0, origin), packet.limit.get(w, 0));
                    while children != 0 {
                        let slot = children.trailing_zeros() as usize & 7;
                        children &= children - 1;
                        let inside = slabs.enters(w, some & 0xffff, &faces, slot, limit);
                        *ends[slot] = entry((some >> 16) as usize, inside);
                        ends[slot] = ends[slot].add(usize::from(inside != 0));
                    }
                } else {
                    let low = (packet.slabs(w, 0, origin), packet.limit.get(w, 0));
                    let high = (packet.slabs(w, 8, origin), packet.limit.get(w, 8));
                    while children != 0 {
                        let slot = children.trailing_zeros() as usize & 7;
                        children &= children - 1;
                        let inside = low.0.enters(w, some & 0xff, &faces, slot, low.1)
                            | high.0.enters(w, some >> 8 & 0xff, &faces, slot, high.1) << 8;
                        *ends[slot] = entry((some >> 16) as usize, inside);
                        ends[slot] = ends[slot].add(usize::from(inside != 0));
                    }
                }
            }
            push::<W, O, false, false>(w, job, node, order, stack, base, stride, &ends);
        }
    }

    /// Tests a list of packets with the triangles of a block.
    #[inline(always)]
    fn leaf(&self, block: Block<'_>, octant: usize, list: &[u32]) {
        let Self { w, e, job, ref origin, all } = *self;
        let triangles = Triangles::new(e, origin, block);
        for &some in list {
            // SAFETY: entries name packets of the sub-stream.
            let packet = unsafe { &mut *all.add((some >> 16) as usize) };
            let (mut rays, mut taken) = (some & 0xffff, 0);
            if is_few::<W>(rays, block.len()) {
                while rays != 0 {
                    let lane = rays.trailing_zeros() as usize & 15;
                    rays &= rays - 1;
                    taken |= u32::from(self.one(packet, lane, &triangles, block, octant));
                }
            }
            for part in 0..PACKET / W::LANES {
                let at = part * W::LANES;
                let mut among = rays >> at & ((1 << W::LANES) - 1);
                if among == 0 {
                    continue;
                }
                let direction = packet.direction(w, at);
                for k in 0..block.len() {
                    let passing = triangles.passing(w, k, direction);
                    let inside = passing.inside(w, among);
                    if inside == 0 {
                        continue;
                    }
                    let slabs = packet.slabs(w, at, origin);
                    let limit = packet.limit.get(w, at);
                    let range = Range { slabs: &slabs, octant, t_min: packet.t_min.get(w, at), limit };
                    let mut hits = triangles.hits(w, k, inside, &passing, direction, &range);
                    packet.settle(w, job, at, block.id(k), &mut hits);
                    if hits.mask == 0 {
                        continue;
                    }
                    taken |= hits.mask;
                    packet.take::<W, ANY>(w, at, block.id(k) & PRIMITIVE, &hits);
                    if ANY {
                        among &= !hits.mask;
                    }
                }
            }
            if taken != 0 {
                packet.interval.limit = packet.highest_limit(w);
            }
        }
    }

    /// Tests one ray of a packet with all triangles of a block; whether it hits.
    #[inline(always)]
    fn one(
        &self,
        packet: &mut Packet,
        lane: usize,
        triangles: &Triangles,
        block: Block<'_>,
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
        let (t, u, v) = (spill(e, t), spill(e, u), spill(e, v));
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

    /// The slab test's constants of lanes.
    #[inline(always)]
    fn slabs<L: Lanes>(&self, l: L, at: usize, origin: &Origin) -> Slabs<L> {
        origin.slabs(l, [self.inverse[0].get(l, at), self.inverse[1].get(l, at), self.inverse[2].get(l, at)])
    }

    /// Strikes out hits that lose a tie or that the filter refuses.
    #[inline(always)]
    fn settle<L: Lanes>(&self, l: L, job: &Job<'_>, at: usize, stored: u32, hits: &mut Hits<L>) {
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
            l.store_ids(to, l.select_ids(mask, l.splat_id(primitive), l.load_ids(to)));
        }
    }
}

/// The lanes of `hit` that the filter accepts.
#[cold]
#[inline(never)]
fn filtered(job: &Job<'_>, primitive: u32, hit: u32, u: &[f32; PACKET], v: &[f32; PACKET]) -> u32 {
    let Some(filter) = job.filter else { return hit };
    (0..PACKET)
        .filter(|&lane| hit >> lane & 1 == 1 && filter.accepts(primitive, u[lane], v[lane]))
        .fold(0, |mask, lane| mask | 1 << lane)
}

/// Distances of a node's planes from the origin along the mirrored axes, widened: see [`Interval`].
struct Planes<E: Lanes> {
    near: Vector<E>,
    far: Vector<E>,
}

impl<E: Lanes> Planes<E> {
    #[inline(always)]
    fn new(e: E, origin: &Origin, faces: &Faces<'_>, octant: usize) -> Self {
        const { assert!(E::LANES == WIDTH) };
        let [x, y, z] = origin.point;
        let slack = 2.0 * origin.slack;
        let plane = |face: &[f32; WIDTH], axis: usize, point: f32, slack: f32| {
            // SAFETY: there are eight numbers, as many as lanes.
            let (face, sign) = unsafe { (e.load(face.as_ptr()), 1.0 - 2.0 * (octant >> axis & 1) as f32) };
            // A sign of one makes the product exact: this is `±(face - point) + slack`.
            e.fma(e.sub(face, e.splat(point)), e.splat(sign), e.splat(slack))
        };
        Self {
            near: [
                plane(faces.near[0], 0, x, -slack),
                plane(faces.near[1], 1, y, -slack),
                plane(faces.near[2], 2, z, -slack),
            ],
            far: [
                plane(faces.far[0], 0, x, slack),
                plane(faces.far[1], 1, y, slack),
                plane(faces.far[2], 2, z, slack),
            ],
        }
    }

    /// The slots whose box some ray of the interval may enter.
    #[inline(always)]
    fn entered(&self, e: E, interval: &Interval) -> u32 {
        let Interval { low, high, limit } = *interval;
        let x = e.mul(self.near[0], e.splat(low[0]));
        let y = e.mul(self.near[1], e.splat(low[1]));
        let z = e.mul(self.near[2], e.splat(low[2]));
        let enter = e.max(e.max(x, y), e.max(z, e.splat(0.0)));
        let x = e.mul(self.far[0], e.splat(high[0]));
        let y = e.mul(self.far[1], e.splat(high[1]));
        let z = e.mul(self.far[2], e.splat(high[2]));
        let leave = e.min(e.min(x, y), e.min(z, e.splat(limit)));
        e.le(0xff, enter, leave)
    }
}
