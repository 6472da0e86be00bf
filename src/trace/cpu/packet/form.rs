//! Rays of a stream → packets.
//!
//! Unsafe code for reading rays in lanes. The invariants of `substream` hold.
#![allow(unsafe_code, reason = "the invariants above")]

use super::super::interval::Interval;
use super::super::setup;
use super::super::substream::{DONE, OctantStack, PADDING, SubStream, lanes_of};
use super::{Origin, PACKET, Packet, entry};
use crate::lanes::{Lanes, Prefetch, spill};
use crate::stream::{MISS, Ray};

/// Packets whose directions differ by more than this, relative to their size and on the mean, are
/// better off as loose rays.
const COHERENT: f32 = 0.1;

/// Packets of a sub-stream.
pub struct Formed {
    pub origin: Origin,
    /// How many there are.
    pub len: usize,
    /// How many are in the list of each octant, at the bottom of its arena.
    pub counts: [usize; 8],
}

/// Whether rays seem to start at one point.
pub fn may_form(rays: &[Ray]) -> bool {
    let is_like = |at: usize| rays[at].origin == rays[0].origin;
    !rays.is_empty() && is_like(rays.len() / 2) && is_like(rays.len() - 1)
}

/// Makes packets of a sub-stream, of rays that follow each other or are neighbours in a picture, and lists of
/// them. None if some start elsewhere or their directions differ much; the arenas are then of no meaning.
#[inline(always)]
pub fn form<W: Lanes>(
    w: W,
    job: &SubStream<'_>,
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
                spread += packets[formed.len].close(w, members, octant);
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
    const EACH: usize = 64 / size_of::<Ray>();
    Prefetch::First.each::<_, { PACKET / EACH }>(std::array::from_fn(|line| rays.wrapping_add(EACH * line)));
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

impl Packet {
    /// Makes it one of these lanes only, which are of an octant; how much their directions differ, relative to their size.
    #[inline(always)]
    fn close<L: Lanes>(&mut self, l: L, members: u32, octant: usize) -> f32 {
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
        let (mut widest, mut longest) = (0.0f32, 0.0f32);
        for axis in 0..3 {
            let (least, most) = (1.0 / high[axis], 1.0 / low[axis]);
            widest = widest.max(most - least);
            longest = longest.max(most);
            let sign = 1.0 - 2.0 * (octant >> axis & 1) as f32;
            (low[axis], high[axis]) = (sign * low[axis], sign * high[axis]);
        }
        self.interval = Interval { low, high, limit: self.highest_limit(l) };
        widest / longest
    }
}
