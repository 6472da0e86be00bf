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

use super::setup;
use super::stream::{
    Answers, DONE, Entry, FrontToBack, Job, LikelyFirst, OctantStack, Order, PADDING, Visit, begin_of,
    fetch_children, lanes_of, push,
};
use super::triangle::{Bounds, Faces, Hits, Passing, Range, Seen, Slabs, Vector, dot, hits};
use crate::bvh::{Block, MASKED, PRIMITIVE, WIDTH};
use crate::lanes::{Lanes, load_one, prefetch, spill, splat, splat_row};
use crate::stream::{Hit, MISS, Ray};

/// Rays in a packet.
pub(super) const PACKET: usize = 16;

/// Packets whose directions differ by more than this, relative to their size and on the mean, are
/// better off as loose rays.
const COHERENT: f32 = 0.1;

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

    /// Makes it one of these lanes only; how much their directions differ, relative to their size.
    #[inline(always)]
    fn close<L: Lanes>(&mut self, l: L, members: u32) -> f32 {
        let (mut low, mut high) = ([f32::INFINITY; 3], [0.0f32; 3]);
        for part in 0..PACKET / L::LANES {
            let at = part * L::LANES;
            let among = members >> at & ((1 << L::LANES) - 1);
            self.limit.set(l, at, l.select(among, self.limit.get(l, at), l.splat(DONE)));
            for axis in 0..3 {
                let size = l.abs(self.inverse[axis].get(l, at));
                low[axis] = low[axis].min(l.lowest(l.select(among, size, l.splat(f32::INFINITY))));
                high[axis] = high[axis].max(l.highest(l.select(among, size, l.splat(0.0))));
            }
        }
        self.interval = Interval { low, high, limit: self.highest_limit(l) };
        let (mut widest, mut longest) = (0.0f32, 0.0f32);
        for axis in 0..3 {
            let (least, most) = (1.0 / high[axis], 1.0 / low[axis]);
            widest = widest.max(most - least);
            longest = longest.max(most);
        }
        widest / longest
    }

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

/// Packets of a sub-stream.
pub(super) struct Formed {
    pub origin: Origin,
    /// How many there are.
    pub len: usize,
    /// How many are in the list of each octant, at the bottom of its arena.
    pub counts: [usize; 8],
}

/// Whether rays seem to start at one point.
pub(super) fn may_form(rays: &[Ray]) -> bool {
    let is_like = |at: usize| rays[at].origin == rays[0].origin;
    !rays.is_empty() && is_like(rays.len() / 2) && is_like(rays.len() - 1)
}

