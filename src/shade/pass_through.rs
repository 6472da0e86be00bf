//! Rays that pass surfaces of computed opacity.
//!
//! A random number decides at the hit whether a ray meets the surface. A ray that passes continues with its throughput,
//! and its path counts no bounce. Shadow rays take such surfaces as opaque, because opacity is known only where hits
//! are shaded. A ray that has passed is therefore treated like a mirrored one: light sampling could not have found what
//! it finds, so what it finds has its full weight. Together both are unbiased for lights that rays can hit. To punctual
//! lights some paths go on as if the light were what they look for.

use crate::geom::{Sampler, mix_lanes};
use crate::lanes::{Int, Lanes, Mask, Num};

/// The most surfaces that a ray passes in a row. The next one is opaque.
pub const MOST_PASSED: u32 = 255;

/// The bits of an infinite density. The densities just below count the surfaces that a ray has passed. No sampled
/// density is as large.
const INFINITE: u32 = f32::INFINITY.to_bits();

/// The first sampler dimension of passing. The dimensions below belong to integrators.
const FIRST_DIMENSION: u32 = 1 << 31;

/// Tells the dimension of following light from those of passing.
const OF_LIGHT: u32 = 0x5bd1_e995;

/// Lanes whose rays pass surfaces of this opacity. `depth` distinguishes the hits of one path on one triangle.
#[cfg_attr(not(unoptimised), inline(always))]
pub fn passes<L: Lanes>(opacity: Num<L>, sampler: &Sampler<L>, depth: Int<L>, primitive: Int<L>) -> Mask<L> {
    // A ray passes a triangle once, so triangle and depth name the decision. The samples of a pixel that see the same
    // triangle share a dimension, and their numbers are stratified.
    let dimension = mix_lanes(primitive ^ mix_lanes(depth)) | FIRST_DIMENSION;
    !sampler.one(dimension).lt(opacity)
}

/// Lanes whose paths follow the light that they have sampled, with this probability.
#[cfg_attr(not(unoptimised), inline(always))]
pub fn follows_light<L: Lanes>(share: Num<L>, sampler: &Sampler<L>, depth: Int<L>) -> Mask<L> {
    let dimension = mix_lanes(depth ^ OF_LIGHT) | FIRST_DIMENSION;
    sampler.one(dimension).lt(share)
}

/// The density to store with rays of density `pdf` that pass another surface, and the lanes that may pass one.
#[cfg_attr(not(unoptimised), inline(always))]
pub fn passed<L: Lanes>(pdf: Num<L>) -> (Num<L>, Mask<L>) {
    let count = (pdf.to_bits() ^ u32::MAX) + INFINITE.wrapping_add(1);
    let is_count = count.below(MOST_PASSED + 1);
    let count = Int::select(is_count, count, Int::splat(pdf.lanes(), 0));
    (((count ^ u32::MAX) + INFINITE).to_num_bits(), count.below(MOST_PASSED))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passed_surfaces_are_counted_up_to_the_most() {
        for first in [0.0, 0.3, 1e6, 1e30, f32::INFINITY] {
            let (mut pdf, mut count) = (Num::from(first), 0);
            loop {
                let (next, may) = passed(pdf);
                if !may.get() {
                    break;
                }
                assert!(next.get() > 3.4e38 && next.get() < f32::INFINITY, "{} after {count}", next.get());
                (pdf, count) = (next, count + 1);
            }
            assert_eq!(count, MOST_PASSED, "from {first}");
        }
    }

    #[test]
    fn rays_pass_as_often_as_the_opacity_says() {
        for opacity in [0.0, 0.25, 0.8, 1.0] {
            let passes = (0..4096u32).filter(|&i| {
                let sampler = Sampler::new(i / 64, i % 64, 0);
                passes(Num::from(opacity), &sampler, 0.into(), (i % 3).into()).get()
            });
            let share = passes.count() as f32 / 4096.0;
            assert!((share - (1.0 - opacity)).abs() < 0.02, "{share} for {opacity}");
        }
    }
}
