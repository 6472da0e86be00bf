//! The data of a packet, and the entries of lists of packets.
//!
//! Unsafe code for loading and storing columns. Invariant 1: lanes from `at` on are within a packet: `at + LANES` is at
//! most [`PACKET_RAYS`], which each access asserts in debug builds.
#![allow(unsafe_code, reason = "the invariants above")]

use super::super::interval::Interval;
use super::super::lane_math::LaneVec3;
use super::super::slabs::Slabs;
use super::super::substream::DONE;
use crate::lanes::{LaneBits, Lanes, MAX_LANES};
use crate::stream::MISS;

/// Rays of a packet: one widest vector, and the bits of half an entry.
pub const PACKET_RAYS: usize = MAX_LANES;

const _: () = assert!(PACKET_RAYS == 16);

/// One number per ray.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub struct Column(pub [f32; PACKET_RAYS]);

impl Column {
    const ZERO: Self = Self([0.0; PACKET_RAYS]);

    /// The numbers of the lanes from `at` on.
    #[inline(always)]
    pub fn get<L: Lanes>(&self, l: L, at: usize) -> L::F {
        debug_assert!(at + L::LANES <= PACKET_RAYS);
        // SAFETY: invariant 1.
        unsafe { l.load(self.0.as_ptr().add(at)) }
    }

    #[inline(always)]
    pub fn set<L: Lanes>(&mut self, l: L, at: usize, f: L::F) {
        debug_assert!(at + L::LANES <= PACKET_RAYS);
        // SAFETY: invariant 1.
        unsafe { l.store(self.0.as_mut_ptr().add(at), f) }
    }
}

/// Up to sixteen rays of one octant, and their hits so far.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub struct Packet {
    pub inverse: [Column; 3],
    pub direction: [Column; 3],
    pub t_min: Column,
    /// The nearest hit so far, at first `t_max`; negative in lanes that are done or vacant.
    pub limit: Column,
    pub u: Column,
    pub v: Column,
    pub primitive: [u32; PACKET_RAYS],
    /// The indices of the rays in their sub-stream.
    pub rays: [u32; PACKET_RAYS],
    pub interval: Interval,
}

impl Packet {
    pub const VACANT: Self = Self {
        inverse: [Column::ZERO; 3],
        direction: [Column::ZERO; 3],
        t_min: Column::ZERO,
        limit: Column([DONE; PACKET_RAYS]),
        u: Column::ZERO,
        v: Column::ZERO,
        primitive: [MISS; PACKET_RAYS],
        rays: [0; PACKET_RAYS],
        interval: Interval { low: [0.0; 3], high: [0.0; 3], limit: DONE },
    };

    #[inline(always)]
    pub fn direction<L: Lanes>(&self, l: L, at: usize) -> LaneVec3<L> {
        [self.direction[0].get(l, at), self.direction[1].get(l, at), self.direction[2].get(l, at)]
    }

    #[inline(always)]
    pub fn inverse<L: Lanes>(&self, l: L, at: usize) -> LaneVec3<L> {
        [self.inverse[0].get(l, at), self.inverse[1].get(l, at), self.inverse[2].get(l, at)]
    }

    #[inline(always)]
    pub fn max_limit<L: Lanes>(&self, l: L) -> f32 {
        let mut max = DONE;
        for part in 0..PACKET_RAYS / L::LANES {
            max = max.max(l.highest(self.limit.get(l, part * L::LANES)));
        }
        max
    }

    /// Sets the primitive ids of the lanes of `mask` from `at` on.
    #[inline(always)]
    pub fn set_primitive<L: Lanes>(&mut self, l: L, at: usize, mask: LaneBits, primitive: u32) {
        debug_assert!(at + L::LANES <= PACKET_RAYS);
        // SAFETY: invariant 1.
        unsafe {
            let to = self.primitive.as_mut_ptr().add(at);
            l.store_u32(to, l.select_u32(mask, l.splat_u32(primitive), l.load_u32(to)));
        }
    }
}

/// The common origin of the rays of a sub-stream.
#[derive(Clone, Copy)]
pub struct Origin {
    pub point: [f32; 3],
    /// The slack of all rays: it depends on the origin alone.
    pub slack: f32,
}

impl Origin {
    /// The slab test's constants of rays, computed from their inverse directions: that is faster than to load them.
    #[inline(always)]
    pub fn slabs<L: Lanes>(&self, l: L, inverse: LaneVec3<L>) -> Slabs<L> {
        let [x, y, z] = self.point;
        let shift =
            [l.mul(l.splat(-x), inverse[0]), l.mul(l.splat(-y), inverse[1]), l.mul(l.splat(-z), inverse[2])];
        Slabs::new(l, inverse, shift, l.splat(self.slack))
    }
}

/// An element of a list of packets: the index of a packet, and a mask of its rays that are still in play.
#[derive(Clone, Copy)]
pub struct PacketEntry(u32);

impl PacketEntry {
    #[inline(always)]
    pub fn new(packet: usize, mask: LaneBits) -> Self {
        Self((packet as u32) << 16 | mask)
    }

    /// From the bits that a list holds.
    #[inline(always)]
    pub fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    #[inline(always)]
    pub fn bits(self) -> u32 {
        self.0
    }

    #[inline(always)]
    pub fn packet(self) -> usize {
        (self.0 >> 16) as usize
    }

    #[inline(always)]
    pub fn mask(self) -> LaneBits {
        self.0 & 0xffff
    }

    /// The mask of the lanes from `at` on.
    #[inline(always)]
    pub fn lanes<L: Lanes>(self, at: usize) -> LaneBits {
        self.0 >> at & L::ALL
    }
}