/// Makes packets of a sub-stream, of rays that follow each other or are neighbours in a picture, and lists of
/// them. None if some start elsewhere or their directions differ much; the arenas are then of no meaning.
#[inline(always)]
pub(super) fn form<W: Lanes>(
    w: W,
    job: &Job<'_>,
    rays: &[Ray],
    stacks: &mut [OctantStack; 8],
    packets: &mut Vec<Packet>,
) -> Option<Formed> {
    for stack in stacks.iter_mut() {
        stack.reserve(rays.len().div_ceil(PACKET) + PADDING);
    }
    let point = rays.first()?.origin;
    let mut formed = Formed { origin: Origin { point, slack: 0.0 }, len: 0, counts: [0; 8] };
    let mut spread = 0.0;
    for (i, group) in rays.chunks(GROUP).enumerate() {
        let order = if lie_in_rows(group) { &SQUARES } else { &STRIPS };
        for (k, ids) in order[..group.len().div_ceil(PACKET)].iter().enumerate() {
            // As many of the next group's rays: in squares they come in no order that a processor would guess.
            fetch_packet(job.rays.wrapping_add((i + 1) * GROUP + k * PACKET));
            // Those of an earlier sub-stream are written over. There is one for each octant at most.
            if packets.len() < formed.len + 8 {
                packets.resize(2 * packets.len() + 8, Packet::VACANT);
            }
            let packet = &mut packets[formed.len];
            packet.rays = ids.map(|ray| (i * GROUP) as u32 + ray.min(group.len() as u32 - 1));
            packet.primitive = [MISS; PACKET];
            let count = group.len() - ids[0] as usize;
            let places = packet.rays.map(|ray| ray * size_of::<Ray>() as u32);
            let (mut valid, mut signs) = (0, [0; 3]);
            for part in 0..PACKET / W::LANES {
                let at = part * W::LANES;
                // SAFETY: these are rays of the sub-stream.
                let ray = unsafe { w.rows(job.rays.cast(), places.as_ptr().add(at)) };
                let among = lanes_of::<W>(count.saturating_sub(at));
                let (row, may_hit, negative) = setup::rows(w, job.scene_max_abs, among, ray);
                let mut at_origin = may_hit;
                for axis in 0..3 {
                    at_origin = w.eq(at_origin, ray[axis], w.splat(point[axis]));
                    signs[axis] |= negative[axis] << at;
                    packet.inverse[axis].set(w, at, row[axis]);
                    packet.direction[axis].set(w, at, ray[4 + axis]);
                }
                if may_hit != at_origin {
                    return None;
                }
                packet.t_min.set(w, at, w.max(ray[3], w.splat(0.0)));
                packet.limit.set(w, at, row[7]);
                valid |= may_hit << at;
                if may_hit != 0 {
                    formed.origin.slack = spill(w, row[6])[may_hit.trailing_zeros() as usize % PACKET];
                }
            }
            while valid != 0 {
                let lane = valid.trailing_zeros();
                let (mut members, mut octant) = (valid, 0);
                for (axis, negative) in signs.into_iter().enumerate() {
                    let is_negative = negative >> lane & 1;
                    members &= if is_negative == 1 { negative } else { !negative };
                    octant |= (is_negative as usize) << axis;
                }
                valid &= !members;
                if valid != 0 {
                    packets[formed.len + 1] = packets[formed.len];
                }
                spread += packets[formed.len].close(w, members);
                stacks[octant].ids[formed.counts[octant]] = entry(formed.len, members);
                formed.counts[octant] += 1;
                formed.len += 1;
            }
        }
        // Whether it is worth while is told by the first ones already.
        if i % 4 == 1 && spread > COHERENT * formed.len as f32 {
            return None;
        }
    }
    (spread <= COHERENT * formed.len as f32).then_some(formed)
}

/// Asks for the rays of a packet, which follow each other.
#[inline(always)]
fn fetch_packet(rays: *const Ray) {
    for ray in (0..PACKET).step_by(64 / size_of::<Ray>()) {
        prefetch(rays.wrapping_add(ray));
    }
}

/// Rays that are made packets together.
const GROUP: usize = PACKET * PACKET;

/// Rays of packets that are made of those which follow each other.
const STRIPS: [[u32; PACKET]; PACKET] = {
    let mut strips = [[0; PACKET]; PACKET];
    let mut ray = 0;
    while ray < GROUP {
        strips[ray / PACKET][ray % PACKET] = ray as u32;
        ray += 1;
    }
    strips
};

/// Rays of packets that are made of four neighbours each of four rows of sixteen.
const SQUARES: [[u32; PACKET]; PACKET] = {
    let mut squares = [[0; PACKET]; PACKET];
    let mut ray = 0;
    while ray < GROUP {
        let (x, y) = (ray % PACKET, ray / PACKET);
        squares[y / 4 * 4 + x / 4][y % 4 * 4 + x % 4] = ray as u32;
        ray += 1;
    }
    squares
};

