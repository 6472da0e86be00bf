//! Hits beside those of Embree's robust mode.

use super::{Kind, Workload};
use crate::embree::{EmbreeRays, EmbreeScene, Mode};
use raystream::stream::{Hit, Tracer};
use serde::Serialize;

/// Relative difference of `t` from which two hits count as different.
const SAME_T: f32 = 1e-4;

/// The most rays that are listed.
const EXAMPLES: usize = 16;

/// Agreement of raystream's hits with those of Embree's robust mode. With an alpha test, the two may look up
/// different texels where `u` and `v` differ in their last bits.
#[derive(Clone, Debug, Serialize)]
pub struct Agreement {
    /// The kind of ray.
    pub kind: Kind,
    /// Number of rays.
    pub rays: usize,
    /// Rays that hit something with one of the two and nothing with the other.
    pub hit_or_miss: usize,
    /// Rays that hit with both, with values of `t` that differ by more than a part in 10⁴.
    pub distance: usize,
    /// Largest relative difference of `t` among the other hits.
    pub largest_t_difference: f32,
    /// The first rays that disagree, by their places in the kind's first order.
    pub examples: Vec<usize>,
}

/// Compares the hits of all rays of a kind.
pub fn compare(tracer: &dyn Tracer, robust: &EmbreeScene<'_>, workload: &Workload, kind: Kind) -> Agreement {
    let rays = workload.rays(kind, kind.orders()[0]);
    let mut theirs = EmbreeRays::new(&rays, Mode::Packet);
    robust.trace(&mut theirs, kind.is_any_hit());
    let mut result = Agreement {
        kind,
        rays: rays.len(),
        hit_or_miss: 0,
        distance: 0,
        largest_t_difference: 0.0,
        examples: Vec::new(),
    };
    let (mut hits, mut occluded) = (vec![Hit::NONE; rays.len()], vec![0; rays.len()]);
    if kind.is_any_hit() {
        tracer.occluded(&rays, &mut occluded);
    } else {
        tracer.closest(&rays, &mut hits);
    }
    for i in 0..rays.len() {
        let differs = if kind.is_any_hit() {
            let differs = (occluded[i] == 1) != theirs.is_occluded(i);
            result.hit_or_miss += usize::from(differs);
            differs
        } else {
            result.add(hits[i], robust.hit(&theirs, i))
        };
        if differs && result.examples.len() < EXAMPLES {
            result.examples.push(i);
        }
    }
    result
}

impl Agreement {
    /// Counts a pair of hits; says whether they differ.
    fn add(&mut self, ours: Hit, theirs: Hit) -> bool {
        if ours.is_miss() || theirs.is_miss() {
            let differs = ours.is_miss() != theirs.is_miss();
            self.hit_or_miss += usize::from(differs);
            return differs;
        }
        let difference = (ours.t - theirs.t).abs() / ours.t.abs().max(theirs.t.abs()).max(f32::MIN_POSITIVE);
        let differs = difference > SAME_T;
        self.distance += usize::from(differs);
        if !differs {
            self.largest_t_difference = self.largest_t_difference.max(difference);
        }
        differs
    }
}
