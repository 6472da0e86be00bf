//! Native BSDFs of finishes, as BSDFs of user code call them.

use super::outlined;
use super::principled::Principled;
use super::{MIN_ROUGHNESS, Smoothness};
use crate::lanes::{Lanes, Mask, Num, Vector};
use crate::scene::{Effects, Finish, Scattered};

/// The native BSDF of finishes without its mirrors: roughnesses below [`MIN_ROUGHNESS`] count as that. Normals, opacity
/// and emission are ignored. The x axis of the shading basis is the rougher direction.
#[derive(Clone, Copy, Debug)]
pub struct FinishBsdf<L: Lanes> {
    surface: Principled<L>,
    wo: Vector<L>,
    /// Lanes whose `wo` is a direction above the surface.
    seen: Mask<L>,
}

impl<L: Lanes> FinishBsdf<L> {
    /// The BSDFs of finishes seen from `wo`, which is outside of the body in the lanes of `outside`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn new(mut finish: Finish<L>, effects: &Effects, outside: Mask<L>, wo: Vector<L>) -> Self {
        let l = wo.lanes();
        finish.roughness = finish.roughness.clamp(MIN_ROUGHNESS, 1.0);
        finish.clearcoat_roughness = finish.clearcoat_roughness.clamp(MIN_ROUGHNESS, 1.0);
        let (finish, coat) = (&finish, &None);
        let task = outlined::Finished { finish, effects, coat, outside, smoothness: Smoothness::EXACT };
        let (wo, seen) = direction(wo);
        Self { surface: l.outlined(task), wo, seen: seen & wo.z.above(0.0) }
    }

    /// BSDF × |cosine|, and the density of [`FinishBsdf::sample`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn evaluate(&self, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        let (wi, there) = direction(wi);
        let Self { surface, wo, seen } = self;
        let (value, pdf) = wi.lanes().outlined(outlined::Evaluate { surface, wo: *wo, wi });
        let there = there & *seen;
        (value.only(there), pdf.only(there))
    }

    /// Samples directions; `u` chooses a lobe, `u2` the direction. Where no direction is found it is 0, for which
    /// [`FinishBsdf::evaluate`] returns 0.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn sample(&self, u: Num<L>, [x, y]: [Num<L>; 2]) -> Scattered<L> {
        let Self { surface, wo, seen } = self;
        let [u, x, y] = [u.clamp(0.0, 1.0), x.clamp(0.0, 1.0), y.clamp(0.0, 1.0)];
        let sample = u.lanes().outlined(outlined::Sampling { surface, wo: *wo, u, u2: [x, y] });
        let there = sample.valid & *seen & !sample.specular;
        Scattered {
            wi: sample.wi.only(there),
            weight: sample.weight.only(there),
            pdf: sample.pdf.only(there),
        }
    }
}

/// Directions of user code with components of -1 to 1, and the lanes in which they have a length. The others are +z.
#[cfg_attr(not(unoptimised), inline(always))]
fn direction<L: Lanes>(given: Vector<L>) -> (Vector<L>, Mask<L>) {
    let l = given.lanes();
    let up = Vector::new(Num::zero(l), Num::zero(l), Num::splat(l, 1.0));
    let there = given.dot(given).above(0.0);
    (Vector::select(there, given.clamp(-1.0, 1.0), up), there)
}
