//! What rays that follow each other have in common, and which boxes none of them enters (Haines and Wallace 1991,
//! *Shaft Culling for Efficient Ray-Traced Radiosity*).

use super::interval::{Interval, Planes};
use super::split_substreams::MOST;
use super::substream::ROW_BYTES;
use super::triangle::{Faces, Vector};
use crate::lanes::{Lanes, each, splat, zip};

/// Rays of a sub-stream that share a shaft.
pub(super) const RAYS: usize = 512;

/// The shafts of a sub-stream.
pub(super) type Shafts = [Shaft; MOST / RAYS];

/// A list is tested with shafts first if it has so many rays for each shaft that it has rays of. Shorter ones cost no more than
/// the shafts.
const WORTH: usize = 32;

/// The extremes of some rays, of whatever octants.
#[derive(Clone, Copy, Default)]
pub(super) struct Shaft {
    /// Least and greatest coordinates of origins.
    origins: [[f32; 3]; 2],
    /// Least and greatest sizes of the inverse on each axis.
    inverses: [[f32; 3]; 2],
    /// Greatest `t_max`.
    limit: f32,
    /// Greatest slack.
    slack: f32,
}

impl Shaft {
    /// The slots whose box some ray of an octant may enter.
    #[inline(always)]
    fn entered<E: Lanes>(&self, e: E, faces: &Faces<'_>, octant: usize) -> u32 {
        let sign = |axis: usize| 1.0 - 2.0 * (octant >> axis & 1) as f32;
        let signed = |[x, y, z]: [f32; 3]| [sign(0) * x, sign(1) * y, sign(2) * z];
        let [low, high] = self.inverses;
        let interval = Interval { low: signed(low), high: signed(high), limit: self.limit };
        Planes::new(e, self.origins, self.slack, faces, octant).entered(e, &interval)
    }
}

/// A shaft that grows, in lanes.
pub(super) struct Growing<L: Lanes> {
    origins: [Vector<L>; 2],
    inverses: [Vector<L>; 2],
    limit: L::F,
    slack: L::F,
}

impl<L: Lanes> Growing<L> {
    /// Of no rays.
    #[inline(always)]
    pub fn new(l: L) -> Self {
        let (least, greatest) = (splat(l, [f32::INFINITY; 3]), splat(l, [f32::NEG_INFINITY; 3]));
        let zero = l.splat(0.0);
        Self { origins: [least, greatest], inverses: [least, [zero; 3]], limit: zero, slack: zero }
    }

    /// Takes in the rays of `among`, of which these are origins and rows.
    #[inline(always)]
    pub fn add(&mut self, l: L, among: u32, origin: Vector<L>, row: [L::F; 8]) {
        let [ix, iy, iz, _, _, _, slack, limit] = row;
        let size = each([ix, iy, iz], |inverse| l.abs(inverse));
        let least = |x, least| l.select(among, l.min(x, least), least);
        let greatest = |x, greatest| l.select(among, l.max(x, greatest), greatest);
        self.origins = [zip(origin, self.origins[0], least), zip(origin, self.origins[1], greatest)];
        self.inverses = [zip(size, self.inverses[0], least), zip(size, self.inverses[1], greatest)];
        self.limit = greatest(limit, self.limit);
        self.slack = greatest(slack, self.slack);
    }

    /// The shaft of all.
    #[inline(always)]
    pub fn done(&self, l: L) -> Shaft {
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

/// The slots of a node whose boxes rays of a list may enter.
pub(super) struct Entered {
    /// By shaft.
    slots: [u8; MOST / RAYS],
    /// How far boxes are to be moved apart so that rays can do without slack: the greatest slack and an eighth, which is more than
    /// what moving them and the rays' constants are rounded by, two half ulps of the largest coordinate.
    pub apart: f32,
}

impl Entered {
    /// For a list of `len` rays from `first` to `last`, if it is worth while.
    #[inline(always)]
    pub fn of<E: Lanes>(
        e: E,
        shafts: &Shafts,
        [first, last]: [u32; 2],
        len: usize,
        faces: &Faces<'_>,
        octant: usize,
    ) -> Option<Self> {
        let (first, last) = (shaft_of(first), shaft_of(last));
        if len < WORTH * (last - first + 1) {
            return None;
        }
        let mut slots = [0; MOST / RAYS];
        let mut slack = 0.0f32;
        for at in first..=last {
            slots[at] = shafts[at].entered(e, faces, octant) as u8;
            slack = slack.max(shafts[at].slack);
        }
        Some(Self { slots, apart: 1.125 * slack })
    }

    /// Those for rays from `first` to `last`.
    #[inline(always)]
    pub fn between(&self, first: u32, last: u32) -> u32 {
        let (first, last) = (shaft_of(first), shaft_of(last));
        let mut slots = self.slots[first];
        for at in first + 1..=last {
            slots |= self.slots[at];
        }
        slots.into()
    }
}

/// Which shaft a ray is of.
#[inline(always)]
fn shaft_of(id: u32) -> usize {
    id as usize / (RAYS * ROW_BYTES) % (MOST / RAYS)
}
