//! Rays in Embree's layouts, and their tracing.
//!
//! Unsafe code for calling Embree. Invariant:
//! 1. Rays, packets and masks of lanes are aligned as Embree requires, by their types. A scene is committed and its
//!    device and library live.
#![allow(unsafe_code, reason = "calls a foreign library; the invariant above")]

use super::EmbreeScene;
use super::api::{Arguments, PACKET, QUERY_COHERENT, RayHit, RayHit16, Valid};
use raystream::stream::{Hit, MISS, Ray};
use std::ffi::c_uint;
use std::ptr;

/// Form in which rays are passed to Embree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// One at a time.
    Single,
    /// Sixteen at a time.
    Packet,
    /// Sixteen at a time, flagged as coherent.
    CoherentPacket,
}

impl Mode {
    /// All modes.
    pub const ALL: [Self; 3] = [Self::Single, Self::Packet, Self::CoherentPacket];

    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Single => "single",
            Self::Packet => "packet",
            Self::CoherentPacket => "coherent packet",
        }
    }
}

/// Rays in the layout of a mode; after tracing, their hits.
#[derive(Debug, Clone)]
pub struct EmbreeRays {
    mode: Mode,
    one: Vec<RayHit>,
    sixteen: Vec<RayHit16>,
    len: usize,
}

impl EmbreeRays {
    /// Converts rays.
    pub fn new(rays: &[Ray], mode: Mode) -> Self {
        let mut this = Self { mode, one: Vec::new(), sixteen: Vec::new(), len: 0 };
        this.set(rays);
        this
    }

    /// Converts rays into the same memory. Embree changes rays as it traces, so each round needs fresh ones.
    pub fn set(&mut self, rays: &[Ray]) {
        self.len = rays.len();
        self.one.clear();
        self.sixteen.clear();
        match self.mode {
            Mode::Single => self.one.extend(rays.iter().map(RayHit::new)),
            Mode::Packet | Mode::CoherentPacket => {
                self.sixteen.extend(rays.chunks(PACKET).map(RayHit16::new));
            }
        }
    }

    /// True if an any-hit query found the ray occluded.
    pub fn is_occluded(&self, ray: usize) -> bool {
        let t_far = match self.mode {
            Mode::Single => self.one[ray].t_far,
            Mode::Packet | Mode::CoherentPacket => self.sixteen[ray / PACKET].t_far[ray % PACKET],
        };
        t_far == f32::NEG_INFINITY
    }

    /// Number of rays.
    pub fn len(&self) -> usize {
        self.len
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }
}

impl EmbreeScene<'_> {
    /// Traces the rays on the calling thread: closest hits, or any hit.
    pub fn trace(&self, rays: &mut EmbreeRays, any: bool) {
        let f = self.functions();
        let coherent = rays.mode == Mode::CoherentPacket;
        let mut arguments = Arguments {
            flags: if coherent { QUERY_COHERENT } else { 0 },
            features: c_uint::MAX,
            context: ptr::null_mut(),
            filter: ptr::null_mut(),
            intersect: ptr::null_mut(),
            min_width: 0.0,
        };
        let (one, sixteen) =
            if any { (f.occluded_one, f.occluded_sixteen) } else { (f.intersect_one, f.intersect_sixteen) };
        let valid = Valid([-1; PACKET]);
        for ray in &mut rays.one {
            // SAFETY: invariant 1.
            unsafe { one(self.handle(), ray, &mut arguments) };
        }
        for packet in &mut rays.sixteen {
            // SAFETY: invariant 1.
            unsafe { sixteen(valid.0.as_ptr(), self.handle(), packet, &mut arguments) };
        }
    }

    /// The hit of a traced ray, or [`Hit::NONE`].
    pub fn hit(&self, rays: &EmbreeRays, ray: usize) -> Hit {
        let (t, u, v, geometry, primitive) = match rays.mode {
            Mode::Single => {
                let r = &rays.one[ray];
                (r.t_far, r.u, r.v, r.geometry, r.primitive)
            }
            Mode::Packet | Mode::CoherentPacket => {
                let (p, lane) = (&rays.sixteen[ray / PACKET], ray % PACKET);
                (p.t_far[lane], p.u[lane], p.v[lane], p.geometry[lane], p.primitive[lane])
            }
        };
        if primitive == MISS {
            return Hit::NONE;
        }
        Hit { t, u, v, primitive: self.primitive(geometry, primitive) }
    }
}
