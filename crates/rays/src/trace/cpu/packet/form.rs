//! Forming packets of a sub-stream's rays.
//!
//! Unsafe code for reading rays in lanes. Invariant 1: the indices in [`Packet::rays`] are of rays of the sub-stream.
#![allow(unsafe_code, reason = "the invariants above")]

use super::super::interval::Interval;
use super::super::setup::{RowColumns, row_columns};
use super::super::substream::{DONE, OctantStack};
use super::columns::{Origin, PACKET_RAYS, Packet, PacketEntry};
use crate::lanes::{LaneBits, Lanes, MAX_LANES, Prefetch, first_lanes, from_index, spill};
use crate::stream::{MISS, Ray};

/// Rays whose directions differ by more than this within packets, on average and relative to their size, are traced
/// faster one by one.
const MAX_SPREAD: f32 = 0.1;

/// Rays that are made packets together: sixteen packets.
const GROUP: usize = PACKET_RAYS * PACKET_RAYS;

/// The packets of a sub-stream.
pub struct PacketSet {
    pub origin: Origin,
    /// Number of packets.
    pub len: usize,
    /// Number of packets in the list of each octant, at the bottom of its arena.
    pub counts: [usize; 8],
}

/// True if rays seem to have one origin.
pub fn may_form(rays: &[Ray]) -> bool {
    let same_origin = |at: usize| rays[at].origin == rays[0].origin;
    !rays.is_empty() && same_origin(rays.len() / 2) && same_origin(rays.len() - 1)
}

/// Makes packets of rays that follow each other, or that are neighbours in a picture, and a list of packets per octant.
/// `None` if some rays start elsewhere or their directions differ much; the arenas then hold no lists.
#[cfg_attr(not(unoptimised), inline(always))]
pub fn form<W: Lanes>(
    w: W,
    scene_max_abs: f32,
    rays: &[Ray],
    stacks: &mut [OctantStack; 8],
    packets: &mut Vec<Packet>,
) -> Option<PacketSet> {
    for stack in stacks.iter_mut() {
        stack.reserve(rays.len().div_ceil(PACKET_RAYS) + MAX_LANES);
    }
    let point = rays.first()?.origin;
    let mut set = PacketSet { origin: Origin { point, slack: 0.0 }, len: 0, counts: [0; 8] };
    let mut spread = 0.0;
    for (i, group) in rays.chunks(GROUP).enumerate() {
        let order = if lies_in_rows(group) { &SQUARES } else { &STRIPS };
        for (k, places) in order[..group.len().div_ceil(PACKET_RAYS)].iter().enumerate() {
            // The next group's rays: in squares they come in no order that a hardware prefetcher would follow.
            prefetch_packet(rays.as_ptr().wrapping_add((i + 1) * GROUP + k * PACKET_RAYS));
            // Packets of an earlier sub-stream are overwritten. At most one packet per octant is added.
            if packets.len() < set.len + 8 {
                packets.resize(2 * packets.len() + 8, Packet::VACANT);
            }
            let packet = &mut packets[set.len];
            packet.rays = from_index(|k| (i * GROUP) as u32 + places[k].min(group.len() as u32 - 1));
            packet.primitive = [MISS; PACKET_RAYS];
            let count = group.len() - places[0] as usize;
            let offsets: [u32; PACKET_RAYS] = from_index(|k| packet.rays[k] * size_of::<Ray>() as u32);
            let (mut valid, mut signs) = (0, [0; 3]);
            for part in 0..PACKET_RAYS / W::LANES {
                let at = part * W::LANES;
                // SAFETY: invariant 1.
                let ray = unsafe { w.rows(rays.as_ptr().cast(), offsets.as_ptr().add(at)) };
                let among = first_lanes::<W>(count.saturating_sub(at));
                let row = row_columns(w, scene_max_abs, among, ray);
                let RowColumns { columns, valid: may_hit, negative } = row;
                let mut at_origin = may_hit;
                for axis in 0..3 {
                    at_origin = w.eq(at_origin, ray[axis], w.splat(point[axis]));
                    signs[axis] |= negative[axis] << at;
                    packet.inverse[axis].set(w, at, columns[axis]);
                    packet.direction[axis].set(w, at, ray[4 + axis]);
                }
                if may_hit != at_origin {
                    return None;
                }
                packet.t_min.set(w, at, w.max(ray[3], w.splat(0.0)));
                packet.limit.set(w, at, columns[7]);
                valid |= may_hit << at;
                if may_hit != 0 {
                    let lane = may_hit.trailing_zeros() as usize % PACKET_RAYS;
                    set.origin.slack = spill(w, columns[6])[lane];
                }
            }
            while valid != 0 {
                let lane = valid.trailing_zeros();
                let (mut same_octant, mut octant) = (valid, 0);
                for (axis, &negative) in signs.iter().enumerate() {
                    let is_negative = negative >> lane & 1;
                    same_octant &= if is_negative == 1 { negative } else { !negative };
                    octant |= (is_negative as usize) << axis;
                }
                valid &= !same_octant;
                if valid != 0 {
                    packets[set.len + 1] = packets[set.len];
                }
                spread += packets[set.len].restrict(w, same_octant, octant);
                stacks[octant].arena[set.counts[octant]] = PacketEntry::new(set.len, same_octant).bits();
                set.counts[octant] += 1;
                set.len += 1;
            }
        }
        // The first groups already tell whether packets are worth it.
        if i % 4 == 1 && spread > MAX_SPREAD * set.len as f32 {
            return None;
        }
    }
    (spread <= MAX_SPREAD * set.len as f32).then_some(set)
}