/// Whether rays seem to lie in rows of sixteen, as those of a picture's blocks do when there is one a pixel: then the first
/// of the next row is nearer than the last of the same. It decides about speed alone.
fn lie_in_rows(group: &[Ray]) -> bool {
    let apart = |a: usize, b: usize| {
        let along = |axis: usize| (group[a].direction[axis] - group[b].direction[axis]).abs();
        along(0) + along(1) + along(2)
    };
    group.len() == GROUP
        && [0, 8 * PACKET].iter().all(|&row| apart(row, row + PACKET) < apart(row, row + PACKET - 1))
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

/// The eight triangles of a block as seen from the origin, as columns.
#[repr(C, align(64))]
struct Triangles {
    edges: [[[f32; WIDTH]; 3]; 3],
    normal: [[f32; WIDTH]; 3],
    distance: [f32; WIDTH],
    low: [[f32; WIDTH]; 3],
    high: [[f32; WIDTH]; 3],
}

impl Triangles {
    #[inline(always)]
    fn new<E: Lanes>(e: E, origin: &Origin, block: Block<'_>) -> Self {
        let corners = block.vertices(e);
        let Seen { edges, normal, distance } = Seen::from(e, &splat(e, origin.point), &corners);
        let Bounds { low, high } = Bounds::of(e, &corners);
        Self {
            edges: [keep(e, edges[0]), keep(e, edges[1]), keep(e, edges[2])],
            normal: keep(e, normal),
            distance: keep(e, [distance; 3])[0],
            low: keep(e, low),
            high: keep(e, high),
        }
    }

    #[inline(always)]
    fn passing<L: Lanes>(&self, l: L, k: usize, direction: Vector<L>) -> Passing<L> {
        let [u, v, w] = &self.edges;
        Passing::new(l, &[splat_row(l, u, k), splat_row(l, v, k), splat_row(l, w, k)], direction)
    }

    #[inline(always)]
    fn hits<L: Lanes>(
        &self,
        l: L,
        k: usize,
        inside: u32,
        passing: &Passing<L>,
        direction: Vector<L>,
        range: &Range<'_, L>,
    ) -> Hits<L> {
        let facing = dot(l, splat_row(l, &self.normal, k), direction);
        let bounds = Bounds::<L> { low: splat_row(l, &self.low, k), high: splat_row(l, &self.high, k) };
        hits(l, inside, passing, [l.splat(self.distance[k]), facing], bounds.faces(range.octant), range)
    }

    /// Where the line of one ray passes all triangles.
    #[inline(always)]
    fn passed<E: Lanes>(&self, e: E, direction: Vector<E>) -> Passing<E> {
        let [u, v, w] = &self.edges;
        Passing::new(e, &[kept(e, u), kept(e, v), kept(e, w)], direction)
    }

    /// Where one ray hits those that its line passes `inside`.
    #[inline(always)]
    fn hit<E: Lanes>(
        &self,
        e: E,
        inside: u32,
        passing: &Passing<E>,
        direction: Vector<E>,
        range: &Range<'_, E>,
    ) -> Hits<E> {
        let facing = dot(e, kept(e, &self.normal), direction);
        let bounds = Bounds::<E> { low: kept(e, &self.low), high: kept(e, &self.high) };
        let distance = load_one(e, &self.distance);
        hits(e, inside, passing, [distance, facing], bounds.faces(range.octant), range)
    }
}

/// What [`keep`] has kept.
#[inline(always)]
fn kept<E: Lanes>(e: E, [x, y, z]: &[[f32; WIDTH]; 3]) -> Vector<E> {
    [load_one(e, x), load_one(e, y), load_one(e, z)]
}

/// Three columns out of eight lanes.
#[inline(always)]
pub(super) fn keep<E: Lanes>(e: E, [x, y, z]: Vector<E>) -> [[f32; WIDTH]; 3] {
    const { assert!(E::LANES == WIDTH) };
    let mut columns = [[0.0; WIDTH]; 3];
    // SAFETY: each column has eight numbers, as many as there are lanes.
    unsafe {
        e.store(columns[0].as_mut_ptr(), x);
        e.store(columns[1].as_mut_ptr(), y);
        e.store(columns[2].as_mut_ptr(), z);
    }
    columns
}
