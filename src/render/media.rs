//! Paths inside of media that scatter light.
//!
//! A ray inside of a body knows its medium when it hits the body's surface from inside. A random number then decides
//! whether light was scattered on the way. If so, the path goes on from there as if it had not met the surface. No
//! light is sampled inside of a medium, because shadow rays do not pass the surface around it: light comes in by the
//! paths that leave.
//!
//! Scatterings are no bounces. They splat nothing, so a film's bound on splats is the same with them.

use super::path_state::States;
use super::path_tracer::survival;
use super::{Contribution, NewRays, PathState};
use crate::geom::{Basis, Sampler};
use crate::lanes::{Int, Lanes, Mask, Num, OutlinedTask, Vector, exponential, trigonometry};
use crate::scene::Medium;
use crate::schedule::Output;
use std::f32::consts::{FRAC_1_PI, LN_2};

/// The most scatterings between two hits of surfaces. A path that is scattered once more ends.
pub(super) const MOST_SCATTERINGS: u32 = 1 << 10;

/// The bits of the density that scattered rays have, to which the number of scatterings since the last surface is
/// added: no sampled density is as large, and those that count passed surfaces are larger. Light sampling could not
/// have found what such a ray finds.
const DENSITY: u32 = 0x7f00_0000;

/// The first sampler dimension of scatterings. Depths begin below it.
const FIRST_DIMENSION: u32 = 1 << 24;

/// Dimensions of each scattering, or of the decision that there is none.
const DIMENSIONS: u32 = 2;

/// The greatest anisotropy. Beyond, directions are lost in rounding.
const MOST_ANISOTROPY: f32 = 0.999;

/// The least anisotropy that is told from none.
const LEAST_ANISOTROPY: f32 = 1e-3;

/// Rays that reach a surface from inside of a medium, or are scattered before. Out of line: few media scatter.
pub(super) struct Walking<'a, 'o, L: Lanes> {
    pub out: &'a mut Output<'o, PathState, Contribution>,
    pub sampler: Sampler<L>,
    pub medium: &'a Medium,
    pub origin: Vector<L>,
    pub direction: Vector<L>,
    /// Distance of the surface.
    pub t: Num<L>,
    pub state: States<L>,
    /// The rays that are inside of the medium.
    pub lanes: Mask<L>,
    /// Bounces and scatterings after which Russian roulette may end a path, if it may.
    pub roulette: Option<u32>,
}

/// The number of scatterings since the last surface.
#[inline(always)]
fn scatterings<L: Lanes>(pdf: Num<L>) -> Int<L> {
    let count = pdf.to_bits() + DENSITY.wrapping_neg();
    Int::select(count.below(MOST_SCATTERINGS + 1), count, Int::splat(pdf.lanes(), 0))
}

/// The cosine by which Henyey and Greenstein deflect light, and the density of such a direction per solid angle.
#[cfg_attr(not(unoptimised), inline(always))]
fn deflected<L: Lanes>(anisotropy: f32, u: Num<L>) -> [Num<L>; 2] {
    let g = anisotropy.clamp(-MOST_ANISOTROPY, MOST_ANISOTROPY);
    if g.abs() < LEAST_ANISOTROPY {
        return [1.0 - u * 2.0, Num::splat(u.lanes(), 0.25 * FRAC_1_PI)];
    }
    let rest = 1.0 - g * g;
    let root = Num::splat(u.lanes(), rest) / (u * (2.0 * g) + (1.0 - g));
    let cosine = ((1.0 + g * g) - root * root) * (0.5 / g);
    [cosine.clamp(-1.0, 1.0), Num::splat(u.lanes(), 0.25 * FRAC_1_PI * rest) / (root * root * root)]
}

