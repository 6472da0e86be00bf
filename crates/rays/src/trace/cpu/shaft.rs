//! Shafts: bounds around consecutive rays of a sub-stream, which tell boxes that none of these rays can enter (Haines
//! and Wallace 1991, *Shaft Culling for Efficient Ray-Traced Radiosity*).
//!
//! Long lists of similar rays, such as soft shadow rays, skip most of a node's boxes that way.

use super::interval::{Interval, PlaneDistances};
use super::lane_math::LaneVec3;
use super::slabs::Faces;
use super::split_substreams::MAX_RAYS;
use crate::lanes::{LaneBits, Lanes, each, splat, zip};

/// Consecutive rays of a sub-stream that share a shaft, the last shaft excepted.
pub(super) const SHAFT_RAYS: usize = 512;

/// The shafts of a sub-stream: ray `i` belongs to shaft `i / SHAFT_RAYS`.
pub(super) type Shafts = [Shaft; MAX_RAYS / SHAFT_RAYS];

/// Shafts are used for lists that have at least this many rays per shaft that they touch. Testing the rays of shorter
/// lists costs no more than testing the shafts.
const MIN_RAYS_PER_SHAFT: usize = 32;

/// The extremes of some rays, of any octants.
#[derive(Clone, Copy, Default)]
pub(super) struct Shaft {
    /// Least and greatest coordinates of the origins.
    origins: [[f32; 3]; 2],
    /// Least and greatest absolute values of the inverse directions.
    inverses: [[f32; 3]; 2],
    /// Greatest `t_max`.
    limit: f32,
    /// Greatest slack.
    slack: f32,
}

impl Shaft {
    /// The slots whose box some ray of an octant may enter.
    #[inline(always)]
    fn slots_entered<E: Lanes>(&self, e: E, faces: &Faces<'_>, octant: usize) -> LaneBits {
        let sign = |axis: usize| 1.0 - 2.0 * (octant >> axis & 1) as f32;
        let signed = |[x, y, z]: [f32; 3]| [sign(0) * x, sign(1) * y, sign(2) * z];
        let [low, high] = self.inverses;
        let interval = Interval { low: signed(low), high: signed(high), limit: self.limit };
        PlaneDistances::new(e, self.origins, self.slack, faces, octant).slots_entered(e, &interval)
    }
}

/// Collects the extremes of rays, lane by lane.
pub(super) struct ShaftBuilder<L: Lanes> {
    origins: [LaneVec3<L>; 2],
    inverses: [LaneVec3<L>; 2],
    limit: L::F,
    slack: L::F,
}

impl<L: Lanes> ShaftBuilder<L> {
    /// A shaft of no rays.
    #[inline(always)]
    pub fn new(l: L) -> Self {
        let (least, greatest) = (splat(l, [f32::INFINITY; 3]), splat(l, [f32::NEG_INFINITY; 3]));
        let zero = l.splat(0.0);
        Self { origins: [least, greatest], inverses: [least, [zero; 3]], limit: zero, slack: zero }
    }

    /// Adds the rays in the lanes of `among`, with these origins and rows.
    #[inline(always)]
    pub fn add(&mut self, l: L, among: LaneBits, origin: LaneVec3<L>, row: [L::F; 8]) {
        let [ix, iy, iz, _, _, _, slack, limit] = row;
        let size = each([ix, iy, iz], |inverse| l.abs(inverse));
        let least = |x, least| l.select(among, l.min(x, least), least);
        let greatest = |x, greatest| l.select(among, l.max(x, greatest), greatest);
        self.origins = [zip(origin, self.origins[0], least), zip(origin, self.origins[1], greatest)];
        self.inverses = [zip(size, self.inverses[0], least), zip(size, self.inverses[1], greatest)];
        self.limit = greatest(limit, self.limit);
        self.slack = greatest(slack, self.slack);
    }

    /// The shaft around all rays that were added.
    #[inline(always)]
    pub fn finish(&self, l: L) -> Shaft {
        let least = |x| each(x, |x| l.lowest(x));
        let greatest = |x| each(x, |x| l.highest(x));
        Shaft {
            origins: [least(self.origins[0]), greatest(self.origins[1])],
            inverses: [least(self.inverses[0]), greatest(self.inverses[1])],
            limit: l.highest(self.limit),
            slack: l.highest(self.slack),
        }
    }
}

/// The slots of a node that rays of a list may enter, by shaft.
pub(super) struct ShaftSlots {
    /// By shaft; meaningful for the shafts that the list touches.
    slots: [u8; MAX_RAYS / SHAFT_RAYS],
    /// Distance by which boxes are widened so that rays can be tested without slack: the greatest slack and an eighth
    /// of it. The eighth exceeds the rounding errors of widened boxes and of the rays' constants, two half ulps of the
    /// largest coordinate.
    pub widening: f32,
}

impl ShaftSlots {
    /// For a list of `len` rays with indices from `first` to `last`; `None` if the list is too short.
    #[inline(always)]
    pub fn new<E: Lanes>(
        e: E,
        shafts: &Shafts,
        first: usize,
        last: usize,
        len: usize,
        faces: &Faces<'_>,
        octant: usize,
    ) -> Option<Self> {
        let (first, last) = (shaft_of(first), shaft_of(last));
        if len < MIN_RAYS_PER_SHAFT * (last - first + 1) {
            return None;
        }
        let mut slots = [0; MAX_RAYS / SHAFT_RAYS];
        let mut slack = 0.0f32;
        for at in first..=last {
            slots[at] = shafts[at].slots_entered(e, faces, octant) as u8;
            slack = slack.max(shafts[at].slack);
        }
        Some(Self { slots, widening: 1.125 * slack })
    }

    /// The slots that rays with indices from `first` to `last` may enter.
    #[inline(always)]
    pub fn of_rays(&self, first: usize, last: usize) -> LaneBits {
        let (first, last) = (shaft_of(first), shaft_of(last));
        let mut slots = self.slots[first];
        for at in first + 1..=last {
            slots |= self.slots[at];
        }
        slots.into()
    }
}

/// The shaft that a ray belongs to, by the ray's index.
#[inline(always)]
fn shaft_of(index: usize) -> usize {
    index / SHAFT_RAYS % (MAX_RAYS / SHAFT_RAYS)
}