/// Prefetches as many consecutive rays as a packet has.
#[inline(always)]
fn prefetch_packet(rays: *const Ray) {
    const PER_LINE: usize = 64 / size_of::<Ray>();
    for line in 0..PACKET_RAYS / PER_LINE {
        Prefetch::First.each([rays.wrapping_add(PER_LINE * line)]);
    }
}

/// The places in a group of the rays of each packet, if packets are consecutive rays.
const STRIPS: [[u32; PACKET_RAYS]; PACKET_RAYS] = {
    let mut strips = [[0; PACKET_RAYS]; PACKET_RAYS];
    let mut ray = 0;
    while ray < GROUP {
        strips[ray / PACKET_RAYS][ray % PACKET_RAYS] = ray as u32;
        ray += 1;
    }
    strips
};

/// The places in a group of the rays of each packet, if the group has sixteen rows of sixteen rays and packets are
/// squares of four neighbours in each of four rows.
const SQUARES: [[u32; PACKET_RAYS]; PACKET_RAYS] = {
    let mut squares = [[0; PACKET_RAYS]; PACKET_RAYS];
    let mut ray = 0;
    while ray < GROUP {
        let (x, y) = (ray % PACKET_RAYS, ray / PACKET_RAYS);
        squares[y / 4 * 4 + x / 4][y % 4 * 4 + x % 4] = ray as u32;
        ray += 1;
    }
    squares
};

/// True if rays seem to lie in rows of sixteen, as the camera rays of a 16 × 16 pixel block with one sample per pixel
/// do: then the first ray of the next row is nearer than the last ray of the same row. Affects speed alone.
fn lies_in_rows(group: &[Ray]) -> bool {
    let difference = |a: usize, b: usize| {
        let along = |axis: usize| (group[a].direction[axis] - group[b].direction[axis]).abs();
        along(0) + along(1) + along(2)
    };
    group.len() == GROUP
        && [0, 8 * PACKET_RAYS]
            .iter()
            .all(|&row| difference(row, row + PACKET_RAYS) < difference(row, row + PACKET_RAYS - 1))
}

impl Packet {
    /// Restricts the packet to the lanes of `mask`, whose rays are of `octant`. Returns how much their directions
    /// differ, relative to their size.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn restrict<L: Lanes>(&mut self, l: L, mask: LaneBits, octant: usize) -> f32 {
        let (mut low, mut high) = ([f32::INFINITY; 3], [0.0f32; 3]);
        for part in 0..PACKET_RAYS / L::LANES {
            let at = part * L::LANES;
            let among = mask >> at & L::ALL;
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
        self.interval = Interval { low, high, limit: self.max_limit(l) };
        widest / longest
    }
}