impl<L: Lanes> OutlinedTask<L> for Walking<'_, '_, L> {
    /// The lanes that do not reach the surface, and the throughputs of the others.
    type Output = (Mask<L>, Vector<L>);

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) -> (Mask<L>, Vector<L>) {
        let Self { out, sampler, medium, origin, direction, t, state, lanes, roulette } = self;
        let count = scatterings(state.pdf);
        let dimension = (state.depth * (MOST_SCATTERINGS + 1) + count) * DIMENSIONS + FIRST_DIMENSION;
        let [u, v] = sampler.two(dimension);
        // The distance is that of one channel, in proportion to what the path carries. Its weight counts all of them.
        let share = state.throughput / state.throughput.element_sum();
        let extinction = Vector::splat(l, medium.absorption + medium.scattering);
        let Vector { x: red, y: green, z: blue } = extinction;
        let chosen = Num::select(u.lt(share.x + share.y), green, blue);
        let chosen = Num::select(u.lt(share.x), red, chosen);
        let distance = exponential::log2(1.0 - v) * -LN_2 / chosen;
        let scattered = lanes & distance.lt(t);
        let way = Num::select(scattered, distance, t);
        let left = Vector::new(
            exponential::exp(-(way * red)),
            exponential::exp(-(way * green)),
            exponential::exp(-(way * blue)),
        );
        let met = left * extinction;
        let density = share.dot(Vector::select(scattered, met, left));
        let kept = Vector::select(scattered, left * Vector::splat(l, medium.scattering), left);
        let throughput = Vector::select(lanes, state.throughput * (kept / density), state.throughput);

        let mut goes = scattered & count.below(MOST_SCATTERINGS) & !throughput.is_zero();
        let mut carried = throughput;
        if let Some(bounces) = roulette {
            let played = goes & !(state.depth + count).below(bounces);
            if played.any() {
                let survival = survival(throughput, state.index2);
                goes &= !(played & !sampler.one(dimension).lt(survival));
                carried = Vector::select(played, throughput * (1.0 / survival), throughput);
            }
        }
        let [u, v] = sampler.two(dimension + 1);
        let [cosine, pdf] = deflected(medium.anisotropy, u);
        let sine = (1.0 - cosine * cosine).clamp(0.0, 1.0).sqrt();
        let (y, x) = trigonometry::sin_cos_turns(v);
        let turned = Basis::around(direction).world(Vector::new(x * sine, y * sine, cosine)).normalize();
        // A camera inside of a medium has no second camera ray: the first scattering is a bounce.
        let depth = Int::select(state.depth.is(0), Int::splat(l, 1), state.depth);
        let zero = Int::splat(l, 0);
        let next = States {
            throughput: carried,
            cone: state.cone.at(distance).scattered(pdf),
            seeks: zero,
            facing: zero,
            depth,
            pdf: (count + (DENSITY + 1)).to_num_bits(),
            ..state
        };
        let states = next.rows(goes);
        let rays = NewRays::new(origin + direction * distance, turned);
        rays.emit(out, goes, bytemuck::cast_slice(states.as_ref()));
        (scattered, throughput)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::path_tracer::MAX_BOUNCES;

    #[test]
    fn every_scattering_of_a_path_has_dimensions_of_its_own() {
        let last = (u64::from(MAX_BOUNCES) + 2) * u64::from(MOST_SCATTERINGS + 1) * u64::from(DIMENSIONS);
        // Dimensions from 2³¹ − 1 on are those of dispersion and of passed surfaces.
        assert!(u64::from(FIRST_DIMENSION) + last < (1 << 31) - 1);
        assert!(u64::from(MAX_BOUNCES) * 8 < u64::from(FIRST_DIMENSION));
    }

    #[test]
    fn densities_count_scatterings_and_are_told_from_sampled_ones() {
        for pdf in [0.0, 0.3, 1e30, f32::MAX, f32::INFINITY] {
            assert_eq!(scatterings(Num::from(pdf)).get(), 0, "{pdf}");
        }
        for count in [1, 7, MOST_SCATTERINGS] {
            assert_eq!(scatterings(Num::from(f32::from_bits(DENSITY + count))).get(), count);
        }
    }

    #[test]
    fn deflections_have_the_anisotropy_as_their_mean_cosine() {
        for g in [-0.95, -0.8, -0.3, 0.0, 5e-4, 2e-3, 0.5, 0.9] {
            let (mut cosines, mut inverse) = (0.0, 0.0);
            let count = 1 << 16;
            for i in 0..count {
                let [cosine, pdf] = deflected(g, Num::from((i as f32 + 0.5) / count as f32));
                cosines += f64::from(cosine.get());
                let (g, cosine) =
                    (f64::from(g.clamp(-MOST_ANISOTROPY, MOST_ANISOTROPY)), f64::from(cosine.get()));
                let root = (1.0 + g * g - 2.0 * g * cosine).sqrt();
                let expected = (1.0 - g * g) / (root * root * root) * 0.25 / std::f64::consts::PI;
                inverse += (f64::from(pdf.get()) / expected - 1.0).abs();
            }
            let (mean, off) = (cosines / f64::from(count), inverse / f64::from(count));
            assert!((mean - f64::from(g)).abs() < 2e-3 && off < 0.01, "{g}: {mean}, {off}");
        }
    }
}
